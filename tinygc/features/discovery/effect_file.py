"""Write a law as an effect file: its form and numbers, with its evidence in the docstring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from textwrap import indent, wrap

import numpy as np

from session.base.texts import printable
from session.base.units import DEG
from tinygc.effects.device import MOST_PASSES, PASSES
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_on_device import why_not
from tinygc.features.discovery.passes import FULL_SCALE, passes_in_c, passes_of
from tinygc.features.discovery.result import evidence_words, law_table, open_words
from tinygc.features.discovery.search_state import Law
from tinygc.features.discovery.words import jumps, rounded, what

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


# The file: a law's form and numbers, which ``law_effect`` makes an effect.  Nothing of a recording becomes code but numbers.

#: digits of a coefficient and of its covariance; of a weight of a combination of coefficients
KNOWN, WEIGHTS = 6, 4
#: columns of a line
WIDTH = 100
#: docstring text of a law that ``correct`` does not remove
TOO_STRONG = (
    f"it is so strong, beside how fast it follows, that {MOST_PASSES} passes of substitution do not take it off: the proof of an effect "
    "(undo) says how much a calibration leaves; write an exact_correct if that is too much"
)


def written(law: Law, where: Where, name: str | None = None) -> str:
    """The effect file of a law; name: follows ``discovered.`` in its id, where it differs from the form's own."""
    form = rounded(law.form, law.constants_sigma)
    dps, first_c = (None if value is None or not isfinite(value) else value for value in (where.full_scale_dps, where.first_temp_c))
    full_scale = FULL_SCALE if dps is None else dps * DEG
    passes: int | None = PASSES
    if jumps(form) or form.reach:
        passes = passes_of(form, law.theta, jumps(form), full_scale)
    given: dict[str, object] = {
        "sigmas": tuple(float(f"{sigma:.3g}") for sigma in law.constants_sigma) or None,
        "full_scale_dps": None if dps is None else float(f"{dps:.9g}"),
        "first_temp_c": None if first_c is None else round(first_c, 3),
        "passes": None if passes in (None, PASSES) else passes,
    }
    lines = [f"{key}={value!r}," for key, value in given.items() if value is not None]
    if not why_not(form) and (in_c := passes_in_c(form, law.theta, full_scale)) != PASSES:
        lines.append(f"passes_in_c={in_c},")
    if len(law.unobserved):
        lines += ["# combinations of the coefficients that the session did not observe; the law is without them"]
        lines.append(f"not_observed={_rows(law.unobserved, f'.{WEIGHTS}f')},")
    made = [f'"discovered.{name or what(form)}",', f"{_form(form)},", "COEFFICIENTS,", "COVARIANCE,", *lines]
    parts = [
        f'"""{docstring(law, where, "" if passes is not None else TOO_STRONG)}\n"""',
        "import numpy as np\n\nfrom tinygc.features.discovery.form import Factor, LawForm\n"
        "from tinygc.features.discovery.law_effect import law_effect",
        f"#: SI: what that session gave; another of the unit must agree\nCOEFFICIENTS = np.array({_row(law.theta, f'.{KNOWN}g')})\n"
        f"COVARIANCE = np.array({_rows(law.covariance, f'.{KNOWN}g')})",
        "EFFECT = law_effect(\n" + indent("\n".join(made), "    ") + "\n)",
    ]
    return "\n\n".join(parts) + "\n"


def _form(form: LawForm) -> str:
    factors = [f'Factor("{each.quantity}", "{each.function}", {each.constant}, {each.lag_s})' for each in form.factors]
    short = ", ".join(factors).replace(", None, None)", ")").replace(", None)", ")").replace(', "itself")', ")")
    return f'LawForm(({short}{"," * (len(factors) == 1)}), "{form.pattern}")'


def _row(values: np.ndarray, digits: str) -> str:
    return repr([float(f"{value:{digits}}") + 0.0 for value in values])


def _rows(values: np.ndarray, digits: str) -> str:
    """Python of a matrix, row by row."""
    lines = [line for row in values for line in wrap(f"{_row(row, digits)},", WIDTH - 8)]
    return "[\n" + indent("\n".join(lines), "    ") + "\n]"
