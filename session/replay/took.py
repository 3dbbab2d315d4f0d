"""What an import took for what: program, columns, units, full scales, clock and rate, each with how sure it is, in three lines."""

from __future__ import annotations

import re
from collections.abc import Sequence

from session.base.units import NS_PER_S, TIME
from session.log.config import Sensor
from session.log.layout import Layout, Triad
from session.replay.dialects import OTHER, OWN, TableLayout
from session.replay.join import Joined
from session.replay.options import Answers
from session.replay.sources import BY_FILE, Source


def said_took(
    sources: Sequence[Source], joined: Joined, answers: Answers, assumed: Sequence[str], rate_hz: float, duration_s: float
) -> tuple[str, ...]:
    """Three lines for people."""
    files = "; ".join(dict.fromkeys(f"{source.path.name}: {said_program(source.layout, answers)}" for source in sources))
    ranges = [
        _range(word, full_scale, any(called in note and "assumed" in note for note in assumed))
        for called, word, full_scale in (("gyroscope", "dps", answers.gyro_fs_dps), ("accelerometer", "g", answers.accel_fs_g))
    ]
    gyro, accel = joined.gyro_layout, joined.accel_layout
    rates, forces = said_triad(gyro, gyro.gyro, said_source(gyro, "gyro")), said_triad(accel, accel.accel, said_source(accel, "accel"))
    sensors = f"gyroscope: {rates}, {ranges[0]}; accelerometer: {forces}, {ranges[1]}"
    return files, sensors, f"clock: {said_clock(gyro, answers, joined.counted)}; {rate_hz:g} Hz for {duration_s:.1f} s"


def said_port(name: str, layout: Layout, sensor: Sensor, rate: str) -> tuple[str, ...]:
    """The same of a port's bytes; layout: of the log that was made of them; sensor: of their session.toml; rate: and for how long."""
    gyro, accel = (said_triad(layout, triad, "header") for triad in (layout.gyro, layout.accel))
    gyro, accel = f"{gyro}, ±{sensor.gyro_fs_dps:g} dps (session.toml)", f"{accel}, ±{sensor.accel_fs_g:g} g (session.toml)"
    clock = f"{layout.name(layout.time_column)} in {_unit(layout.time_ns)}, the board's own"
    return f"{name}: a port's bytes, by its name", f"gyroscope: {gyro}; accelerometer: {accel}", f"clock: {clock}; {rate}"


def said_program(layout: TableLayout, answers: Answers) -> str:
    """The program, and how it was known."""
    if layout.dialect == OTHER:
        return "columns as you say" if answers.columns else "columns by their names; no program that is known"
    how = "as --like says" if answers.like else "by its header" if layout.header_line else "by its bytes"
    called = "this tool's own log" if layout.dialect == OWN else layout.dialect
    return f"{called}, {how}"


def said_source(layout: TableLayout, kind: str) -> str:
    """Where the unit of ``gyro`` or ``accel`` is from."""
    return layout.sources.get(kind, "header")


def said_triad(layout: Layout, triad: Triad | None, source: str) -> str:
    """Three columns, their unit, and where it is from."""
    assert triad is not None  # ``join`` chose the files that have them
    columns = ", ".join(f"{'-' if sign < 0 else ''}{layout.name(column)}" for column, sign in zip(triad.columns, triad.signs, strict=True))
    counts = re.fullmatch(r"([0-9.e+-]+) ?(.+)", triad.unit.word)
    word = f"counts of {float(counts[1]):.4g} {counts[2]}" if counts else triad.unit.word
    unit = "registers" if triad.unit.si is None else f"in {word}"
    return f"{columns} {unit} ({source})"


def _range(word: str, full_scale: float | None, assumed: bool) -> str:
    return f"±{full_scale:g} {word}{' (assumed)' if assumed else ''}"


def said_clock(layout: TableLayout, answers: Answers, counted: bool) -> str:
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
