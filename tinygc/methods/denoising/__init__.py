"""The denoising subnet: what it is, what it learns from, how it is trained, its file."""
