"""A form's columns as Python that a person would write: its quantities by name, what is made of them, and the axes that they add to."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tinygc.discovery.grammar.form import Factor, Form
from tinygc.discovery.told.constants import Constant, constants_of

ONE, OTHER = "one", "other"


@dataclass(frozen=True)
class LawCode:
    """lines: of a function of ``m``, the last of which returns the columns; shape: of the parameter; helpers: of ``tinygc.effects`` that
    they use; libraries: of numpy and signals, those that they use."""

    lines: tuple[str, ...]
    shape: tuple[int, ...]
    helpers: tuple[str, ...]
    libraries: tuple[str, ...]


def law_code(form: Form, scanned: Constant | None = None) -> LawCode:
    """scanned: the constant that is an argument of the function, by its word, and no constant of the module."""
    constants = constants_of(form)
    names = [factor.quantity for factor in form.factors]
    single = len(names) == 1
    lines = []
    for number, factor in enumerate(form.factors):
        own = {c.lag: (c.word if scanned is not None and c.python == scanned.python else c.python) for c in constants if c.of == number}
        variable = "law" if single else (ONE, OTHER)[number]
        if factor.quantity not in names[:number]:
            lines.append(f"{factor.quantity} = {factor.of.source}  # {factor.of.words}{_unit(factor)}")
        made = re.sub(r"\b[xc]\b", lambda found: factor.quantity if found[0] == "x" else own[False], factor.through.source)  # noqa: B023
        if factor.lag_s is not None:
            made = f"signals.lagged({made}, {own[True]}, m.t_s)"
        lines.append(f"{variable} = {made}")
    columns = _one(form) if single else _two(form)
    text = "\n".join([*lines, f"return {columns}"])
    lines, columns = _shorter(lines, columns, form)
    per_axis = form.size // 3
    helpers = tuple(name for name in HELPERS if re.search(rf"\b{name}\(", text))
    libraries = tuple(name for name in ("np", "signals") if re.search(rf"\b{name}\.", text))
    return LawCode((*lines, f"return {columns}"), (3,) if per_axis == 1 else (3, per_axis), helpers, libraries)


HELPERS = ("before", "behind", "cross", "diagonal", "full", "rows", "without_vibration")


def _unit(factor: Factor) -> str:
    return "" if factor.of.unit in ("", "1") else f", {factor.of.unit}"


def _shorter(lines: list[str], columns: str, form: Form) -> tuple[list[str], str]:
    """Without the names of what is used once, right as it is."""
    for variable in ("law", ONE, OTHER):
        plain = next((line for line in lines if re.fullmatch(rf"{variable} = \w+", line)), None)
        if plain is not None:
            lines = [line for line in lines if line != plain]
            columns = re.sub(rf"\b{variable}\b", plain.split(" = ")[1], columns)
    return lines, columns


def _one(form: Form) -> str:
    (factor,) = form.factors
    if factor.each == 1:
        return {"each": "diagonal(law)", "full": "full(law)", "cross": "cross(law)"}[form.pattern]
    if form.pattern == "cross":
        return "rows(np.concatenate([behind(law), before(law)], axis=2))" if _is_flat(factor) else _flat("behind(law)", "before(law)")
    if form.pattern == "full":
        return "rows(law.reshape(len(law), 1, -1))"
    return "rows(law.reshape(len(law), 3, -1))" if factor.vector and not _is_flat(factor) else f"rows({_by_axis(factor, 'law')})"


def _is_flat(factor: Factor) -> bool:
    """Whether its values are (N, 3, K) or, of a scalar, (N, K): directions or phases, not both."""
    return factor.of.directions == 1 or factor.through.phases == 1


def _flat(*parts: str) -> str:
    return f"rows(np.concatenate([{', '.join(f'{part}.reshape(len(law), 3, -1)' for part in parts)}], axis=2))"


def _by_axis(factor: Factor, name: str) -> str:
    """(N, 3 or 1, K)."""
    if factor.each == 1:
        return f"{name}[:, :, None]" if factor.vector else f"{name}[:, None, None]"
    if factor.vector:
        return name if _is_flat(factor) else f"{name}.reshape(len({name}), 3, -1)"
    return f"{name}[:, None]"


def _two(form: Form) -> str:
    one, other = form.factors
    if one.each == other.each == 1:
        if form.pattern == "leant":
            return "rows(one[:, :, None] * other[:, None, :])"
        if form.pattern in ("next", "last"):
            return f"diagonal({' * '.join(_neighbour(form, number, (ONE, OTHER)[number]) for number in (0, 1))})"
        column = {(True, False): "one * other[:, None]", (False, True): "one[:, None] * other"}
        return f"{PLAIN[form.pattern]}({column.get((one.vector, other.vector), 'one * other')})"
    if form.pattern in ("next", "last"):
        sides = [_neighbour(form, number, _by_axis(factor, (ONE, OTHER)[number])) for number, factor in enumerate(form.factors)]
    else:
        sides = [_by_axis(factor, name) for factor, name in zip(form.factors, (ONE, OTHER), strict=True)]
    if form.pattern == "leant":
        product = f"{sides[0]}[:, :, None, :, None] * {sides[1]}[:, None, :, None, :]"
        return f"rows(({product}).reshape(len(one), 3, -1))"
    product = f"({sides[0]}[:, :, :, None] * {sides[1]}[:, :, None, :])"
    if form.pattern == "full":
        return f"rows({product}.reshape(len(one), 1, -1))"
    if form.pattern == "cross":
        return f"rows(np.concatenate([behind({product}), before({product})], axis=2).reshape(len(one), 3, -1))"
    axes = 3 if one.vector or other.vector else 1
    return f"rows({product}.reshape(len(one), {axes}, -1))"


PLAIN = {"each": "diagonal", "full": "full", "cross": "cross"}


def _neighbour(form: Form, number: int, name: str) -> str:
    first = (form.pattern == "next") == (number == 0)
    return f"{'behind' if first else 'before'}({name})"
