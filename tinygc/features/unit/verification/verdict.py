"""One verdict on a stored calibration, by today's recording: holds, holds with a new bias, does not hold, undecided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base import features
from session.base.errors import CalibrationError, DataError, FormatError
from session.base.files import require_file
from session.base.names import is_session
from session.base.numeric import sigmas_in
from session.base.progress import Progress, Reporter, no_report
from session.base.records import in_unit, plain, write_whole
from session.base.texts import command_line, measured, probability, significant
from session.base.units import DEG
from session.log.folder import Session, hash_of_log, read_session
from tinygc.closure.motion import MINUTE_S
from tinygc.estimation.spread import ZERO
from tinygc.features.unit.options import VerifyOptions
from tinygc.features.unit.verification.causes import Diagnosis, Evidence, beyond_linear, candidate_causes, diagnose
from tinygc.features.unit.verification.cost import (
    Bound,
    Cost,
    bound_deg,
    cost_of,
    estimated_change,
    left_open,
    turns_to_separate,
    turns_to_test,
    uses,
)
from tinygc.features.unit.verification.questions import GRAVITY, NOISE, B, E, ExpectedPart, Question, ask, expected_parts, todays_noise
from tinygc.features.unit.verification.rows import Rows, clocks_apart, facts, rows_of
from tinygc.fitting.unit_state import UnitState, read_state, spread_of, spread_over
from tinygc.inference.decide import BIAS, FAILS, HOLDS, UNDECIDED, Answer
from tinygc.library.arguments import is_path, public
from tinygc.library.records import Shown
from tinygc.models.linear import BIAS as BIAS_OF_12
from tinygc.models.physics import PhysicsModel
from tinygc.planning.proposals import Proposal
from tinygc.reporting.facts import Part, Table, screen
from tinygc.reporting.terminal import Group, Text, one_line

SCHEMA = "tinygc-verify/1"
#: what each question is about, and a change of it that this recording would not show
TOPICS = {E: "scale and axes", B: "bias", GRAVITY: "gravity", NOISE: "beyond noise"}
UNSEEN = {
    E: "a scale error of up to {}° per turn",
    B: "a bias error of up to {}° per minute",
    GRAVITY: "a tilt error of up to {}°",
}
FIT_AGAIN = "fit a new session, and look at `explain`"
#: causes that change within the recording
IN_TIME = {"step", "warm-up"}


@dataclass(frozen=True, eq=False, repr=False)
class Verified(Shown):
    """Result of ``tinygc.verify``: the answer, with its reasons.

    old: the calibration; today: the name of the session that verifies it; decision: the answer with its reason; bias_change (3,) rad/s:
    change of B by today's rests, with covariance (3, 3); diagnosis: None where no question found a change; to_test, to_separate: turns that
    would test what is open, and separate the causes; facts: how the settings differ; notes; bias_serves: whether the model may be used with
    the new bias, as far as this recording shows.
    """

    old: UnitState
    today: str
    rows: Rows
    options: VerifyOptions
    decision: Answer
    questions: tuple[Question, ...]
    parts: tuple[ExpectedPart, ...]
    bounds: tuple[Bound, ...]
    cost: Cost
    bias_change: np.ndarray
    bias_covariance: np.ndarray
    diagnosis: Diagnosis | None
    to_test: tuple[Proposal, ...]
    to_separate: tuple[Proposal, ...]
    facts: tuple[str, ...]
    notes: tuple[str, ...] = ()
    bias_serves: bool = True

    def __repr__(self) -> str:
        return f"<Verified {self.old.name} by {self.today}: {self.answer}>"

    @property
    def answer(self) -> str:
        """``holds``, ``holds with a new bias``, ``does not hold`` or ``undecided``."""
        return self.decision.kind

    @property
    def headline(self) -> str:
        """The reason, in one line."""
        return self.decision.line

    @property
    def exit_code(self) -> int:
        """0 holds, 1 does not hold as it is, 5 undecided."""
        return self.decision.of.exit_code

    @property
    def alarm(self) -> bool:
        """Whether a question found a change: the event whose probability without a fault is stated."""
        return any(question.tested and not question.holds for question in self.questions)

    @property
    def new_bias(self) -> np.ndarray:
        """(3,) rad/s: B by today's rests."""
        return self.old.bias + self.bias_change

    @property
    def bias_dps(self) -> np.ndarray:
        """(3,) dps: the new bias."""
        return np.asarray(self.new_bias / DEG)

    @property
    def verdict_line(self) -> Text:
        """The answer and its reason in one line."""
        return one_line(self.decision.headline, self.decision.of.style)

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        title = f"{self.rows.turns} turns and {self.rows.stills} rests against {self.old.name}"
        rows = []
        for each in self.questions:
            p = probability(each.p_value)
            answer = "not tested" if not each.tested else "no change" if each.holds else "changed"
            rows.append([TOPICS[each.name], answer, "" if not each.tested else p.replace("=", "<") if each.beyond_draws else p])
        table = Table(title, ("question", "answer", ""), rows, left=(0, 1))
        lines = (*(f"{fact}." for fact in self.facts), *cause_lines(self), *open_lines(self), *(f"Note: {note}." for note in self.notes))
        below: list[Part] = [one_line(line) for line in lines]
        return screen([self.verdict_line, table, *cost_parts(self), *below, one_line(f"next: {self.decision.do}", "bold")])

    def save_model(self, path: Path | str) -> Path:
        """Write the model with the new bias, and return the path.  Raises StorageError for a file that cannot be written,
        DataError where E does not hold, or the bias moves within the recording."""
        if not self.bias_serves:
            raise DataError(f"{self.old.path}: not written with a new bias: {self.headline}; {self.decision.do}")
        old, more = self.old, dict[str, Any]()
        if np.isfinite(self.rows.temp_c):
            more["temperature_c"] = self.rows.temp_c
        if old.covariance.shape == (12, 12) and old.linear is old.model:
            covariance = old.covariance.copy()
            covariance[BIAS_OF_12, :] = covariance[:, BIAS_OF_12] = 0.0
            covariance[BIAS_OF_12, BIAS_OF_12] = self.bias_covariance
            more["covariance"] = covariance
        words = f"{old.table.get('method') or 'stored'}, new bias"
        write_whole(Path(path), old.table_with_bias(self.bias_change, words, self.today, **more))
        return Path(path)

    def to_json(self) -> dict:
        """``tinygc-verify/1`` (docs/formats/unit.md)."""
        diagnosis = self.diagnosis
        return plain(
            {
                "schema": SCHEMA,
                "version": VERSION,
                "model": self.old.path.name,
                "of": self.old.name,
                "today": self.today,
                "answer": self.answer,
                "headline": self.headline,
                "advice": self.decision.do,
                "exit_code": self.exit_code,
                "alarm": self.alarm,
                "false_alarm": self.options.false_alarm,
                "turns": self.rows.turns,
                "rests": self.rows.stills,
                "questions": [
                    {"name": each.name, "tested": each.tested, "freedom": each.rank, "level": each.level}
                    | {name: getattr(each, name) if each.tested else None for name in ("holds", "statistic", "chi_square", "p_value")}
                    for each in self.questions
                ],
                "expected": self.parts,
                "new_bias": in_unit(DEG, bias_dps=self.new_bias, change_dps=self.bias_change, sigma_dps=sigmas_in(self.bias_covariance)),
                "cause": None
                if diagnosis is None
                else {
                    "names": diagnosis.best.names,
                    "words": [f"{each.claim}: {', '.join(each.numbers)}" for each in diagnosis.best.stated],
                    "probability": diagnosis.probability,
                    "instead": [{"name": name, "others": others} for name, others in diagnosis.rivals.items()],
                    "alone": [{"name": name, "log_odds": odds} for name, odds in diagnosis.alone.items()],
                },
                "cost": self.cost,
                "bounds": self.bounds,
                "turns_to_test": [proposal.words for proposal in self.to_test],
                "turns_to_separate": [proposal.words for proposal in self.to_separate],
                "facts": self.facts,
                "notes": self.notes,
            }
        )


@public(VerifyOptions)
def verify(model: Path | str, today: Any, *, progress: Progress | None = None, **choices: Any) -> Any:
    """Verify a stored calibration by a short recording of today: whether it holds, and if not, why, its cost, and what to do.

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
        ``answer``, ``headline``, ``exit_code``, ``bias_dps``, ``questions``, ``diagnosis``, ``cost``; ``summary()``, ``to_json()``,
        ``save_model(path)``.

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
    options = VerifyOptions(**choices)
    old = read_state(Path(model), options.noise)
    old.with_bias_moved(np.zeros(3))  # fail early for a model whose bias cannot be changed

    def step(what: str) -> None:
        (progress or no_report)(what, 0, 1)

    if not isinstance(today, Session):
        today = Path(today)
        if not today.exists():
            raise FormatError(f"{today}: not found; give a session folder with rests, with turns or without")
        if not today.is_dir():
            require_file(today)
        if not is_session(today):
            raise FormatError(f"{today}: no session folder; `{command_line('import', today)}` makes one of a log, of any program")
        today = read_session(today, lambda name: step(f"reading {name}"))
    return verify_session(old, today, options, step)


def verify_session(
    old: UnitState,
    session: Session,
    options: VerifyOptions,
    progress: Reporter = no_report,
) -> Verified:
    """Verify a calibration by a session.

    Raises DataError for a session of another sensor, unless that is accepted, and the errors of ``rows_of`` and ``spread_of_unit``.
    """
    settings, then, now = facts(old, session), old.sensor.get("serial"), session.config.sensor.serial
    if then and now and then != now and not options.other_serial:
        raise DataError(
            f"{session.folder}: of sensor {now!r}, expected {then!r}, which the model "
            "was fitted to; give a recording of that one, or --other-serial if it is the same sensor after all"
        )
    settings += [apart] if (apart := clocks_apart(old, session)) else []
    notes = old.missing_words
    rows = rows_of(session, old, options.earth, progress)
    if rows.remark:
        settings.append(rows.remark)
    lot = None if options.lot is None else features.first("spread of a production lot", options.lot, session.config.sensor.model)
    if options.lot is not None and lot is None:
        raise CalibrationError("verify has no option --lot: no feature reads a lot")
    between = spread_over(options.history, session, old.accelerometer) if options.history else None
    spread = spread_of(session.config, old.table, between=between, lot=lot)
    if rows.warmer_than(old) is None:
        which = "the model" if np.isfinite(rows.temp_c) else "today's recording"
        notes.append(f"no temperature in {which}; a warmer sensor looks like a moved bias")
    parts = expected_parts(old, rows, spread, switched_on=options.switched_on, elapsed_s=options.elapsed_s)
    if options.switched_on and spread.at(ZERO).is_usual:
        notes.append("switch-on scatter is the usual one; --history gives this unit's")
    if options.switched_on and spread.note:
        notes.append(spread.note)
    progress("noise of today")
    noise = todays_noise(rows)
    progress("questions")
    questions = tuple(ask(rows, parts, noise, old, options.false_alarm))
    W = left_open(rows, noise)
    used = uses(rows, old.linear, old.accelerometer is not None)
    bounds = tuple(Bound(name, bound_deg(slopes, np.zeros(len(W)), W), options.limit_deg, words) for name, slopes, words in used)
    causes = candidate_causes(rows, old)
    evidence = Evidence(rows, parts, noise.s)
    moved_bias = evidence.of([cause for cause in causes if cause.name == "bias"])
    refuted = [question for question in questions if question.tested and not question.holds]
    diagnosis, change, covariance = None, moved_bias.change, moved_bias.covariance
    if refuted:
        progress("causes")
        diagnosis = diagnose(evidence, causes)
        change, covariance = diagnosis.best.change, diagnosis.best.covariance
        if len(turned := diagnosis.best.of("rotation")):  # its second order would pass for further causes
            more = beyond_linear(old.linear, turned)
            diagnosis = diagnose(Evidence(replace(rows, r=rows.r + rows.parameters @ more), parts, noise.s), causes)
            change, covariance = diagnosis.best.change + more, diagnosis.best.covariance
    cost = cost_of(rows, old.linear, change, covariance, moved_bias.change[ZERO], moved_bias.covariance[ZERO, ZERO])
    if diagnosis is not None and not diagnosis.best.causes:  # whatever it was, it is as large as today's data alone leave it
        change, covariance = estimated_change(rows, noise, W), W
    effects = {name: bound_deg(slopes, change, covariance) for name, slopes, _ in used}
    effects[NOISE] = max(question.left_rps for question in questions) * MINUTE_S / DEG
    if diagnosis is not None:  # a bias that moves within the recording
        effects[NOISE] = max(effects[NOISE], *(float(np.linalg.norm(diagnosis.best.of(n))) * MINUTE_S / DEG for n in ("step", "warm-up")))
    changed = {question.name: effects[question.name] for question in refuted}
    decision, bias_serves = _decide(changed, bounds, cost, diagnosis, options, rows.turns > 0)
    if rows.remark and bias_serves:
        decision, bias_serves = Answer(FAILS, rows.remark, "correct the unit, the range or the data rate, then verify again"), False
    if old.logs & {hash_of_log(log) for log in session.logs}:
        decision, bias_serves = Answer(UNDECIDED, "the model was fitted to this very recording.", "give another recording"), False
    open_names = {bound.name for bound in bounds if not bound.is_seen}
    into = {cause.name: cause.into for cause in causes}
    pairs = [] if diagnosis is None else [(name, others[0]) for name, others in diagnosis.rivals.items() if others]
    spans = next(([into[name], into[other]] for name, other in pairs if into[name].any() and into[other].any()), None)
    return Verified(
        old=old,
        today=session.name,
        rows=rows,
        options=options,
        decision=decision,
        questions=questions,
        parts=tuple(parts),
        bounds=bounds,
        cost=cost,
        bias_change=moved_bias.change[ZERO],
        bias_covariance=moved_bias.covariance[ZERO, ZERO],
        diagnosis=diagnosis,
        to_test=tuple(turns_to_test(rows, noise, W, options.limit_deg)) if open_names - {B} else (),
        to_separate=tuple(turns_to_separate(rows, noise, spans)) if spans else (),
        facts=tuple(settings),
        notes=tuple(notes),
        bias_serves=bias_serves,
    )


def _decide(
    changed: Mapping[str, float],
    found: Sequence[Bound],
    cost: Cost,
    diagnosis: Diagnosis | None,
    options: VerifyOptions,
    turned: bool = True,
) -> tuple[Answer, bool]:
    """Decide by the questions with a significant change, and the degrees that a minute of use misses by it at most (95 %): changed.

    Returns the answer, and whether the model works with the new bias.  turned: whether there are turns, without which nothing tests E.
    """
    limit = options.limit_deg * DEG
    matters = [name for name in changed if changed[name] > options.limit_deg]
    causes = () if diagnosis is None else diagnosis.best.causes
    stated = [] if diagnosis is None else diagnosis.best.stated
    because = f"{stated[0].claim}: {stated[0].largest}" if stated else ""
    if set(matters) - {B} or (matters and any(cause.name not in ("bias", "temperature") for cause in causes)):
        largest = max(matters, key=lambda name: changed[name])
        what = "more than noise is left" if largest == NOISE else f"{TOPICS[largest]} changed"
        why = because or f"{what}, of unknown cause, by up to {significant(changed[largest], 2)}°"
        advice = "; ".join(dict.fromkeys(step for cause in causes for step in cause.advice.split("; "))) or FIT_AGAIN
        return Answer(FAILS, f"{why}.", advice), False
    unseen = [bound for bound in found if not bound.is_seen]
    e_seen = E not in [bound.name for bound in unseen]
    costs, with_new = (float(np.linalg.norm(each)) for each in (cost.as_it_is, cost.with_new_bias))
    error = f"error after the next minute {significant(costs / DEG, 2)}°"
    if matters or costs > max(limit, 2 * float(np.linalg.norm(cost.sigma))):
        why = because or ("bias moved by more than a switch-on" if matters else "bias moved, as at a switch-on")
        if with_new > max(limit, 2 * float(np.linalg.norm(cost.with_new_bias_sigma))):
            return Answer(FAILS, f"{error}; with a new bias still {significant(with_new / DEG, 2)}°.", FIT_AGAIN), False
        use_new = "use the new bias: --write FILE writes the model with it"
        if e_seen:
            return Answer(BIAS, f"{why}; {error}.", use_new), True
        return Answer(FAILS if matters else UNDECIDED, f"{why}; {error}.", f"{use_new}; then record the turns above"), True
    if unseen and (turned or B in [bound.name for bound in unseen]):
        turns = "record the turns above, with a rest before and after each, then verify again"
        if {bound.name for bound in unseen} == {B}:
            turns = "let it lie still for some minutes, in several attitudes, then verify again"
        return Answer(UNDECIDED, unseen_words(max(unseen, key=lambda bound: bound.bound_deg / bound.limit_deg)), turns), True
    if unseen:  # at rest, the bias is all that is tested
        fine = "bias and gravity are" if any(bound.name == GRAVITY and bound.is_seen for bound in found) else "bias is"
        return Answer(HOLDS, f"{fine} fine; {error}.", "scale cannot be seen at rest: record the turns above"), True
    return Answer(HOLDS, f"{error}.", "use it as it is"), True


def unseen_words(bound: Bound) -> str:
    """A change that this recording would not show, and how large."""
    return f"{UNSEEN[bound.name].format(significant(bound.bound_deg, 2))} would go unseen."


# The screen: what was tested, why, what it costs, and what this recording cannot test.


def cause_lines(found: Verified) -> list[str]:
    """Why it does not hold."""
    diagnosis, lines = found.diagnosis, []
    if diagnosis is None:
        return []
    if not diagnosis.best.causes:
        return ["Cause unknown: none of the list explains it; run `explain`."]
    for cause, stated in zip(diagnosis.best.causes, diagnosis.best.stated, strict=True):
        lines.append(f"Cause: {stated.claim}")
        lines += [f"  {', '.join(stated.numbers[k : k + 3])}" for k in range(0, len(stated.numbers), 3)]
        if others := diagnosis.rivals.get(cause.name, ()):
            lines.append(f"  or: {', '.join(others)}")
    sure = "over 99" if diagnosis.probability > 0.99 else significant(100 * diagnosis.probability, 2)
    lines.append(f"{sure} % sure of the cause (of {len(diagnosis.alone)} tried).")
    return lines + [f"To separate the causes: {proposal.words}." for proposal in found.to_separate]


def cost_parts(found: Verified) -> list[Part]:
    """Errors of the attitude as it is; where the bias is to be replaced, also with the new one, and that bias in the terms of ``fit``."""
    cost, as_it_is = found.cost, ("as it is", found.cost.as_it_is, found.cost.sigma)
    new = ("with the new bias", cost.with_new_bias, cost.with_new_bias_sigma)
    in_time = found.diagnosis is not None and bool(set(found.diagnosis.best.names) & IN_TIME)
    replaces = found.bias_serves and found.answer != HOLDS and not in_time
    rows = [
        [label, *((float(angle), float(s)) for angle, s in zip(value / DEG, sigma / DEG, strict=True))]
        for label, value, sigma in ((as_it_is, new) if replaces else (as_it_is,))
    ]
    table = Table(f"Largest error in {cost.motion}, °", ("", "roll", "pitch", "yaw"), rows)
    if in_time:
        return [table, "No new bias: the bias moves within this recording."]
    return [table, one_line(f"New {bias_words(found)}")] if replaces else [table]


def bias_words(found: Verified) -> str:
    """The new bias as ``fit`` prints it, what the sensor reads at no rate, with its sigmas."""
    model = found.old.model
    M = np.linalg.inv((model.linear if isinstance(model, PhysicsModel) else found.old.linear).E)
    bias, sigma = -M @ found.new_bias / DEG, sigmas_in(M @ found.bias_covariance @ M.T) / DEG
    return "bias, dps: " + ", ".join(f"{name} {measured(*each)}" for name, *each in zip("xyz", bias, sigma, strict=True))


def open_lines(found: Verified) -> list[str]:
    """What this recording cannot test, and which turns would."""
    lines = [f"Not tested: {unseen_words(bound)}" for bound in found.bounds if not bound.is_seen]
    return lines + [f"  {number}. {proposal.words}" for number, proposal in enumerate(found.to_test if lines else (), start=1)]
