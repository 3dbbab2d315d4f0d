"""A discovery as ``tinygc-explain/1`` has it, key ``discovery`` (docs/formats.md); the page and the report are made of the same table."""

from __future__ import annotations

from collections.abc import Sequence

from session.common.units import DEG
from tinygc.discovery.grammar.words import equation, in_words
from tinygc.discovery.judge.answer import Discovery, HeldOut, Law, RunnerUp
from tinygc.discovery.told.sentences import constant_names
from tinygc.effects import AppliedEffect
from tinygc.explanation.verdict.measured import p_entry
from tinygc.explanation.verdict.readable import readable


def to_json(discovery: Discovery, files: Sequence[str | None]) -> dict:
    """JSON-ready; files: of each law, relative to the folder of the explanation, None where none is written."""
    return {
        "verdict": discovery.verdict,
        "why": discovery.why,
        "laws": [_law(law, file) for law, file in zip(discovery.laws, files, strict=True)],
        "names": list(discovery.names),
        "forms": discovery.forms,
        "distinct": discovery.distinct,
        "chance": discovery.chance_gain,
        "best": discovery.best_promise,
        "learnable": {name: {"size_dps": None if size is None else size / DEG} for name, size in discovery.learnable.items()},
    }


def _law(law: Law, file: str | None) -> dict:
    _, parameters, std = readable(AppliedEffect(law.effect, law.theta), law.covariance)
    constants = zip(constant_names(law.form), law.form.constants, law.constants_sigma, strict=True)
    return {
        "id": law.effect.id,
        "equation": law.effect.equation,
        "in_words": in_words(law.form),
        "parameters": parameters,
        "std": std,
        "unit": law.effect.parameter.unit,
        "constants": {name: {"value": value, "sigma": sigma, "unit": unit} for (name, unit), value, sigma in constants},
        "bits": law.bits,
        "chi_square": law.gain,
        "better_by": law.better,
        "chance_p": law.chance_p,
        "held_out": [_held_out(each) for each in law.held_out],
        "file": file,
        "same_here": [equation(form) for form in law.same],
        "runners_up": [_runner_up(each) for each in law.runners_up],
        "learnable_from": law.learnable_from,
    }


def _held_out(each: HeldOut) -> dict:
    return {
        "before_deg": each.before_rad / DEG,
        "after_deg": each.after_rad / DEG,
        "floor_deg": each.floor_rad / DEG,
        "removed": each.removed,
        **p_entry("p_value", each.p_value),
        "segments": each.segments,
        "recording": each.recording,
    }


def _runner_up(each: RunnerUp) -> dict:
    return {
        "id": each.effect.id if each.form is None else None,
        "equation": each.effect.equation,
        "worse_by": each.worse,
        "correlation": each.correlation,
        "splits": each.splits,
    }
