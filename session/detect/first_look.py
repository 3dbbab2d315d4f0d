"""The first look at a session: everything that has burnt users before, tested before anything is fitted.

Each check returns findings: a measured number, the bar it was held against, what to do.  The bars come from physics and the
datasheet, not from recordings.  Order: the log by itself, then its stills, then the gyroscope against gravity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError
from session.base.names import CLOCKS, is_special, log_paths
from session.base.units import NS
from session.detect.axes import check_axes, check_gravity_moves
from session.detect.check_references import check_dials, check_known_turns, with_own_accelerometer
from session.detect.check_samples import (
    Ceiling,
    ceiling_finding,
    check_bridges,
    check_comments,
    check_copies,
    check_dead,
    check_impacts,
    check_quantised,
    check_registers,
    check_repeated_gravity,
    check_stamps,
    check_standin,
    clean_turns,
    find_ceiling,
    with_bridges,
)
from session.detect.check_stills import (
    accel_unit_factor,
    check_gravity,
    check_leaps,
    check_noise,
    check_rests,
    check_stills,
    check_temperature,
    check_turns,
    check_unseen,
    check_unused_rests,
    check_zero_rate,
)
from session.detect.check_time import check_length, check_rate, check_rate_changes, check_undersampling
from session.detect.dials import without_wrong_dials
from session.detect.findings import Finding, as_arguments, unreadable, worst
from session.detect.segments import FEWEST_SEGMENTS, Ends, Segment, cut_segments, known_turns, moments_of, session_segments
from session.detect.signatures import FILTER, check_signatures, explains_others
from session.detect.stills import Noise, SessionStills, Still, UnusedRest, references
from session.log.config import HOST_CLOCK, ByHand, Config, LeftOut, by_hand_words, read_config
from session.log.folder import Session, read_session
from session.log.lines import BREAKS_OFF
from session.log.logfile import Log, read_log
from session.log.samples import Samples, extremes, mapped, times

__all__ = ["Finding", "check_folder", "check_session", "first_look", "worst"]


#: a log as it is fitted, short gaps and peaks bridged, and its turns by the stills around them: those that ``fit`` uses, and those that
#: axes and scale are examined on
LogTurns = tuple[Log, list[Ends], list[Ends]]


def _turns_of(log: Log, segments: Sequence[Segment], enough: bool, run: bool = False) -> LogTurns:
    """enough: whether ``fit`` has enough turns.  Else all are examined, since a wrong unit may be what rules them out.  run: whether it is
    a closure run, of which only what cannot be integrated is left out."""
    used = [s.stills for s in segments if (not s.breaks_yaw if run else s.accepted)]
    return log, used, used if enough and used else [s.stills for s in segments]


def first_look(
    session: Session,
    log: Log,
    stills: list[Still],
    noise: Noise | None,
    unused: Sequence[UnusedRest] = (),
    turns: LogTurns | None = None,
) -> list[Finding]:
    """All checks of one log; stills, noise and rests that are none as ``SessionStills`` found them; turns: as in the session, by default
    those of this log alone, as it stands."""
    config, where = session.config, log.path.name
    good = references(stills)
    missing_accel = session.reference is not None
    findings = [
        *(
            Finding("warning", where, "reading", note, "copy it again, whole: turns may be missing")
            if note == BREAKS_OFF
            else Finding("note", where, "reading", note)  # what the reader repaired or left out
            for note in log.notes
        ),
        *check_comments(log, config.sensor, [each.comments.get("serial", "") for each in session.logs]),
        *check_rate(log, config.sensor),
        *check_stamps(log, noise, config.protocol.segment_s),
    ]
    signatures = check_signatures(log, config.sensor, at_rest=not missing_accel)
    if explains_others(signatures):
        return findings + signatures
    findings += [
        *signatures,
        *check_registers(log, config.sensor, good, missing_accel),
        *check_bridges(log, config.sensor, good, noise, config.protocol.segment_s),
        *check_dead(log, missing_accel),
        *check_temperature(log, good, config.sensor),
    ]
    if session.reference is not None and log in session.logs:
        # Where something better than gravity is the reference, nothing has to be still.
        return findings + session.reference.check(session, log)
    ceiling = find_ceiling(log.samples.gyro)
    if not good:
        findings += check_length(log, config.protocol.segment_s)
    if not good and ceiling is not None:
        return [*findings, ceiling_finding(log, config.sensor, ceiling)]
    coarse = [] if good else check_quantised(log, config.sensor)
    stuck = bool(np.equal(*extremes(log.samples.gyro)).any())
    findings += coarse + check_stills(where, stills, bool(coarse) or stuck) + check_unused_rests(where, unused, stills)
    if not good:
        return findings
    if turns is None:
        segments = cut_segments(log.samples, stills, config.sensor, config.protocol)
        turns = _turns_of(log, segments, sum(segment.accepted for segment in segments) >= FEWEST_SEGMENTS)
    fitted, used, examined = turns
    if fitted is not log:
        ceiling = find_ceiling(fitted.samples.gyro)
    factor, _ = accel_unit_factor(good, config)
    samples = fitted.samples.with_accel(mapped(mapped(fitted.samples.accel, times(factor)), config.accelerometer.correct))
    return [
        *findings,
        *check_repeated_gravity(log, noise),
        *check_noise(where, noise, config.sensor),
        *check_zero_rate(where, good, config.sensor),
        *check_gravity(where, good, config, noise, closure_run=log in session.closures, raw=log.raw),
        *_axes_below(ceiling, fitted, examined, samples, config),
        *check_rate_changes(samples, where, examined, noise, config.protocol.segment_s),
        *check_undersampling(fitted, used, noise, config),
        *check_impacts(where, samples, used),
    ]


def _axes_below(ceiling: Ceiling | None, log: Log, between: list[Ends], samples: Samples, config: Config) -> list[Finding]:
    """``check_axes`` by the turns that reach no ceiling; where these are too few and the others disagree, the ceiling is the reason."""
    if stays := check_gravity_moves(log.path.name, samples, between):
        return stays
    clean = clean_turns(ceiling, between)
    findings = check_axes(log, samples, clean if len(clean) >= FEWEST_SEGMENTS else between, config)
    spoilt = ceiling is not None and len(clean) < min(len(between), FEWEST_SEGMENTS) and worst(findings) != "ok"
    return [ceiling_finding(log, config.sensor, ceiling, between)] if spoilt and ceiling is not None else findings


def check_folder(
    folder: Path, further: Callable[[Session, SessionStills], list[Finding]] | None = None, clock: str = CLOCKS[0]
) -> list[Finding]:
    """The first look at every log and closure run of a folder; a log that cannot be read becomes an error among the findings.

    further: a look at the whole session, as it is read, and its stills, taken where nothing is an error; clock: that times the logs.
    """
    findings: list[Finding] = []
    if (rests := _rests_alone(folder)) is not None:
        return rests
    try:
        session: Session | None = read_session(folder)
    except CalibrationError as error:
        session, findings = _read_what_there_is(folder, error)
    if session is None:
        return findings
    session = session.on_clock(clock)
    session, own = with_own_accelerometer(session)
    session, aligned = session.examined()
    found = SessionStills(session)
    checked = check_session(session, found)
    findings += ([] if explains_others(checked) else own) + aligned + checked
    if further is not None and worst(findings) != "error":
        findings += further(session, found)
    return findings + check_rests(session.rests, session.config.sensor)


def _rests_alone(folder: Path) -> list[Finding] | None:
    """All findings of a folder that holds rest logs and nothing that was turned; None of any other."""
    try:
        if log_paths(folder, "log") or not (paths := log_paths(folder, "rest")):
            return None
        config = read_config(folder / "session.toml")
    except CalibrationError:
        return None  # the reading of the session reports it
    return _check_keys(config) + check_rests(tuple(paths), config.sensor)


def check_session(session: Session, found: SessionStills | None = None) -> list[Finding]:
    """The first look at every log and closure run of a session that could be read; ``found`` holds its stills for later steps."""
    found = found or SessionStills(session)
    logs = (*session.logs, *session.closures)
    findings = _check_keys(session.config) + check_copies(logs) + check_standin(logs)
    for log in logs:
        found.of(log)
    whole = with_bridges(session)
    there, config = SessionStills(whole, found), session.config
    parts = [] if session.reference is not None else session_segments(whole, there)
    whole, parts, dials = without_wrong_dials(whole, parts)
    session = replace(session, attitudes=whole.attitudes)
    known = known_turns(whole, parts)
    counted = [] if session.reference is not None else check_turns(session.name, parts, known, config.protocol.still_s)
    enough = worst(counted) != "error"
    for log, as_fitted in zip(logs, (*whole.logs, *whole.closures), strict=True):
        here, turns = found.of(log), None
        if log in session.logs:
            turns = next((_turns_of(as_fitted, part.segments, enough) for part in parts if part.log is as_fitted), None)
        elif (run := there.of(as_fitted)).noise is not None:
            cut = cut_segments(run.samples, run.stills, config.sensor, config.protocol, put_in=as_fitted.put_in)
            turns = _turns_of(as_fitted, cut, enough=True, run=True)
        unused = here.unused if log in session.logs and session.reference is None else ()
        findings += first_look(session, log, here.stills, here.noise, unused, turns)
    findings += check_by_hand(session)
    if not explains_others(findings):
        findings += counted + check_leaps(parts)
        changes = any(finding.what == FILTER for finding in findings)  # the reason of what is not seen
        findings += [] if changes or session.reference is not None else check_unseen(parts)
        findings += dials + check_dials(session, found) + check_known_turns(known, parts)
    return [as_arguments(finding) for finding in findings] if session.in_memory else findings


def _check_keys(config: Config) -> list[Finding]:
    """Keys of session.toml that nothing reads: a misspelt one would silently leave its default in force.  And a sensor without a name."""
    findings = []
    if not config.model_given:
        text = f"sensor.model is not given: its registers and limits are taken to be those of an {config.sensor.model}"
        findings.append(Finding("note", "session.toml", "sensor", text, 'name it (`calibrate.py sensors`), or give "unknown"'))
    if (ratio := config.sensor.clock_ratio) is not None:
        words, sigma_ppm = config.sensor.clock_words, config.sensor.clock_sigma_ppm or 0.0
        level = "warning" if abs(ratio - 1) > 3 * max(HOST_CLOCK, 1e-6 * sigma_ppm) else "ok"
        do = "`fit --clock arrivals` divides the stamps by it" if level == "warning" else ""
        findings.append(Finding(level, "session.toml", "clock", f"{words}: so much every scale factor is off by the stamps", do))
    for key, near in config.unknown:
        do = f"did you mean {near}?" if near else "remove it"
        findings.append(Finding("warning", "session.toml", "unknown key", f"{key} is read by nothing", do))
    return findings


def check_by_hand(session: Session) -> list[Finding]:
    """What a person left out or changed (session.toml), in one line; and turns left out in logs that are not there, or outside of them."""
    findings: list[Finding] = []
    there: list[ByHand] = []
    rows: list[ByHand] = [*session.config.exclude, *session.config.still]
    for row in rows:
        logs = session.logs if isinstance(row, LeftOut) else (*session.logs, *session.closures)
        mine = [log.samples for log in logs if moments_of(log.path, [row])]
        if any(samples.t_ns[0] * NS <= row.at_s <= samples.t_ns[-1] * NS for samples in mine):
            there.append(row)
            continue
        where = "lies outside of it" if mine else "is no log of this session"
        text, do = f"{row.log} at {row.at_s:g} s is left out, which {where}", "correct log and at_s (s of the log's clock), or remove it"
        findings.append(Finding("warning", "session.toml", "exclude", text, do))
    return findings + ([Finding("ok", "session.toml", CHANGED, by_hand_words(there))] if there else [])


CHANGED = "by hand"


def _read_what_there_is(folder: Path, error: CalibrationError) -> tuple[Session | None, list[Finding]]:
    """The session without what cannot be read, and why not; ``error`` is what stopped the reading of the whole."""
    if is_special(folder):
        return None, [unreadable(folder.name, error)]
    try:
        config = read_config(folder / "session.toml")
        paths = {stem: log_paths(folder, stem) for stem in ("log", "closure")}
    except CalibrationError:
        return None, [unreadable(folder.name, error)]
    logs: dict[str, list[Log]] = {"log": [], "closure": []}
    findings: list[Finding] = []
    for stem in paths:
        for path in paths[stem]:
            try:
                logs[stem].append(read_log(path, config.sensor))
            except CalibrationError as reason:
                findings.append(unreadable(path.name, reason))
    if not findings:  # the logs are readable: it was the dial readings, or there is no log
        findings.append(unreadable(folder.name, error))
    return Session(folder, config, tuple(logs["log"]), tuple(logs["closure"])), findings
