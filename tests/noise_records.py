"""Noise figures that are made by hand."""

from __future__ import annotations

from collections.abc import Mapping

from tinygc.noise.figures import TERMS, AxisNoise, NoiseFigures, SensorNoise, Term


def axis_of(limits: Mapping[str, float] | None = None, tau_s: float | None = None, **terms: tuple[float, float]) -> AxisNoise:
    """Terms by name, each with its value and sigma, SI; limits of terms that are not shown; tau_s of G."""
    found = {}
    for name in TERMS:
        if name in terms:
            found[name] = Term(*terms[name], 1.0, None, tau_s if name == "G" else None, None if name != "G" else 0.0)
        else:
            found[name] = Term(0.0, None, 0.0, (limits or {}).get(name))
    return AxisNoise(found)


def figures_of(
    gyro: SensorNoise, accel: SensorNoise | None = None, serial: str = "", logs: tuple[str, ...] = ("rest0001.csv",)
) -> NoiseFigures:
    """Figures of a rest of ten hours at 104 Hz."""
    return NoiseFigures(gyro, accel, 104.0, 36_000.0, 3_744_000, logs, "ASM330LHH", serial)
