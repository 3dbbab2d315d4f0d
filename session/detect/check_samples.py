"""Checks of one log's samples: gaps, registers, clipping level, dead axes, quantisation, copies, bridges, impacts."""

from __future__ import annotations

from collections.abc import Container, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations, pairwise
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from session.base.errors import DataError
from session.base.numeric import held_for, new_readings, runs_of, smallest_step
from session.base.texts import SENSOR_NAME, STANDIN_NAME, significant
from session.base.units import DEG, MDPS, MG, NS, G
from session.detect.bridging import CLIPPED, GAP, MOST, bridged, short_gaps
from session.detect.events import JUMP_G, LEAST_RUN, accel_reach_g, find_impacts, gyro_reach_dps, plateau, run_bar
from session.detect.findings import Correction, Finding, axes_text
from session.detect.segments import Ends, why_broken
from session.detect.stamp_errors import JITTER, angle_rms, stamp_errors
from session.detect.stills import Noise, Still, noise_floor
from session.log.config import Sensor
from session.log.folder import Session
from session.log.logfile import Bridge, Log
from session.log.samples import Samples, pick, pieces
from session.log.stamps import GAP_PERIODS, along_line

# Checks of one log by itself: gaps, registers, temperature, and what its comments contain.  Each returns findings.

LOST_SHARE = 0.001  #: of single samples; more is a fault of the logger that will cost more one day
STUCK = "look at the wiring, the register map, the columns; or is it quantisation, a full scale or a unit whose steps hide its noise?"


def check_comments(log: Log, sensor: Sensor, serials: Container[str] = ()) -> list[Finding]:
    """The log's own ``gyro_fs_dps=``, ``accel_fs_g=``, ``serial=`` against session.toml; serials: those of all logs.

    Registers times the wrong sensitivity are wrong by the ratio of the full scales: nothing in a fit can repair the units.
    """
    findings = []
    for key, declared in (("gyro_fs_dps", sensor.gyro_fs_dps), ("accel_fs_g", sensor.accel_fs_g)):
        stated = log.number(key)
        if stated is not None and abs(stated / declared - 1) > 1e-6:
            text = f"the log has {key}={stated:g}, session.toml {declared:g}"
            right = Correction(f"{key} is {stated:g}, by the log, not {declared:g}", settings=((key, stated),))
            findings.append(Finding("error", log.path.name, "full scale", text, f"correct {key} in session.toml", (right,)))
    serial = log.comments.get("serial")
    if serial and sensor.serial and serial != sensor.serial:
        text = f"the log is of sensor {serial}, session.toml has {sensor.serial}"
        if sensor.serial in serials:
            findings.append(Finding("error", log.path.name, "serial", text, "move it out: keep one folder per sensor"))
        else:  # all may be of the sensor, named otherwise by hand
            findings.append(Finding("warning", log.path.name, "serial", text, "correct sensor.serial in session.toml"))
    return findings


def check_stamps(log: Log, noise: Noise | None, segment_s: float) -> list[Finding]:
    """Gaps, and the jitter of the stamps.

    What the stamps' errors make of a turn matters where it exceeds the gyro's own: angle random walk x sqrt(duration).
    """
    samples, where = log.samples, log.path.name
    pace = samples.pace
    steps = samples.dt_s
    period, long = pace.period_s, steps > GAP_PERIODS * pace.period_s
    gaps = np.zeros(len(steps), dtype=bool)
    gaps[samples.gaps] = True
    single = pace.missing(steps[~long] if long.any() else steps)
    lost = single + int(np.rint(steps[gaps] / period).sum()) - len(samples.gaps)
    findings = [_gaps(samples, gaps, lost, single, where)]
    if len(samples) < 3:
        return findings
    del steps, long, gaps  # of a day
    errors, floor = stamp_errors(samples, segment_s), noise_floor(noise, segment_s)
    whole = angle_rms(samples, errors, segment_s)
    angle = whole * sqrt(errors.share)
    text = f"{significant(errors.scatter_s * 1e6)} µs rms ({errors.scatter_s / period:.1%} of a period): {angle / DEG:.4f} deg per turn"
    if np.isfinite(floor):
        text += f", noise {floor / DEG:.4f}"
    if angle > floor:
        grid = errors.grid_s**2 / 12 > errors.scatter_s**2 / 2
        text = f"stamps in steps of {errors.grid_s * 1e3:g} ms, {text}" if grid else f"stamps come early and late, {text}"
        do = "stamp on the board, not on arrival"
        with suppress(DataError):  # it would refuse
            along_line(samples.t_ns, where)
            do = f"import the log with --even; {do}"
        findings.append(Finding("warning", where, JITTER, text, do))
    elif whole > floor:
        follow = "the readings follow: the stamps are right" if errors.resolved else "whether the stamps are wrong is not known"
        text += f"; {whole / DEG:.4f} if all of it were error: {follow}"
        findings.append(Finding("ok" if errors.resolved else "note", where, JITTER, text))
    else:
        findings.append(Finding("ok", where, JITTER, text))
    return findings


def _gaps(samples: Samples, gaps: np.ndarray, lost: int, single: int, where: str) -> Finding:
    """What is missing: in gaps, which cost turns, and one at a time, which cost accuracy."""
    if gaps.any():
        long = int(np.count_nonzero(gaps)) - int(np.count_nonzero(gaps[short_gaps(samples)[0]]))
        longest_s, first_s = samples.dt_s.max(), samples.at_s(int(np.argmax(gaps)))
        text = f"{gaps.sum()} gaps, {lost} samples lost{f' ({single} of them singly)' if single else ''}"
        text += f", the longest {longest_s:.3f} s, the first at {first_s:.1f} s"
        text += f"; {long} of them longer than {MOST} samples" if long else f"; none longer than {MOST} samples"
        do = f"turns with a gap of more than {MOST} samples are not used; " if long else ""
        return Finding("warning", where, "gaps", text, f"{do}look at the card or the port")
    if not single:
        return Finding("ok", where, "gaps", f"none longer than {GAP_PERIODS:g} periods")
    share = single / (len(samples) + single)
    text = f"{single} samples lost singly ({share:.2%}); no gap longer than {GAP_PERIODS:g} periods"
    return Finding("warning" if share > LOST_SHARE else "note", where, "gaps", text, "look at the card or the port")


def check_registers(log: Log, sensor: Sensor, stills: list[Still], missing_accel: bool = False) -> list[Finding]:
    """Clipping, axes that never move, readings that repeat; ``missing_accel``: rows whose accelerometer reads 0, 0, 0 have none."""
    samples, findings = log.samples, []
    absent = _without_force(samples) if missing_accel else np.zeros(len(samples), dtype=bool)
    if absent.any():
        text = f"{absent.sum()} of {len(absent)} rows read 0, 0, 0: taken as not recorded"
        findings.append(Finding("note", log.path.name, "accelerometer", text))
    for name, unit, values, full, reach, factor, stds in (
        ("gyro", "dps", samples.gyro, sensor.gyro_fs_dps, gyro_reach_dps(sensor), DEG, [s.gyro_std for s in stills]),
        ("accelerometer", "g", samples.accel, sensor.accel_fs_g, accel_reach_g(sensor), G, [s.accel_std for s in stills]),
    ):
        rows: slice | np.ndarray = slice(None)  # of a day's log no list
        if name == "accelerometer" and absent.any():
            if absent.all():
                continue
            rows = np.flatnonzero(~absent)
            values = pick(values, rows)
        new = new_readings(values)
        if held_for(new) > 1:  # then each reading stands, and not at a limit
            values, rows = pick(values, new), np.flatnonzero(new) if isinstance(rows, slice) else rows[new]
        # One axis after the other: a day's log is three times as long side by side.
        ends = np.array([(values[:, i].min(), values[:, i].max()) for i in range(3)])
        stuck = ends[:, 0] == ends[:, 1]
        if stuck.any():
            text = f"{axes_text(stuck)} reads one value throughout; a sensor has noise"
            findings.append(Finding("error", log.path.name, f"{name} stuck", text, STUCK))
        noise = np.median(stds, axis=0) if stds else np.zeros(3)
        least = REST_G if name == "accelerometer" else 0.0
        resting = np.zeros(len(samples), dtype=bool)
        for still in stills:
            resting[still.start : still.stop] = True
        stamps = (samples.t_ns[rows], samples.t_ns[0])
        each = [
            _clipping(values[:, i] / factor, noise[i] / factor, (least, reach), resting[rows], stamps, f"{axis}", unit)
            for i, axis in enumerate("xyz")
            if not stuck[i]
        ]
        clipped = [text for text in each if text]
        peak = np.abs(ends).max() / factor
        if clipped:
            do = "turn slower or choose a larger full scale" if name == "gyro" else "choose a larger full scale, or do not knock"
            findings.append(Finding("warning", log.path.name, f"{name} clipping", "; ".join(clipped), do))
        else:
            level = "note" if peak > full else "ok"
            beyond = " is passed: the datasheet promises nothing there" if peak > full else ""
            findings.append(Finding(level, log.path.name, f"{name} clipping", f"peak {peak:.4g} {unit}, full scale {full:g}{beyond}"))
    return findings + _repeats(log, stills)


#: g: no range of an accelerometer ends below what it reads at rest, gravity with 20 % of scale and zero (``UNITS_RIGHT``)
REST_G = 1.2


def _without_force(samples: Samples) -> np.ndarray:
    """(N,) bool: rows whose accelerometer reads 0, 0, 0."""
    return np.concatenate([(part == 0).all(axis=1) for _, part in pieces(samples.accel)])


def _clipping(
    values: np.ndarray,
    noise_std: float,
    limits: tuple[float, float],
    resting: np.ndarray,
    stamps: tuple[np.ndarray, int],
    axis: str,
    unit: str,
) -> str | None:
    """At the register's end, or at an extreme that the axis keeps for longer than noise lets it while the body moves.

    limits: the least that a range can end at, and the register's end; resting (N,) bool; stamps (N,) ns, and the log's first.  What
    repeats at rest, or within what gravity alone makes, is a register coarser than the noise.
    """
    least, reach = limits
    run = run_bar(noise_std, smallest_step(values))
    rest = np.median(values)
    mask = np.zeros(len(values), dtype=bool)
    for level in (values.max(), values.min()):
        if abs(level) >= reach * (1 - 1e-6):
            mask |= values == level
        elif abs(level) > least and abs(level - rest) > 20 * noise_std:  # an axis that is not turned has its extremes in the noise
            at = plateau(values, level, run)
            for start, stop in zip(*runs_of(at), strict=True):
                at[start:stop] = not resting[start:stop].any()
            mask |= at
    if not mask.any():
        return None
    levels = " and ".join(f"{level:.5g}" for level in np.unique(values[mask]))
    first_s = (stamps[0][np.argmax(mask)] - stamps[1]) * NS
    return f"{axis} stands at {levels} {unit} in {mask.sum()} samples, first at {first_s:.1f} s"


#: of the finding on rows that repeat a reading
HELD = "repeats"
#: of rows that repeat a reading: fewer are not looked into; times as many as noise and the register's steps make
LEAST_SHARE, BEYOND_CHANCE = 0.01, 10


def _repeats(log: Log, stills: list[Still]) -> list[Finding]:
    """Rows whose six readings all repeat the row before: the log was read faster than the sensor measures.  Or one sensor's three: it
    measures at another rate than the other.

    Noise repeats a reading with a chance of step / (2 sqrt(pi) std) per axis, all six at once nearly never.
    """
    samples = log.samples
    new = new_readings(samples.gyro), new_readings(samples.accel)
    shares = [1 - float(each[1:].mean()) if len(samples) > 1 else 0.0 for each in (*new, new[0] | new[1])]
    if max(shares) < LEAST_SHARE:
        return []
    std = np.median([np.concatenate([s.gyro_std, s.accel_std]) for s in stills], axis=0) if stills else np.zeros(6)
    steps = np.array([smallest_step(sensor[:, axis]) for sensor in (samples.gyro, samples.accel) for axis in range(3)])
    by_noise = np.minimum(1.0, steps / np.maximum(2 * np.sqrt(np.pi) * std, 1e-300))
    chances = [*by_noise.reshape(2, 3).prod(axis=1), by_noise.prod()]
    held = [share >= max(LEAST_SHARE, BEYOND_CHANCE * chance) for share, chance in zip(shares, chances, strict=True)]
    do = "read on the data-ready signal or from the FIFO; log each sample once"
    where, rows_hz = log.path.name, 1 / samples.period_s
    if held[2]:
        fresh_hz, by_chance = (1 - shares[2]) * rows_hz, "below 0.1%" if chances[2] < 1e-3 else f"{chances[2]:.1%}"
        text = f"{shares[2]:.0%} of the rows repeat all six readings (by noise {by_chance}): new ones come at {fresh_hz:.0f} Hz"
        return [Finding("warning", where, HELD, text, do)]
    findings = []
    for name, level, each, share, is_held in zip(("gyro", "accelerometer"), ("warning", "note"), new, shares, held, strict=False):
        if share < 1 and (is_held or held_for(each) > 1):  # else it is stuck, another finding
            text = f"each reading of the {name} stands for {1 / (1 - share):.3g} rows: new ones come at {(1 - share) * rows_hz:.0f} Hz"
            findings.append(Finding(level, where, HELD, f"{text}, rows at {rows_hz:.0f}", do))
    return findings


# A gyro that stops at a level far below its full scale: checked before its scale and its stills, which it spoils.

#: readings at a level, of either sign, from which it is one; a turn's own peak is a few
LEAST_AT = 20
#: times the readings' own noise that a level is from rest: an axis that is not turned has its extremes in the noise
FAR = 20.0


class Ceiling(NamedTuple):
    """levels_dps (3,), NaN where an axis has none; at (N,) bool: rows with a reading at its level."""

    levels_dps: np.ndarray
    at: np.ndarray


def find_ceiling(gyro: np.ndarray) -> Ceiling | None:
    """Of rates (N, 3) rad/s: extremes of both signs that an axis stands at again and again, and never passes."""
    new = new_readings(gyro)
    if held_for(new) > 1:  # each reading stands, and not at a level
        found = find_ceiling(gyro[new])
        return None if found is None else found._replace(at=found.at[np.cumsum(new) - 1])
    levels, at = np.full(3, np.nan), np.zeros(len(gyro), dtype=bool)
    for axis in range(3):
        noise = _usual_step(gyro[:, axis])  # of a day, before the next column is held
        if (stands := _stands(gyro[:, axis], noise)) is not None:
            levels[axis] = stands[0] / DEG
            at |= stands[1]
    return Ceiling(levels, at) if at.any() else None


def _stands(values: np.ndarray, noise: float) -> tuple[float, np.ndarray] | None:
    """Of the readings (N,) of one axis: the level at which they stand, and which (N,) bool; noise: their usual step."""
    rest = np.median(values)
    sides = [plateau(values, extreme, LEAST_RUN) for extreme in (values.max(), values.min()) if abs(extreme - rest) > FAR * noise]
    if len(sides) < 2 or min(side.sum() for side in sides) < LEAST_AT:
        return None
    at = sides[0] | sides[1]
    return float(np.abs(values[at]).mean()), at


def _usual_step(values: np.ndarray) -> float:
    """The median of the steps between neighbours (N,) that differ."""
    steps = np.diff(values)
    del values  # of a day, no two columns at once
    np.abs(steps, out=steps)
    steps = steps[steps > 0]
    return float(np.median(steps, overwrite_input=True)) if len(steps) else 0.0


def clean_turns(ceiling: Ceiling | None, between: Sequence[Ends]) -> list[Ends]:
    """Those of the turns, given by the stills around them, that hold no reading at the level."""
    return [(first, last) for first, last in between if ceiling is None or not ceiling.at[first.stop : last.start].any()]


def ceiling_finding(log: Log, sensor: Sensor, ceiling: Ceiling, between: Sequence[Ends] = ()) -> Finding:
    """The one line that stands for what the ceiling spoils; between: turns, by the stills around them."""
    levels_dps, at = ceiling
    found = np.isfinite(levels_dps)
    levels = " and ".join(f"{level:.4g}" for level in np.unique(np.round(levels_dps[found], 2)))
    clean, turns = len(clean_turns(ceiling, between)), len(between)
    text = (
        f"{axes_text(found)} never pass{'es' if found.sum() == 1 else ''} ±{levels} dps, of ±{sensor.gyro_fs_dps:g}: "
        f"{at.mean():.0%} of the readings stand there, the first at {log.samples.at_s(int(np.argmax(at))):.1f} s"
    )
    if turns:
        text += f"; {turns - clean} of {turns} turns reach it"
    do = "what is beyond is lost: turn slower, or look for the limit in the sensor's settings and in what wrote the log"
    return Finding("error", log.path.name, "gyro ceiling", text, do)


# An axis that dies within a log: it reads one value for a second or more, and sixty readings, while the others move or scatter.

#: and so many readings: at 2 Hz two equal neighbours are a coarse register, not a second of silence
LEAST_S, LEAST_DEAD_READINGS = 1.0, 60
#: a run at the axis's own extreme may be a turn that clips; no turn is longer than this
CLIPPED_S = 5.0
#: the body moves where another axis spans this, dps and g, over the middle four fifths of the readings
MOVES_DPS, MOVES_G = 10.0, 0.1
#: an axis scatters where fewer neighbours than this are equal: noise of 0.37 of a step, which stays in one step for sixty readings
#: with a chance of 1e-5
SCATTERS = 0.6
#: shorter runs than the least, by as much, are a coarse register's: it has runs of every length, noise has none of these
COARSE_S, COARSE_READINGS, COARSE_RUNS = 0.15, 10, 3


def check_dead(log: Log, missing_accel: bool = False) -> list[Finding]:
    """The longest such run of each axis; ``missing_accel``: rows whose accelerometer reads 0, 0, 0 have none, by agreement."""
    samples, findings = log.samples, []
    absent = _without_force(samples) if missing_accel else np.zeros(len(samples), dtype=bool)
    for number, column in enumerate(("gx", "gy", "gz", "ax", "ay", "az")):
        found = _dead_runs(samples, number, absent)
        if not found:
            continue
        start, stop = max(found, key=lambda run: run[1] - run[0])
        sensor, unit = ("gyro", "dps") if number < 3 else ("accelerometer", "g")
        text = (
            f"{column} reads {_channel(samples, number, start) + 0.0:.4g} {unit} from row {start} to row {stop - 1}, "
            f"{samples.at_s(start):.1f} to {samples.at_s(stop - 1):.1f} s, while others go on; a sensor has noise"
        )
        text += f" ({len(found)} such places)" if len(found) > 1 else ""
        do = "look at the wiring and at what wrote the log; record again, or cut the log there"
        findings.append(Finding("error", log.path.name, f"{sensor} dead", text, do))
    return findings


def _channel(samples: Samples, number: int, rows: slice | int) -> Any:
    """Readings of one of six channels, dps or g."""
    return samples.gyro[rows, number] / DEG if number < 3 else samples.accel[rows, number - 3] / G


def _dead_runs(samples: Samples, number: int, absent: np.ndarray) -> list[tuple[int, int]]:
    """start, stop of each run of equal readings of one of six channels that neither noise, clipping nor a coarse register makes."""
    period_s, values = samples.period_s, _channel(samples, number, slice(None))
    extremes = (values.min(), values.max())
    if extremes[0] == extremes[1]:
        return []  # stuck throughout: another finding
    starts, stops = runs_of((values[1:] == values[:-1]) & ~(absent[1:] & (number >= 3)))  # of steps: a run of readings is one longer
    lengths = stops - starts + 1
    long = (lengths * period_s >= LEAST_S) & (lengths >= LEAST_DEAD_READINGS)
    coarse = ~long & (lengths * period_s >= COARSE_S) & (lengths >= COARSE_READINGS) & ~np.isin(values[starts], extremes)
    if coarse.sum() >= max(COARSE_RUNS, long.sum() / 4):
        return []
    found = []
    for start, length in zip(starts[long].tolist(), lengths[long].tolist(), strict=True):
        some = slice(start, start + length)
        run = np.concatenate([samples.gyro[some] / DEG, samples.accel[some] / G], axis=1)
        clips = values[start] in extremes and length * period_s <= CLIPPED_S
        if not clips and (_others_move(run, number) or (not coarse.any() and _others_scatter(run, number))):
            found.append((start, start + length))
    return found


def _others_move(run: np.ndarray, number: int) -> bool:
    low, high = np.quantile(np.delete(run, number, axis=1), (0.1, 0.9), axis=0)
    bars = np.delete([MOVES_DPS] * 3 + [MOVES_G] * 3, number)
    return bool((high - low > bars).any())


def _others_scatter(run: np.ndarray, number: int) -> bool:
    """Both other axes of the same sensor."""
    first = number - number % 3
    others = [other for other in range(first, first + 3) if other != number]
    return bool(((np.diff(run[:, others], axis=0) == 0).mean(axis=0) < SCATTERS).all())


# Registers whose steps are larger than the noise: a gyro repeats one value at rest, and rest cannot be separated from a slow turn; an
# accelerometer repeats one in each still, and gravity's error cannot be estimated.

QUANTISATION = "quantisation"
#: of neighbours that are equal: a step of 2.5 sigma makes so many of pure noise
REPEATS = 0.6
#: stretches that are looked at, and the share of them, the quietest, that must repeat
STRETCH_S, LEAST_READINGS, QUIETEST = 1.0, 8, 0.2
#: a larger step is stated in dps
MOST_MDPS = 999
#: of a step: scatter in the stills that is nothing but the rounding of sums
NO_SCATTER = 1e-3


def check_quantised(log: Log, sensor: Sensor) -> list[Finding]:
    """Of a log in which no still was found: whether its steps are the reason, axis by axis; one that never moves is reported as stuck."""
    gyro = log.samples.gyro
    moves = np.ptp(gyro, axis=0) > 0
    size = max(LEAST_READINGS, round(STRETCH_S / log.samples.period_s))
    count = (len(gyro) - 1) // size
    if not count or not moves.any():
        return []
    same = (np.diff(gyro, axis=0) == 0)[: count * size].reshape(count, size, 3).mean(axis=1)
    share = np.quantile(same, 1 - QUIETEST, axis=0)
    coarse = moves & (share > REPEATS)
    if not coarse.any():
        return []
    steps = np.abs(np.diff(gyro, axis=0))
    step = float(np.min(steps[:, coarse], where=steps[:, coarse] > 0, initial=np.inf))
    wide = f"{step / DEG:.3g} dps" if step / MDPS > MOST_MDPS else f"{step / MDPS:.3g} mdps"
    text = f"the gyro ({axes_text(coarse)}) moves in steps of {wide}, and repeats {share[coarse].max():.0%} of its readings"
    text += " where it is quietest: the steps are larger than its noise"
    if (typical := sensor.typical("gyro_noise_mdps_rthz")) is not None:
        rms = typical[1] * np.sqrt(0.5 / log.samples.period_s)
        text += f" ({rms:.3g} mdps rms for the {typical[0]} at {1 / log.samples.period_s:.4g} Hz)"
    do = "choose a smaller full scale, or a higher data rate; with such steps a rest cannot be separated from a slow turn"
    return [Finding("error", log.path.name, QUANTISATION, text, do)]


def check_repeated_gravity(log: Log, noise: Noise | None) -> list[Finding]:
    """Whether the accelerometer, on some axis that moves, repeats one reading in each still; noise: of these stills."""
    if noise is None:
        return []
    accel = log.samples.accel
    apart = (np.abs(np.diff(part, axis=0)) for _, part in pieces(accel, overlap=1))
    step = np.min([np.min(steps, axis=0, where=steps > 0, initial=np.inf) for steps in apart], axis=0)
    coarse = np.isfinite(step) & (noise.accel * np.sqrt(0.5 / log.samples.period_s) < NO_SCATTER * step)
    if not coarse.any():
        return []
    text = (
        f"the accelerometer ({axes_text(coarse)}) moves in steps of {step[coarse].max() / MG:.3g} mg, and repeats one reading in each still"
    )
    text += ": the steps are larger than its noise, so it is not known how far gravity is off"
    do = "choose a smaller full scale, a higher data rate or a wider filter; was the log rounded where it was written?"
    return [Finding("error", log.path.name, QUANTISATION, text, do)]


# One recording twice in a folder: it would count as twice the evidence, and validate itself.

#: samples that two recordings cannot have in common by chance: a sensor has noise
LEAST = 100


def check_copies(logs: tuple[Log, ...]) -> list[Finding]:
    """An error for each log or closure run whose readings are another's, whole or as far as the shorter one goes."""
    do = "remove one of them: a copy makes every sigma too small, and is held out of nothing"
    return [
        Finding("error", second.path.name, "copy", f"holds the same readings as {first.path.name}", do)
        for first, second in combinations(logs, 2)
        if _same(first.samples.gyro, second.samples.gyro)
    ]


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    count = min(len(one), len(other))
    if count < LEAST or not np.array_equal(one[:LEAST], other[:LEAST]) or not np.ptp(one[:count], axis=0).any():
        return False
    return np.array_equal(one[:count], other[:count])


# Short gaps and single clipped readings are bridged before a fit: what was put in, and how much of a turn it may cost.

BRIDGED = "bridged readings"


def with_bridges(session: Session) -> Session:
    """The session with the short gaps and short peaks of its logs and closure runs bridged; logs without any are the same objects."""

    def whole(log: Log) -> Log:
        if log.bridges:  # done before
            return log
        samples, bridges = bridged(log.samples, session.config.sensor)
        return replace(log, samples=samples, bridges=bridges) if bridges else log

    return session.with_logs(whole)


def check_bridges(log: Log, sensor: Sensor, stills: list[Still], noise: Noise | None, segment_s: float) -> list[Finding]:
    """What a fit puts in, against what the gyro's own noise adds to a segment; what lies in turns that are not used for another reason,
    between these stills, is not counted."""
    samples, bridges = bridged(log.samples, sensor)
    if not bridges:
        return []
    whole = replace(log, samples=samples, bridges=bridges)
    turns = [(first.start_s + first.duration_s, last.start_s) for first, last in pairwise(stills)]
    rows = np.searchsorted(samples.t_s, turns).reshape(-1, 2)
    broken = [(a, b) for a, b in rows.tolist() if why_broken(samples, slice(a, b + 1), sensor, whole.put_in)]
    bridges = tuple(bridge for bridge in bridges if not any(a <= bridge.row <= b for a, b in broken))
    if not bridges:
        return []
    floor = noise_floor(noise, segment_s)
    worst = max(float(np.linalg.norm(bridge.sigma_rad)) for bridge in bridges)
    text = "; ".join(text for text in (_gaps_text(bridges), _peaks_text(bridges)) if text)
    text += f": put in from their neighbours, off by {significant(worst / DEG, 2)} deg at worst"
    text += f" (gyro noise per segment {significant(floor / DEG, 2)})" if np.isfinite(floor) else ""
    do = "their turns count, with so much wider a sigma"
    return [Finding("warning" if worst > floor else "note", log.path.name, BRIDGED, text, do)]


def _gaps_text(bridges: tuple[Bridge, ...]) -> str:
    gaps = [bridge for bridge in bridges if bridge.what == GAP]
    if not gaps:
        return ""
    lost = sum(gap.count for gap in gaps)
    return f"{lost} missing in {len(gaps)} gap{'s' * (len(gaps) != 1)}, the first at {gaps[0].at_s:.1f} s"


def _peaks_text(bridges: tuple[Bridge, ...]) -> str:
    peaks = [bridge for bridge in bridges if bridge.what == CLIPPED]
    if not peaks:
        return ""
    axes = axes_text(np.any([peak.sigma_rad > 0 for peak in peaks], axis=0))
    stood = sum(peak.count for peak in peaks)
    return f"{stood} at the register's end on {axes}, the first at {peaks[0].at_s:.1f} s"


# Impacts in turns: how many, the hardest, and how near to the turn's end.

IMPACTS = "impacts"


def check_impacts(where: str, samples: Samples, between: Sequence[Ends]) -> list[Finding]:
    """Of the turns, given by the stills around them; nothing where there is none."""
    found = find_impacts(samples)
    turns = [(first.stop, last.start) for first, last in between]
    hit = {number: [each for each in found if start <= each.row < stop] for number, (start, stop) in enumerate(turns)}
    hit = {number: impacts for number, impacts in hit.items() if impacts}
    if not hit:
        return []
    number, worst = max(((n, each) for n, impacts in hit.items() for each in impacts), key=lambda pair: pair[1].jump_g)
    before_s = samples.at_s(turns[number][1]) - worst.at_s
    text = (
        f"{len(hit)} of {len(turns)} turns hold one: specific force jumps by {JUMP_G:g} g or more from one reading to the next, "
        f"most by {worst.jump_g:.1f} g at {worst.at_s:.1f} s, {before_s:.1f} s before the next rest"
    )
    do = "a softer stop or a slower hand; a fit weighs such turns by how they close"
    return [Finding("note", where, IMPACTS, text, do)]


# Logs of a board that had no sensor (docs/boards.md): made up, or played to it.

#: as the board's comment in a log names who gave the samples
SOURCE = "source"


def check_standin(logs: tuple[Log, ...]) -> list[Finding]:
    """A warning for each log or closure run without a sensor; an error where others are of one: together they calibrate nothing."""
    found = [log for log in logs if log.comments.get(SOURCE) == STANDIN_NAME]
    real = next((log.path.name for log in logs if log.comments.get(SOURCE) == SENSOR_NAME), None)
    text = "the board had no sensor: these samples are made up, or were played to it"
    if real is None:
        return [Finding("warning", log.path.name, "sensor", text, "look at the board's wiring, and record again") for log in found]
    return [Finding("error", log.path.name, "sensor", f"{text}; {real} is a sensor's", "take it out of the folder") for log in found]
