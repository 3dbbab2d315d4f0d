"""Any program's logs of a gyroscope alone as a session folder: ``import LOG… --turns turns.csv``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from session.annexes.turntable.folder import GyroLog, write_turn_session
from session.io.dialects import Answers
from session.io.errors import FormatError
from session.io.logfile import read_known_turns
from session.io.texts import command_line
from session.replay.answers import with_comments
from session.replay.convert import Converted
from session.replay.join import rates_of
from session.replay.sources import Sources


def import_turns(paths: Sequence[Path], out: Path, answers: Answers, turns: Path, columns: Sequence[str] = ()) -> Converted:
    """A session folder of a gyroscope alone: a log of each file, and the turns of ``turns``, which name the files in their column log.

    An accelerometer beside the gyroscope is left out.  Nothing is left behind where it fails.  Raises FormatError, DataError, and
    QuestionsError for all that the logs do not say.
    """
    logs: list[GyroLog] = []
    notes: list[str] = []
    dialects: list[str] = []
    took: list[str] = []
    names: dict[str, str] = {}
    with Sources(paths, answers, columns) as sources:
        answers = with_comments(answers, sources)
        for source in sources:
            layout = source.layout
            if layout.gyro is None:
                continue
            if layout.gyro.unit.si is None:
                raise FormatError(f"{source.path.name} holds registers; of a gyroscope alone give what one count is, --gyro-unit 0.061dps")
            t_ns, written, said = rates_of(source, answers.odr_hz)
            later = np.diff(t_ns, prepend=t_ns[:1] - 1) > 0
            name = f"log{len(logs) + 1:04d}_{re.sub(r'[^A-Za-z0-9]+', '_', source.path.name.split('.csv')[0]).strip('_')}"
            names[source.path.name] = name
            logs.append(GyroLog(name, t_ns[later], written[later] * layout.gyro.unit.si))
            notes += said
            dialects.append(layout.dialect)
            took.append(f"{source.path.name}: {layout.dialect}, rates in {layout.gyro.unit.word}, {len(t_ns)} samples, as {name}.csv.gz")
    if not logs:
        raise FormatError(f"{paths[0].name}: no gyroscope; give its logs")
    # The file of turns names the logs as they were called before.
    known = [replace(turn, log=None if turn.log is None else f"{names[turn.log]}.csv.gz") for turn in read_known_turns(turns, list(names))]
    write_turn_session(out, logs, known, model=answers.sensor or "unknown", gyro_fs_dps=answers.gyro_fs_dps)
    return Converted(
        out,
        out / f"{logs[0].name}.csv.gz",
        tuple(dict.fromkeys(dialects)),
        sum(len(log.t_ns) for log in logs),
        tuple(notes),
        (),
        (command_line("fit", out),),
        tuple(took),
    )
