"""An explanation as one page of pictures (matplotlib, imported on use)."""
