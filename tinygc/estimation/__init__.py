"""The methods (raw, least squares, PSO, TinyGC-Net and its denoiser), the fit of a session, its files."""
