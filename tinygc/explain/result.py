"""An explanation as ``tinygc-explain/1`` (FORMATS): what, where, how sure, and what would tell more."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import tinygc
from session.units import DEG, G
from session.writing import result_folder
from tinygc.effects import catalogue
from tinygc.explain.channels import bonferroni
from tinygc.explain.claims import Claimed
from tinygc.explain.explain import Explanation
from tinygc.explain.proof import tilt_rms
from tinygc.explain.where import BELONGS_P, where, worst_segments
from tinygc.files import write_whole
from tinygc.provenance import sha256_of

SCHEMA = "tinygc-explain/1"
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
        "within_stills": {f"{name}_rms_sigmas": e.within.rms(name) for name in ("slope", "scatter")},
        "seen_from": {
            name: {"size": size if np.isfinite(size) else None, "unit": catalogue()[name].parameter.unit}
            for name, size in e.seen_from.items()
        },
        "warnings": [vars(warning) for warning in e.warnings],
        "next": what_next(e),
        "logs": {log.path.name: sha256_of(log.path) for log in e.session.logs},
        "version": tinygc.__version__,
    }


def save(e: Explanation, folder: Path | None = None, pictures: bool = True) -> Path:
    """Write the result, and its picture, into a folder, the session's ``explain`` by default; returns that folder."""
    folder = folder or e.session.folder / "explain"
    with result_folder(folder):
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
        worst = worst_segments(e)
        where_to_look = f"; begin with the movement of segment {worst[0]}" if worst else ""
        return "repeat the session with one thing changed at a time (rate, temperature, attitude)" + where_to_look
    if e.verdict == "partly_explained" and bonferroni(e.left) < BELONGS_P:
        return "mend what is named, record again, and explain what is left"
    return None
