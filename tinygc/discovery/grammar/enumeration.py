"""All forms of the grammar that a recording can be asked, each once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations_with_replacement, product

from tinygc.discovery.grammar.form import Factor, Form
from tinygc.discovery.grammar.quantities import QUANTITIES

#: of a quantity's largest size in the recording: constants in its unit that are tried, sharpened afterwards
SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7)
#: s
LAGS_S = (0.05, 0.15, 0.5, 1.5, 5.0, 15.0, 50.0)


def enumerated(largest: Mapping[str, float]) -> list[Form]:
    """Every form over these quantities, by name, each with its largest size in the recording; 0 where it does not vary."""
    names = [name for name in QUANTITIES if largest.get(name, 0.0) > 0]
    return list(_singles(names, largest)) + list(_products(names, largest))


def _singles(names: list[str], largest: Mapping[str, float]) -> Iterator[Form]:
    for name in names:
        for function in ("itself", "size", "square", "signed_square", "cube", "root", "signed_root", "root_cube", "sign"):
            yield from _patterns((Factor(name, function),))
        for function, share in product(("dead_zone", "beyond", "decay", "wave"), SHARES):
            yield from _patterns((Factor(name, function, share * largest[name]),))


def _products(names: list[str], largest: Mapping[str, float]) -> Iterator[Form]:
    factors = [Factor(name, function) for name in names for function in ("itself", "size", "square")]
    for pair in combinations_with_replacement(factors, 2):
        if pair[0] != pair[1]:
            yield from _patterns(pair)


def _patterns(factors: tuple[Factor, ...]) -> Iterator[Form]:
    vectors = sum(factor.vector for factor in factors)
    yield Form(factors, "each")
    if vectors:
        yield Form(factors, "full")
    if vectors == 2:
        yield Form(factors, "next")
