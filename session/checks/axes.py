"""Checks of the gyroscope against gravity: axes and signs, then the sensitivity."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding
from session.common.units import DEG
from session.detect.stills import Still
from session.detect.tilt import AxesAgreement, agreement
from session.log.config import Config, Sensor
from session.log.samples import Samples
from session.sensor.profiles.profile import Profile

CLEARLY = 0.5  #: another order of axes must halve what is unexplained
EXPLAINED = 0.5  #: of gravity's movement, or nothing is said of axes
SCALE_OK = 0.05  #: a gyro's sensitivity tolerance, misalignment and this coarse look together
NAMED_WITHIN = 0.05
CLOSES_WITHIN = 0.10  #: of the angle turned: beyond what tolerances and misalignment of some percent leave
#: ST's sensitivity against full scale / 2^15, which most other makers have: 17.5 mdps for 500 dps / 32768, the same for all ranges
ST_OVER_FULL_SCALE = 17.5e-3 * 32768 / 500


def check_axes(
    where: str, samples: Samples, stills: list[Still], config: Config, raw: bool, skip: np.ndarray | None = None
) -> list[Finding]:
    """The movement of gravity that the accelerometer shows must be the one that the gyro's rates make.

    48 signed orders of the gyro's axes are tried, each with the scale that suits it best.  Another than x, y, z must leave less
    than half of the misfit to be believed.  Then the scale is compared with the usual mistakes.  skip (N,) bool: rows whose turns
    are not looked at.
    """
    found = agreement(samples, stills, skip)
    if found is None:
        says = "gravity hardly moves in the sensor, or all turns hold gaps: it cannot test the gyro's axes and units"
        return [Finding("note", where, "gyro against gravity", says, "turn about horizontal axes as well")]
    turns = f"{found.turns} turn{'s' if found.turns > 1 else ''} of {found.turned / DEG:.0f} deg"
    unclosed = np.isfinite(found.residual) and found.residual > CLOSES_WITHIN * found.turned
    if found.misfit > EXPLAINED or unclosed:
        says = f"{turns}: gravity's movement is explained to {1 - found.misfit:.0%} (bar {EXPLAINED:.0%})"
        if unclosed:
            says += f", and missed by {found.residual / DEG:.1f} deg at the end (bar {CLOSES_WITHIN:.0%} of the turn)"
        do = "are gyro and accelerometer of one board, with one clock? are samples lost, does the gyro clip?"
        says += ", whatever the order, signs and scale of the gyro's axes"
        return [Finding("warning", where, "gyro against gravity", says, do)]
    return [_axes_finding(where, found, turns), _scale_finding(where, found, turns, config, raw)]


def _axes_finding(where: str, found: AxesAgreement, turns: str) -> Finding:
    ends = f", ends to {found.residual / DEG:.2f} deg" if np.isfinite(found.residual) else ""
    if found.misfit < CLEARLY * found.identity_misfit:
        says = f"{axes_in_words(found.axes)}: explains gravity's movement to {1 - found.misfit:.0%}{ends}, as logged to "
        says += f"{1 - found.identity_misfit:.0%} ({turns})"
        return Finding("error", where, "axes", says, _axes_advice(found.axes))
    return Finding("ok", where, "axes", f"the gyro explains gravity's movement to {1 - found.identity_misfit:.0%}{ends} ({turns})")


def axes_in_words(axes: np.ndarray) -> str:
    """What is wrong with the gyro's columns, where ``omega = axes @ m`` for a signed permutation: one sentence part."""
    source, signs = np.argmax(np.abs(axes), axis=1), axes.sum(axis=1)
    flipped = ["xyz"[i] for i in range(3) if source[i] == i and signs[i] < 0]
    moved = [i for i in range(3) if source[i] != i]
    texts = []
    if len(moved) == 2:
        texts.append(f"the gyro's {'xyz'[moved[0]]} and {'xyz'[moved[1]]} are exchanged")
    elif moved:
        texts.append("the gyro's axes are in a wrong order")
    if len(flipped) == 3:
        texts.append("all three axes of the gyro have the wrong sign")
    elif flipped:
        of = "" if moved else "the gyro's "
        texts.append(f"{of}{' and '.join(flipped)} {'have' if len(flipped) > 1 else 'has'} the wrong sign")
    if moved:
        logged = [f"{'-' if signs[i] < 0 else '+'}{'xyz'[source[i]]}" for i in range(3)]
        texts.append("true " + ", ".join(f"{'xyz'[i]} is the logged {logged[i]}" for i in range(3)))
    if np.linalg.det(axes) < 0:
        texts.append("its triad is left-handed")
    return "; ".join(texts)


def _axes_advice(axes: np.ndarray) -> str:
    """A gyro mirrored alone is the gyro's fault; a turned one can be the accelerometer's: ``d' = det(Q) d x Q'm`` if d is Q d.

    Gravity's sign does not show (d and -d move alike), so of Q and -Q the one that changes less is named.
    """
    if np.linalg.det(axes) < 0:
        return "correct the columns or their signs where the log is written; a rotation of the board cannot do this"
    other = max((axes.T, -axes.T), key=np.trace)
    text = axes_in_words(other).replace("gyro", "accelerometer").replace("; its triad is left-handed", "")
    return f"correct the columns where the log is written; or it is the accelerometer: {text}"


def _scale_finding(where: str, found: AxesAgreement, turns: str, config: Config, raw: bool) -> Finding:
    """The factor that the rates need, against the factors of the usual mistakes."""
    k, bar = found.scale, max(SCALE_OK, found.scale_std)
    says = f"gravity asks for rates x {k:.3g} (bar 1 ± {bar:g}, {turns})"
    if abs(k - 1) <= bar:
        return Finding("ok", where, "gyro scale", says)
    mistakes = _mistakes(config.sensor, raw)
    nearest = min(mistakes, key=lambda factor: abs(np.log(k / factor)))
    if abs(np.log(k / nearest)) <= max(NAMED_WITHIN, found.scale_std):
        return Finding("error", where, "gyro scale", says, mistakes[nearest])
    level = "error" if abs(np.log(k)) > np.log(1.2) else "warning"
    return Finding(level, where, "gyro scale", says, "no usual mistake has this factor; are the stamps the device's own time?")


def _mistakes(sensor: Sensor, raw: bool) -> dict[float, str]:
    """Factor that mends it -> what went wrong."""
    full_scale_dps, profile = sensor.gyro_fs_dps, sensor.profile
    mistakes = {
        DEG: "the rates are in deg/s, but are read as rad/s: name the columns gx_dps, gy_dps, gz_dps",
        1 / DEG: "the rates are in rad/s, but are read as dps: name the columns gx_rps, gy_rps, gz_rps",
        1e-3: "the rates are in mdps: divide by 1000; or time runs 1000 times too slowly: is it ns that are read as us?",
        1e3: "time runs 1000 times too fast: is it us that are read as ns? or the rates are 1000 times too small",
    }
    mistakes |= _sensitivities(full_scale_dps, profile)
    for power in (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5):
        factor = 2.0**power
        fits = factor * full_scale_dps
        has = profile is None or profile.gyro is None or fits in profile.gyro
        there = "" if has or not raw else " (which the sensor does not have)"
        do = "correct gyro_fs_dps in session.toml" if raw else "correct what converted the log"
        mistakes[factor] = f"wrong full scale: {fits:g} dps would match{there}, not {full_scale_dps:g}; {do}"
    return mistakes


def _sensitivities(full_scale_dps: float, profile: Profile | None) -> dict[float, str]:
    """ST's sensitivity taken for the full scale's at 32768 counts, which most others have, or the reverse."""
    to_span, st = (factor * full_scale_dps / 32768 * 1e3 for factor in (1.0, ST_OVER_FULL_SCALE))
    own = None if profile is None or profile.gyro is None else profile.gyro.get(full_scale_dps)
    if profile is not None and own is not None and abs(own / st - 1) < 1e-3:
        return {
            1 / ST_OVER_FULL_SCALE: (
                f"sensitivity: this sensor's is full scale / 32768 = {to_span:.3f} mdps per LSB, not the {profile.name}'s {st:.2f}"
            ),
            ST_OVER_FULL_SCALE: f"sensitivity: converted with full scale / 32768 = {to_span:.3f} mdps per LSB; the datasheet says {st:.2f}",
        }
    return {
        1 / ST_OVER_FULL_SCALE: (
            f"sensitivity: converted with ST's {st:.2f} mdps per LSB; most other sensors have full scale / 32768 = {to_span:.3f}"
        ),
        ST_OVER_FULL_SCALE: (
            f"sensitivity: converted with full scale / 32768 = {to_span:.3f} mdps per LSB; "
            f"ST's sensors have {st:.2f}: is sensor.model right?"
        ),
    }
