"""Write a law as an effect file: its form and numbers, with its evidence in the docstring."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from textwrap import indent, wrap

import numpy as np

from session.base.numeric import rms_of
from session.base.rotation import unit_vectors
from session.base.texts import printable
from session.base.units import DEG
from tinygc.effects import Movement
from tinygc.effects.device import MOST_PASSES, PASSES
from tinygc.effects.inversion import substituted, undone_with_jumps
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


# A simulated movement.
#
# Every quantity takes values over its whole range and of both signs, independent of the others, so that steps at neighbouring thresholds
# differ in a few samples.

SAMPLES, RATE_HZ, FULL_SCALE = 2400, 10.0, 500 * DEG
#: jitter of samples in sampling periods, so that no time is a multiple of it; samples of the shortest and the longest turn or rest
STRAY, SHORTEST, LONGEST = 0.2, 10, 240
#: share of a turn's size: 1 to 10 dps is slower than what ends a rest, and above noise
CREEP = 0.015


def some_movement(seed: int) -> Movement:
    """Four minutes of turns, rests and creeps of many lengths, with warming, cooling and vibration."""
    rng = np.random.default_rng(seed)
    t_s = (np.arange(SAMPLES) + rng.uniform(0, STRAY, SAMPLES)) / RATE_HZ
    force = _wandering(rng, 3)
    return Movement(
        t_s=rng.uniform(0.1, 0.5) + t_s,
        dt_s=1 / RATE_HZ,
        rate=0.8 * FULL_SCALE * _turning(rng)[:, None] * _wandering(rng, 3),
        force_g=unit_vectors(force) * rng.uniform(0.8, 1.2, (SAMPLES, 1)),
        temp_c=25 + 10 * _wandering(rng, 1)[:, 0],
        vibration_g2=rng.uniform(0.0, 0.2, SAMPLES),
        duration_s=SAMPLES / RATE_HZ + 1.0,
        fs_rps=FULL_SCALE,
        first_temp_c=25.0,
    )


def _turning(rng: np.random.Generator) -> np.ndarray:
    """(SAMPLES,) a swell up to 1 in turns and to ``CREEP`` in every other rest, 0 in the others.

    It begins with a short turn and the longest rest, so that settling with time is not yet complete there.
    """
    found, first, number = np.zeros(SAMPLES), 0, 0
    while first < SAMPLES:
        length = (SHORTEST, LONGEST)[number] if number < 2 else int(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
        phase = (np.arange(length) + 0.5) / length
        swell = np.cos(np.pi / 2 * phase) if number == 0 else np.sin(np.pi * phase)
        found[first : first + length] = ((1.0, 0.0, 1.0, CREEP)[number % 4] * swell)[: SAMPLES - first]
        first, number = first + length, number + 1
    return found


def _wandering(rng: np.random.Generator, axes: int) -> np.ndarray:
    """(SAMPLES, axes) smooth over about a second, uniform over −1 to 1."""
    noise = rng.standard_normal((SAMPLES + 20, axes))
    smooth = np.stack([np.convolve(column, np.hanning(22)[1:], mode="valid") for column in noise.T], axis=1)
    return 2 * np.argsort(np.argsort(smooth, axis=0), axis=0) / (SAMPLES - 1) - 1


# How many fixed-point passes invert a law, by trial on a simulated movement: declared by the written file and run by its C.

#: Hz, the highest rate of a proof; s of movement
TRIAL_HZ, TRIAL_S = 833.0, 8.0
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
    t_s = drawn.t_s[0] + np.arange(0.0, TRIAL_S, 1 / TRIAL_HZ)

    def at(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        return np.stack([np.interp(t_s, drawn.t_s, column) for column in flat.T], axis=-1).reshape(-1, *values.shape[1:])

    return replace(
        drawn,
        t_s=t_s,
        dt_s=1 / TRIAL_HZ,
        rate=at(drawn.rate) * full_scale / FULL_SCALE,
        force_g=at(drawn.force_g),
        temp_c=at(drawn.temp_c),
        vibration_g2=at(drawn.vibration_g2),
        fs_rps=full_scale,
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
