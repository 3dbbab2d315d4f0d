"""A form's columns as Python that a person would write: its quantities by name, what is made of them, and the axes that they add to."""

from __future__ import annotations

import re
from collections.abc import Sequence
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


#: what a session has -> the constant of a file that has it from the session where the law was found
SESSIONS_OWN = {"m.fs_rps": "FULL_SCALE_RPS", "m.first_temp_c": "FIRST_TEMP_C"}


def law_code(form: Form, scanned: Constant | None = None, fixed: Sequence[str] = ()) -> LawCode:
    """scanned: the constant that is an argument of the function, by its word, and no constant of the module; fixed: which of
    ``SESSIONS_OWN`` are constants of the module."""
    constants = constants_of(form)
    names = [factor.quantity for factor in form.factors]
    single = len(names) == 1
    lines = []
    for number, factor in enumerate(form.factors):
        own = {c.lag: (c.word if scanned is not None and c.python == scanned.python else c.python) for c in constants if c.of == number}
        variable = "law" if single else (ONE, OTHER)[number]
        if factor.quantity not in names[:number]:
            lines.append(f"{factor.quantity} = {_source(factor, fixed)}  # {factor.of.words}{_unit(factor)}")
        made = re.sub(r"\b[xc]\b", lambda found: factor.quantity if found[0] == "x" else own[False], factor.through.source)  # noqa: B023
        if factor.lag_s is not None:
            made = f"signals.lagged({made}, {own[True]}, m.t_s)"
        lines.append(f"{variable} = {made}")
    more, columns = ([], _one(form)) if single else _two(form)
    lines, columns = _shorter([*lines, *more], columns)
    text = "\n".join([*lines, f"return {columns}"])
    per_axis = form.size // 3
    helpers = tuple(name for name in HELPERS if re.search(rf"\b{name}\(", text))
    libraries = tuple(name for name in ("np", "signals") if re.search(rf"\b{name}\.", text))
    return LawCode((*lines, f"return {columns}"), (3,) if per_axis == 1 else (3, per_axis), helpers, libraries)


HELPERS = ("before", "behind", "cross", "diagonal", "full", "rows", "without_vibration")


def _source(factor: Factor, fixed: Sequence[str]) -> str:
    source = factor.of.source
    for of_session, constant in SESSIONS_OWN.items():
        source = source.replace(of_session, constant if constant in fixed else of_session)
    return source


def _unit(factor: Factor) -> str:
    return "" if factor.of.unit in ("", "1") else f", {factor.of.unit}"


def _shorter(lines: list[str], columns: str) -> tuple[list[str], str]:
    """Without a name for what has one already and is used in the last line alone."""
    for variable in ("law", ONE, OTHER):
        plain = next((line for line in lines if re.fullmatch(rf"{variable} = \w+", line)), None)
        used = sum(len(re.findall(rf"\b{variable}\b", line)) for line in lines)
        if plain is not None and used == 1:
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


def _two(form: Form) -> tuple[list[str], str]:
    """Lines before the last, and the columns."""
    one, other = form.factors
    if one.each == other.each == 1:
        if form.pattern == "leant":
            return [], "rows(one[:, :, None] * other[:, None, :])"
        if form.pattern in ("next", "last"):
            return [], f"diagonal({' * '.join(_neighbour(form, number, (ONE, OTHER)[number]) for number in (0, 1))})"
        column = {(True, False): "one * other[:, None]", (False, True): "one[:, None] * other"}
        return [], f"{PLAIN[form.pattern]}({column.get((one.vector, other.vector), 'one * other')})"
    first, second = (_by_axis(factor, name) for factor, name in zip(form.factors, (ONE, OTHER), strict=True))
    if form.pattern in ("next", "last"):
        first, second = _neighbour(form, 0, first), _neighbour(form, 1, second)
    lines = [f"one, other = {first}, {second}  # (N, axis, numbers of each)"]
    if form.pattern == "leant":
        lines += ["both = one[:, :, None, :, None] * other[:, None, :, None, :]"]
        return lines, "rows(both.reshape(len(both), 3, -1))"
    lines += ["both = one[:, :, :, None] * other[:, :, None, :]"]
    if form.pattern == "cross":
        lines += ["both = np.concatenate([behind(both), before(both)], axis=2)"]
    axes = 1 if form.pattern == "full" or not (one.vector or other.vector) else 3
    return lines, f"rows(both.reshape(len(both), {axes}, -1))"


PLAIN = {"each": "diagonal", "full": "full", "cross": "cross"}


def _neighbour(form: Form, number: int, name: str) -> str:
    first = (form.pattern == "next") == (number == 0)
    return f"{'behind' if first else 'before'}({name})"
