"""The closure residual: integrated rate against the reference attitude; its noise floor and its linear solution."""

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
