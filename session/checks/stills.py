"""Checks of what a log's still phases show: their number, the noise, the zero-rate level, the length of gravity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.accelerometer.from_stills import force_of
from session.accelerometer.lengths import APART_RAD, attitudes_of
from session.checks.findings import Finding, xyz_text
from session.common.units import DEG, MDPS, MG, STANDARD_GRAVITY_MPS2, G
from session.detect.stills import Noise, Still
from session.detect.unused_rests import UnusedRest
from session.log.config import Config, Sensor

NOISE_RATIO = 3.0  #: units differ by 1.4 at most
GRAVITY_OK = 0.02  #: an accelerometer's sensitivity tolerance
GRAVITY_WRONG = 0.10  #: what an offset of 65 mg and 2 % of sensitivity can do together
MOST_LISTED = 8  #: places in one line; ``fit`` writes all of them into its JSON
ENOUGH_SEGMENTS = 13
ENOUGH_ATTITUDES = 6  #: to tell a scale factor and a bias of each of three axes; fewer can all have gravity's length by chance


def check_stills(where: str, stills: list[Still], blind: bool = False) -> list[Finding]:
    """How many stills there are, how long, and those that are no reference; blind: the gyro shows no noise, which has been said."""
    good = [still for still in stills if still.problem is None]
    if not good:
        do = "let go of the table for still_s between turns; is it vibrating?"
        if blind:
            do = "no still can be found while the gyro shows no noise: mend that first"
        reason = f"none of {len(stills)} quiet phases is at rest: each {stills[0].problem}" if stills else "none found: it never rests"
        return [Finding("error", where, "stills", reason, do)]
    durations = np.array([still.duration_s for still in good])
    says = f"{len(good)} of {durations.min():.1f} to {durations.max():.1f} s (median {np.median(durations):.1f})"
    bumps = sum(still.bumps for still in good)
    findings = [Finding("ok", where, "stills", says + (f", {bumps} bumps survived" if bumps else ""))]
    bad = [(number, still) for number, still in enumerate(stills) if still.problem]
    if bad:
        listed = _first_few([f"still {number} at {still.start_s:.1f} s {still.problem}" for number, still in bad])
        says = f"{len(bad)} of {len(stills)} are no reference: {listed}"
        findings.append(Finding("warning", where, "not still", says, "their turns are joined over them; take the hand off the table"))
    return findings


def check_unused_rests(where: str, unused: Sequence[UnusedRest], stills: list[Still]) -> list[Finding]:
    """Rests that became no still, each with its place and reason; those that are in the list of stills are said there."""
    stood = {still.start_s for still in stills}
    rests = [rest for rest in unused if rest.start_s not in stood]
    if not rests:
        return []
    places = [f"at {rest.start_s:.1f} s ({rest.duration_s:.1f} s) {rest.cause}" for rest in rests]
    says = f"{len(rests)} rest{'s' * (len(rests) != 1)} no reference: {_first_few(places)}"
    return [Finding("note", where, "rests not used", says, "where a turn ends, take the hand off and wait for the whole of still_s")]


def _first_few(texts: list[str]) -> str:
    return "; ".join(texts[:MOST_LISTED]) + (f"; and {len(texts) - MOST_LISTED} more" if len(texts) > MOST_LISTED else "")


def check_segment_count(where: str, stills_per_log: list[list[Still]]) -> list[Finding]:
    """Whether the turns can hold 12 parameters: gravity gives 2 angles each.

    12 segments give twice as many angles as there are parameters; one more can be held out to try the result on.
    """
    count = sum(max(0, sum(still.problem is None for still in stills) - 1) for stills in stills_per_log)
    says = f"{count} turns from still to still, {2 * count} angles for 12 parameters"
    if count >= ENOUGH_SEGMENTS:
        return [Finding("ok", where, "turns", says)]
    do = "record more turns, each to another attitude, both ways about each axis"
    return [Finding("warning", where, "turns", f"{says}; expected {ENOUGH_SEGMENTS} turns or more", do)]


def check_noise(where: str, noise: Noise | None, sensor: Sensor) -> list[Finding]:
    """White noise in the stills against the sensor's own: of session.toml, else of its model; where neither tells, it is only said.

    Taken from neighbouring means of 0.1 s, so the sensor's filter does not lower it; what raises it is vibration of the table, and
    then the stills are no longer still.
    """
    if noise is None:
        return []
    gyro, accel = _gyro_yardstick(sensor), _of_model(sensor, "accel_noise_ug_rthz")
    mdps, ug = noise.gyro / MDPS, noise.accel / MG * 1e3
    return [
        _noise_finding(where, "gyro noise", xyz_text(mdps, 1) + " mdps/√Hz", mdps, gyro, "give sensor.gyro_noise_mdps_rthz"),
        _noise_finding(where, "accelerometer noise", xyz_text(ug, 0) + " ug/√Hz", ug, accel, ""),
    ]


def _gyro_yardstick(sensor: Sensor) -> tuple[str, float] | None:
    """Who says it, and how much, mdps/sqrt(Hz)."""
    if sensor.gyro_noise_mdps_rthz is not None:
        return "session.toml says", sensor.gyro_noise_mdps_rthz
    return _of_model(sensor, "gyro_noise_mdps_rthz")


def _of_model(sensor: Sensor, figure: str) -> tuple[str, float] | None:
    typical = sensor.typical(figure)
    return typical and (f"the {typical[0]} has", typical[1])


def _noise_finding(where: str, what: str, says: str, found: np.ndarray, yardstick: tuple[str, float] | None, ask: str) -> Finding:
    if yardstick is None:
        return Finding("note", where, what, f"{says}; what this sensor should have is not known", ask)
    who, expected = yardstick
    ratio, says = found.max() / expected, f"{says}, {who} {expected:g}"
    if ratio > NOISE_RATIO:
        do = "not the sensor's noise: does the table, the floor or a fan vibrate? or wrong units"
        return Finding("warning", where, what, f"{says}: {ratio:.1f} times as much (bar {NOISE_RATIO:g})", do)
    if found.min() < expected / NOISE_RATIO:
        return Finding("note", where, what, f"{says}: less than it can be; averaged before logging, or wrong units?", "")
    return Finding("ok", where, what, says, "")


def check_zero_rate(where: str, stills: list[Still], sensor: Sensor) -> list[Finding]:
    """The rate read at rest, median over the stills, against the greatest zero-rate level of a good part, where that is known."""
    if not stills:
        return []
    bias = np.median([still.gyro_mean for still in stills], axis=0) / DEG
    typical = sensor.typical("zero_rate_dps")
    if typical is None:
        return [Finding("note", where, "zero-rate level", f"{xyz_text(bias)} dps; what this sensor may have is not known")]
    bar = typical[1]
    says = f"{xyz_text(bias)} dps, bar {bar:g}"
    if np.abs(bias).max() <= bar:
        return [Finding("ok", where, "zero-rate level", says)]
    return [
        Finding("warning", where, "zero-rate level", says, "a calibration removes it; a unit that far off is worth a look, or the units")
    ]


def accel_unit_factor(stills: list[Still], config: Config) -> tuple[float, float]:
    """What the measured specific force must be multiplied by to make gravity right, among the usual mistakes.

    Returns (factor, gravity's mean length with it, m/s^2).  The pre-calibration holds for right units only, so it is undone and
    applied again for each candidate: 1, g for m/s^2 and the reverse, and the ratios of full scales.
    """
    found = np.array([still.accel_mean for still in stills])
    measured = np.linalg.solve(config.accelerometer.matrix, found.T).T + config.accelerometer.bias_mps2
    g, one = config.site.expected_gravity_mps2, STANDARD_GRAVITY_MPS2
    candidates = [1.0, one, 1 / one, 1e3, 1e-3, 0.125, 0.25, 0.5, 2.0, 4.0, 8.0]
    lengths = [float(np.linalg.norm(config.accelerometer.correct(measured * c), axis=1).mean()) for c in candidates]
    best = int(np.argmin([abs(np.log(max(length, 1e-300) / g)) for length in lengths]))
    if abs(lengths[0] / g - 1) < GRAVITY_WRONG:
        best = 0
    return candidates[best], lengths[best]


def check_gravity(where: str, stills: list[Still], config: Config, noise: Noise | None, closure_run: bool = False) -> list[Finding]:
    """Length of gravity in the stills against the site's, and its spread over attitudes.

    The length does not depend on attitude, so its mean tests the units and the sensitivity.  Its spread is what the
    pre-calibration leaves: a spread of s turns the measured vertical by about s/g, to be held against what the gyro's own
    noise adds to a segment (angle random walk x sqrt(duration)).  A closure_run
    rests in one attitude by protocol, so no others are asked for.
    """
    if not stills:
        return []
    lengths = np.array([still.gravity_mps2 for still in stills])
    g = config.site.expected_gravity_mps2
    off = lengths.mean() / g - 1
    says = f"{lengths.mean():.4f} m/s² in the stills, {g:.4f} expected ({off:+.2%}, bar {GRAVITY_OK:.0%})"
    if abs(off) <= GRAVITY_OK:
        own = config.accelerometer.source == "stills"
        findings = [Finding("ok", where, "gravity", says + (": it was fitted to that" if own else ""))]
    elif abs(off) < GRAVITY_WRONG:
        do = "is [accelerometer] of session.toml this sensor's pre-calibration?"
        if config.accelerometer.source == "none":
            do = "an accelerometer that nobody has calibrated may be so far off; rest it on all sides, and it is calibrated"
        findings = [Finding("warning", where, "gravity", says, do)]
    else:
        return [Finding("error", where, "gravity", says, _unit_advice(*accel_unit_factor(stills, config), config))]
    spread = float(lengths.std())
    tilt = spread / lengths.mean()
    floor = np.inf if noise is None else float(noise.angle_random_walk.max()) * np.sqrt(config.protocol.segment_s)
    level = "warning" if tilt > 3 * floor else "note" if tilt > floor else "ok"
    do = "calibrate the accelerometer again: the reference is worse than the gyro" if level != "ok" else ""
    attitudes = attitudes_of(force_of(stills))
    says = f"{spread / MG:.2f} mg over {_attitudes_text(stills, attitudes)}, worth {tilt / DEG:.4f} deg of tilt"
    says += f"; gyro noise per segment {floor / DEG:.4f}"
    if attitudes < ENOUGH_ATTITUDES and level == "ok" and not closure_run:
        level, do = "note", f"it tells nothing of other attitudes: rest it in {ENOUGH_ATTITUDES} or more, on all sides"
    if len(lengths) > 1:
        findings.append(Finding(level, where, "gravity spread", says, do))
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


def _unit_advice(factor: float, length: float, config: Config) -> str:
    if factor == 1.0 or abs(length / config.site.expected_gravity_mps2 - 1) > GRAVITY_WRONG:
        return "no usual mistake of units explains it: look at the columns" + (
            "" if config.accelerometer.source == "none" else ", and at [accelerometer] in session.toml"
        )
    if factor in (G, 1 / G):
        have, want = ("g", "ax_mps2") if factor == G else ("m/s²", "ax_g")
        return f"m/s² and g are mixed up: the values are in {have}, but the header says {want}; correct the header"
    if factor in (1e3, 1e-3):
        return f"the values are {'1000 times too small' if factor > 1 else 'in mg or mm/s²'}: correct the unit"
    full_scale = factor * config.sensor.accel_fs_g
    profile = config.sensor.profile
    there = profile is None or profile.accel is None or full_scale in profile.accel
    would = f"accel_fs_g = {full_scale:g} would make it {length:.3f}"
    return f"a wrong full scale: {would}" + ("; correct session.toml, or what converted the log" if there else ", but no such range exists")
