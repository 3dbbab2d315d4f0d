"""Any program's logs of a gyroscope alone as a session folder: ``import LOG… --turns turns.csv``."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.texts import command_line
from session.base.units import NS
from session.log.config import Sensor, read_config
from session.log.logfile import NAME, read_known_turns
from session.log.stamps import pace_of
from session.replay.answers import with_comments
from session.replay.convert import Imported
from session.replay.interpretation import clock_text, program_text, triad_text, unit_source
from session.replay.join import rates_of
from session.replay.options import Answers
from session.replay.sources import Source, sources_of
from tinygc.features.turns.folder import GyroLog, write_turn_session

#: files that are named one by one
NAMED = 3


def import_turns(
    paths: Sequence[Path], out: Path, answers: Answers, turns: Path, columns: Sequence[str] = (), serial: str = ""
) -> Imported:
    """A session folder of a gyroscope alone: a log of each file, and the turns of ``turns``, which name the files in their column log.

    An accelerometer next to the gyroscope is left out.  Nothing is left behind where it fails.  Raises FormatError, DataError, and
    QuestionsError for all that the logs do not state.
    """
    logs: list[GyroLog] = []
    notes: list[str] = []
    dialects: list[str] = []
    used: list[Source] = []
    names: dict[str, str] = {}
    with sources_of(paths, answers, columns, gyro_alone=True) as sources:
        answers = with_comments(answers, sources)
        for source in sources:
            layout = source.layout
            if layout.gyro is None:
                continue
            if layout.gyro.unit.si is None:
                raise FormatError(f"{source.path.name} holds registers; of a gyroscope alone give what one count is, --gyro-unit 0.061dps")
            if source.path.name in names:
                raise FormatError(f"two files are called {source.path.name}, and {turns.name} could mean either; rename one")
            t_ns, written, remarks = rates_of(source, answers.odr_hz)
            later = np.diff(t_ns, prepend=t_ns[:1] - 1) > 0
            name = f"log{len(logs) + 1:04d}_{re.sub(r'[^A-Za-z0-9]+', '_', source.path.name.split('.csv')[0]).strip('_')}"
            names[source.path.name] = name
            logs.append(GyroLog(name, t_ns[later], written[later] * layout.gyro.unit.si))
            notes += remarks
            dialects.append(layout.dialect)
            used.append(source)
    if not logs:
        raise FormatError(f"{paths[0].name}: no gyroscope; give its logs")
    # The file of turns names the logs as they were called before.
    try:
        known = read_known_turns(turns, list(names))
        known = tuple(replace(turn, log=None if turn.log is None else f"{names[turn.log]}.csv.gz") for turn in known)
        write_turn_session(out, logs, known, model=answers.sensor or "unknown", serial=serial, gyro_fs_dps=answers.gyro_fs_dps)
    except FormatError as error:
        raise FormatError(re.sub(rf"^{re.escape(NAME)}\b", lambda _: turns.name, str(error))) from None
    return Imported(
        out,
        out / f"{logs[0].name}.csv.gz",
        tuple(dict.fromkeys(dialects)),
        sum(len(log.t_ns) for log in logs),
        tuple(notes),
        (),
        (command_line("fit", out),),
        _took(used, logs, answers, read_config(out / "session.toml").sensor),
    )


def _took(used: Sequence[Source], logs: Sequence[GyroLog], answers: Answers, sensor: Sensor) -> tuple[str, ...]:
    """What was taken for what, in three lines."""
    places = [f"{source.path.name} as {log.name}.csv.gz" for source, log in zip(used, logs, strict=True)]
    more = f" and {len(used) - NAMED} more" if len(used) > NAMED else ""
    assumed = " (assumed)" if answers.gyro_fs_dps is None else ""
    rates_hz = [pace_of(log.t_ns).rate_hz for log in logs]
    slow, fast = (f"{edge(rates_hz):.4g}" for edge in (min, max))
    duration_s = sum(float(log.t_ns[-1] - log.t_ns[0]) * NS for log in logs)

    def each(text: Callable[[Source], str]) -> str:
        """What is known of the files, each once."""
        return " or ".join(dict.fromkeys(map(text, used)))

    return (
        f"{each(lambda source: program_text(source.layout, answers))}: {', '.join(places[:NAMED])}{more}",
        f"gyroscope: {each(lambda source: triad_text(source.layout, source.layout.gyro, unit_source(source.layout, 'gyro')))}, "
        f"±{sensor.gyro_fs_dps:g} dps{assumed}",
        f"clock: {each(lambda source: clock_text(source.layout, answers, source.layout.time is None))}; "
        f"{slow if slow == fast else f'{slow} to {fast}'} Hz for {duration_s:.1f} s",
    )
