"""How a log was read: program, columns, units, full scales, clock and rate, each with how sure it is, a line each."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from session.base.units import NS_PER_S, TIME
from session.log.config import Sensor
from session.log.layout import Layout, Triad
from session.replay.dialects import OTHER, OWN, TableLayout
from session.replay.guesses import BY_GRAVITY
from session.replay.join import Joined
from session.replay.options import Answers
from session.replay.sources import BY_FILE, Source


def interpretation(
    sources: Sequence[Source], joined: Joined, answers: Answers, assumed: Sequence[str], rate_hz: float, duration_s: float
) -> tuple[str, ...]:
    """Four lines for people: program, gyroscope, accelerometer, clock."""
    files = "; ".join(dict.fromkeys(f"{source.path.name}: {program_text(source.layout, answers)}" for source in sources))
    ranges = [
        _range(word, full_scale, any(called in note and "assumed" in note for note in assumed))
        for called, word, full_scale in (("gyroscope", "dps", answers.gyro_fs_dps), ("accelerometer", "g", answers.accel_fs_g))
    ]
    gyro, accel = joined.gyro_layout, joined.accel_layout
    rates, forces = triad_text(gyro, gyro.gyro, unit_source(gyro, "gyro")), triad_text(accel, accel.accel, unit_source(accel, "accel"))
    clock = f"clock: {clock_text(gyro, answers, joined.counted)}; {rate_hz:g} Hz for {duration_s:.1f} s"
    return files, f"gyroscope: {rates}, {ranges[0]}", f"accelerometer: {forces}, {ranges[1]}", clock


def read_as(joined: Joined, answers: Answers, rate_hz: float) -> str:
    """The units alone, in one line: ``read as: time in ms (208 Hz), gyro in rad/s, accelerometer in g``."""
    layout = joined.gyro_layout
    stamps = "time of day" if layout.clock else f"time in {_unit(layout.time_ns)}"
    time = "samples counted" if joined.counted else "evenly by the stamps" if joined.even_sigma_ppm is not None else stamps
    units = [triad and (triad.unit.word if triad.unit.si else "registers") for triad in (layout.gyro, joined.accel_layout.accel)]
    whose = f"{answers.sensor} at ±{answers.gyro_fs_dps:g} dps, " if answers.sensor and answers.gyro_fs_dps else ""
    return f"read as: {whose}{time} ({rate_hz:g} Hz), gyro in {units[0]}, accelerometer in {units[1]}"


def port_interpretation(name: str, layout: Layout, sensor: Sensor, rate: str) -> tuple[str, ...]:
    """The same of a port's bytes; layout: of the log that was made of them; sensor: of their session.toml; rate: and for how long."""
    gyro, accel = (triad_text(layout, triad, "header") for triad in (layout.gyro, layout.accel))
    gyro, accel = f"{gyro}, ±{sensor.gyro_fs_dps:g} dps (session.toml)", f"{accel}, ±{sensor.accel_fs_g:g} g (session.toml)"
    clock = f"{layout.name(layout.time_column)} in {_unit(layout.time_ns)}, the board's own"
    return f"{name}: a port's bytes, by its name", f"gyroscope: {gyro}", f"accelerometer: {accel}", f"clock: {clock}; {rate}"


def program_text(layout: TableLayout, answers: Answers) -> str:
    """The program, and how it was known."""
    by_person = layout.sources.get("gyro") != BY_GRAVITY
    if layout.dialect == OTHER:
        return "columns by their names" if not answers.columns else "columns as given" if by_person else "columns by gravity"
    how = "by --like" if answers.like else "by its header" if layout.header_line else "by its bytes"
    called = "this tool's own log" if layout.dialect == OWN else layout.dialect
    return f"{called}, {how}"


def unit_source(layout: TableLayout, kind: str) -> str:
    """Where the unit of ``gyro`` or ``accel`` is from."""
    return layout.sources.get(kind, "header")


def triad_text(layout: Layout, triad: Triad | None, source: str) -> str:
    """Three columns, their unit, and where it is from."""
    assert triad is not None  # ``join`` chose the files that have them
    named = [re.sub(r"(?<!\s)\s*+[\[(][^\[\](A-Za-z)]*+[A-Za-z][^\[\]()]*+[\])]$", "", layout.name(column)) for column in triad.columns]
    columns = ", ".join(f"{'-' if sign < 0 else ''}{name}" for name, sign in zip(named, triad.signs, strict=True))
    if len(columns) > LONGEST and min(triad.signs) > 0 and np.diff(triad.columns).tolist() == [1, 1]:
        columns = f"{named[0]} to {named[2]}"
    return f"{columns} {_unit_words(triad)} ({source})"


#: characters of three columns' names, of which longer ones are the first and the last
LONGEST = 26


def _unit_words(triad: Triad) -> str:
    counts, per = re.fullmatch(r"([0-9.e+-]+) ?(.+)", triad.unit.word), re.fullmatch(r"(dps|g)/([0-9.]+)", triad.unit.word)
    word = f"counts of {float(counts[1]):.4g} {counts[2]}" if counts else triad.unit.word
    return "registers" if triad.unit.si is None else f"{per[2]} counts/{per[1]}" if per else f"in {word}"


def _range(word: str, full_scale: float | None, assumed: bool) -> str:
    return f"±{full_scale:g} {word}{' (assumed)' if assumed else ''}"


def clock_text(layout: TableLayout, answers: Answers, counted: bool) -> str:
    """The columns of the stamps, their unit, and where it is from; counted: whether there are none."""
    if counted or layout.time is None:
        return f"none, samples counted at {answers.odr_hz:g} Hz" if answers.odr_hz else "none, samples counted"
    columns = " + ".join(layout.name(column) for column in (layout.time, *(column for column, _ in layout.finer)))
    source = layout.sources["time"]
    if layout.clock:
        return f"{columns} as a time of day"
    summed = ", intervals that are added up," if layout.intervals else ""
    return f"{columns}{summed}{'' if source == BY_FILE else f' in {_unit(layout.time_ns)}'} ({source})"


def _unit(ns: float) -> str:
    """The unit of a stamp, as people write it."""
    word = next((word for word in ("s", "ms", "us", "ns") if TIME[word] == ns), None)
    return word or (f"{ns:g} ns" if ns < 1000 else f"{ns / 1000:g} us" if ns < NS_PER_S else f"{ns / NS_PER_S:g} s")
