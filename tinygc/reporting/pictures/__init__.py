"""The explanation as one page of pictures (matplotlib, imported where it draws)."""
