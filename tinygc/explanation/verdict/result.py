"""An explanation as ``tinygc-explain/1`` (docs/formats.md): what, where, how sure, and what would tell more."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G
from session.common.version import VERSION
from session.log.hashes import file_key, hash_of_log
from tinygc.effects import catalogue
from tinygc.explanation.naming.unknown import lines_end_hz
from tinygc.explanation.verdict.claims import Claim, Considered
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.measured import p_entry
from tinygc.explanation.verdict.next_step import what_next
from tinygc.explanation.verdict.proof import tilt_rms
from tinygc.explanation.verdict.residuals import channel_rms
from tinygc.explanation.verdict.where import where

SCHEMA = "tinygc-explain/1"


def to_json(e: Explanation) -> dict:
    """The whole result, JSON-ready."""
    assert e.within is not None
    assert e.noise is not None  # an explanation that is told is whole
    return {
        "schema": SCHEMA,
        "session": e.session.name,
        "verdict": e.verdict,
        "mismatch": {
            **p_entry("p_value", e.p_value),
            "closure_rms_deg": tilt_rms(e.proof.before) / DEG,
            "expected_rms_deg": e.problem.floor.tilt_rms / DEG,
            "where": where(e),
        },
        "effects": [_effect(claim) for claim in e.claimed],
        "findings": [_effect(claim) | {"share": claim.share} for claim in e.findings],
        "considered": [_considered(each) for each in e.considered],
        "lot_effects": [each.to_json() for each in e.of_lot],
        "lines_end_hz": lines_end_hz(e.twin),
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
            name: p_entry("p_before", before) | p_entry("p_after", after) | {"rms_sigmas": dict(zip(("before", "after"), rms, strict=True))}
            for (name, (before, after)), rms in zip(e.own_p.items(), channel_rms(e).values(), strict=True)
        },
        "turn_gravity": {
            "lever_m": e.gravity.lever_m.tolist(),
            "offset_s": e.gravity.offset_s,
            "offset_std_s": e.gravity.sigma_s,
            "rms_mg": {"before": 1e3 * e.gravity.before_mps2 / G, "after": 1e3 * e.gravity.after_mps2 / G},
        },
        "noise": e.problem.instability.to_json() | {"components": e.noise.to_json()},
        "within_stills": {f"{name}_rms_sigmas": e.within.rms(name) for name in ("slope", "scatter")},
        "seen_from": {
            name: {"size": size if np.isfinite(size) else None, "unit": catalogue()[name].parameter.unit}
            for name, size in e.seen_from.items()
        },
        "warnings": [vars(warning) for warning in e.warnings],
        "next": what_next(e),
        "logs": {file_key(log.path): hash_of_log(log) for log in e.session.logs},
        "version": VERSION,
    }


def _considered(each: Considered) -> dict:
    closure = None if each.closure_rad is None else dict(zip(("before", "after"), (rad / DEG for rad in each.closure_rad), strict=True))
    return {"id": each.id, "probability": each.probability, "moments": each.moments, "closure_rms_deg": closure}


def _effect(claim: Claim) -> dict:
    return {
        "id": claim.effect.id,
        "equation": claim.effect.equation,
        "parameters": claim.parameters,
        "std": claim.std,
        **p_entry("p_value", claim.p_value, claim.p_is_bound),
        "probability": claim.probability,
        "rivals": claim.rivals,
        "equivalent": list(claim.equivalent),
        "says": claim.says,
    }
