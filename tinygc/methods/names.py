"""The names of the methods."""

from __future__ import annotations

METHODS = ("raw", "raw_bias_removed", "least_squares", "pso", "tinygc", "tinygc_denoised")


PARAMETERS = {"raw": 0, "raw_bias_removed": 3, "least_squares": 12, "pso": 12}


LOSSES = ("squared", "distance")
