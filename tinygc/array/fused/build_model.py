"""An array's model from what a joint fit gives: weights with their reason, and how much the units differ beyond their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from session.common.errors import CalibrationError
from session.common.units import DEG
from session.files.results import write_whole
from tinygc.array.fused.agreement import disagreement
from tinygc.array.fused.model import INSTABILITY, WHITE, ArrayModel, Disagreement, FusedUnit, instability_covariance, white_covariance
from tinygc.array.fused.model_files import to_table
from tinygc.array.fused.weights import best_weights, combined, divisible
from tinygc.closure.allan import FLICKER_FLOOR

#: the weights are best at this averaging time: a turn takes seconds, and what a rate is integrated over is its attitude's error
AVERAGING_S = 3.0


def build_array_model(
    units: Sequence[FusedUnit],
    rate_hz: float,
    *,
    correlation: np.ndarray | None = None,
    joint_covariance: np.ndarray | None = None,
    measured: np.ndarray | None = None,
    averaging_s: float = AVERAGING_S,
    session: str = "",
) -> ArrayModel:
    """The model of units whose parameters, places and noise are known; rate_hz: samples a second of the array.

    correlation (3 N, 3 N): of the units' white noise in the array's frame, where it was measured; joint_covariance (12 N, 12 N) of the
    units' E and B, unit by unit; measured (T, N, 3) rad/s: what the units read at the same moments in the calibration, NaN where one
    has none: how much they differ beyond noise is learnt from it; averaging_s: what the weights are best for.
    Raises CalibrationError for fewer than two units, and for noise that no combination can be best for.
    """
    units = tuple(units)
    if len(units) < 2:
        raise CalibrationError(f"an array of {len(units)} unit, expected two or more")
    if len(set(numbers := [unit.number for unit in units])) < len(numbers):
        raise CalibrationError(f"units {', '.join(map(str, numbers))}: a number stands twice")
    remark = ""
    white = white_covariance(units, correlation)
    weights, fused = best_weights(white)
    if correlation is not None and not divisible(weights, fused):
        correlation, white = None, white_covariance(units)
        weights, fused = best_weights(white)
        remark = "; the noise's correlation is left out, since by it a unit would have a negative weight"
    wander = instability_covariance(units)
    best_for, reason = WHITE, "no bias instability of every unit is known, so the weights are best for white noise"
    if wander is not None:
        # Allan variances: white N^2 / tau with N^2 half the one-sided density; flicker the square of 0.664 B, at any tau (IEEE 952, C.1)
        slow, _ = best_weights(wander)
        by_white = np.trace(fused) / 2 / averaging_s
        by_wander = FLICKER_FLOOR**2 * np.trace(combined(weights, wander))
        best_for = WHITE if by_white >= by_wander else INSTABILITY
        parts = [np.sqrt(part / 3) / DEG for part in (by_white, by_wander)]
        words = {WHITE: "white noise", INSTABILITY: "bias instability"}[best_for]
        reason = f"over {averaging_s:g} s white noise leaves {parts[0]:.2g} dps, bias instability {parts[1]:.2g} dps: best for {words}"
        weights = weights if best_for == WHITE else slow
    model = ArrayModel(units, weights, float(rate_hz), best_for, reason + remark, correlation, Disagreement(), joint_covariance, session)
    return model if measured is None else replace(model, disagreement=disagreement(model, measured))


def save_array_model(model: ArrayModel, path: Path) -> None:
    """As ``tinygc-array-model/1``, whole or not at all."""
    write_whole(path, to_table(model))
