"""``tinygc-temperature/1`` (docs/formats.md)."""

from __future__ import annotations

from typing import Any

import numpy as np

from session.common.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MG
from session.common.version import VERSION
from tinygc.closure.allan import angle_random_walk, bias_instability
from tinygc.models.linear import BIAS, MATRIX
from tinygc.temperature.axis_fit import AxisFit
from tinygc.temperature.hysteresis import Hysteresis
from tinygc.temperature.rest_fit import RestFit
from tinygc.temperature.sessions_fit import SessionsFit
from tinygc.temperature.thermal_fit import ThermalFit

SCHEMA = "tinygc-temperature/1"


def to_json(fit: ThermalFit) -> dict:
    """All that was found, in the contract's units."""
    model = fit.model
    table: dict[str, Any] = {
        "schema": SCHEMA,
        "session": fit.name,
        "version": VERSION,
        "reference_c": model.reference_c,
        "range_c": list(model.range_c),
        "remaining_dps": _numbers(fit.remaining_rps / DEG),
    }
    table["model"] = {
        "E_per_c": model.E_terms.tolist(),
        "zero_dps_per_c": (model.zero_terms / DEG).tolist(),
        "lag_s": model.lag_s.tolist(),
        "parameters": [
            {"name": name, "value": float(value), "std": float(sigma)}
            for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True)
        ],
    }
    if fit.rests is not None:
        table |= of_rests(fit.rests)
    if fit.sessions is not None:
        table |= of_sessions(fit.sessions)
    return table


def of_sessions(sessions: SessionsFit) -> dict:
    """What sessions with turns tell."""
    return {
        "sessions": [
            {
                "name": point.name,
                "temperature_c": _numbers([point.low_c, point.temp_c, point.high_c]),
                "segments": point.segments,
                "E": point.values[MATRIX].reshape(3, 3).tolist(),
                "zero_dps": _numbers(point.values[BIAS] / DEG),
                "zero_std_dps": _numbers(np.sqrt(np.diag(point.covariance))[BIAS] / DEG),
            }
            for point in sessions.points
        ],
        "E_goodness": {
            "chi_square": sessions.chi_square,
            "freedom": sessions.freedom,
            "p_value": _number(sessions.p_value),
            "widened": sessions.widened,
        },
        "E_constant_p_value": sessions.p_constant,
        "turn_on_dps": _number(sessions.turn_on_rps / DEG),
    }


def of_rests(rests: RestFit) -> dict:
    """What rest logs tell."""
    return {
        "rests": [
            {
                "file": log.path.name,
                "samples": log.samples,
                "duration_s": log.duration_s,
                "rate_hz": _number(1 / log.period_s),
                "left_out_s": (len(log) - len(kept)) * log.block_s,
                "temperature_c": _numbers([log.temp_c.min(), log.temp_c.max()]),
            }
            for log, kept in zip(rests.logs, rests.knots.logs, strict=True)
        ],
        "sweeps": {name: sum(s.direction == way for s in rests.sweeps) for name, way in (("up", 1), ("down", -1))},
        "gyro": [_axis(axis, fit, DEG, "dps") for axis, fit in zip("xyz", rests.gyro, strict=True)],
        "accel": [_axis(axis, fit, MG, "mg") for axis, fit in zip("xyz", rests.accel, strict=False)],
        "noise": [_noise(rests, axis) for axis in range(3)] if rests.allan is not None else [],
    }


def _axis(axis: str, fit: AxisFit, unit: float, word: str) -> dict:
    terms = np.arange(fit.order + 1)
    lagged = fit.tau_s != 0
    return {
        "axis": axis,
        "order": int(terms[-1]),
        f"terms_{word}": _numbers(fit.terms / unit),
        f"terms_std_{word}": _numbers(fit.sigma[:-1] / unit),
        "lag_s": fit.tau_s if lagged else None,
        "lag_std_s": float(fit.sigma[-1]) if lagged else None,
        "p_value": fit.p_value,
        "held_out_by": fit.examined.by,
        f"held_out_{word}": fit.held_out / unit,
        f"held_out_constant_{word}": _number(fit.held_out_of(0, False) / unit),
        f"left_{word}": fit.left / unit,
        f"turn_on_{word}": _number(fit.turn_on / unit),
        "hysteresis": {
            name: None if found is None else _hysteresis(found, unit, word)
            for name, found in (("before", fit.hysteresis_before), ("after", fit.hysteresis_after))
        },
    }


def _hysteresis(found: Hysteresis, unit: float, word: str) -> dict:
    largest, sigma, at_c = found.largest
    return {f"largest_{word}": largest / unit, f"std_{word}": sigma / unit, "at_c": at_c, f"rms_{word}": found.rms / unit}


def _noise(rests: RestFit, axis: int) -> dict:
    assert rests.allan is not None
    walk, floor = angle_random_walk(rests.allan, axis), bias_instability(rests.allan, axis)
    over = rests.noise
    return {
        "axis": "xyz"[axis],
        "angle_random_walk_deg_rth": _number(walk.value / DEG_PER_SQRT_HOUR),
        "angle_random_walk_std_deg_rth": _number(walk.sigma / DEG_PER_SQRT_HOUR),
        "bias_instability_dph": _number(floor.value / DEG_PER_HOUR) if floor.observed else None,
        "bias_instability_std_dph": _number(floor.sigma / DEG_PER_HOUR) if floor.observed else None,
        "bias_instability_at_most_dph": _number(floor.at_most / DEG_PER_HOUR),
        "rms_per_c": None if over is None else float(over.per_c[axis]),
        "rms_std_per_c": None if over is None else float(over.sigma[axis]),
        "rms_at_c": [] if over is None else _numbers(over.at_c),
        "rms_dps": [] if over is None else _numbers(over.rms[:, axis] / DEG),
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(values: Any) -> list[float | None]:
    return [_number(value) for value in np.asarray(values, dtype=float).tolist()]
