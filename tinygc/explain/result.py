"""An explanation as ``tinygc-explain/1`` (FORMATS): what, where, how sure, and what would tell more."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import tinygc
from session.units import DEG, G
from tinygc.effects import catalogue
from tinygc.explain.channels import bonferroni, own_residuals
from tinygc.explain.claims import Claimed
from tinygc.explain.explain import Explanation
from tinygc.explain.proof import tilt_rms
from tinygc.explain.twin import Twin
from tinygc.files import write_whole

SCHEMA = "tinygc-explain/1"
#: a channel, an axis, a segment belongs to the mismatch at this level
BELONGS_P = 1e-3
BELONGS_SIGMAS = 4.0
MOST_SEGMENTS = 12
SMALLEST_P = 1e-300


def to_json(e: Explanation) -> dict:
    """The whole result, JSON-ready."""
    return {
        "schema": SCHEMA,
        "session": e.session.name,
        "verdict": e.verdict,
        "mismatch": {
            "p_value": max(e.p_value, SMALLEST_P),
            "closure_rms_deg": tilt_rms(e.proof.before) / DEG,
            "expected_rms_deg": e.problem.floor.tilt_rms / DEG,
            "where": where(e),
        },
        "effects": [_effect(claim) for claim in e.claimed],
        "findings": [_effect(claim) | {"share": claim.share} for claim in e.findings],
        "fit": {
            "holdout_closure_rms_deg": {
                "before": tilt_rms(e.proof.before) / DEG,
                "after": tilt_rms(e.proof.after) / DEG,
                "floor": e.proof.floor_rms / DEG,
            },
            "excess_removed": e.proof.removed,
            "segments_after": len(e.proof.after_numbers),
        },
        "channels": {
            name: {"p_before": max(before, SMALLEST_P), "p_after": max(after, SMALLEST_P)} for name, (before, after) in e.own_p.items()
        },
        "turn_gravity": {
            "lever_m": e.gravity.lever_m.tolist(),
            "offset_s": e.gravity.offset_s,
            "offset_std_s": e.gravity.sigma_s,
            "rms_mg": {"before": 1e3 * e.gravity.before_mps2 / G, "after": 1e3 * e.gravity.after_mps2 / G},
        },
        "seen_from": {
            name: {"size": size if np.isfinite(size) else None, "unit": catalogue()[name].parameter.unit}
            for name, size in e.seen_from.items()
        },
        "warnings": [vars(warning) for warning in e.warnings],
        "next": what_next(e),
        "version": tinygc.__version__,
    }


def save(e: Explanation, folder: Path | None = None, pictures: bool = True) -> Path:
    """Write the result, and its picture, into a folder, the session's ``explain`` by default; returns that folder."""
    folder = folder or e.session.folder / "explain"
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "explain.json", to_json(e))
    if pictures:
        from tinygc.explain.picture import draw

        draw(e, folder / "explain.png")
    return folder


def _effect(claim: Claimed) -> dict:
    return {
        "id": claim.effect.id,
        "equation": claim.effect.equation,
        "parameters": claim.parameters,
        "std": claim.std,
        "p_value": max(claim.p_value, SMALLEST_P),
        "equivalent": list(claim.equivalent),
        "says": claim.says,
    }


def where(e: Explanation) -> dict:
    """Phases, axes, segments and the regime in which the mismatch lives; empty where there is none."""
    if e.verdict == "no_mismatch":
        return {"phases": [], "axes": [], "segments": [], "regime": None}
    told = [*e.claimed, *e.findings]
    phases = {phase for claim in e.claimed for phase in claim.effect.seen_in}  # a shape without a name may be seen anywhere
    names = {"closure": "turn", "still": "still", "length": "reference"}
    phases |= {names[name] for name, (before, after) in e.own_p.items() if (after if e.claimed else before) < BELONGS_P}
    order = ("still", "turn", "reference", "timing")
    return {
        "phases": [phase for phase in order if phase in phases],
        "axes": _axes(e, told),
        "segments": _segments(e),
        "regime": _regime(e.twin, told),
    }


def _axes(e: Explanation, told: list[Claimed]) -> list[str]:
    """Body axes whose parameters stand out of their std; from the stills' residual rates where nothing is told."""
    weights = np.zeros(3)
    for claim in told:
        name = claim.effect.parameter.name
        if name not in claim.std or claim.effect.kind == "register":
            continue
        ratio = np.abs(np.ravel(claim.parameters[name])) / np.maximum(np.ravel(claim.std[name]), 1e-300)
        if ratio.size % 3 == 0:
            weights = np.maximum(weights, ratio.reshape(3, -1).max(axis=1))
    if not told:
        part = e.whiten.parts["still"]
        rows = own_residuals(e.twin, e.whiten, e.naming.first)[0][part].reshape(-1, 3)
        weights = np.abs(rows).max(axis=0)
    return [axis for axis, weight in zip("xyz", weights, strict=True) if weight > BELONGS_SIGMAS]


def _segments(e: Explanation) -> list[int]:
    """Numbers of the segments that close worst beyond their floor, worst first."""
    sigma = np.sqrt(np.trace(e.problem.floor.own, axis1=1, axis2=2))
    excess = np.linalg.norm(e.proof.before, axis=1) / sigma
    order = np.argsort(-excess)[:MOST_SEGMENTS]
    return [e.proof.before_numbers[i] for i in order if excess[i] > BELONGS_SIGMAS / np.sqrt(2)]


def _regime(twin: Twin, told: list[Claimed]) -> dict | None:
    """The variable that the strongest effect goes along with, over the range where it is at least half its greatest."""
    claim = next((claim for claim in told if claim.effect.regime), None)
    if claim is None:
        return None
    variable, units = claim.effect.regime
    values = _variable(twin, variable)
    if values is None:
        return None
    if claim.effect.kind == "register" or variable == "attitude":
        return {"variable": variable, "units": units, "from": float(values.min()), "to": float(values.max())}
    strength = _strength(twin, claim)
    inside = values[strength > 0.5 * np.quantile(strength, 0.999)] if strength is not None else values
    return {"variable": variable, "units": units, "from": float(inside.min()), "to": float(inside.max())}


def _strength(twin: Twin, claim: Claimed) -> np.ndarray | None:
    """How much the effect adds at each sample, rad/s."""
    if claim.effect.kind != "rate":
        return None
    name, parameter = claim.effect.parameter.name, claim.effect.parameter
    theta = np.ravel(claim.parameters[name]) * parameter.si
    return np.concatenate([np.linalg.norm(claim.effect.columns(m) @ theta, axis=1) for m in twin.movements])


def _variable(twin: Twin, name: str) -> np.ndarray | None:
    """A movement's variable at each sample, in people's units."""
    read = {
        "temperature": lambda m: m.temp_c,
        "time": lambda m: m.t_s,
        "rate": lambda m: np.abs(m.rate).max(axis=1) / DEG,
        "angular acceleration": lambda m: np.abs(m.acceleration).max(axis=1),
        "vibration": lambda m: m.vibration_g2,
    }.get(name)
    if name == "attitude":
        return np.array([still.accel_mean[2] / still.gravity_mps2 for _, still in twin.stills])
    return None if read is None else np.concatenate([read(movement) for movement in twin.movements])


def what_next(e: Explanation) -> str | None:
    """The movement or condition that would tell what this recording cannot; None where nothing is open."""
    for claim in e.claimed:
        if claim.equivalent:
            return f"to tell {claim.effect.id} from {', '.join(claim.equivalent)}: {claim.effect.splits}"
    if e.findings:
        return e.findings[0].effect.splits
    if e.verdict == "unexplained" and (suspicion := next((warning.do for warning in e.warnings if warning.do), None)):
        return suspicion
    if e.verdict == "unexplained":
        worst = _segments(e)
        where_to_look = f"; begin with the movement of segment {worst[0]}" if worst else ""
        return "repeat the session with one thing changed at a time (rate, temperature, attitude)" + where_to_look
    if e.verdict == "partly_explained" and bonferroni(e.left) < BELONGS_P:
        return "mend what is named, record again, and explain what is left"
    return None
