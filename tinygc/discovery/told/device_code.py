"""The C of a law that a device can undo, with the NumPy that does the same in single precision; or the reason why there is none.

A device knows the rate and the temperature of the sample.  What single precision gives to the last bit on any processor is sums,
products and comparisons: a law of other functions has no C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import indent

from tinygc.discovery.grammar.form import Factor, Form
from tinygc.discovery.told import said
from tinygc.discovery.told.constants import Constant
from tinygc.effects.device import PASSES

#: quantity -> why a device cannot follow it
WHY_NOT = {
    "level": "it follows the heading, which the device does not know",
    "world": "it follows the heading, which the device does not know",
    "acceleration": "it needs samples that are yet to come",
    "jerk": "it needs samples that are yet to come",
    "vibration": "it needs samples that are yet to come",
    "time": "it belongs to the time of that one session",
    "turned": "it follows the angle turned since its session began",
    "rest": "it follows its session from the beginning",
    "sense": "it follows its session from the beginning",
    "force": "it follows a mean of the force, to which samples belong that are yet to come",
    "temperature_rate": "it follows the last ten seconds of the temperature, and C is not told the data rate",
    "rate_size": "it asks for a square root, which C has no code for here",
}
SIZE = "({x} < 0.0f ? -{x} : {x})"
HELD = "({x} < -{k} ? -{k} : ({x} > {k} ? {k} : {x}))"
#: function -> C, NumPy, and what it costs: products, sums, comparisons; {x} what it is of, {k} its constant
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


@dataclass(frozen=True)
class DeviceCode:
    """source: Python of the effect's ``device``; functions: what it uses, to stand above."""

    source: str
    functions: str = ""


def why_not(form: Form) -> str:
    """Why a device cannot undo it, or nothing."""
    for factor in form.factors:
        if factor.quantity in WHY_NOT:
            return WHY_NOT[factor.quantity]
    if any(factor.lag_s is not None for factor in form.factors):
        return "it remembers by a lag, and C is not told the data rate"
    if any(factor.through.memory for factor in form.factors):
        return "it follows its session from the beginning"
    if said.jumps(form):
        return "where it jumps a reading may belong to two rates, which takes the samples before to tell"
    if any(factor.function not in FUNCTIONS for factor in form.factors):
        return "it asks for a root, an exponential or a sine, whose last bits differ from one processor to another"
    return ""


def device_code(form: Form, constants: Sequence[Constant], name: str) -> DeviceCode:
    """Of a form whose constants have these names; name: of the law."""
    if why := why_not(form):
        return DeviceCode(f'NoC("{why}")')
    return _Code(form, constants, name).all()


class _Code:
    """The C of one law."""

    def __init__(self, form: Form, constants: Sequence[Constant], name: str):
        self.form, self.name, self.c = form, name, name.upper()
        self.own = {constant.of: constant for constant in constants}
        self.of_rate = any(factor.quantity == "rate" for factor in form.factors)
        self.of_temperature = any(factor.quantity == "temperature" for factor in form.factors)

    def all(self) -> DeviceCode:
        """For one coefficient of each axis that multiplies what that axis has, a term; for any other, statements."""
        return self._term() if self.form.pattern == "each" and self.form.size == 3 else self._stage()

    def _term(self) -> DeviceCode:
        factors = [self._c(factor, number, "w") for number, factor in enumerate(self.form.factors)]
        arrays = [self._numpy(factor, number) for number, factor in enumerate(self.form.factors)]
        product, same = (" * ".join(parts) for parts in (factors, arrays))
        product, same = (f"({text})" if len(factors) > 1 else text for text in (product, same))
        lines = [f'return c["{self.c}"] * {same}']
        costs = self._costs(1 + len(factors) - 1, 1)
        source = "\n".join(
            [
                "PerAxisC(",
                f'    name="{self.c}",',
                f'    says="r -= the law discovered.{self.name}",',
                *(f"    {line}" for line in _strings("term=", f"{self.c}[i] * {product}")),
                "    constants=_constants,",
                "    numpy=_single,",
                f"    cost=Cost({costs}),",
                *([] if self.of_rate else ["    passes=1,"]),
                ")",
            ]
        )
        return DeviceCode(source, f"{self._constants()}\n\n\n{self._function('w', lines)}")

    def _stage(self) -> DeviceCode:
        passes = PASSES if self.of_rate else 1
        rows, same = [], []
        for axis in range(3):
            parts, others = [], []
            for number, term in enumerate(self.form.terms()):
                if term.axis != axis:
                    continue
                parts.append(f"{self.c}[{number}] * " + _product([f"{'xy'[k]}[{j}]" for k, (_, j) in enumerate(term.parts)]))
                others.append(f'c["{self.c}"][{number}] * ' + _product([f"{'xy'[k]}[:, {j}]" for k, (_, j) in enumerate(term.parts)]))
            rows.append(f"w[{axis}] = r[{axis}] - ({' + '.join(parts)});")
            same.append(f"{' + '.join(others)},")
        vectors = []
        for number, factor in enumerate(self.form.factors):
            letter, made = "xy"[number], self._c(factor, number, "w[i]")
            vectors.append(f"float {letter}[3];\nfor (int i = 0; i < 3; i++)\n    {letter}[i] = {made};")
        inner = "\n".join([*vectors, *rows])
        body = ["float w[3] = {r[0], r[1], r[2]};", f"for (int pass = 0; pass < {passes}; pass++) {{", indent(inner, "    "), "}"]
        body += ["for (int i = 0; i < 3; i++)", "    r[i] = w[i];"]
        lines = ["w = rate", f"for _ in range({passes}):"]
        for number, factor in enumerate(self.form.factors):
            lines.append(f"    {'xy'[number]} = np.broadcast_to({self._numpy(factor, number)}, w.shape)")
        lines += ["    added = [", *(f"        {line}" for line in same), "    ]", "    w = rate - np.stack(added, axis=1)", "return w"]
        size = self.form.size
        costs = self._costs(size * len(self.form.factors), size, 3, passes)
        says = f'says="r -= the law discovered.{self.name}"'
        given = [says, "body=_BODY", "constants=_constants", "numpy=_single", f"cost=Cost({costs})"]
        source = "\n".join(["StageC(", *(f"    {each}," for each in given), ")"])
        text = '_BODY = """\\\n' + "\n".join(body) + '"""'
        return DeviceCode(source, f"{text}\n\n\n{self._constants()}\n\n\n{self._function('rate', lines)}")

    def _constants(self) -> str:
        """Name in C -> value: the coefficients, and what they multiply is made of."""
        given = [f'"{self.c}": theta']
        given += [f'"{self.c}_PER_FS": np.array([1 / known.fs_rps])'] if self.of_rate else []
        given += [f'"{self.c}_AT_C": np.array([known.first_temp_c])'] if self.of_temperature else []
        arguments = "theta: np.ndarray, known: Conditions"
        if len(self.own) == 1:
            (one,) = self.own.values()
            arguments += f", {one.word}: float = {one.python}"
        given += [f'"{self.c}_{constant.python}": np.array([{self._value(constant)}])' for constant in self.own.values()]
        return f'def _constants({arguments}) -> dict:\n    """What the C holds."""\n    return {{{", ".join(given)}}}'

    def _value(self, constant: Constant) -> str:
        return constant.word if len(self.own) == 1 else constant.python

    def _function(self, rate: str, lines: list[str]) -> str:
        head = f"def _single(c: dict, {rate}: np.ndarray, inputs) -> np.ndarray:\n" + '    """What the C does, in single precision."""\n'
        return head + indent("\n".join([*self._quantities(rate), *lines]), "    ")

    def _quantities(self, rate: str) -> list[str]:
        return [f'temperature = (inputs.temp_c - c["{self.c}_AT_C"])[:, None]'] if self.of_temperature else []

    def _c(self, factor: Factor, number: int, rate: str) -> str:
        x = f"({rate} * {self.c}_PER_FS[0])" if factor.quantity == "rate" else f"(in->temp_c - {self.c}_AT_C[0])"
        constant = self.own.get(number)
        return FUNCTIONS[factor.function][0].format(x=x, k="" if constant is None else f"{self.c}_{constant.python}[0]")

    def _numpy(self, factor: Factor, number: int) -> str:
        x = f'(w * c["{self.c}_PER_FS"])' if factor.quantity == "rate" else "temperature"
        constant = self.own.get(number)
        return FUNCTIONS[factor.function][1].format(x=x, k="" if constant is None else f'c["{self.c}_{constant.python}"]')

    def _costs(self, multiply: int, add: int, times: int = 1, passes: int = 1) -> str:
        products, sums, compares = (sum(FUNCTIONS[factor.function][2][k] for factor in self.form.factors) for k in range(3))
        products, sums = products + self.of_rate, sums + self.of_temperature
        numbers = [passes * (times * inner + outer) for inner, outer in ((products, multiply), (sums, add), (compares, 0))]
        return ", ".join(map(str, numbers))


def _product(parts: list[str]) -> str:
    return f"({' * '.join(parts)})" if len(parts) > 1 else parts[0]


def _strings(name: str, text: str) -> list[str]:
    """An argument that is a text, in pieces where it is long."""
    pieces, line = [], ""
    for word in text.split(" "):
        if len(line) + len(word) > 90:
            pieces.append(line)
            line = ""
        line += f"{word} "
    pieces.append(line.rstrip())
    return [f'{name}"{pieces[0]}",'] if len(pieces) == 1 else [f"{name}(", *(f'    "{piece}"' for piece in pieces), "),"]
