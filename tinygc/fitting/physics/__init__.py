"""The named physics in the model: fitted, saved, undone."""
