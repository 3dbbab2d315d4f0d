"""Write a law as a complete effect file with its evidence in the docstring."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from textwrap import dedent, indent, wrap

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import printable
from session.base.units import DEG
from tinygc.effects import NEIGHBOURS, Movement, Reach, signals
from tinygc.effects.device import MOST_PASSES, PASSES
from tinygc.effects.inversion import substituted, undone_with_jumps
from tinygc.features.discovery.equivalence import FULL_SCALE, columns_of, some_movement
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_code import SESSIONS_OWN, device_code, law_code, why_not
from tinygc.features.discovery.result import evidence_words, law_table, open_words
from tinygc.features.discovery.search_state import Law
from tinygc.features.discovery.words import (
    Constant,
    coefficient_unit,
    constants_of,
    equation,
    follows,
    jumps,
    known_to,
    observable_in,
    regime,
    rounded,
    splits,
    what,
)

# The docstring of a written file: the law, where it was found, and its evidence.

EVIDENCE_WIDTH, INDENT = 110, 12
#: longest name taken from a file, and a line of evidence, in characters
LONGEST, LONGEST_EVIDENCE = 80, 1000
#: hexadecimal digits of a log's hash that identify it
DIGEST = 16


@dataclass(frozen=True)
class Where:
    """Where a law was found: the session's name; logs, name -> sha256; version of the tool; full scale in dps and temperature of the first
    sample in degC, the reference conditions of the law's numbers: without them a file takes those of each session."""

    session: str
    logs: Mapping[str, str] = field(default_factory=dict)
    version: str = ""
    full_scale_dps: float | None = None
    first_temp_c: float | None = None


def plain(text: str, most: int = LONGEST) -> str:
    """Sanitise foreign text for a docstring, of so many characters: it can neither end the docstring nor contain escapes."""
    line = printable(text)
    line = line if len(line) <= most else line[: most - 1] + "…"
    return line.replace("\\", "/").replace('"', "'").replace("{", "(").replace("}", ")")


def docstring(law: Law, where: Where, undoing: str = "") -> str:
    """The text between the quotes, not indented; undoing: a note on inverting the law."""
    told = law_table(law, None)
    parts = [("Equation", told["equation"]), ("Found in", _where(where))]
    parts += [("Evidence", plain(words, LONGEST_EVIDENCE)) for words in (*evidence_words(told), *open_words(told))]
    parts += [("Undoing", undoing)] if undoing else []
    first = f"A law found in a recording.  {told['in_words']}"
    lines = ["\n".join(wrap(first, EVIDENCE_WIDTH)), ""]
    for name, text in parts:
        lines += wrap(f"{name:<{INDENT}}{text}", EVIDENCE_WIDTH, subsequent_indent=" " * INDENT, break_long_words=False)
    return "\n".join(lines)


def _where(where: Where) -> str:
    logs = ", ".join(f"{plain(name)} (sha256 {plain(digest)[:DIGEST]}…)" for name, digest in where.logs.items())
    scale = "" if where.full_scale_dps is None else f", full scale {where.full_scale_dps:g} dps"
    return (
        f"session {plain(where.session)}{scale}{f'; {logs}' if logs else ''}{f'; TinyGC {plain(where.version)}' if where.version else ''}"
    )


# How many fixed-point passes invert a law, by trial on a simulated movement: declared by the written file and run by its C.

#: Hz, the highest rate of a proof; s of movement
RATE_HZ, LENGTH_S = 833.0, 8.0
#: factors on the size found, of each sign, that another unit may have: the range of a proof
STRONGER, DRAWN = 1.5, 2
#: share of the added rate that may remain (a proof requires 5e-3), and share of rows that may exceed it, as at the rate that ends a
#: rest
LEFT, ASTRAY = 1e-3, 0.01
#: residual allowed in C relative to 1 rad/s: about the rounding of single precision
LEFT_IN_C = 2e-6


def passes_of(form: LawForm, theta: np.ndarray, jumps: bool, full_scale: float = FULL_SCALE) -> int | None:
    """Fixed-point passes over all rows that invert a law, theta (P,) SI; None where ``MOST_PASSES`` are not enough."""
    moved = _movement(full_scale)

    def left(size: np.ndarray, passes: int) -> bool:
        def added(movement: Movement) -> np.ndarray:
            return columns_of(form, movement) @ size

        distorted = moved.rate + (adds := added(moved))
        undone = undone_with_jumps if jumps else substituted
        rate = undone(distorted, moved, added, passes)
        off = np.abs(rate - moved.rate).max(axis=1) > LEFT * np.abs(adds).max(initial=1e-12)
        return bool(off.mean() > ASTRAY)

    return _least(theta, left)


def passes_in_c(form: LawForm, theta: np.ndarray, full_scale: float = FULL_SCALE) -> int | None:
    """As ``passes_of`` in single precision up to full scale, each row on its own."""
    rng, moved = np.random.default_rng(0), _movement(full_scale)
    moved = replace(moved, rate=rng.uniform(-full_scale, full_scale, np.shape(moved.rate)))

    def left(size: np.ndarray, passes: int) -> bool:
        rate = substituted(moved.rate, moved, lambda movement: columns_of(form, movement) @ size, passes)
        again = rate + columns_of(form, moved.with_rate(rate)) @ size
        return bool((np.abs(again - moved.rate) > LEFT_IN_C * (1 + np.abs(moved.rate))).any())

    return _least(theta, left)


def _least(theta: np.ndarray, left: Callable[[np.ndarray, int], bool]) -> int | None:
    rng, rms = np.random.default_rng(0), rms_of(theta)
    sizes = [STRONGER * theta, *(STRONGER * rms * rng.choice((-1.0, 1.0), (DRAWN, len(theta))))]
    passes = PASSES
    for size in sizes:
        while left(size, passes):
            if passes >= MOST_PASSES:
                return None
            passes = min(passes + 1 + passes // 4, MOST_PASSES)
    return passes


def _movement(full_scale: float) -> Movement:
    """(N,) rows of a simulated movement, linear between its samples and more abrupt than a hand."""
    drawn = some_movement(0)
    t_s = drawn.t_s[0] + np.arange(0.0, LENGTH_S, 1 / RATE_HZ)

    def at(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        return np.stack([np.interp(t_s, drawn.t_s, column) for column in flat.T], axis=-1).reshape(-1, *values.shape[1:])

    return replace(
        drawn,
        t_s=t_s,
        dt_s=1 / RATE_HZ,
        rate=at(drawn.rate) * full_scale / FULL_SCALE,
        force_g=at(drawn.force_g),
        temp_c=at(drawn.temp_c),
        vibration_g2=at(drawn.vibration_g2),
        fs_rps=full_scale,
    )


# A law as a complete effect file, as a person would write it.  Nothing of a recording becomes code.

#: digits of the plausible size, which is a prior and no limit
DIGITS = 2
#: plausible size over the size found: a proof (``tinygc.effects.testing``) injects a twentieth of it
PLAUSIBLE = 20.0
#: factors on the constant found, at which another unit's own constant is searched
GRID = "0.5, 0.63, 0.8, 1, 1.25, 1.6, 2"
#: digits of a coefficient and of its covariance
KNOWN = 6
#: digits of a weight of a combination of coefficients
WEIGHTS = 4
#: columns of a line
WIDTH = 120


def written(law: Law, where: Where, name: str | None = None) -> str:
    """The effect file of a law; name: follows ``discovered.`` in its id, where it differs from the form's own."""
    form, constants = rounded(law.form, law.constants_sigma), constants_of(law.form, law.constants_sigma)
    return _File(law, form, constants, name or what(form), where).text(where)


class _File:
    """The parts of one effect file."""

    def __init__(self, law: Law, form: LawForm, constants: list[Constant], name: str, where: Where):
        self.law, self.form, self.constants, self.name = law, form, constants, name
        self.scanned = constants[0] if len(constants) == 1 else None
        used = " ".join(factor.of.source for factor in form.factors)
        self.at = at_of(where)
        self.fixed = tuple(constant for of_session, constant in SESSIONS_OWN.items() if of_session in used and constant in self.at)
        self.lines, self.shape = law_code(form, self.scanned, self.fixed)
        self.jumps, full_scale = jumps(form), self.at.get("FULL_SCALE_RPS", (FULL_SCALE, ""))[0]
        counted = self.jumps or bool(reaches_of(form)) or any(factor.lag_s is not None for factor in form.factors)
        #: fixed-point passes over all rows; None: they do not invert the law
        self.passes = passes_of(form, law.theta, self.jumps, full_scale) if counted else PASSES
        in_c = passes_in_c(form, law.theta, full_scale) if not why_not(form) else None
        self.device, self.functions = device_code(form, constants, name, in_c, self.fixed)
        if len(law.unobserved):
            self.device, self.functions = 'NoC("part of it was not observed, and its C would apply that part")', ""

    def text(self, where: Where) -> str:
        """The whole file."""
        undoing = "" if self.passes is not None else TOO_STRONG
        rest = "\n".join([*self.lines, self._correct(), self._at(), self._effect(), self.functions])
        bare = ("NEIGHBOURS", "Conditions")
        names = [name for name in USED if re.search(rf"\b{name}" + (r"\b" if name in bare else "[(.]"), rest)]
        lines = ["from dataclasses import replace\n"] if "replace(" in rest else []
        lines += [
            "import numpy as np\n",
            "from session.base.units import DEG",
            *_from("tinygc.effects", ["Effect", "Movement", *names]),
        ]
        lines += ["from tinygc.effects.inversion import JUMPS_REACH, undone_with_jumps"] if jumps(self.form) else []
        lines += ["from tinygc.effects.effect import SCALE_LAW"] if _is_scale_law(self.form) else []
        head = [f'"""{docstring(self.law, where, undoing)}\n"""', "\n".join(lines), self._constants()]
        body = [self._columns(), self._correct(), self.functions, self._at(), self._effect()]
        return "\n\n".join(part for part in head if part) + "\n\n\n" + "\n\n\n".join(part for part in body if part) + "\n"

    def _constants(self) -> str:
        lines = [line for name in self.fixed for line in self.at[name][1].split("\n")]
        for constant in self.constants:
            unit = constant.unit or "of full scale"
            sigma = "sigma not known" if constant.sigma is None else f"sigma {constant.sigma:.2g}"
            lines += [f"#: {unit}, {sigma}", f"{constant.python} = {constant.source}"]
        lines += ["#: SI: what that session gave; another of the unit must agree", f"COEFFICIENTS = {_array(self.law.theta)}"]
        lines += [f"COVARIANCE = {_array(self.law.covariance)}"]
        if len(self.law.unobserved):
            lines += ["#: combinations of the coefficients that the session did not observe; the law is without them"]
            lines += [f"NOT_OBSERVED = np.array({_rows(self.law.unobserved)})"]
            lines += [f"OBSERVED = np.eye({self.form.size}) - np.linalg.pinv(NOT_OBSERVED) @ NOT_OBSERVED"]
        return "\n".join(lines)

    @property
    def _given(self) -> str:
        return "" if self.scanned is None else f", {self.scanned.word}: float = {self.scanned.python}"

    def _columns(self) -> str:
        head = [
            f"def _columns(m: Movement{self._given}) -> np.ndarray:",
            f'    """(N, 3, {self.form.size}): what one of each coefficient adds."""',
        ]
        *lines, last = self.lines
        if len(self.law.unobserved):
            last = f"return {last.removeprefix('return ')} @ OBSERVED"
        return "\n".join(head) + "\n" + indent("\n".join([*lines, last]), "    ")

    def _correct(self) -> str:
        if not jumps(self.form):
            return ""
        own = "" if self.scanned is None else f", {self.scanned.word}"
        more = f", {self.passes}" if (self.passes or PASSES) != PASSES else ""
        return dedent(f'''\
            def _correct(measured: np.ndarray, m: Movement, theta: np.ndarray{self._given}) -> np.ndarray:
                """Where it jumps, a reading may belong to two rates: the one that goes on smoothly."""
                return undone_with_jumps(measured, m, lambda moved: _columns(moved{own}) @ theta{more})''')

    def _at(self) -> str:
        if self.scanned is None:
            return ""
        word = self.scanned.word
        given = [f"columns=lambda m: _columns(m, {word})"]
        given += [f"reach={self._reach(word)}"] if self.scanned.lag else []
        given += [f"exact_correct=lambda measured, m, theta: _correct(measured, m, theta, {word})"] if jumps(self.form) else []
        if self.functions:
            given += [f"device=replace(EFFECT.device, constants=lambda theta, known: _constants(theta, known, {word}))"]
        made = f"replace(EFFECT, {', '.join(given)})"
        if len(made) > WIDTH - 20:
            made = "replace(\n" + indent(",\n".join(["EFFECT", *given]) + ",\n", 8 * " ") + "    )"
        head = f'def _at({word}: float) -> Effect:\n    """The law with another {word}."""\n    return {made}\n\n\n'
        return head + dedent(f'''\
            def _grid(movements) -> np.ndarray:
                """Where another unit's own {word} is looked for."""
                return {self.scanned.python} * np.array([{GRID}])''')

    def _effect(self) -> str:
        form, shape = self.form, self.shape
        size = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
        plausible = PLAUSIBLE * rms_of(self.law.theta) / DEG
        (unit, parameter), reach, own = coefficient_unit(form), self._reach(None), "" if self.scanned is None else "lambda m: "
        lines = [
            f'id="discovered.{self.name}",',
            *_text("equation=", self._anywhere(equation(form)), ","),
            f'parameter=Parameter("{parameter}", {size}, "{unit}", DEG, plausible={plausible:.{DIGITS}g} * DEG),',
            f"observable_in={_tuple(observable_in(form))},",
            f"columns={own}_columns(m)," if own else "columns=_columns,",
            "describe=lambda theta: (",
            f'    f"{{abs(largest(theta)) / DEG:.3g}} {unit} on {{axis_of(theta)}}: "',
            *(f"    {line}" for line in _pieces(self._anywhere(follows(form)))),
            "),",
            *_text("discriminating_motion=", splits(form), ","),
        ]
        lines += [f"inputs={_tuple(inputs)},"] if (inputs := form.inputs) else []
        lines += [f"reach={reach},"] if reach else []
        lines += [f"passes={self.passes},"] if not self.jumps and (self.passes or PASSES) != PASSES else []
        if jumps(form):
            correct = "_correct" if self.scanned is None else "lambda measured, m, theta: _correct(measured, m, theta)"
            lines += [f"exact_correct={correct},"]
        lines += [f"conditions={_tuple(regime(form))},"]
        if self.scanned is not None:
            si = f", si={self.scanned.times.removeprefix(' * ')}" if self.scanned.times else ""
            lines += [f'scan=Scan("{self.scanned.json}", "{self.scanned.unit or "fraction"}", make=_at{si}, grid=_grid, smooth=True),']
        if self.fixed:
            given = {"FULL_SCALE_RPS": "fs_rps", "FIRST_TEMP_C": "first_temp_c"}
            lines += [f"reference_conditions=ReferenceConditions({', '.join(f'{given[name]}={name}' for name in self.fixed)}),"]
        if len(self.law.unobserved):
            lines += ["gauge_convention=Convention(settle=lambda theta: OBSERVED @ theta, slope=lambda theta: OBSERVED),"]
        sigma = None if self.scanned is None else self.scanned.sigma
        known = "" if self.scanned is None or sigma is None else f", ({self.scanned.python}, {sigma:.3g}{self.scanned.times})"
        lines += [f"stated=StatedNumbers(COEFFICIENTS, COVARIANCE{known}),"]
        lines += [f"known_to={share},"] if (share := known_to(form)) else []
        lines += ["picture=SCALE_LAW,"] if _is_scale_law(form) else []
        lines += f"device={self.device},".split("\n")
        return "EFFECT = Effect(\n" + indent("\n".join(lines), "    ") + "\n)"

    def _anywhere(self, text: str) -> str:
        """Reword text about one session so that it holds in any."""
        if "FULL_SCALE_RPS" in self.fixed:
            dps = f"{self.at['FULL_SCALE_RPS'][0] / DEG:.6g} dps"
            text = text.replace("ω / FS", f"ω / ({dps})").replace("of full scale", f"of {dps}")
        if "FIRST_TEMP_C" in self.fixed:
            first = f"{self.at['FIRST_TEMP_C'][0]:g} °C"
            text = text.replace("T in °C", f"T in °C, T₀ = {first}").replace("since the session's beginning", f"above {first}")
        return text

    def _reach(self, lag: str | None) -> str:
        """Python source of how far it looks around; lag: the name of its lag in the file, else that of the lag's constant."""
        parts = [f"signals.lag_reach({lag or constant.python})" for constant in self.constants if constant.lag]
        parts += [_source(reach) for reach in reaches_of(self.form)]
        parts = list(dict.fromkeys(parts))
        if not jumps(self.form):
            return " + ".join(parts)
        # Each pass of an inversion looks back once more; a reach to the log's beginning does not grow.
        parts = ["signals.WHOLE"] if "signals.WHOLE" in parts else [f"{part}.times({(self.passes or PASSES) + 2})" for part in parts]
        return " + ".join([*parts, "JUMPS_REACH"])


#: docstring text of a law that ``correct`` does not remove
TOO_STRONG = (
    f"it is so strong, beside how fast it follows, that {MOST_PASSES} passes of substitution do not take it off: the proof of an effect "
    "(undo) says how much a calibration leaves; write an exact_correct if that is too much"
)


def at_of(where: Where) -> dict[str, tuple[float, str]]:
    """Constant of a file -> its value and the Python that defines it: the law's reference conditions."""
    found: dict[str, tuple[float, str]] = {}
    if (dps := where.full_scale_dps) is not None and isfinite(dps):
        dps = float(f"{dps:.9g}")
        line = f"#: of the session where it was found: what the law calls FS, in every session\nFULL_SCALE_RPS = {dps!r} * DEG"
        found["FULL_SCALE_RPS"] = (dps * DEG, line)
    if (first_c := where.first_temp_c) is not None and isfinite(first_c):
        first_c = round(first_c, 3)
        line = f"#: °C, at that session's first sample: what the law calls T₀, in every session\nFIRST_TEMP_C = {first_c!r}"
        found["FIRST_TEMP_C"] = (first_c, line)
    return found


#: names of ``tinygc.effects`` that a file may use in addition to ``Effect`` and ``Movement``
USED = (
    *("NEIGHBOURS", "Conditions", "Convention", "Cost", "ReferenceConditions", "NoC", "Parameter", "Reach", "Scan", "StageC"),
    *("StatedNumbers", "axis_of", "before", "behind", "cross", "diagonal", "full", "largest", "rows", "signals", "without_vibration"),
)


def _from(module: str, names: Sequence[str]) -> list[str]:
    """An import statement, names in a formatter's order."""
    ordered = sorted(names, key=lambda name: (not name.isupper(), not name[0].isupper(), name))
    line = f"from {module} import {', '.join(ordered)}"
    if len(line) <= WIDTH:
        return [line]
    return [f"from {module} import (", *(f"    {name}," for name in ordered), ")"]


def _text(name: str, text: str, end: str) -> list[str]:
    """A text argument, on one line or in brackets."""
    pieces = _pieces(text)
    return [f"{name}{pieces[0]}{end}"] if len(pieces) == 1 else [f"{name}(", *(f"    {piece}" for piece in pieces), f"){end}"]


def _pieces(text: str) -> list[str]:
    """The text as consecutive string literals."""
    lines = wrap(text, WIDTH - 20)
    return [f'"{line}{" " if number < len(lines) - 1 else ""}"' for number, line in enumerate(lines)]


def _array(values: np.ndarray) -> str:
    """Python of an array, to ``KNOWN`` digits, a matrix row by row."""
    given = np.vectorize(lambda value: float(f"{value:.{KNOWN}g}") + 0.0, otypes=[float])(values).tolist()
    rows = [repr(row) for row in given] if np.ndim(values) == 2 else []
    if not rows:
        return f"np.array({given!r})"
    lines = [line for row in rows for line in wrap(f"{row},", WIDTH - 8)]
    return "np.array(\n    [\n" + "\n".join(f"        {line}" for line in lines) + "\n    ]\n)"


def _rows(values: np.ndarray) -> str:
    """Python of a small matrix, to the digits of a weight."""
    return "[" + ", ".join("[" + ", ".join(f"{value:.{WEIGHTS}f}" for value in row) + "]" for row in values) + "]"


def _tuple(names: Sequence[str]) -> str:
    inside = ", ".join(f'"{name}"' for name in names)
    return f"({inside}{',' if len(names) == 1 else ''})"


def reaches_of(form: LawForm) -> list[Reach]:
    """Reaches of the form's quantities and functions, without its lags."""
    found = [factor.of.reach for factor in form.factors if factor.of.reach]
    return found + ([signals.WHOLE] if any(factor.through.memory for factor in form.factors) else [])


def _source(reach: Reach) -> str:
    """Python source of a reach."""
    named = {getattr(signals, name): f"signals.{name}" for name in ("SLOPE", "WHOLE", "DERIVATIVE")} | {NEIGHBOURS: "NEIGHBOURS"}
    around = Reach.around(reach.before_samples, reach.before_s) == reach
    given = {"samples": reach.before_samples, "seconds": reach.before_s} if around else vars(reach)
    call = "Reach.around" if around else "Reach"
    return named.get(reach) or f"{call}({', '.join(f'{name}={value!r}' for name, value in given.items() if value)})"


def _is_scale_law(form: LawForm) -> bool:
    """Whether each axis has one coefficient that multiplies its own rate, without memory."""
    if form.pattern != "each" or form.size != 3 or reaches_of(form) or any(factor.lag_s is not None for factor in form.factors):
        return False
    return sum(factor.quantity == "rate" and factor.through.odd for factor in form.factors) == 1
