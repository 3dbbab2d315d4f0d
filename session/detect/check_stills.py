"""Checks of stills, rest logs and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError
from session.base.numeric import median_length
from session.base.units import DEG, MDPS, MG, STANDARD_GRAVITY_MPS2, G
from session.detect.accelerometer import APART_RAD, attitudes_of, force_of
from session.detect.events import knocked
from session.detect.findings import Correction, Finding, unreadable, xyz_text
from session.detect.segments import LEAPS, FoundTurn, LogSegments, why_too_few
from session.detect.stills import BY_HAND, Noise, Still, UnusedRest, noise_floor, references
from session.log.config import Config, Sensor
from session.log.logfile import Log
from session.log.rests import RestLog, read_rest
from session.log.sensors import Profile

# Checks of what a log's still phases show: their number, the noise, the zero-rate level, the length of gravity.

#: share of a log without a still: 0.17 at most in recordings that begin or end by moving (mimu, mikov); 0.42 and 0.5 where a range or a
#: filter changes on the way
UNSEEN_SHARE = 1 / 3
NOISE_RATIO = 3.0  #: units differ by 1.4 at most
#: mdps/√Hz of nearly all MEMS gyroscopes: so narrow that dps and rad/s, by a factor of 57, cannot both lie in it
MEMS_MDPS_RTHZ = (1.0, 50.0)
#: findings on the noise at rest
GYRO_NOISE, ACCEL_NOISE = "gyro noise", "accelerometer noise"
GRAVITY_OK = 0.02  #: an accelerometer's sensitivity tolerance
GRAVITY_WRONG = 0.10  #: what an offset of 65 mg and 2 % of sensitivity can do together
MOST_LISTED = 8  #: places in one line; ``fit`` writes all of them into its JSON
ENOUGH_SEGMENTS = 13
#: of the finding on the turns that a fit uses
TURNS, MOVEMENT, NO_STILLS = "turns", "movement", "no stills"
ENOUGH_ATTITUDES = 6  #: to determine a scale factor and a bias of each of three axes; fewer can all have gravity's length by chance


def check_stills(where: str, stills: list[Still], blind: bool) -> list[Finding]:
    """The number and length of the stills, and those that are no reference; blind: the gyro shows no noise, and that finding gives the
    reason that there is none."""
    good = references(stills)
    if not good and blind:
        return []
    if not good:
        do = "let go of the table for still_s between turns; is it vibrating?"
        if stills and all(still.problem == BY_HAND for still in stills):
            return [Finding("error", where, "stills", f"each of {len(stills)} {BY_HAND}", "take one back: remove its entry of [[still]]")]
        reason = f"none of {len(stills)} quiet phases is at rest: each {stills[0].problem}" if stills else "none found: it never rests"
        return [Finding("error", where, "stills", reason, do)]
    durations = np.array([still.duration_s for still in good])
    text = f"{len(good)} of {durations.min():.1f} to {durations.max():.1f} s (median {np.median(durations):.1f})"
    bumps = sum(still.bumps for still in good)
    findings = [Finding("ok", where, "stills", text + (f", {bumps} bumps survived" if bumps else ""))]
    bad = [(number, still) for number, still in enumerate(stills) if still.problem not in (None, BY_HAND)]
    if bad:
        listed = _first_few([f"still {number} at {still.start_s:.1f} s {still.problem}" for number, still in bad])
        text = f"{len(bad)} of {len(stills)} are no reference: {listed}"
        findings.append(Finding("warning", where, "not still", text, "their turns are joined over them; take the hand off the table"))
    return findings


def check_unused_rests(where: str, unused: Sequence[UnusedRest], stills: list[Still]) -> list[Finding]:
    """Rests that became no still, each with its place and reason; those in the list of stills are reported there."""
    stood = {still.start_s for still in stills}
    rests = [rest for rest in unused if rest.start_s not in stood]
    if not rests:
        return []
    places = [f"at {rest.start_s:.1f} s ({rest.duration_s:.1f} s) {rest.cause}" for rest in rests]
    text = f"{len(rests)} rest{'s' * (len(rests) != 1)} no reference: {_first_few(places)}"
    return [Finding("note", where, "rests not used", text, "where a turn ends, take the hand off and wait for the whole of still_s")]


def _first_few(texts: list[str]) -> str:
    return "; ".join(texts[:MOST_LISTED]) + (f"; and {len(texts) - MOST_LISTED} more" if len(texts) > MOST_LISTED else "")


def check_turns(where: str, parts: Sequence[LogSegments], turns: Sequence[FoundTurn], still_s: float) -> list[Finding]:
    """Whether the turns that ``fit`` uses can hold 12 parameters: gravity gives 2 angles each.  An error where ``fit`` refuses.

    12 segments give twice as many angles as there are parameters; one more can be held out to try the result on.  Nothing where no still is
    a reference: another finding reports that.
    """
    stills = [still for part in parts for still in part.stills]
    if not references(stills):
        return []
    segments = [segment for part in parts for segment in part.segments]
    used = [segment for segment in segments if segment.accepted]
    out = [f"turn {s.number} at {s.start_s:.1f} s: {s.problem}" for s in segments if not s.accepted]
    left_out = f"; not used: {_first_few(out)}" if out else ""
    do = "record more turns, each to another attitude, both ways about each axis"
    if (refused := why_too_few(stills, segments, turns, still_s)) is not None:
        return [Finding("error", where, TURNS, f"{refused}{left_out}", f"{do}; a verdict needs {ENOUGH_SEGMENTS}")]
    of = f" of {len(segments)}" if out else ""
    text = f"{len(used)}{of} turns from still to still, {2 * len(used)} angles for 12 parameters"
    if len(used) >= ENOUGH_SEGMENTS:
        return [Finding("ok", where, TURNS, f"{text}{left_out}")]
    return [Finding("warning", where, TURNS, f"{text}; expected {ENOUGH_SEGMENTS} turns or more{left_out}", do)]


def check_leaps(parts: Sequence[LogSegments]) -> list[Finding]:
    """Turns whose movement is missing from the log."""
    do = "it is left out; were rows removed, or lost with stamps that have closed up?"
    gone = [(part.log.path.name, s) for part in parts for s in part.segments if (s.problem or "").startswith(LEAPS)]
    return [Finding("warning", where, MOVEMENT, f"turn {s.number}: {s.problem}", do) for where, s in gone]


def check_unseen(parts: Sequence[LogSegments]) -> list[Finding]:
    """Long stretches of a log without a still: what moves there is not used, and what differs there is not seen."""
    found = []
    for part in parts:
        samples, stills = part.log.samples, references(part.stills)
        if not stills:
            continue  # another finding reports that
        begins = [0.0, *(still.start_s + still.duration_s for still in stills)]
        ends = [*(still.start_s for still in stills), samples.duration_s]
        begin, end = max(zip(begins, ends, strict=True), key=lambda span: span[1] - span[0])
        if (share := (end - begin) / samples.duration_s) > UNSEEN_SHARE:
            text = f"from {begin:.0f} to {end:.0f} s, {share:.0%} of the log: nothing there is used"
            do = "does the noise, the range or a filter of the sensor change there? rest between the turns there, too, or cut the log"
            found.append(Finding("warning", part.log.path.name, NO_STILLS, text, do))
    return found


def check_noise(where: str, noise: Noise | None, sensor: Sensor) -> list[Finding]:
    """White noise in the stills against the sensor's own, by session.toml or else by its model; without either the noise is only reported.

    Taken from neighbouring means of 0.1 s, so the sensor's filter does not lower it.
    """
    if noise is None:
        return []
    stated = sensor.gyro_noise_mdps_rthz
    gyro = _of_model(sensor, "gyro_noise_mdps_rthz") if stated is None else ("session.toml has", stated)
    accel = _of_model(sensor, "accel_noise_ug_rthz")
    mdps, ug = noise.gyro / MDPS, noise.accel / MG * 1e3
    return [
        _noise_finding(where, GYRO_NOISE, xyz_text(mdps, 1) + " mdps/√Hz", mdps, gyro, _unit_at_rest(mdps)),
        _noise_finding(where, ACCEL_NOISE, xyz_text(ug, 0) + " µg/√Hz", ug, accel, ""),
    ]


def _unit_at_rest(mdps: np.ndarray) -> str:
    """What to do where the sensor's noise is not known: at rest it alone can show that rates are in another unit than is stated."""
    low, high = MEMS_MDPS_RTHZ
    for unit, other in (("dps", mdps * DEG), ("rad/s", mdps / DEG)):
        if not low <= mdps.max() <= high and low <= other.max() <= high:
            return f"MEMS gyroscopes have {low:g} to {high:g}: are these rates in {unit}? Their unit is read as it is stated"
    return "give sensor.gyro_noise_mdps_rthz"


def _of_model(sensor: Sensor, figure: str) -> tuple[str, float] | None:
    """Which test shows it, and how much."""
    typical = sensor.typical(figure)
    return typical and (f"the {typical[0]} has", typical[1])


def _noise_finding(where: str, what: str, text: str, found: np.ndarray, yardstick: tuple[str, float] | None, do_unknown: str) -> Finding:
    if yardstick is None:
        return Finding("note", where, what, f"{text}; what this sensor should have is not known", do_unknown)
    who, expected = yardstick
    ratio, text = found.max() / expected, f"{text}, {who} {expected:g}"
    if ratio > NOISE_RATIO:
        text = f"{text}: {ratio:.1f} times as much (bar {NOISE_RATIO:g})"
        do = "does the table, the floor or a fan vibrate? else it is this unit's noise or filter, or a wrong unit"
        return Finding("warning", where, what, text, do)
    if found.min() < expected / NOISE_RATIO:
        return Finding("note", where, what, f"{text}: less than it can be; averaged before logging, or wrong units?", "")
    return Finding("ok", where, what, text, "")


def check_zero_rate(where: str, stills: list[Still], sensor: Sensor) -> list[Finding]:
    """The rate read at rest, median over the stills, against the greatest zero-rate level of a good part, where that is known."""
    if not stills:
        return []
    bias = np.median([still.gyro_mean for still in stills], axis=0) / DEG
    typical = sensor.typical("zero_rate_dps")
    if typical is None:
        return [Finding("note", where, "zero-rate level", f"{xyz_text(bias)} dps; what this sensor may have is not known")]
    bar = typical[1]
    text = f"{xyz_text(bias)} dps, bar {bar:g}"
    if np.abs(bias).max() <= bar:
        return [Finding("ok", where, "zero-rate level", text)]
    return [
        Finding("warning", where, "zero-rate level", text, "a calibration removes it; a unit that far off is worth a look, or the units")
    ]


def accel_unit_factor(stills: list[Still], config: Config) -> tuple[float, float]:
    """What the measured specific force must be multiplied by to make gravity right, among the usual mistakes.

    Returns (factor, gravity's mean length with it, m/s^2).  The pre-calibration holds for right units only, so it is reversed and
    applied again for each candidate: 1, g for m/s^2 and the reverse, and the ratios of full scales.
    """
    found = force_of(stills)
    measured = np.linalg.solve(config.accelerometer.matrix, found.T).T + config.accelerometer.bias_mps2
    g, one = config.site.expected_gravity_mps2, STANDARD_GRAVITY_MPS2
    candidates = [1.0, one, 1 / one, 1e3, 1e-3, 0.125, 0.25, 0.5, 2.0, 4.0, 8.0]
    lengths = [float(np.linalg.norm(config.accelerometer.correct(measured * c), axis=1).mean()) for c in candidates]
    best = int(np.argmin([abs(np.log(max(length, 1e-300) / g)) for length in lengths]))
    if abs(lengths[0] / g - 1) < GRAVITY_WRONG:
        best = 0
    return candidates[best], lengths[best]


def check_gravity(where: str, stills: list[Still], config: Config, noise: Noise | None, closure_run: bool, raw: bool) -> list[Finding]:
    """Length of gravity in the stills against the site's, and its spread over attitudes.

    The length does not depend on attitude, so its mean tests the units and the sensitivity.  Its spread is what the
    pre-calibration leaves: a spread of s turns the measured vertical by about s/g, to be held against what the gyro's own
    noise adds to a segment (angle random walk x sqrt(duration)).  A closure_run
    rests in one attitude by protocol, so no others are expected.  raw: whether the log holds registers.
    """
    if not stills:
        return []
    lengths = np.array([still.gravity_mps2 for still in stills])
    g = config.site.expected_gravity_mps2
    off = lengths.mean() / g - 1
    text = f"{lengths.mean():.4f} m/s² in the stills, {g:.4f} expected ({off:+.2%}, bar {GRAVITY_OK:.0%})"
    if abs(off) <= GRAVITY_OK:
        own = config.accelerometer.source == "stills"
        findings = [Finding("ok", where, "gravity", text + (": it was fitted to that" if own else ""))]
    elif abs(off) < GRAVITY_WRONG:
        do = "is [accelerometer] of session.toml this sensor's pre-calibration?"
        if config.accelerometer.source == "none":
            do = "an uncalibrated accelerometer may be so far off; rest it on all sides, and it is calibrated"
        findings = [Finding("warning", where, "gravity", text, do)]
    else:
        return [Finding("error", where, "gravity", text, *_unit_mistake(*accel_unit_factor(stills, config), config, raw))]
    spread = float(lengths.std())
    tilt = spread / lengths.mean()
    floor = noise_floor(noise, config.protocol.segment_s)
    level = "warning" if tilt > 3 * floor else "note" if tilt > floor else "ok"
    do = "calibrate the accelerometer again: the reference is worse than the gyro" if level != "ok" else ""
    attitudes = attitudes_of(force_of(stills))
    text = f"{spread / MG:.2f} mg over {_attitudes_text(stills, attitudes)}, worth {tilt / DEG:.4f} deg of tilt"
    text += f"; gyro noise per segment {floor / DEG:.4f}"
    if attitudes < ENOUGH_ATTITUDES and level == "ok" and not closure_run:
        level, do = "note", f"other attitudes are not covered: rest it in {ENOUGH_ATTITUDES} or more, on all sides"
    if len(lengths) > 1:
        findings.append(Finding(level, where, "gravity spread", text, do))
    return findings


def _attitudes_text(stills: list[Still], attitudes: int) -> str:
    """How many stills lie in how many attitudes; where all are one, within which angle."""
    if attitudes > 1:
        return f"{len(stills)} stills in {attitudes} attitudes (more than {APART_RAD / DEG:.0f} deg apart)"
    down = np.array([still.accel_mean / max(still.gravity_mps2, 1e-12) for still in stills])
    middle = down.mean(axis=0) / max(float(np.linalg.norm(down.mean(axis=0))), 1e-12)
    sine = np.linalg.norm(np.cross(down, middle), axis=1)
    widest = 2 * float(np.arctan2(sine, down @ middle).max())
    return f"{len(stills)} stills that are all one attitude (within {widest / DEG:.2g} deg)"


def _unit_mistake(factor: float, length: float, config: Config, raw: bool) -> tuple[str, tuple[Correction, ...]]:
    """What to do where gravity is wrong, and what makes it right, where a usual mistake does."""
    sensor = config.sensor
    if factor == 1.0 or abs(length / config.site.expected_gravity_mps2 - 1) > GRAVITY_WRONG:
        more = "" if config.accelerometer.source == "none" else ", and at [accelerometer] in session.toml"
        return f"no usual mistake of units explains it: look at the columns{more}", ()
    if factor in (G, 1 / G):
        have, stated, want = ("g", "m/s²", "ax_mps2") if factor == G else ("m/s²", "g", "ax_g")
        do = f"m/s² and g are mixed up: the values are in {have}, but the header has {want}; correct the header"
        return do, () if raw else (Correction(f"the specific force is in {have}, and is read as {stated}", "accel", factor),)
    if factor in (1e3, 1e-3):
        do = f"the values are {'1000 times too small' if factor > 1 else 'in mg or mm/s²'}: correct the unit"
        return do, () if raw else (Correction(f"the specific force is {1 / factor:g} times what it should be", "accel", factor),)
    full_scale = factor * sensor.accel_fs_g
    do = f"a wrong full scale: accel_fs_g = {full_scale:g} would make it {length:.3f}"
    if sensor.profile is not None and sensor.profile.accel is not None and full_scale not in sensor.profile.accel:
        return f"{do}, but no such range exists", ()
    settings = [("accel_fs_g", full_scale)]
    if raw and sensor.accel_mg_per_lsb is not None:
        settings.append(("accel_mg_per_lsb", factor * sensor.accel_mg_per_lsb))
    text, columns = f"accel_fs_g is {full_scale:g}, not {sensor.accel_fs_g:g}", ("", 1.0) if raw else ("accel", factor)
    return f"{do}; correct session.toml, or what converted the log", (Correction(text, *columns, settings=tuple(settings)),)


# A temperature, and whether it is in degC: what a chip survives, what its thermometer can scatter, and the steps of its register.

WHAT = "temperature"
TEMP_CHANGE_C = 3.0
#: degC that a chip survives, where its model is unknown
CHIP_C = (-60.0, 150.0)
#: room and outdoor temperatures at which people handle a sensor, degC
HANDLED_C = (0.0, 60.0)
#: a chip that warms itself in a closed case is hardly warmer; in Fahrenheit it is where a cool room is
WARM_C = 55.0
#: degC from sample to sample, rms: thermometers in such packages have 0.05 to 0.5, registers tens
SCATTER_C, LEAST_READINGS = 2.0, 100
#: of a register's step in another unit
STEP_WITHIN = 0.02
#: unit -> degC of a value of it
OTHERS = {
    "degC": lambda value: value,
    "kelvin": lambda value: value - 273.15,
    "Fahrenheit": lambda value: (value - 32) / 1.8,
    "tenths of a degree": lambda value: value / 10,
    "hundredths of a degree": lambda value: value / 100,
    "thousandths of a degree": lambda value: value / 1000,
}


def check_temperature(log: Log, stills: list[Still], sensor: Sensor) -> list[Finding]:
    """Temperature there, in degC, and how far it moves.

    A zero-rate level moves by some 0.01 dps/degC: 3 degC are 0.03 dps, or 0.15 deg over a turn of 5 s, ten times the noise.
    """
    temp_c, where = log.samples.temp_c, log.path.name
    if temp_c is None:
        return [Finding("note", where, WHAT, "not recorded: a bias that follows temperature cannot be separated from drift")]
    low, high = map(float, np.percentile(temp_c, [1, 99]))
    if (other := _scatters(temp_c, sensor.profile) or other_unit(low, high, sensor.profile, _step(temp_c))) is not None:
        level, text, do = other
        return [Finding(level, where, WHAT, text, do)]
    if np.ptp(temp_c) == 0:
        return [Finding("note", where, WHAT, f"stands at {temp_c[0]:.2f} degC: is the register read?")]
    means = np.array([still.temp_c for still in stills]) if len(stills) > 1 else np.array([low, high])
    moved, text = np.ptp(means), f"{means.min():.1f} to {means.max():.1f} degC"
    if moved > TEMP_CHANGE_C:
        text += f", moved {moved:.1f} (bar {TEMP_CHANGE_C:g}): the bias is likely to follow"
        return [Finding("note", where, WHAT, text, "let it warm up before, or let the fit include temperature")]
    return [Finding("ok", where, WHAT, text)]


def other_unit(low: float, high: float, profile: Profile | None, step: float = 0.0) -> tuple[str, str, str] | None:
    """Level, words and advice where temperatures from low to high, as read in degC, seem to be in another unit; None where they do not.

    step: of the column's values, 0 where it is not known.
    """
    works = CHIP_C if profile is None or profile.works_c is None else profile.works_c
    register = None if profile is None else profile.thermometer
    if low < works[0] or high > works[1]:
        whose = "a chip survives" if works is CHIP_C else "the sensor works from"
        text = f"{low:.1f} to {high:.1f} degC; {whose} {works[0]:g} to {works[1]:g}"
        scale = "" if register is None else f"{register.lsb_per_c:.6g} LSB per degC, 0 at {register.at_zero_c:.4g} degC: "
        return "warning", text, f"{scale}look at the column and its unit{units_of_people(low, high, profile)}"
    if low < WARM_C or not _handled("Fahrenheit", low, high):
        return None
    text = f"{low:.1f} to {high:.1f} degC, which in Fahrenheit is {_words('Fahrenheit', low, high)}"
    if register is not None and abs(step * abs(register.lsb_per_c) / 1.8 - 1) < STEP_WITHIN:
        return "warning", f"{text}; its steps of {step:.4g} are those of this sensor's register in Fahrenheit", "write temp_c in degC"
    return "note", text, "is the column in degC, by its name?"


def _scatters(temp_c: np.ndarray, profile: Profile | None) -> tuple[str, str, str] | None:
    """A register, or noise: no thermometer in a package jumps so from sample to sample."""
    if len(temp_c) < LEAST_READINGS:
        return None
    steps = np.diff(temp_c)
    np.clip(steps, -1e4, 1e4, out=steps)
    rms = float(np.sqrt(np.mean(np.square(steps, out=steps)) / 2))
    del steps
    if rms <= SCATTER_C:
        return None
    low, high = map(float, np.percentile(temp_c, [1, 99]))
    text = f"scatters by {rms:.3g} degC rms from sample to sample (bar {SCATTER_C:g}), {low:.0f} to {high:.0f}: no thermometer does"
    return "warning", text, f"is it the raw register? then the column is called temp{units_of_people(low, high, profile)}"


def units_of_people(low: float, high: float, profile: Profile | None) -> str:
    """The units in which the values would be where people are: `` (in kelvin 24.9 to 25.3 degC)``."""
    units = [f"in {unit} {_words(unit, low, high)}" for unit in OTHERS if unit != "degC" and _handled(unit, low, high)]
    if profile is not None and profile.thermometer is not None:
        register = profile.thermometer
        ends = [register.at_zero_c + value / register.lsb_per_c for value in (low, high)]
        if HANDLED_C[0] <= min(ends) and max(ends) <= HANDLED_C[1]:
            units.append(f"as this sensor's register {ends[0]:.1f} to {ends[1]:.1f} degC")
    return f" ({'; '.join(units)})" if units else ""


def _words(unit: str, low: float, high: float) -> str:
    return f"{OTHERS[unit](low):.1f} to {OTHERS[unit](high):.1f} degC"


def _handled(unit: str, low: float, high: float) -> bool:
    return HANDLED_C[0] <= OTHERS[unit](low) and OTHERS[unit](high) <= HANDLED_C[1]


def _step(values: np.ndarray) -> float:
    """The smallest difference between neighbours, beyond rounding; 0 where nothing moves."""
    steps = np.diff(values)
    steps = steps[np.abs(steps, out=steps) > 1e-9]
    return float(np.quantile(steps, 0.01)) if len(steps) else 0.0


# The first look at a rest log: was it still throughout, is it in the units that it declares, and how far did the temperature go?

#: of one g: the error of an uncalibrated accelerometer at rest
GRAVITY_WITHIN = 0.3
#: degrees within a minute: more than an accelerometer's zero can do by temperature (1.5 mg/degC, 5 degC a minute: 0.4)
TILT_DEG, TILT_BLOCKS = 0.5, 30
#: share of blocks that may be left out before the log was not at rest at all
KNOCKED_SHARE = 0.2
#: degC: what a rest log must cover before a dependence on temperature can be separated from one on time
LEAST_RANGE_C = 5.0


def check_rests(paths: tuple[Path, ...], sensor: Sensor) -> list[Finding]:
    """Of rest logs as files; one that cannot be read is an error among the findings."""
    findings: list[Finding] = []
    for path in paths:
        try:
            findings += check_rest(read_rest(path, sensor))
        except CalibrationError as error:
            findings.append(unreadable(path.name, error))
    return findings


def check_rest(log: RestLog) -> list[Finding]:
    """What to know of one rest log; an ``error`` where nothing can be made of it."""
    where = log.path.name
    findings = [Finding("note", where, "reading", note) for note in log.notes]
    return [*findings, _gravity(log, where), _still(log, where), *_attitude(log, where), _temperature(log, where)]


def _gravity(log: RestLog, where: str) -> Finding:
    length_g = median_length(log.accel) / G
    text = f"{length_g:.3f} g at rest (1 within {GRAVITY_WITHIN:g})"
    if abs(length_g - 1) <= GRAVITY_WITHIN:
        return Finding("ok", where, "gravity", text)
    return Finding("error", where, "gravity", text, "is the accelerometer's unit or full scale right, and does the sensor lie still?")


def _still(log: RestLog, where: str) -> Finding:
    out = knocked(log)
    share = float(out.mean())
    if share > KNOCKED_SHARE:
        text = f"{100 * share:.0f} % of the time is more restless than the rest (at most {100 * KNOCKED_SHARE:.0f} %)"
        return Finding("error", where, "stillness", text, "let the sensor lie away from footsteps and machines")
    if not out.any():
        return Finding("ok", where, "stillness", f"still for all of {log.duration_s:.0f} s")
    times = ", ".join(f"{t:.0f}" for t in log.t_s[np.flatnonzero(np.diff(out.astype(int), prepend=0) > 0)][:6])
    text = f"knocks at {times} s{'' if np.count_nonzero(np.diff(out.astype(int), prepend=0) > 0) <= 6 else ' and later'}"
    return Finding("note", where, "stillness", f"{text}: {np.count_nonzero(out) * log.block_s:.0f} s are left out")


def _attitude(log: RestLog, where: str) -> list[Finding]:
    """A sensor that was put down otherwise reads another share of the Earth's rate, and of gravity."""
    if len(log) < 2 * TILT_BLOCKS:
        return []
    means = np.array([np.median(part, axis=0) for part in np.array_split(log.accel, len(log) // TILT_BLOCKS)])
    means /= np.linalg.norm(means, axis=1)[:, None]
    tilts = np.linalg.norm(np.cross(means[1:], means[:-1]), axis=1) / DEG
    worst = int(np.argmax(tilts))
    if tilts[worst] <= TILT_DEG:
        return []
    at_s = float(log.t_s[min((worst + 1) * TILT_BLOCKS, len(log) - 1)])
    text = f"tilts by {tilts[worst]:.2f}° around {at_s:.0f} s (at most {TILT_DEG:g}° within {2 * TILT_BLOCKS * log.block_s:.0f} s)"
    return [Finding("warning", where, "attitude", text, "fix the sensor to something heavy; split the log where it was moved")]


def _temperature(log: RestLog, where: str) -> Finding:
    if not log.has_temperature:
        do = "log the sensor's temperature with the rates (temp, or temp_c)"
        return Finding("warning", where, "temperature", "no such column: only the noise can be estimated", do)
    low, high = float(log.temp_c.min()), float(log.temp_c.max())
    text = f"{low:.1f} to {high:.1f} °C"
    if low < CHIP_C[0] or high > CHIP_C[1]:
        do = f"is the column's unit right? temp_c is in °C{units_of_people(low, high, None)}"
        return Finding("error", where, "temperature", f"{text}, where no chip survives", do)
    if (other := other_unit(low, high, None)) is not None:
        return Finding(other[0], where, "temperature", *other[1:])
    if high - low < LEAST_RANGE_C:
        do = "let it go through the temperatures of its use, up and down"
        return Finding("warning", where, "temperature", f"{text}: {high - low:.1f} °C of change (at least {LEAST_RANGE_C:g})", do)
    return Finding("ok", where, "temperature", text)
