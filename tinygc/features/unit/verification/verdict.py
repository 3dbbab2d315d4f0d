"""One verdict on a stored calibration, by today's recording: holds, holds for E with B anew, does not hold, undecided."""

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
from session.base.progress import Progress, Told, untold
from session.base.records import in_unit, plain, write_whole
from session.base.texts import command_line, probability, significant
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
    turns_that_separate,
    turns_that_tell,
    uses,
)
from tinygc.features.unit.verification.questions import GRAVITY, NOISE, B, E, Part, Question, ask, expected_parts, todays_noise
from tinygc.features.unit.verification.rows import Rows, clocks_apart, facts, rows_of
from tinygc.fitting.unit_state import UnitState, read_state, spread_of, spread_over
from tinygc.inference.decide import BIAS, FAILS, HOLDS, UNDECIDED, Answer
from tinygc.library.arguments import is_path, public
from tinygc.library.records import Shown
from tinygc.models.linear import BIAS as BIAS_OF_12
from tinygc.planning.proposals import Proposal
from tinygc.reporting.facts import Table, screen
from tinygc.reporting.terminal import Group, Text, one_line

SCHEMA = "tinygc-verify/1"
#: in whose way it fails, in words
OF = {E: "E", B: "the zero", GRAVITY: "the accelerometer", NOISE: "what is left beyond noise"}

#: questions in words
ASKED = {
    E: "scale and axes (E), the zero free",
    B: "the zero (B)",
    GRAVITY: "gravity's length (the accelerometer)",
    NOISE: "noise explains the rest",
}
#: causes that change within the recording
IN_TIME = {"step", "warm-up"}


@dataclass(frozen=True, eq=False, repr=False)
class Verified(Shown):
    """Result of ``tinygc.verify``: the answer, with all that it stands on.

    old: the calibration; today: the name of the session that verifies it; decision: the answer with its reason;
    bias_anew (3,) rad/s: change of B that today's rests ask for, with covariance (3, 3); diagnosis: None where nothing speaks against the
    calibration; tell, separate: turns that would tell what is open, and what the causes are; facts: what the settings say; notes;
    bias_serves: whether the model may be used with B anew, as far as this recording tells.
    """

    old: UnitState
    today: str
    rows: Rows
    options: VerifyOptions
    decision: Answer
    questions: tuple[Question, ...]
    parts: tuple[Part, ...]
    bounds: tuple[Bound, ...]
    cost: Cost
    bias_anew: np.ndarray
    bias_covariance: np.ndarray
    diagnosis: Diagnosis | None
    tell: tuple[Proposal, ...]
    separate: tuple[Proposal, ...]
    facts: tuple[str, ...]
    notes: tuple[str, ...] = ()
    bias_serves: bool = True

    def __repr__(self) -> str:
        return f"<Verified {self.old.name} by {self.today}: {self.answer}>"

    @property
    def answer(self) -> str:
        """``holds``, ``holds for E, take B anew``, ``does not hold`` or ``undecided``."""
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
        """Whether a question was answered with no: the event whose probability without a fault is stated."""
        return any(question.asked and not question.holds for question in self.questions)

    @property
    def new_bias(self) -> np.ndarray:
        """(3,) rad/s: B with the change."""
        return self.old.bias + self.bias_anew

    @property
    def bias_dps(self) -> np.ndarray:
        """(3,) dps: B taken anew."""
        return np.asarray(self.new_bias / DEG)

    @property
    def verdict_line(self) -> Text:
        """The answer and its reason in one line, for ``--quiet``."""
        return one_line(self.decision.headline, self.decision.of.style)

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        title = (
            f"{self.rows.turns} turns and {self.rows.stills} rests against {self.old.name}; "
            f"a false alarm in {significant(100 * self.options.false_alarm, 2)} % of such recordings"
        )
        rows = []
        for each in self.questions:
            chi_square, p = f"{each.chi_square:.1f}", probability(each.p_value)
            if each.beyond_draws:
                chi_square, p = f"> {chi_square}", p.replace("=", "<")
            numbers = (chi_square, each.rank, p, significant(each.level, 2))
            answer = "not asked by this recording" if not each.asked else "nothing against it" if each.holds else "no"
            rows.append([ASKED[each.name], answer, *(numbers if each.asked else ("", "", "", ""))])
        table = Table(title, ("does it hold?", "answer", "χ²", "degrees of freedom", "p", "bar"), rows, left=(0, 1))
        said = [*cause_lines(self), *cost_lines(self), *open_lines(self), *(f"Note: {note}." for note in self.notes)]
        settings = (f"Settings: {fact}." for fact in self.facts)
        return screen([self.verdict_line, *settings, table, *said, one_line(f"Do: {self.decision.do}.", "bold")])

    def save_model(self, path: Path | str) -> Path:
        """Write the model with B taken anew, and return the path.  Raises StorageError for a file that cannot be written,
        DataError where E does not hold, or the zero moves within the recording."""
        if not self.bias_serves:
            raise DataError(f"{self.old.path}: not written with B anew: {self.headline}; {self.decision.do}")
        old, more = self.old, dict[str, Any]()
        if np.isfinite(self.rows.temp_c):
            more["temperature_c"] = self.rows.temp_c
        if old.covariance.shape == (12, 12) and old.linear is old.model:
            covariance = old.covariance.copy()
            covariance[BIAS_OF_12, :] = covariance[:, BIAS_OF_12] = 0.0
            covariance[BIAS_OF_12, BIAS_OF_12] = self.bias_covariance
            more["covariance"] = covariance
        words = f"{old.table.get('method') or 'stored'}, bias anew"
        write_whole(Path(path), old.table_with_bias(self.bias_anew, words, self.today, **more))
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
                    {"name": each.name, "asked": each.asked, "freedom": each.rank, "level": each.level}
                    | {name: getattr(each, name) if each.asked else None for name in ("holds", "statistic", "chi_square", "p_value")}
                    for each in self.questions
                ],
                "expected": self.parts,
                "bias_anew": in_unit(DEG, bias_dps=self.new_bias, change_dps=self.bias_anew, sigma_dps=sigmas_in(self.bias_covariance)),
                "cause": None
                if diagnosis is None
                else {
                    "names": diagnosis.best.names,
                    "words": diagnosis.best.words,
                    "probability": diagnosis.probability,
                    "instead": [{"name": name, "others": others} for name, others in diagnosis.rivals.items()],
                    "alone": [{"name": name, "log_odds": odds} for name, odds in diagnosis.alone.items()],
                },
                "cost": self.cost,
                "bounds": self.bounds,
                "turns_that_tell": [proposal.words for proposal in self.tell],
                "turns_that_separate": [proposal.words for proposal in self.separate],
                "facts": self.facts,
                "notes": self.notes,
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
    return verify_session(old, today, options, step)


def verify_session(
    old: UnitState,
    session: Session,
    options: VerifyOptions,
    progress: Told = untold,
) -> Verified:
    """Verify a calibration by a session.

    Raises DataError for a session of another sensor, unless that is accepted, and the errors of ``rows_of`` and ``spread_of_unit``.
    """
    told, then, now = facts(old, session), old.sensor.get("serial"), session.config.sensor.serial
    if then and now and then != now and not options.other_serial:
        raise DataError(
            f"{session.folder}: of sensor {now!r}, expected {then!r}, which the model "
            "was fitted to; give a recording of that one, or --other-serial if it is the same sensor after all"
        )
    told += [apart] if (apart := clocks_apart(old, session)) else []
    notes = old.lacks
    rows = rows_of(session, old, options.earth, progress)
    if rows.remark:
        told.append(rows.remark)
    lot = None if options.lot is None else features.first("spread of a production lot", options.lot, session.config.sensor.model)
    if options.lot is not None and lot is None:
        raise CalibrationError("verify has no option --lot: no feature reads a lot")
    between = spread_over(options.history, session, old.accelerometer) if options.history else None
    spread = spread_of(session.config, old.table, between=between, lot=lot)
    if rows.warmer_than(old) is None:
        which = "the model" if np.isfinite(rows.temp_c) else "today's recording"
        notes.append(f"{which} does not say how warm the sensor was: a change by temperature is not told apart from a moved zero")
    parts = expected_parts(old, rows, spread, switched_on=options.switched_on, elapsed_s=options.elapsed_s)
    if options.switched_on and spread.at(ZERO).is_usual:
        source = spread.at(ZERO).source
        notes.append(f"how far the zero moves between switch-ons is {source}; --history with other sessions of this unit tells it")
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
    anew = evidence.of([cause for cause in causes if cause.name == "zero"])
    refuted = [question for question in questions if question.asked and not question.holds]
    diagnosis, change, covariance = None, anew.change, anew.covariance
    if refuted:
        progress("causes")
        diagnosis = diagnose(evidence, causes)
        change, covariance = diagnosis.best.change, diagnosis.best.covariance
        if len(turned := diagnosis.best.of("rotation")):  # its second order would pass for further causes
            more = beyond_linear(old.linear, turned)
            diagnosis = diagnose(Evidence(replace(rows, r=rows.r + rows.parameters @ more), parts, noise.s), causes)
            change, covariance = diagnosis.best.change + more, diagnosis.best.covariance
    cost = cost_of(rows, old.linear, change, covariance, anew.change[ZERO], anew.covariance[ZERO, ZERO])
    if diagnosis is not None and not diagnosis.best.causes:  # whatever it was, it is as large as today's data alone leave it
        change, covariance = estimated_change(rows, noise, W), W
    effects = {name: bound_deg(slopes, change, covariance) for name, slopes, _ in used}
    effects[NOISE] = max(question.left_rps for question in questions) * MINUTE_S / DEG
    if diagnosis is not None:  # a zero that moves within the recording
        effects[NOISE] = max(effects[NOISE], *(float(np.linalg.norm(diagnosis.best.of(n))) * MINUTE_S / DEG for n in ("step", "warm-up")))
    changed = {question.name: effects[question.name] for question in refuted}
    new = bias_words(old.bias + anew.change[ZERO], anew.covariance[ZERO, ZERO])
    decision, bias_serves = _decide(changed, bounds, cost, new, diagnosis, options, rows.turns > 0)
    if rows.remark and bias_serves:
        decision, bias_serves = Answer(FAILS, rows.remark, "mend the unit, the range or the data rate, then verify again"), False
    if old.logs & {hash_of_log(log) for log in session.logs}:
        itself = "the model was fitted to this very recording, and agrees with itself"
        decision, bias_serves = Answer(UNDECIDED, itself, "give another recording"), False
    power = ", ".join(f"{OF[bound.name]} to {significant(bound.bound_deg, 2)}°" for bound in bounds)  # what would have been seen
    line = "; ".join(filter(None, (f"this recording tells {power} (95 %)", apart, decision.line)))
    open_names = {bound.name for bound in bounds if not bound.is_seen}
    into = {cause.name: cause.into for cause in causes}
    pairs = [] if diagnosis is None else [(name, others[0]) for name, others in diagnosis.rivals.items() if others]
    spans = next(([into[name], into[other]] for name, other in pairs if into[name].any() and into[other].any()), None)
    return Verified(
        old=old,
        today=session.name,
        rows=rows,
        options=options,
        decision=replace(decision, line=line),
        questions=questions,
        parts=tuple(parts),
        bounds=bounds,
        cost=cost,
        bias_anew=anew.change[ZERO],
        bias_covariance=anew.covariance[ZERO, ZERO],
        diagnosis=diagnosis,
        tell=tuple(turns_that_tell(rows, noise, W, options.limit_deg)) if open_names - {B} else (),
        separate=tuple(turns_that_separate(rows, noise, spans)) if spans else (),
        facts=tuple(told),
        notes=tuple(notes),
        bias_serves=bias_serves,
    )


def _decide(
    changed: Mapping[str, float],
    found: Sequence[Bound],
    cost: Cost,
    new: str,
    diagnosis: Diagnosis | None,
    options: VerifyOptions,
    turned: bool = True,
) -> tuple[Answer, bool]:
    """Decide by the questions with a significant change, and the degrees that a minute of use misses by it at most (95 %): changed.

    Returns the answer, and whether the model may be used with B anew.  new: B anew, in words; turned: whether there are turns, without
    which E is not asked.
    """
    limit, uses = options.limit_deg * DEG, {bound.name: bound.use for bound in found}
    matters = [name for name in changed if changed[name] > options.limit_deg]
    by_size = sorted(changed, key=lambda name: -changed[name])

    def amount(name: str) -> str:
        return f"{significant(changed[name], 2)}° in {uses.get(name, uses[B])}"

    amounts = {name: f"{OF[name]} (up to {amount(name)})" for name in by_size}
    causes = () if diagnosis is None else diagnosis.best.causes
    because = "" if diagnosis is None else "; ".join(diagnosis.best.words)
    fit_again = "fit a new session, and look at `explain`"
    if set(matters) - {B} or (matters and any(cause.name not in ("zero", "temperature") for cause in causes)):
        why = because or "no cause of the list explains it; run explain"
        moved = ", ".join(amounts[name] for name in by_size if name in matters and name != NOISE)
        left = f"more than noise is left: up to {amount(NOISE)}" if NOISE in matters else ""
        departs = f"{'; '.join(filter(None, (moved and f'departs from the calibration: {moved}', left)))} (95 %)"
        advice = "; ".join(dict.fromkeys(cause.advice for cause in causes)) or fit_again
        return Answer(FAILS, f"{departs}; {why}", advice), False
    unseen = [bound for bound in found if not bound.is_seen]
    e_seen = E not in [bound.name for bound in unseen]
    small = [amounts[name] for name in by_size if name not in matters]
    less = f"changed beyond chance, and by less than {options.limit_deg:g}° (95 %): {', '.join(small)}"
    costs, anew = (float(np.linalg.norm(each)) for each in (cost.as_it_is, cost.bias_anew))
    if matters or costs > max(limit, 2 * float(np.linalg.norm(cost.sigma))):
        why = (because or "the zero moved by more than between switch-ons") if matters else "it moved as between switch-ons"
        why += f", and costs {significant(costs / DEG, 2)}° in the next minute{f'; {less}' if small else ''}"
        if anew > max(limit, 2 * float(np.linalg.norm(cost.bias_anew_sigma))):
            still = f"{why}; with B anew the minute still misses {significant(anew / DEG, 2)}°"
            return Answer(FAILS, still, fit_again), False
        take = "take B anew: --write FILE writes the model with it"
        if e_seen:
            return Answer(BIAS, f"B = {new}; {why}", take), True
        said = f"take B anew: B = {new}; {why}; whether E holds stays open"
        return Answer(FAILS if matters else UNDECIDED, said, f"{take}; then record the turns above, which decide about E"), True
    if unseen and (turned or B in [bound.name for bound in unseen]):
        turns = "record the turns above, with a rest before and after each, then verify again"
        if {bound.name for bound in unseen} == {B}:
            turns = "let it lie still for some minutes, in several attitudes, then verify again"
        open_ = " and ".join(OF[bound.name] for bound in unseen)
        said = f"{less if small else 'nothing significant'}, but {open_} may miss more than {options.limit_deg:g}°"
        return Answer(UNDECIDED, said, turns), True
    so_far = less if small else "within what noise, the old fit and a switch-on explain"
    said = f"{so_far}; it costs {significant(costs / DEG, 2)}° in the next minute"
    if unseen:  # at rest, the zero is all that is asked for
        return Answer(HOLDS, f"the zero holds: {said}", "use it as it is; turns would tell E (above)"), True
    return Answer(HOLDS, said, "use it as it is"), True


def bias_words(bias: np.ndarray, covariance: np.ndarray) -> str:
    """B with its sigmas, dps."""
    sigma = sigmas_in(covariance) / DEG
    return ", ".join(f"{value / DEG:+.4f} ± {s:.4f}" for value, s in zip(bias, sigma, strict=True)) + " dps"


# The screen: what was asked, why, what it costs, and what this recording cannot tell.


def cause_lines(found: Verified) -> list[str]:
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


def cost_lines(found: Verified) -> list[str]:
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


def open_lines(found: Verified) -> list[str]:
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
