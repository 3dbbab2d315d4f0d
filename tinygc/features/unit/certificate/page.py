"""The certificate as one HTML document for paper: A4, the number and page x of y on every sheet; nothing is fetched, nothing runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from session.base.texts import fixed, significant
from session.log.requirements import ATTITUDE
from tinygc.features.unit.certificate.content import Content, ResultRow
from tinygc.reporting.html.markup import decimals_for, render
from tinygc.verdict.requirements import Conformity, Measured, share_words

TITLE, DRAFT = "Calibration certificate", "Draft of a calibration certificate"


def page(content: Content) -> str:
    """The certificate as HTML."""
    title = DRAFT if content.draft else TITLE
    number = f"{'draft, ' if content.draft else ''}certificate number {content.number}"
    rows = zip("xyz", content.model.E, content.model.B, strict=True)
    return render(
        "certificate.html",
        "tinygc.features.unit.certificate",
        c=content,
        title=title,
        running={"bottom-left": number},
        rows=[_row(each) for each in content.results],
        found=[_row(each) for each in content.as_found],
        model=[(axis, [*(fixed(each, 6) for each in row), fixed(bias, 7)]) for axis, row, bias in rows],
        closure=[(_first(each.words), _value(each), _factor(each), significant(floor, 2)) for each, floor in content.closure],
        statements=[(reference, rule, [_conformity(one) for one in each]) for reference, rule, each in content.statements],
    ).lstrip()


def _first(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}"


def _row(row: ResultRow) -> dict[str, Any]:
    """A line of the table of results: decimals that give the largest U of the line two digits, and the range of k."""
    words, values = row
    known = [each for _, each in values if each.observed and np.isfinite(each.expanded) and each.expanded > 0]
    decimals = min((decimals_for(each.expanded) for each in known), default=3)
    factors = sorted({fixed(each.factor, 2) for each in known})
    cells = [_cell(part, each, decimals) for part, each in values]
    return {
        "words": _first(words),
        "unit": values[0][1].unit,
        "cells": [*cells, None, None, None][:3],
        "k": "–".join(dict.fromkeys((factors[0], factors[-1]))) if factors else "",
    }


def _cell(part: str, each: Measured, decimals: int) -> dict[str, str]:
    if not each.observed:
        return {"part": part, "value": "not observed", "expanded": ""}
    known = np.isfinite(each.expanded) and each.expanded > 0
    return {"part": part, "value": fixed(each.value, decimals), "expanded": fixed(each.expanded, decimals) if known else ""}


def _factor(each: Measured) -> str:
    return fixed(each.factor, 2) if each.observed and np.isfinite(each.expanded) and each.expanded > 0 else ""


def _value(each: Measured) -> str:
    if not (np.isfinite(each.expanded) and each.expanded > 0):
        return significant(each.value, 3)
    decimals = decimals_for(each.expanded)
    return f"{fixed(each.value, decimals)} ± {fixed(each.expanded, decimals)}"


def _conformity(each: Conformity) -> dict[str, str]:
    if each.measured.key == ATTITUDE:
        risk = "none: an uncertainty"
    elif each.risk is not None:
        risk = share_words(each.risk)
    elif each.measured.observed and np.isfinite(each.measured.sigma):
        risk = f"PASS {share_words(1 - each.probability)}, FAIL {share_words(each.probability)}"
    else:
        risk = "not known"
    sides = [significant(side, 3) for side in each.limits if np.isfinite(side)]
    limits = " to ".join(sides) if len(sides) == 2 else f"at {'most' if np.isfinite(each.limits[1]) else 'least'} {sides[0]}"
    value = _value(each.measured) if each.measured.observed else "not observed"
    return {
        "words": _first(each.measured.words),
        "unit": each.measured.unit,
        "limits": limits,
        "value": value,
        "k": _factor(each.measured),
        "answer": each.answer.upper(),
        "risk": risk,
    }
