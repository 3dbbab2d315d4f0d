"""The closure residual: how far the integrated rate misses the attitude that the reference saw; its floor, its linear solution."""

from tinygc.closure.residual import (
    Batch,
    attitudes,
    batch_residual,
    directions,
    end_and_sensitivity,
    end_attitude,
    error_angles,
    like,
    nearest_yaw,
    parts,
    residual,
    segment_residuals,
    sensitivity,
    turned,
)

__all__ = [
    "Batch",
    "attitudes",
    "batch_residual",
    "directions",
    "end_and_sensitivity",
    "end_attitude",
    "error_angles",
    "like",
    "nearest_yaw",
    "parts",
    "residual",
    "segment_residuals",
    "sensitivity",
    "turned",
]
