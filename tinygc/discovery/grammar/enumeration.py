"""All forms of the grammar that a recording can be asked, each once.

One factor: every function of every quantity, through every lag that it may have.  Two factors: the plainer functions of both.  Each in
every pattern of axes that its factors allow.  Forms that are the same whatever the movement are one: they give the same columns on a
movement that is drawn, and the one of fewest bits stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from tinygc.discovery.grammar.bits import bits
from tinygc.discovery.grammar.form import Factor, Form
from tinygc.discovery.grammar.grids import LAGS_S, constants_of
from tinygc.discovery.grammar.quantities import QUANTITIES
from tinygc.discovery.grammar.some_movement import SAMPLES, some_movement

#: what each quantity is looked at through, alone
ALONE: dict[str, tuple[str, ...]] = {
    "rate": (
        "itself size square signed_square cube size_cube root signed_root root_cube sign dead_zone within beyond decay wave saw"
    ).split(),
    "rate_size": "itself square cube root root_cube dead_zone within beyond decay".split(),
    "force": "itself size square signed_square cube size_cube root signed_root sign wave".split(),
    "acceleration": "itself size square signed_square cube root signed_root sign dead_zone beyond".split(),
    "jerk": "itself size square signed_square".split(),
    "temperature": "itself square cube root root_cube beyond decay wave".split(),
    "temperature_rate": "itself size square signed_square".split(),
    "time": "itself square cube root decay wave clock".split(),
    "rest": "itself root square decay beyond".split(),
    "vibration": "itself root square".split(),
    "turned": "itself size square wave".split(),
    "sense": ("itself",),
    "level": ("itself",),
}
#: and in a product
TOGETHER: dict[str, tuple[str, ...]] = {
    "rate": "itself size square signed_square cube root_cube signed_root root sign dead_zone beyond".split(),
    "rate_size": "itself square cube root beyond decay".split(),
    "force": "itself size square signed_square".split(),
    "acceleration": "itself size square sign".split(),
    "jerk": ("itself",),
    "temperature": "itself square root".split(),
    "temperature_rate": ("itself",),
    "time": "itself decay".split(),
    "rest": "itself decay beyond".split(),
    "vibration": "itself root".split(),
    "turned": ("itself",),
    "sense": ("itself",),
    "level": ("itself",),
}
#: functions that are also tried behind a lag
LAGGED: dict[str, tuple[str, ...]] = {
    "rate": "itself size square signed_square sign".split(),
    "rate_size": "itself square".split(),
    "force": "itself square".split(),
    "acceleration": ("size",),
    "temperature": ("itself",),
    "vibration": "itself root".split(),
}
#: by which columns are told apart
LOOK = np.random.default_rng(1).standard_normal((3, SAMPLES))


def enumerated(largest: Mapping[str, float]) -> list[Form]:
    """Every form over these quantities, by name, each with its largest size in the recording; 0 where it does not vary."""
    names = [name for name in QUANTITIES if largest.get(name, 0.0) > 0]
    forms = [*_singles(names, largest), *_products(names, largest)]
    return _once([form for form in forms if not _is_linear(form)])


def _factors(name: str, functions: Sequence[str], largest: Mapping[str, float], finely: bool) -> list[Factor]:
    return [Factor(name, function, constant) for function in functions for constant in constants_of(name, function, largest, finely)]


def _lagged(name: str, lags_s: Sequence[float]) -> list[Factor]:
    return [Factor(name, function, None, lag_s) for function in LAGGED.get(name, ()) for lag_s in lags_s]


def _singles(names: list[str], largest: Mapping[str, float]) -> Iterator[Form]:
    for name in names:
        for factor in [*_factors(name, ALONE[name], largest, True), *_lagged(name, LAGS_S)]:
            yield from (Form((factor,), pattern) for pattern in (("each", "full", "cross") if factor.vector else ("each",)))


def _products(names: list[str], largest: Mapping[str, float]) -> Iterator[Form]:
    factors = [
        factor for name in names for factor in [*_factors(name, TOGETHER[name], largest, False), *_lagged(name, LAGS_S[2::2])]
    ]
    for one in factors:
        if one.of.components == 3:
            yield Form((one, one), "next")
    for one, other in combinations(factors, 2):
        if one.each * other.each > 2:
            continue
        if one.vector and other.vector:
            yield from (Form((one, other), pattern) for pattern in ("each", "next", "last", "leant"))
            yield Form((other, one), "leant")
        elif one.vector or other.vector:
            yield from (Form((one, other), pattern) for pattern in ("each", "full"))
        else:
            yield Form((one, other), "each")


def _is_linear(form: Form) -> bool:
    """Whether a calibration holds all of it."""
    return form.factors == (Factor("rate"),)


def _once(forms: list[Form]) -> list[Form]:
    """Of forms that give the same columns on a drawn movement the simplest."""
    movement = some_movement()
    values: dict[tuple[Factor, int], np.ndarray] = {}
    found: dict[tuple, Form] = {}
    for form in sorted(forms, key=bits):
        marks = []
        for term in form.terms():
            product = 1.0
            for factor, component in term.parts:
                if (factor, component) not in values:
                    for number, column in enumerate(factor.values(movement).T):
                        values[factor, number] = column
                product = product * values[factor, component]
            size = float(np.linalg.norm(product))
            marks.append((term.axis, *np.round(LOOK @ product / size, 7)) if size > 0 else (term.axis, 0))
        if any(len(mark) == 2 for mark in marks):
            continue
        key = tuple(sorted(marks))
        if key not in found:
            found[key] = form
    return list(found.values())
