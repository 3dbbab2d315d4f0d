"""The docstring of a written file: what the law is, where it was found, and what speaks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from textwrap import wrap

from session.common.texts import printable
from session.common.units import DEG
from tinygc.discovery.grammar.words import equation, in_words
from tinygc.discovery.judge.answer import HeldOut, Law, RunnerUp

WIDTH, INDENT = 110, 12
#: signs of a name that came from a file
LONGEST = 80
#: hexadecimal digits of a log's hash that tell it from any other
DIGEST = 16
#: runners-up that are told
MOST = 3


@dataclass(frozen=True)
class Where:
    """Where a law was found: the session's name; logs, name -> sha256; version of the tool; full scale in dps
    and temperature of the first sample in degC, to which a law's numbers belong: without them a file takes those of each session."""

    session: str
    logs: Mapping[str, str] = field(default_factory=dict)
    version: str = ""
    full_scale_dps: float | None = None
    first_temp_c: float | None = None


def plain(text: str) -> str:
    """Another's words, fit for a docstring: they can neither end it nor say anything to Python."""
    line = printable(text)
    line = line if len(line) <= LONGEST else line[: LONGEST - 1] + "…"
    return line.replace("\\", "/").replace('"', "'").replace("{", "(").replace("}", ")")


def docstring(law: Law, where: Where, undoing: str = "") -> str:
    """Between its quotes, lines that begin at the left; undoing: what is to be said of taking it off."""
    parts = {"Equation": equation(law.form), "Found in": _where(where), "Evidence": _evidence(law)}
    for number, each in enumerate(law.held_out):
        parts[f"Held out{' ' * number}"] = _held_out(each)
    if law.same:
        parts["The same"] = "this recording cannot tell it from " + "; ".join(equation(form) for form in law.same[:MOST])
    for number, other in enumerate(law.runners_up[:MOST]):
        parts[f"Else{' ' * number}"] = _runner_up(other)
    if law.learnable_from is not None:
        parts["Learnable"] = f"in 19 of 20 draws of noise the search finds it in that recording from {law.learnable_from:.2g} of its size"
    if undoing:
        parts["Undoing"] = undoing
    first = f"A law found in a recording.  {in_words(law.form)}"
    lines = ["\n".join(wrap(first, WIDTH)), ""]
    for name, text in parts.items():
        lines += wrap(f"{name.strip():<{INDENT}}{text}", WIDTH, subsequent_indent=" " * INDENT, break_long_words=False)
    return "\n".join(lines)


def _where(where: Where) -> str:
    logs = ", ".join(f"{plain(name)} (sha256 {plain(digest)[:DIGEST]}…)" for name, digest in where.logs.items())
    scale = "" if where.full_scale_dps is None else f", full scale {where.full_scale_dps:g} dps"
    return (
        f"session {plain(where.session)}{scale}{f'; {logs}' if logs else ''}{f'; TinyGC {plain(where.version)}' if where.version else ''}"
    )


def _evidence(law: Law) -> str:
    numbers = f"{len(law.theta)} coefficients" + (f" and {len(law.form.constants)} constant(s)" if law.form.constants else "")
    return (
        f"chi-square {law.gain:.0f} taken up by {numbers}, of a form of {law.bits:.1f} bits; better by {law.better:.0f} in -2 log evidence "
        f"than without it; chance that the best of all forms does as much in noise: {_chance(law.chance_p)}"
    )


def _chance(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "below 0.0001"


def _held_out(each: HeldOut) -> str:
    source = "parts of the recording" if each.recording is None else f"recording {plain(each.recording)}"
    share = "" if each.removed is None else f", {100 * each.removed:.0f} % of what was beyond it"
    return (
        f"{source} that the search never saw, {each.segments} segments: closure {each.before_rad / DEG:.4f}° without it, "
        f"{each.after_rad / DEG:.4f}° with it, noise {each.floor_rad / DEG:.4f}°{share} (chance {_chance(each.p_value)})"
    )


def _runner_up(each: RunnerUp) -> str:
    name = each.effect.id if each.form is None else equation(each.form)
    return f"could be {plain(name)} instead, worse by {each.worse:.1f} in -2 log evidence; to tell: {plain(each.splits)}"
