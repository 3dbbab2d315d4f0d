"""Write a law as Python and as C for a device."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import indent

from tinygc.effects.device import MOST_PASSES, PASSES
from tinygc.features.discovery.form import Factor, LawForm
from tinygc.features.discovery.words import Constant, constants_of, jumps

# A form's columns as readable Python: its quantities by name, their products, and the axes that they add to.

ONE, OTHER = "one", "other"


#: a session's property -> the constant of a file that holds it for the session where the law was found
SESSIONS_OWN = {"m.fs_rps": "FULL_SCALE_RPS", "m.first_temp_c": "FIRST_TEMP_C"}


def law_code(form: LawForm, scanned: Constant | None = None, fixed: Sequence[str] = ()) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Python of the form's columns: lines of a function of ``m``, the last of which returns them; and the parameter's shape.

    scanned: the constant that is an argument of the function and no constant of the module; fixed: the
    ``SESSIONS_OWN`` that are constants of the module."""
    constants = constants_of(form)
    names = [factor.quantity for factor in form.factors]
    single = len(names) == 1
    lines = []
    for number, factor in enumerate(form.factors):
        own = {c.lag: (c.word if scanned is not None and c.python == scanned.python else c.python) for c in constants if c.of == number}
        variable = "law" if single else (ONE, OTHER)[number]
        if factor.quantity not in names[:number]:
            unit = "" if factor.of.unit == "1" else f", {factor.of.unit}"
            source = factor.of.source
            for of_session, constant in SESSIONS_OWN.items():
                source = source.replace(of_session, constant if constant in fixed else of_session)
            lines.append(f"{factor.quantity} = {source}  # {factor.of.words}{unit}")
        made = re.sub(r"\b[xc]\b", lambda found: factor.quantity if found[0] == "x" else own[False], factor.through.source)  # noqa: B023
        if factor.lag_s is not None:
            made = f"signals.lagged({made}, {own[True]}, m.t_s)"
        lines.append(f"{variable} = {made}")
    more, columns = ([], _one(form)) if single else _two(form)
    lines, columns = _shorter([*lines, *more], columns)
    per_axis = form.size // 3
    return (*lines, f"return {columns}"), (3,) if per_axis == 1 else (3, per_axis)


def _shorter(lines: list[str], columns: str) -> tuple[list[str], str]:
    """Drop a name for an expression that has one already and is used in the last line alone."""
    for variable in ("law", ONE, OTHER):
        plain = next((line for line in lines if re.fullmatch(rf"{variable} = \w+", line)), None)
        used = sum(len(re.findall(rf"\b{variable}\b", line)) for line in lines)
        if plain is not None and used == 1:
            lines = [line for line in lines if line != plain]
            columns = re.sub(rf"\b{variable}\b", plain.split(" = ")[1], columns)
    return lines, columns


def _one(form: LawForm) -> str:
    (factor,) = form.factors
    if factor.each == 1:
        return {"each": "diagonal(law)", "full": "full(law)", "cross": "cross(law)"}[form.pattern]
    if form.pattern == "cross":
        parts = [part if _is_flat(factor) else f"{part}.reshape(len(law), 3, -1)" for part in ("behind(law)", "before(law)")]
        return f"rows(np.concatenate([{', '.join(parts)}], axis=2))"
    if form.pattern == "full":
        return "rows(law.reshape(len(law), 1, -1))"
    return "rows(law.reshape(len(law), 3, -1))" if factor.vector and not _is_flat(factor) else f"rows({_by_axis(factor, 'law')})"


def _is_flat(factor: Factor) -> bool:
    """Whether its values are (N, 3, K) or, of a scalar, (N, K): directions or phases, not both."""
    return factor.of.directions == 1 or factor.through.phases == 1


def _by_axis(factor: Factor, name: str) -> str:
    """Source with the shape (N, 3 or 1, K)."""
    if factor.each == 1:
        return f"{name}[:, :, None]" if factor.vector else f"{name}[:, None, None]"
    if factor.vector:
        return name if _is_flat(factor) else f"{name}.reshape(len({name}), 3, -1)"
    return f"{name}[:, None]"


def _two(form: LawForm) -> tuple[list[str], str]:
    """Lines before the last, and the columns, of a form of two factors."""
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


def _neighbour(form: LawForm, number: int, name: str) -> str:
    first = (form.pattern == "next") == (number == 0)
    return f"{'behind' if first else 'before'}({name})"


# The C of a law that a device can invert, with the NumPy that does the same in single precision; or the reason why there is none.
#
# A device knows the rate and the temperature of the sample.  Only sums, products and comparisons give the same bits in single precision on
# every processor, so a law of other functions has no C.

#: quantity -> why a device cannot compute it
WHY_NOT = {
    **dict.fromkeys(("level", "world"), "it follows the heading, which the device does not know"),
    **dict.fromkeys(("acceleration", "acceleration_size", "speed_slope", "jerk", "vibration"), "it needs samples that are yet to come"),
    "time": "it belongs to the time of that one session",
    "turned": "it follows the angle turned since its session began",
    **dict.fromkeys(("rest", "sense"), "it follows its session from the beginning"),
    "force": "it follows a mean of the force, to which samples belong that are yet to come",
    "temperature_rate": "it follows the last ten seconds of the temperature, and C is not told the data rate",
    "rate_size": "it asks for a square root, which C has no code for here",
}
SIZE = "({x} < 0.0f ? -{x} : {x})"
HELD = "({x} < -{k} ? -{k} : ({x} > {k} ? {k} : {x}))"
#: function -> C, NumPy, and its cost: products, sums, comparisons; {x} its argument, {k} its constant
FUNCTIONS = {
    "itself": ("{x}", "{x}", (0, 0, 0)),
    "size": (SIZE, "np.abs({x})", (0, 0, 1)),
    "square": ("({x} * {x})", "({x} * {x})", (1, 0, 0)),
    "signed_square": (f"({{x}} * {SIZE})", "({x} * np.abs({x}))", (1, 0, 1)),
    "cube": ("({x} * {x} * {x})", "({x} * {x} * {x})", (2, 0, 0)),
    "size_cube": (f"({{x}} * {{x}} * {SIZE})", "({x} * {x} * np.abs({x}))", (2, 0, 1)),
    "dead_zone": (f"({{x}} - {HELD})", "({x} - np.clip({x}, -{k}, {k}))", (0, 1, 2)),
    "within": (HELD, "np.clip({x}, -{k}, {k})", (0, 0, 2)),
    "excess": (f"({SIZE} > {{k}} ? {SIZE} - {{k}} : 0.0f)", "np.maximum(np.abs({x}) - {k}, np.float32(0))", (0, 1, 3)),
    "beyond": (f"({SIZE} > {{k}} ? 1.0f : 0.0f)", "(np.abs({x}) > {k}).astype(np.float32)", (0, 0, 2)),
}


def why_not(form: LawForm) -> str:
    """Why a device cannot invert it, or empty."""
    for factor in form.factors:
        if factor.quantity in WHY_NOT:
            return WHY_NOT[factor.quantity]
    if any(factor.lag_s is not None for factor in form.factors):
        return "it remembers by a lag, and C is not told the data rate"
    if any(factor.through.memory for factor in form.factors):
        return "it follows its session from the beginning"
    if jumps(form):
        return "where it jumps a reading may belong to two rates, which takes the samples before to tell"
    if any(factor.function not in FUNCTIONS for factor in form.factors):
        return "it asks for a root, an exponential or a sine, whose last bits differ from one processor to another"
    return ""


def device_code(
    form: LawForm, constants: Sequence[Constant], name: str, passes: int | None = PASSES, fixed: Sequence[str] = ()
) -> tuple[str, str]:
    """Python of the ``device`` of a form whose constants have these names, and the functions that it uses, to be defined above it.

    name: of the law; passes: that invert it, or None; fixed: as ``law_code``.
    """
    if why := why_not(form):
        return f'NoC("{why}")', ""
    if passes is None:
        return f'NoC("it is so strong that {MOST_PASSES} passes do not undo it")', ""
    return _Code(form, constants, name, passes, fixed).all()


#: a factor's argument, in C and in NumPy: the rate as a share of full scale, or the temperature since the first sample
OF = {"rate": "u", "temperature": "t"}


class _Code:
    """The C of one law, and its NumPy.

    x and y are the factors, k the coefficients, w the rate without the law, found in fixed-point passes where the law follows it.
    """

    def __init__(self, form: LawForm, constants: Sequence[Constant], name: str, passes: int, fixed: Sequence[str]):
        #: prefix of the constants in C, unique among the stages of a program
        self.form, self.name, self.c = form, name, f"LAW_{name.upper()}"
        self.own = {constant.of: constant for constant in constants}
        self.quantities = {factor.quantity for factor in form.factors}
        self.passes = passes if "rate" in self.quantities else 1
        self.full_scale = "FULL_SCALE_RPS" if "FULL_SCALE_RPS" in fixed else "known.fs_rps"
        self.first_temp = "FIRST_TEMP_C" if "FIRST_TEMP_C" in fixed else "known.first_temp_c"

    def all(self) -> tuple[str, str]:
        """The device stage of a law and the functions that it uses."""
        given = [f'formula="r -= the law discovered.{self.name}"', "body=_BODY", "constants=_constants", "numpy=_single"]
        source = "\n".join(["StageC(", *(f"    {each}," for each in [*given, f"cost={self._cost()}"]), ")"])
        body = '_BODY = """\\\n' + "\n".join(self._c()) + '"""'
        head = 'def _single(c: dict, rate: np.ndarray, inputs) -> np.ndarray:\n    """What the C does, in single precision."""\n'
        return source, "\n\n\n".join([body, self._constants(), head + indent("\n".join(self._numpy()), "    ")])

    def _c(self) -> list[str]:
        lines = [f"const float *k = {self.c};"]
        lines += [f"const float {a} = {self.c}_{self.own[n].python}[0];" for n, a in self._letters.items()]
        lines += [f"const float t = in->temp_c - {self.c}_AT_C[0];"] if "temperature" in self.quantities else []
        lines += ["float w[3] = {r[0], r[1], r[2]};"]
        inner = [f"float {letter}[3];" for letter in "xy"[: len(self.form.factors)]]
        if "rate" in self.quantities:
            inner += [f"const float s = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2] - {self.c}_STILL[0]) * {self.c}_TURNS[0];"]
            inner += ["const float m = s < 0.0f ? 0.0f : (s > 1.0f ? 1.0f : s);"]
        made = [f"const float u = m * w[i] * {self.c}_PER_FS[0];"] if "rate" in self.quantities else []
        made += [f"{'xy'[number]}[i] = {text};" for number, text in enumerate(self._factors(0))]
        inner += ["for (int i = 0; i < 3; i++) {", *(f"    {line}" for line in made), "}"]
        inner += [f"w[{axis}] = r[{axis}] - ({' + '.join(self._products(axis))});" for axis in range(3)]
        lines += [f"for (int pass = 0; pass < {self.passes}; pass++) {{", *(f"    {line}" for line in inner), "}"]
        return [*lines, "for (int i = 0; i < 3; i++)", "    r[i] = w[i];"]

    def _products(self, axis: int) -> list[str]:
        """Products of one axis, in the order of their sum."""
        numbered = [(number, parts) for number, (own, parts) in enumerate(self.form.terms()) if own == axis]
        return [
            f"k[{number}] * {_product([f'{letter}[{j}]' for letter, (_, j) in zip('xy', parts, strict=False)])}"
            for number, parts in numbered
        ]

    def _numpy(self) -> list[str]:
        lines = [f'k = c["{self.c}"]']
        lines += [f'{a} = c["{self.c}_{self.own[n].python}"]' for n, a in self._letters.items()]
        lines += [f't = (inputs.temp_c - c["{self.c}_AT_C"])[:, None]'] if "temperature" in self.quantities else []
        inner = []
        if "rate" in self.quantities:
            size = " + ".join(f"w[:, {part}] * w[:, {part}]" for part in (":1", "1:2", "2:"))
            inner += [f's = ({size} - c["{self.c}_STILL"]) * c["{self.c}_TURNS"]', "m = np.clip(s, np.float32(0), np.float32(1))"]
            inner += [f'u = m * w * c["{self.c}_PER_FS"]']
        inner += [f"{'xy'[number]} = {text}" for number, text in enumerate(self._factors(1))]
        terms, each = self.form.terms(), self.form.size // 3
        picked = [
            f"{letter}[:, {[parts[number][1] for _, parts in terms]}]" for number, letter in enumerate("xy"[: len(self.form.factors)])
        ]
        inner += [f"added = k * {_product(picked)}"]
        inner += ["w = rate - " + ("added" if each == 1 else f"({' + '.join(f'added[:, {n}::{each}]' for n in range(each))})")]
        if self.passes == 1:
            return [*lines, *inner, "return w"]
        return [*lines, "w = rate", f"for _ in range({self.passes}):", *(f"    {line}" for line in inner), "return w"]

    def _constants(self) -> str:
        """Name in C -> value: the coefficients and the constants of their factors."""
        given = [f'"{self.c}": theta']
        if "rate" in self.quantities:
            given += [f'"{self.c}_PER_FS": np.array([1 / {self.full_scale}])', f'"{self.c}_STILL": np.array([signals.MOVING_RPS**2])']
            turns = "1 / (signals.FULLY_MOVING_RPS**2 - signals.MOVING_RPS**2)"
            given += [f'"{self.c}_TURNS": np.array([{turns}])']
        given += [f'"{self.c}_AT_C": np.array([{self.first_temp}])'] if "temperature" in self.quantities else []
        own, arguments = list(self.own.values()), "theta: np.ndarray, known: Conditions"
        if len(own) == 1:
            arguments += f", {own[0].word}: float = {own[0].python}"
        given += [f'"{self.c}_{each.python}": np.array([{each.word if len(own) == 1 else each.python}])' for each in own]
        head = f'def _constants({arguments}) -> dict:\n    """What the C holds."""\n    return {{\n'
        return head + "".join(f"        {each},\n" for each in given) + "    }"

    @property
    def _letters(self) -> dict[int, str]:
        """Number of a factor -> its constant's name in the code."""
        return {number: "ab"[number] for number in self.own}

    def _factors(self, language: int) -> list[str]:
        """Each factor through its function; language: 0 C, 1 NumPy."""
        texts = []
        for number, factor in enumerate(self.form.factors):
            text = FUNCTIONS[factor.function][:2][language]
            texts.append(text.format(x=OF[factor.quantity], k=self._letters.get(number, "")))
        return [text[1:-1] if text.startswith("(") and text.endswith(")") and _closes(text) else text for text in texts]

    def _cost(self) -> str:
        """Cost of one sample."""
        products, sums, compares = (3 * sum(FUNCTIONS[factor.function][2][k] for factor in self.form.factors) for k in range(3))
        rate, size = int("rate" in self.quantities), self.form.size
        products += size * len(self.form.factors) + 10 * rate
        sums, compares = sums + size + 3 * rate, compares + 2 * rate
        warm = int("temperature" in self.quantities)
        return f"Cost({self.passes * products}, {self.passes * sums + warm}, {self.passes * compares})"


def _product(parts: list[str]) -> str:
    return f"({' * '.join(parts)})" if len(parts) > 1 else parts[0]


def _closes(text: str) -> bool:
    """Whether its first bracket matches its last."""
    depth = 0
    for sign in text[:-1]:
        depth += (sign == "(") - (sign == ")")
        if not depth:
            return False
    return True
