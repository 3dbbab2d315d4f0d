"""What a person may set of the denoiser, under the denoiser's own name; the record stands below, where ``FitOptions`` holds it."""

from tinygc.methods.denoise_options import LOSSES, DenoiseOptions

__all__ = ["LOSSES", "DenoiseOptions"]
