"""A discovery as ``tinygc-explain/1`` has it, key ``discovery`` (docs/formats.md); the page and the report are made of the same table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from session.common.units import DEG
from tinygc.discovery.grammar.words import ABBREVIATIONS, NEIGHBOURS, SYMBOLS, equation, in_words
from tinygc.discovery.judge.answer import Discovery, HeldOut, Law, RunnerUp
from tinygc.discovery.told import said
from tinygc.discovery.told.constants import constants_of
from tinygc.discovery.told.law_code import law_code
from tinygc.discovery.told.terms import terms_of
from tinygc.explanation.verdict.measured import p_entry


def to_json(discovery: Discovery, files: Sequence[str | None]) -> dict:
    """JSON-ready; files: of each law, relative to the folder of the explanation, None where none is written."""
    return {
        "verdict": discovery.verdict,
        "why": discovery.why,
        "laws": [_law(law, file) for law, file in zip(discovery.laws, files, strict=True)],
        "beside": [vars(each) for each in discovery.beside],
        "forms": discovery.forms,
        "distinct": discovery.distinct,
        "chance": discovery.chance_promise,
        "best": discovery.best_promise,
        "learnable": {name: {"size_dps": None if size is None else size / DEG} for name, size in discovery.learnable.items()},
    }


def _law(law: Law, file: str | None) -> dict:
    unit, name = said.unit_of(law.form)
    parameters, std = ((x / DEG).reshape(law_code(law.form).shape).tolist() for x in (law.theta, np.sqrt(np.diag(law.covariance))))
    return {
        "id": law.effect.id if file is None else id_of(file),
        "equation": equation(law.form),
        "in_words": in_words(law.form),
        "parameters": {name: parameters},
        "std": {name: std},
        "unit": unit,
        "terms": terms_of(law.form),
        "constants": {
            each.json: {"value": each.number, "sigma": each.sigma, "unit": each.unit or "fraction"}
            for each in constants_of(law.form, law.constants_sigma)
        },
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


def id_of(file: str) -> str:
    """Of the effect in ``effects/discovered_rate.py``: ``discovered.rate``."""
    return PurePosixPath(file).stem.replace("_", ".", 1)


def _held_out(each: HeldOut) -> dict:
    return {
        "before_deg": each.before_rad / DEG,
        "after_deg": each.after_rad / DEG,
        "floor_deg": each.floor_rad / DEG,
        "removed": each.removed,
        **p_entry("p_value", each.p_value),
        **p_entry("noise_p", each.noise_p),
        "segments": each.segments,
        "recording": each.recording,
    }


def _runner_up(each: RunnerUp) -> dict:
    return {
        "id": each.effect.id if each.form is None else None,
        "equation": other_equation(each),
        "worse_by": each.worse,
        "correlation": each.correlation,
        "splits": each.splits,
    }


def other_equation(each: RunnerUp) -> str:
    """Of a form or of a name."""
    return each.effect.equation if each.form is None else equation(each.form)


def briefly(text: str) -> str:
    """An equation without what its symbols are."""
    for note in (*SYMBOLS.values(), NEIGHBOURS, *ABBREVIATIONS.values()):
        text = text.split(f", {note}")[0]
    return text
