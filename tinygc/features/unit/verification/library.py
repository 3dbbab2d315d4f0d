"""Python interface of ``verify``, a stored calibration against today's session, log, or minute at rest; and its screen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.files import require_file
from session.base.names import is_session
from session.base.numeric import sigmas_in
from session.base.progress import Progress, untold
from session.base.records import in_unit, plain, write_whole
from session.base.texts import command_line, probability, significant
from session.base.units import DEG
from session.log.folder import Session, read_session
from tinygc import models
from tinygc.features.unit.options import VerifyOptions
from tinygc.features.unit.verification.old import read_old
from tinygc.features.unit.verification.questions import GRAVITY, NOISE, B, E, Question
from tinygc.features.unit.verification.verdict import BIAS, FAILS, HOLDS, Verification, bias_words, verify_session, written_model
from tinygc.library.arguments import is_path, public
from tinygc.library.records import Shown
from tinygc.reporting.terminal import Group, RenderableType, one_line, plain_table

SCHEMA = "tinygc-verify/1"


@dataclass(frozen=True, eq=False, repr=False)
class Verified(Shown):
    """Result of ``tinygc.verify``: ``answer``, ``headline``, ``exit_code``, ``bias_dps``; ``result`` holds everything."""

    result: Verification
    today: str

    def __repr__(self) -> str:
        return f"<Verified {self.result.old.name} by {self.today}: {self.answer}>"

    @property
    def answer(self) -> str:
        """``holds``, ``holds for E, take B anew``, ``does not hold`` or ``undecided``."""
        return self.result.answer

    @property
    def headline(self) -> str:
        """The reason, in one line."""
        return self.result.headline

    @property
    def exit_code(self) -> int:
        """0 holds; 1 does not hold as it is; 5 undecided."""
        return self.result.exit_code

    @property
    def bias_dps(self) -> np.ndarray:
        """(3,) dps: B taken anew."""
        return np.asarray(self.result.new_bias / DEG)

    @property
    def verdict_line(self) -> RenderableType:
        """The answer and its reason in one line, for ``--quiet``."""
        return verdict_line(self.result)

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        return verification_page(self.result)

    def save_model(self, path: Path | str) -> Path:
        """Write the model with B taken anew, and return the path.  Raises StorageError for a file that cannot be written,
        DataError where E does not hold, or the zero moves within the recording."""
        model, more = written_model(self.result)
        write_whole(Path(path), models.to_dict(model, **more, session=self.today, version=VERSION))
        return Path(path)

    def to_json(self) -> dict:
        """``tinygc-verify/1`` (docs/features/unit/verify-format.md)."""
        found = self.result
        diagnosis = found.diagnosis
        return plain(
            {
                "schema": SCHEMA,
                "version": VERSION,
                "model": found.old.path.name,
                "of": found.old.name,
                "today": self.today,
                "answer": found.answer,
                "headline": found.headline,
                "advice": found.advice,
                "exit_code": found.exit_code,
                "alarm": found.alarm,
                "false_alarm": found.options.false_alarm,
                "turns": found.rows.turns,
                "rests": found.rows.stills,
                "questions": [
                    {"name": each.name, "asked": each.asked, "freedom": each.rank, "level": each.level}
                    | {name: getattr(each, name) if each.asked else None for name in ("holds", "statistic", "chi_square", "p_value")}
                    for each in found.questions
                ],
                "expected": found.parts,
                "bias_anew": in_unit(DEG, bias_dps=found.new_bias, change_dps=found.bias_anew, sigma_dps=sigmas_in(found.bias_covariance)),
                "cause": None
                if diagnosis is None
                else {
                    "names": diagnosis.best.names,
                    "words": diagnosis.best.words,
                    "probability": diagnosis.probability,
                    "instead": [{"name": name, "others": others} for name, others in diagnosis.rivals.items()],
                    "alone": [{"name": name, "log_odds": odds} for name, odds in diagnosis.alone.items()],
                },
                "cost": found.cost,
                "bounds": found.bounds,
                "turns_that_tell": [proposal.words for proposal in found.tell],
                "turns_that_separate": [proposal.words for proposal in found.separate],
                "facts": found.facts,
                "notes": found.notes,
            }
        )


@public(VerifyOptions)
def verify(model: Path | str, today: Any, *, progress: Progress | None = None, **choices: Any) -> Any:
    """Say whether a stored calibration still holds, and if not, why, what that costs, and what to do.

    Parameters
    ----------
    model : str or Path
        A model file, or a fitted session folder.
    today : Session, str or Path
        A session, or its folder: with rests and turns, or a minute at rest.
    progress : callable, optional
        Called with what is done, how far, and of how much.

    Returns
    -------
    Verified
        ``answer``, ``headline``, ``exit_code``, ``bias_dps``, ``result``, ``summary()``, ``to_json()``, ``save_model(path)``.

    Raises
    ------
    CalibrationError
        For what cannot be read or compared; its message is one line.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> unit = {"closure_s": 0.0, "odr_hz": 104.0, "unit_seed": 1}
    >>> then = tinygc.fit(tinygc.simulate(segments=14, seed=1, **unit).session, methods=("least_squares",))
    >>> model = then.save(folder) / "model_least_squares.json"
    >>> tinygc.verify(model, tinygc.simulate(segments=10, seed=2, **unit).session).answer
    'holds'

    """
    if not isinstance(today, Session) and not is_path(today):
        raise CalibrationError(f"today is of type {type(today).__name__}, expected a tinygc.Session or a session folder")
    options, old = VerifyOptions(**choices), read_old(Path(model))

    def step(what: str) -> None:
        (progress or untold)(what, 0, 1)

    if not isinstance(today, Session):
        today = Path(today)
        if not today.exists():
            raise FormatError(f"{today}: not found; give a session folder with rests, with turns or without")
        if not today.is_dir():
            require_file(today)
        if not is_session(today):
            raise FormatError(f"{today}: no session folder; `{command_line('import', today)}` makes one of a log, of any program")
        today = read_session(today, lambda name: step(f"reading {name}"))
    return Verified(verify_session(old, today, options, step), today.name)


# The screen: the verdict, what was asked, why, what it costs, what this recording cannot tell, and remarks.

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
