"""The screen of ``verify``: the verdict, what was asked, why, what it costs, what this recording cannot tell, and remarks."""

from __future__ import annotations

import numpy as np

from session.base.texts import probability, significant
from session.base.units import DEG
from tinygc.features.unit.verification.questions import GRAVITY, NOISE, B, E, Question
from tinygc.features.unit.verification.verdict import BIAS, FAILS, HOLDS, Verification, bias_words
from tinygc.reporting.terminal import Group, RenderableType, one_line, plain_table

#: questions in words
ASKED = {
    E: "scale and axes (E), the zero free",
    B: "the zero (B)",
    GRAVITY: "gravity's length (the accelerometer)",
    NOISE: "noise explains the rest",
}
#: causes that change within the recording
IN_TIME = {"step", "warm-up"}
STYLES = {HOLDS: "bold green", BIAS: "bold yellow", FAILS: "bold red"}


def verdict_line(found: Verification) -> RenderableType:
    """The answer and its reason."""
    return one_line(f"{found.answer}: {found.headline}", STYLES.get(found.answer, "bold"))


def verification_page(found: Verification) -> Group:
    """The command's output."""
    parts: list[RenderableType] = [verdict_line(found)]
    parts += [one_line(f"Settings: {fact}.") for fact in found.facts]
    rows = found.rows
    title = (
        f"{rows.turns} turns and {rows.stills} rests against {found.old.name}; "
        f"a false alarm in {significant(100 * found.options.false_alarm, 2)} % of such recordings"
    )
    table = plain_table(title, "does it hold?", "answer", "χ²", "degrees of freedom", "p", "bar")
    for question in found.questions:
        chi_square, p = f"{question.chi_square:.1f}", probability(question.p_value)
        if question.beyond_draws:
            chi_square, p = f"> {chi_square}", p.replace("=", "<")
        numbers = (chi_square, str(question.rank), p, significant(question.level, 2))
        table.add_row(ASKED[question.name], _answer(question), *(numbers if question.asked else ("", "", "", "")))
    parts.append(table)
    parts += [one_line(line) for line in (*cause_lines(found), *cost_lines(found), *open_lines(found))]
    parts += [one_line(f"Note: {note}.") for note in found.notes]
    parts.append(one_line(f"Do: {found.advice}.", "bold"))
    return Group(*parts)


def _answer(question: Question) -> str:
    if not question.asked:
        return "not asked by this recording"
    return "nothing against it" if question.holds else "no"


def cause_lines(found: Verification) -> list[str]:
    """Why it does not hold."""
    if found.diagnosis is None:
        return []
    diagnosis, said = found.diagnosis, []
    if not diagnosis.best.causes:
        return ["Cause: none of the list is more probable than none; `explain` looks further."]
    for cause, words in zip(diagnosis.best.causes, diagnosis.best.words, strict=True):
        others = diagnosis.rivals.get(cause.name, ())
        instead = f"; not told apart from: {', '.join(others)}" if others else ""
        said.append(f"Cause: {words}{instead}.")
    said.append(f"Probability of this explanation among those compared: {significant(100 * diagnosis.probability, 2)} %.")
    said += [f"To tell the causes apart: {proposal.words}." for proposal in found.separate]
    return said


def cost_lines(found: Verification) -> list[str]:
    """What it costs."""
    cost = found.cost

    def angles(value: np.ndarray, sigma: np.ndarray) -> str:
        pairs = zip(("roll", "pitch", "yaw"), value / DEG, sigma / DEG, strict=True)
        return ", ".join(f"{name} {angle:+.3f} ± {s:.3f}°" for name, angle, s in pairs)

    as_it_is = f"Cost, the largest error in {cost.motion}: {angles(cost.as_it_is, cost.sigma)}."
    if found.diagnosis is not None and set(found.diagnosis.best.names) & IN_TIME:
        return [as_it_is, "B anew would not last: the zero moves within this recording."]
    return [
        as_it_is,
        f"With B anew ({bias_words(found.new_bias, found.bias_covariance)}): {angles(cost.bias_anew, cost.bias_anew_sigma)}.",
    ]


def open_lines(found: Verification) -> list[str]:
    """What this recording cannot tell, and which turns would."""
    said = [
        f"Open: {ASKED[bound.name]}: {bound.use} may miss {significant(bound.bound_deg, 2)}° (95 %), "
        f"more than {significant(bound.limit_deg, 2)}°."
        for bound in found.bounds
        if not bound.is_seen
    ]
    if said and found.tell:
        said.append(f"Turns that would tell ({len(found.tell)}):")
        said += [f"  {number}. {proposal.words}" for number, proposal in enumerate(found.tell, start=1)]
    return said
