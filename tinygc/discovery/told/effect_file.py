"""A law as a complete effect file, such as a person would write it: text alone, nothing of a recording in it is ever code."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import dedent, indent

from session.common.units import DEG
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.judge.answer import Law
from tinygc.discovery.told import said
from tinygc.discovery.told.constants import Constant, constants_of, rounded
from tinygc.discovery.told.evidence_text import Where, docstring
from tinygc.discovery.told.law_code import LawCode, law_code
from tinygc.effects import NEIGHBOURS, Effect, Reach, signals

#: digits of the plausible size: a prior, not a bar
DIGITS = 2
#: of the constant that was found: where another unit's own is looked for
GRID = "0.5, 0.63, 0.8, 1, 1.25, 1.6, 2"


def written(law: Law, where: Where, name: str | None = None) -> str:
    """The file of a law; name: behind ``discovered.`` in its id, where it is another than the form's own."""
    form = rounded(law.form, law.constants_sigma)
    constants = constants_of(law.form, law.constants_sigma)
    scanned = constants[0] if len(constants) == 1 else None
    code = law_code(form, scanned)
    parts = [f'"""{docstring(law, where)}\n"""', _imports(form, code, scanned), _constants(constants)]
    parts += [_columns(code, scanned), _at(form, scanned), _effect(law.effect, form, code, scanned, name or said.what(form))]
    return "\n\n".join(part for part in parts[:3] if part) + "\n\n\n" + "\n\n\n".join(part for part in parts[3:] if part) + "\n"


def _imports(form: Form, code: LawCode, scanned: Constant | None) -> str:
    names = {"Effect", "Movement", "NoC", "Parameter", "axis_of", "largest", *code.helpers}
    names |= {"signals"} if "signals." in "".join(code.lines) + _reach(form, None) else set()
    names |= {"Scan"} if scanned is not None else set()
    names |= {name for name in ("Reach", "NEIGHBOURS") if name in _reach(form, None)}
    lines = ["from dataclasses import replace\n"] if scanned is not None else []
    lines += [
        "import numpy as np\n",
        "from session.common.units import DEG",
        f"from tinygc.effects import {', '.join(sorted(names, key=_order))}",
    ]
    lines += ["from tinygc.effects.picture import SCALE_LAW"] if _is_scale_law(form) else []
    return "\n".join(lines)


def _order(name: str) -> tuple[bool, bool, str]:
    return (not name.isupper(), not name[0].isupper(), name)


def _constants(constants: Sequence[Constant]) -> str:
    lines = []
    for constant in constants:
        unit = constant.unit or "of full scale"
        sigma = "sigma not known" if constant.sigma is None else f"sigma {constant.sigma:.2g}"
        lines += [f"#: {unit}, {sigma}", f"{constant.python} = {constant.source}"]
    return "\n".join(lines)


def _columns(code: LawCode, scanned: Constant | None) -> str:
    given = "" if scanned is None else f", {scanned.word}: float = {scanned.python}"
    size = code.shape[0] if len(code.shape) == 1 else code.shape[0] * code.shape[1]
    head = f'def _columns(m: Movement{given}) -> np.ndarray:\n    """(N, 3, {size}): what one unit of each coefficient adds."""'
    return head + "\n" + indent("\n".join(code.lines), "    ")


def _at(form: Form, scanned: Constant | None) -> str:
    if scanned is None:
        return ""
    further = f", reach={_reach(form, scanned.word)}" if scanned.lag else ""
    return dedent(f'''\
        def _at({scanned.word}: float) -> Effect:
            """The law with another {scanned.word}."""
            return replace(EFFECT, columns=lambda m: _columns(m, {scanned.word}){further})


        def _grid(movements) -> np.ndarray:
            """Where another unit's own {scanned.word} is looked for."""
            return {scanned.python} * np.array([{GRID}])''')


def _effect(effect: Effect, form: Form, code: LawCode, scanned: Constant | None, name: str) -> str:
    unit, parameter = said.unit_of(form)
    shape = f"({', '.join(map(str, code.shape))}{',' if len(code.shape) == 1 else ''})"
    plausible = f"{effect.parameter.plausible / DEG:.{DIGITS}g} * DEG"
    inputs = tuple(dict.fromkeys(each for factor in form.factors for each in factor.of.inputs))
    lines = [
        f'id="discovered.{name}",',
        f'equation="{said.equation(form)}",',
        f'parameter=Parameter("{parameter}", {shape}, "{unit}", DEG, plausible={plausible}),',
        f"seen_in={_tuple(said.seen_in(form))},",
        "columns=_columns," if scanned is None else "columns=lambda m: _columns(m),",
        "says=lambda theta: (",
        f'    f"the rate\'s error on {{axis_of(theta)}} follows {said.in_words(form)}, "',
        f'    f"by {{abs(largest(theta)) / DEG:.3g}} {unit}: {said.splits(form)} to be sure of it"',
        "),",
        f'splits="{said.splits(form)}",',
    ]
    lines += [f"inputs={_tuple(inputs)},"] if inputs else []
    lines += [f"reach={reach},"] if (reach := _reach(form, None)) else []
    lines += [f"regime={_tuple(said.regime(form))},"]
    if scanned is not None:
        smooth = "" if form.factors[scanned.of].function == "beyond" and not scanned.lag else ", smooth=True"
        size = f", si={scanned.times.removeprefix(' * ')}" if scanned.times else ""
        lines += [f'scan=Scan("{scanned.json}", "{scanned.unit or "fraction"}", make=_at{size}, grid=_grid{smooth}),']
    lines += ["picture=SCALE_LAW,"] if _is_scale_law(form) else []
    lines += [f'device=NoC("{_why_no_c(form)}"),']
    return "EFFECT = Effect(\n" + indent("\n".join(lines), "    ") + "\n)"


def _tuple(names: Sequence[str]) -> str:
    inside = ", ".join(f'"{name}"' for name in names)
    return f"({inside}{',' if len(names) == 1 else ''})"


def _reach(form: Form, lag: str | None) -> str:
    """Python of how far it looks around; lag: the name that its lag has there, else its constant's."""
    parts = []
    for constant in constants_of(form):
        if constant.lag:
            parts.append(f"signals.lag_reach({lag or constant.python})")
    parts += [_source(factor.of.reach) for factor in form.factors if factor.of.reach]
    return " + ".join(dict.fromkeys(parts))


def _source(reach: Reach) -> str:
    """Python of it."""
    named = {signals.SLOPE: "signals.SLOPE", signals.WHOLE: "signals.WHOLE", NEIGHBOURS: "NEIGHBOURS"}
    given = {name: value for name, value in vars(reach).items() if value}
    return named.get(reach) or f"Reach({', '.join(f'{name}={value!r}' for name, value in given.items())})"


def _is_scale_law(form: Form) -> bool:
    """Whether each axis has one coefficient that multiplies its own rate, without a memory."""
    if form.pattern != "each" or form.size != 3 or _reach(form, None):
        return False
    return sum(factor.quantity == "rate" and factor.through.odd for factor in form.factors) == 1


def _why_no_c(form: Form) -> str:
    for factor in form.factors:
        if factor.quantity in WHY_NO_C:
            return WHY_NO_C[factor.quantity]
    return "no C has been written for it"


WHY_NO_C = {
    "level": "it follows the heading, which the device does not know",
    "acceleration": "it needs samples that are yet to come",
    "jerk": "it needs samples that are yet to come",
    "force": "it needs samples that are yet to come",
    "time": "it belongs to the time of that one session",
    "turned": "it follows the angle turned since its session began",
    "rest": "it follows its session from the beginning",
    "sense": "it follows its session from the beginning",
    "vibration": "it needs samples that are yet to come",
    "temperature_rate": "it follows the last ten seconds of the temperature, and C is not told the data rate",
}
