"""Write a law as an effect file: its form and numbers, with its evidence in the docstring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from textwrap import indent, wrap

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import printable
from session.base.units import DEG
from tinygc.effects import Movement, ReferenceConditions
from tinygc.effects.device import MOST_PASSES, PASSES
from tinygc.effects.inversion import substituted, undone_with_jumps
from tinygc.effects.testing import hand_movement
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import columns_of, why_not
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
    table = law_table(law, None)
    parts = [("Equation", table["equation"]), ("Found in", _where(where))]
    parts += [("Evidence", plain(words, LONGEST_EVIDENCE)) for words in (*evidence_words(table), *open_words(table))]
    parts += [("Undoing", undoing)] if undoing else []
    first = f"A law found in a recording.  {table['in_words']}"
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


# How many passes of substitution invert a law, by trial on the movement of a proof: declared by the written file, and run by its C.

#: rad/s, where the session's is unknown; Hz, the highest rate of a proof; s of movement
FULL_SCALE, TRIAL_HZ, TRIAL_S = 500 * DEG, 833.0, 8.0
#: factors on the size found, of each sign, that another unit may have: the range of a proof
STRONGER, DRAWN = 1.5, 2
#: share of the added rate that may remain (a proof requires 5e-3), and share of rows that may exceed it, as at the rate that ends a
#: rest
LEFT, ASTRAY = 1e-3, 0.01
#: residual allowed in C relative to 1 rad/s: about the rounding of single precision
LEFT_IN_C = 2e-6


def passes_of(form: LawForm, theta: np.ndarray, full_scale: float = FULL_SCALE, in_c: bool = False) -> int | None:
    """Passes over all rows that invert a law, theta (P,) SI, or in single precision up to full scale, each row on its own; None where
    ``MOST_PASSES`` are not enough."""
    rng, rms = np.random.default_rng(0), rms_of(theta)
    moved = hand_movement(TRIAL_HZ, ReferenceConditions(full_scale), TRIAL_S)
    if in_c:
        moved = moved.with_rate(np.random.default_rng(1).uniform(-full_scale, full_scale, moved.rate.shape))
    undone = undone_with_jumps if jumps(form) else substituted
    passes = PASSES
    for size in (STRONGER * theta, *(STRONGER * rms * rng.choice((-1.0, 1.0), (DRAWN, len(theta))))):

        def added(movement: Movement, size: np.ndarray = size) -> np.ndarray:
            return columns_of(form, movement) @ size

        adds = added(moved)
        allowed, astray = (LEFT_IN_C, 0.0) if in_c else (LEFT * np.abs(adds).max(initial=1e-12), ASTRAY)
        while np.mean(np.abs(undone(moved.rate + adds, moved, added, passes) - moved.rate).max(axis=1) > allowed) > astray:
            if passes >= MOST_PASSES:
                return None
            passes = min(passes + 1 + passes // 4, MOST_PASSES)
    return passes


# The file: a law's form and numbers, which ``law_effect`` makes an effect.  Nothing of a recording becomes code but numbers.

#: digits of a coefficient and of its covariance; of a weight of a combination of coefficients
KNOWN, WEIGHTS = 6, 4
#: columns of a line
WIDTH = 100
#: docstring text of a law that ``correct`` does not remove
TOO_STRONG = (
    f"it is so strong for how fast it follows that {MOST_PASSES} passes of substitution do not take it off: the proof of an effect "
    "(inverse) states how much a calibration leaves; write an exact_correct if that is too much"
)


def written(law: Law, where: Where, name: str | None = None) -> str:
    """The effect file of a law; name: follows ``discovered.`` in its id, where it differs from the form's own."""
    form = rounded(law.form, law.constants_sigma)
    dps, first_c = (None if value is None or not isfinite(value) else value for value in (where.full_scale_dps, where.first_temp_c))
    full_scale = FULL_SCALE if dps is None else dps * DEG
    passes: int | None = PASSES
    if jumps(form) or form.reach:
        passes = passes_of(form, law.theta, full_scale)
    given: dict[str, object] = {
        "sigmas": tuple(float(f"{sigma:.3g}") for sigma in law.constants_sigma) or None,
        "full_scale_dps": None if dps is None else float(f"{dps:.9g}"),
        "first_temp_c": None if first_c is None else round(first_c, 3),
        "passes": None if passes in (None, PASSES) else passes,
    }
    lines = [f"{key}={value!r}," for key, value in given.items() if value is not None]
    if not why_not(form) and (in_c := passes_of(form, law.theta, full_scale, in_c=True)) != PASSES:
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
