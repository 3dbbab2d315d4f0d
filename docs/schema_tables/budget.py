"""docs/formats/budget.md: what ``budget`` writes of the uncertainty by source."""

from __future__ import annotations

from .shapes import COUNT, NUMBER, SHARE, SIZE, TEXT, maybe, words

_KIND = words("A", "B")
_SOURCE = {
    "source": TEXT,
    "type": _KIND,
    "degrees_of_freedom": maybe(SIZE),
    "size": maybe(SIZE),
    "size_unit": TEXT,
    "sensitivity": maybe(SIZE),
    "u": NUMBER,
    "variance_si": NUMBER,
    "share": NUMBER,
}
_BUDGET = {
    "name": TEXT,
    "unit": TEXT,
    "unit_si": SIZE,
    "value": maybe(NUMBER),
    "u": SIZE,
    "degrees_of_freedom": maybe(SIZE),
    "k": SIZE,
    "expanded_uncertainty": SIZE,
    "variance_si": SIZE,
    "sources": [_SOURCE],
    "not_in_the_sum": [{"what": TEXT, "u": maybe(SIZE), "why": TEXT}],
}
_ANSWER = words("agrees", "differs", "undecided")
_DRAWN = {
    "answer": _ANSWER,
    "seed": COUNT,
    "draws": COUNT,
    "draws_by_source": COUNT,
    "failed": COUNT,
    "quantities": [
        {
            "name": TEXT,
            "unit": TEXT,
            **dict.fromkeys(("u", "half", "drawn_u", "tolerance", "apart"), SIZE),
            **dict.fromkeys(("low", "high"), NUMBER),
            "digits": COUNT,
            "coverage": SHARE,
            "answer": _ANSWER,
        }
    ],
    "sources": [{"source": TEXT, "parameter": TEXT, "ratio": SIZE, "sigmas": NUMBER}],
    "sigmas_by_chance": SIZE,
}
TABLES = {
    "tinygc-budget/1": {"version": TEXT, "session": TEXT, "motion": TEXT, "budgets": [_BUDGET], "monte_carlo": maybe(_DRAWN)},
}
