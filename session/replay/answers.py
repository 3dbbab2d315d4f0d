"""What a log does not state of its sensor: taken from its comments, requested, or assumed and noted."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from session.base.errors import DataError
from session.base.numeric import held_for, new_readings, runs_of
from session.base.questions import Question, QuestionsError
from session.base.texts import measured, significant
from session.base.units import DEG, G
from session.bench.session_file import ASSUMED
from session.log.arrays import USUAL_DPS, USUAL_G
from session.log.config import Sensor
from session.log.registers import DEFAULT, UNKNOWN, nearest_name, profile_of, require_profile
from session.log.samples import pieces
from session.replay.dialects import OWN
from session.replay.join import LEAST_GRAVITY, Joined
from session.replay.options import Answers
from session.replay.sources import Source

#: of a note on a full scale that no one has stated
ASSUMED_RANGE = "is assumed"
#: readings in a row that stand at the largest value of all: the range ends there
AT_THE_END = 4
#: of a full scale: beyond it a unit or the range is another; registers end at 1.15
FAR = 1.2
#: of a range: up to where a register's last count lies
AT_LAST = 1.0005
#: of the least step between readings: the step to a range's end, where readings run into it
ABRUPT = 3
#: a rate that small is a rest's, whose few values come again and again
LEAST_AT_END = {"gyro": 60 * DEG, "accel": 1.5 * G}
#: of g, the most that readings have as their median length: twice, whatever the scale's error
MOST_GRAVITY = 2.0


def with_comments(answers: Answers, sources: Sequence[Source]) -> Answers:
    """What a log's own comments state (``# gyro_fs_dps=500 accel_fs_g=4``), unless the person states another."""
    stated: dict[str, float] = {}
    for source in sources:
        for key in ("gyro_fs_dps", "accel_fs_g", "odr_hz"):
            with contextlib.suppress(KeyError, ValueError):
                stated[key] = float(source.comments[key])
    return replace(
        answers,
        gyro_fs_dps=stated.get("gyro_fs_dps") if answers.gyro_fs_dps is None else answers.gyro_fs_dps,
        accel_fs_g=stated.get("accel_fs_g") if answers.accel_fs_g is None else answers.accel_fs_g,
        odr_hz=stated.get("odr_hz") if answers.odr_hz is None else answers.odr_hz,
        sensor=answers.sensor or next((source.comments["sensor"] for source in sources if "sensor" in source.comments), None),
    )


def with_sensor(sources: Sequence[Source], answers: Answers) -> tuple[Answers, tuple[str, ...]]:
    """The answers with the sensor, and notes: registers must be some sensor's, numbers in physical units may be anyone's.

    Raises FormatError where the registers are of a sensor that is not known, QuestionsError where they are of a foreign log that names
    neither the sensor nor its full scales.
    """
    registers = {kind for source in sources for kind, _, unit in source.layout.kinds if unit.si is None}
    ours = all(source.layout.dialect == OWN for source in sources)
    questions = []
    if registers and answers.sensor is None and not ours:
        questions.append(Question("whose registers it holds", "--sensor NAME", "`calibrate.py sensors` lists them"))
    if "gyro" in registers and answers.gyro_fs_dps is None:
        questions.append(Question("the gyroscope's full scale", "--gyro-fs DPS"))
    if "accel" in registers and answers.accel_fs_g is None:
        questions.append(Question("the accelerometer's full scale", "--accel-fs G"))
    if questions:
        named = " and ".join(dict.fromkeys(source.path.name for source in sources))
        raise QuestionsError(named, " and ".join(dict.fromkeys(source.layout.dialect for source in sources)), questions)
    if answers.sensor and answers.sensor != UNKNOWN:
        if registers:
            require_profile(answers.sensor)
        if profile_of(answers.sensor) is not None:
            return answers, ()
        near = nearest_name(answers.sensor)
        note = f"{answers.sensor} is no sensor that is known{f' (is {near} meant?)' if near else ''}"
        return answers, (f"{note}: it has no yardstick (`calibrate.py sensors` lists those that have one)",)
    return (replace(answers, sensor=DEFAULT), (ASSUMED,)) if registers else (answers, ())


def with_full_scales(sources: Sequence[Source], joined: Joined, answers: Answers) -> tuple[Answers, tuple[str, ...]]:
    """The answers with full scales, and notes: where none is stated, the smallest usual range that holds the readings is assumed.  A note
    states where the accelerometer shows too much for gravity.

    Raises QuestionsError where the readings stand at the end of their range, DataError where they are far beyond the one that is stated, or
    any usual one, or have no gravity in them.
    """
    name = " and ".join(dict.fromkeys(source.path.name for source in sources))
    dialect = " and ".join(dict.fromkeys(source.layout.dialect for source in sources))
    gyro, accel = joined.gyro_layout.gyro, joined.accel_layout.accel
    assert gyro is not None and accel is not None  # noqa: PT018  # ``join`` chose the files that have them
    questions, assumed, found, warned = [], [], {}, ""
    for kind, called, option, unit, stated, values, si, usual, word in (
        ("gyro", "gyroscope", "--gyro-fs", DEG, answers.gyro_fs_dps, joined.gyro, gyro.unit.si, USUAL_DPS, "dps"),
        ("accel", "accelerometer", "--accel-fs", G, answers.accel_fs_g, joined.accel, accel.unit.si, USUAL_G, "g"),
    ):
        if kind == "accel" and si is not None:
            lengths = np.concatenate([np.linalg.norm(part, axis=1) for _, part in pieces(values)])
            length_g = float(np.median(lengths, overwrite_input=True)) * si / G
            shows = f"its accelerometer shows {significant(length_g)} g where gravity belongs"
            if length_g < LEAST_GRAVITY:
                what = "a telephone's linear or user acceleration, or another unit; give the file with gravity, or --accel-unit"
                raise DataError(f"{name}: {shows}: {what}")
            warned = f"{shows}; is its unit right? give --accel-unit" if length_g > MOST_GRAVITY else ""
        if si is None:
            found[kind] = stated
            continue
        most = max(float(np.abs(values[:, axis] * (si / unit)).max()) for axis in range(3))  # of a day no copy of all
        if most > FAR * (stated or usual[-1]):
            range_ = f"{option} {stated:g} holds" if stated else f"any usual full scale (up to {usual[-1]:g} {word}) holds"
            reach = f"{name}: the {called}'s readings reach {significant(most, 4)} {word}, more than {range_}"
            raise DataError(f"{reach}; is its unit right? give --{kind}-unit, or {option}")
        if stated is not None:
            found[kind] = stated
            continue
        new = new_readings(values)
        rows = new if held_for(new) > 1 else slice(None)
        run = max(_standing(values[rows, axis] * (si / unit), most) for axis in range(3))
        if run >= AT_THE_END and most * unit > LEAST_AT_END[kind]:
            what = f"the {called}'s full scale, and its readings stand at {measured(most)} {word} for {run} rows"
            questions.append(Question(what, f"{option} {word.upper()}", "its range ends there, or near"))
            continue
        found[kind] = next((float(range_) for range_ in usual if range_ * AT_LAST > most), float(np.ceil(most)))
        assumed.append((called, f"±{found[kind]:g} {word}", f"{significant(most, 4)} {word}", option))
    if questions:
        raise QuestionsError(name, dialect, questions)
    notes = [
        f"the {called}'s full scale of {range_} {ASSUMED_RANGE}, the smallest usual one that holds its readings, up to {most}: {option}"
        for called, range_, most, option in assumed
    ]
    return replace(answers, gyro_fs_dps=found["gyro"], accel_fs_g=found["accel"]), (*notes, *([warned] if warned else []))


def _standing(values: np.ndarray, most: float) -> int:
    """The longest run of readings (N,) of one axis that are all as large as the largest of any axis, and begin or end abruptly: a peak in
    coarse steps stands, too, but the next reading is one step away."""
    runs = list(zip(*runs_of(np.abs(values) == most), strict=True))
    if not runs:
        return 0
    steps = np.abs(np.diff(values))
    bar = ABRUPT * steps[steps > 0].min(initial=np.inf)
    around = [[abs(values[start] - values[row]) for row in (start - 1, stop) if 0 <= row < len(values)] for start, stop in runs]
    return max(int(stop - start) if max(each, default=0.0) >= bar else 0 for (start, stop), each in zip(runs, around, strict=True))


def sensor_of(answers: Answers) -> Sensor:
    """The sensor of a session.toml to be, of answers with full scales."""
    assert answers.gyro_fs_dps is not None and answers.accel_fs_g is not None  # noqa: PT018  # ``with_full_scales`` has found them
    return Sensor(answers.sensor or UNKNOWN, "", 1.0, answers.gyro_fs_dps, answers.accel_fs_g)
