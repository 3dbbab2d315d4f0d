"""Checks of one log by itself: gaps, registers, temperature, and what its comments say.  Each returns findings."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding, axes_text
from session.common.units import DEG, NS, G
from session.detect.bridges import MOST, short_gaps
from session.detect.clipping import accel_reach_g, gyro_reach_dps, plateau, run_bar
from session.detect.pace import pace_of
from session.detect.segments import GAP_PERIODS
from session.detect.stills import Noise, Still
from session.log.config import Sensor
from session.log.logfile import Log
from session.log.readings import pick, pieces
from session.log.samples import Samples

LOST_SHARE = 0.001  #: of single samples; more is a fault of the logger that will cost more one day
STUCK = "look at the wiring, the register map, the columns; or is it quantisation, a full scale or a unit whose steps hide its noise?"


def check_reading(log: Log) -> list[Finding]:
    """What the reader mended or left out."""
    return [Finding("note", log.path.name, "reading", note) for note in log.notes]


def check_comments(log: Log, sensor: Sensor) -> list[Finding]:
    """The log's own ``gyro_fs_dps=``, ``accel_fs_g=``, ``serial=`` against session.toml.

    Registers times the wrong sensitivity are wrong by the ratio of the full scales: nothing in a fit can repair the units.
    """
    findings = []
    for key, declared in (("gyro_fs_dps", sensor.gyro_fs_dps), ("accel_fs_g", sensor.accel_fs_g)):
        said = _number(log.comments.get(key))
        if said is not None and abs(said / declared - 1) > 1e-6:
            says = f"the log says {key}={said:g}, session.toml {declared:g}"
            findings.append(Finding("error", log.path.name, "full scale", says, f"correct {key} in session.toml"))
    serial = log.comments.get("serial")
    if serial and sensor.serial and serial != sensor.serial:
        says = f"the log is of sensor {serial}, session.toml says {sensor.serial}"
        findings.append(Finding("warning", log.path.name, "serial", says, "keep one folder per sensor"))
    return findings


def check_stamps(log: Log, noise: Noise | None, segment_s: float) -> list[Finding]:
    """Gaps, and the jitter of the stamps.

    A stamp wrong by e misplaces e times the change of rate around it, (m[k+1] - m[k-1]) / 2; over a segment these add up as a
    random walk.  It matters where it exceeds the gyro's own: angle random walk x sqrt(duration).
    """
    samples, where = log.samples, log.path.name
    steps, pace = samples.dt_s, pace_of(samples.t_ns)
    period, gaps = pace.period_s, steps > GAP_PERIODS * samples.period_s  # as in the segments
    single = pace.missing(steps[~gaps])
    findings = [_gaps(samples, gaps, pace.missing(steps), single, where)]
    # A step of two periods is no jitter where a sample is missing.
    share = single / max(int(np.count_nonzero(~gaps)), 1)
    jitter = float(np.sqrt(max(steps[~gaps].var() - share * (1 - share) * period**2, 0.0) / 2))
    square = sum((np.sum(((part[2:] - part[:-2]) / 2) ** 2, axis=0) for _, part in pieces(samples.gyro, overlap=2)), np.zeros(3))
    angle = float(np.sqrt((square / (len(samples) - 2)).max() * segment_s / period)) * jitter if len(samples) > 2 else 0.0
    floor = float("inf") if noise is None else float(noise.angle_random_walk.max()) * np.sqrt(segment_s)
    says = f"{jitter * 1e6:.1f} us rms ({jitter / period:.1%} of a period): {angle / DEG:.4f} deg per turn"
    if np.isfinite(floor):
        says += f", noise {floor / DEG:.4f}"
    if angle > floor:
        do = "stamp with the sensor's or the board's clock, not on arrival"
        findings.append(Finding("warning", where, "jitter", says, do))
    else:
        findings.append(Finding("ok", where, "jitter", says))
    return findings


def _gaps(samples: Samples, gaps: np.ndarray, lost: int, single: int, where: str) -> Finding:
    """What is missing: in gaps, which cost turns, and one at a time, which cost accuracy."""
    if gaps.any():
        long = int(np.count_nonzero(gaps)) - int(np.count_nonzero(gaps[short_gaps(samples)[0]]))
        longest_s, first_s = samples.dt_s.max(), samples.t_s[int(np.argmax(gaps))]
        says = f"{gaps.sum()} gaps, {lost} samples lost{f' ({single} of them singly)' if single else ''}"
        says += f", the longest {longest_s:.3f} s, the first at {first_s:.1f} s"
        says += f"; {long} of them longer than {MOST} samples" if long else f"; none longer than {MOST} samples"
        do = f"turns with a gap of more than {MOST} samples are not used; " if long else ""
        return Finding("warning", where, "gaps", says, f"{do}look at the card or the port")
    if not single:
        return Finding("ok", where, "gaps", f"none longer than {GAP_PERIODS:g} periods")
    share = single / (len(samples) + single)
    says = f"{single} samples lost singly ({share:.2%}); no gap longer than {GAP_PERIODS:g} periods"
    return Finding("warning" if share > LOST_SHARE else "note", where, "gaps", says, "look at the card or the port")


def check_registers(log: Log, sensor: Sensor, stills: list[Still], missing_accel: bool = False) -> list[Finding]:
    """Clipping, axes that never move, readings that repeat; ``missing_accel``: rows whose accelerometer reads 0, 0, 0 have none."""
    samples, findings = log.samples, []
    absent = without_force(samples) if missing_accel else np.zeros(len(samples), dtype=bool)
    if absent.any():
        says = f"{absent.sum()} of {len(absent)} rows read 0, 0, 0: taken as not recorded"
        findings.append(Finding("note", log.path.name, "accelerometer", says))
    for name, unit, values, full, reach, factor, stds in (
        ("gyro", "dps", samples.gyro, sensor.gyro_fs_dps, gyro_reach_dps(sensor), DEG, [s.gyro_std for s in stills]),
        (
            "accelerometer",
            "g",
            samples.accel,
            sensor.accel_fs_g,
            accel_reach_g(sensor),
            G,
            [s.accel_std for s in stills],
        ),
    ):
        t_ns = samples.t_ns
        if name == "accelerometer" and absent.any():
            if absent.all():
                continue
            values, t_ns = pick(values, ~absent), t_ns[~absent]
        # One axis after the other: a day's log is three times as long side by side.
        ends = np.array([(values[:, i].min(), values[:, i].max()) for i in range(3)])
        stuck = ends[:, 0] == ends[:, 1]
        if stuck.any():
            says = f"{axes_text(stuck)} reads one value throughout; a sensor has noise"
            findings.append(Finding("error", log.path.name, f"{name} stuck", says, STUCK))
        noise = np.median(stds, axis=0) if stds else np.zeros(3)
        each = [
            _clipping(values[:, i] / factor, noise[i] / factor, reach, (t_ns, samples.t_ns[0]), f"{axis}", unit)
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


def without_force(samples: Samples) -> np.ndarray:
    """(N,) bool: rows whose accelerometer reads 0, 0, 0."""
    return np.concatenate([(part == 0).all(axis=1) for _, part in pieces(samples.accel)])


def _clipping(values: np.ndarray, noise_std: float, reach: float, stamps: tuple[np.ndarray, int], axis: str, unit: str) -> str | None:
    """At the register's end, or at an extreme that the axis keeps for longer than noise lets it; stamps (N,) ns, and the log's first."""
    run = run_bar(noise_std, _step(values))
    rest = np.median(values)
    mask = np.zeros(len(values), dtype=bool)
    for level in (values.max(), values.min()):
        if abs(level) >= reach * (1 - 1e-6):
            mask |= values == level
        elif abs(level - rest) > 20 * noise_std:  # an axis that is not turned has its extremes in the noise
            mask |= plateau(values, level, run)
    if not mask.any():
        return None
    levels = " and ".join(f"{level:.5g}" for level in np.unique(values[mask]))
    first_s = (stamps[0][np.argmax(mask)] - stamps[1]) * NS
    return f"{axis} stands at {levels} {unit} in {mask.sum()} samples, first at {first_s:.1f} s"


def _repeats(log: Log, stills: list[Still]) -> list[Finding]:
    """Rows whose six readings all repeat the row before: the log was read faster than the sensor measures.

    Noise repeats a reading with a chance of step / (2 sqrt(pi) std) per axis, all six at once nearly never.
    """
    samples = log.samples
    same, steps = np.ones(max(len(samples) - 1, 0), dtype=bool), np.empty(6)
    for number in range(6):
        column = (samples.gyro if number < 3 else samples.accel)[:, number % 3]
        same &= column[1:] == column[:-1]
        steps[number] = _step(column)
    share = float(same.mean())
    std = np.median([np.concatenate([s.gyro_std, s.accel_std]) for s in stills], axis=0) if stills else np.zeros(6)
    chance = np.prod(np.minimum(1.0, steps / np.maximum(2 * np.sqrt(np.pi) * std, 1e-300)))
    if share < max(0.01, 10 * chance):
        return []
    fresh_hz = (1 - share) / log.samples.period_s
    says = f"{share:.0%} of the rows repeat all six readings (by noise {chance:.1g}): new ones come at {fresh_hz:.0f} Hz"
    return [Finding("warning", log.path.name, "repeats", says, "read on the data-ready signal or from the FIFO; log each sample once")]


def _step(values: np.ndarray) -> float:
    """The register's step as seen in the values: the smallest difference between neighbours, or 0."""
    steps = np.diff(values)
    np.abs(steps, out=steps)
    size = max(abs(values.max()), abs(values.min()))
    return float(steps.min(initial=np.inf, where=steps > 1e-9 * max(size, 1e-300))) if (steps > 0).any() else 0.0


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
