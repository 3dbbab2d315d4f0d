"""The watch for Python and for the command."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.log.config import read_config
from tinygc.deploy.apply import model_of
from tinygc.deploy.calibration import Surroundings, surroundings
from tinygc.features.unit.options import SourceOptions, WatchOptions
from tinygc.features.unit.watch.source import SILENT_S, Remark, items_of, require_source
from tinygc.features.unit.watch.watch import Event, Watch
from tinygc.fitting.unit_state import UnitState, read_state
from tinygc.library.arguments import public


@dataclass(frozen=True)
class Watched:
    """Result of ``tinygc.watch``: events in their order; held: True, False after an alarm, None where nothing could be judged."""

    events: tuple[Event, ...]

    @property
    def held(self) -> bool | None:
        """Whether the calibration held."""
        return self.events[-1].table["held"] if self.events else None

    @property
    def alarms(self) -> tuple[Event, ...]:
        """The alarms alone."""
        return tuple(event for event in self.events if event.kind == "alarm")

    def summary(self) -> str:
        """One line."""
        return self.events[-1].words if self.events else ""

    def to_json(self) -> list[dict]:
        """A table of ``tinygc-watch/1`` for each event."""
        return [event.to_json() for event in self.events]


def surroundings_of(known: UnitState, model: Path, source: str, session: Path | None) -> Surroundings:
    """Full scales and the accelerometer's calibration, as ``apply`` takes them; without a calibration gravity says nothing.

    Raises CalibrationError where nobody has calibrated the accelerometer.
    """
    log = Path(source)
    found = surroundings(known.table, model, log if log.is_file() else Path("-"), session)
    if found.accelerometer is None:
        raise CalibrationError(
            f"{model}: no calibration of the accelerometer, without which gravity's length says nothing; fit again, or give --session DIR"
        )
    return found


def events_of(
    model: Path,
    source: str,
    how: SourceOptions,
    options: WatchOptions,
    ended: Callable[[], bool] = lambda: False,
) -> Iterator[Event]:
    """Events of a source until it ends, or ``ended`` says so.

    Raises CalibrationError for what cannot be read.
    """
    require_source(source)
    path = model_of(model)
    known = read_state(path, options.noise)
    if known.model.session_s is not None:
        raise CalibrationError(f"{path}: follows the time of its own session; give {path.stem}_at_end.json beside it")
    if options.session is not None:
        known = replace(known, config=read_config(options.session / "session.toml"))
    around = surroundings_of(known, path, source, options.session)
    live = Watch(known, options.false_alarm_every_s)
    items = items_of(source, how, around)
    heard_s, silent = time.monotonic(), False
    with contextlib.suppress(KeyboardInterrupt):  # where a read cannot be waited for otherwise; a second one ends the program
        for item in items:
            if item is not None:
                for event in live.take(item):
                    yield event
                    if ended():
                        break
            if item is not None and not isinstance(item, Remark):
                heard_s, silent = time.monotonic(), False
            elif not silent and time.monotonic() - heard_s > SILENT_S:
                silent = True
                yield Event("remark", live.t_s, f"no sample has come for {SILENT_S:.0f} s", {"what": "silent", "count": 1})
            if ended():
                break
    yield from live.end()


@public(WatchOptions)
def watch(model: Path | str, source: Path | str, **choices: Any) -> Any:
    """Hold a log's rests, its gravity and its turns against a calibration, one after the other, as the command ``watch`` does.

    Parameters
    ----------
    model : str or Path
        A model file, or the folder of a session: the model that its fit recommends.
    source : str or Path
        A standard log, a port, ``udp:HOST:PORT``, or ``-`` for standard input; it is watched to its end.

    Returns
    -------
    Watched
        ``held`` (None where nothing could be judged), ``alarms``, ``events`` with ``t_s``, ``words`` and ``table``, ``summary()``.

    Raises
    ------
    CalibrationError
        For what cannot be read; its message is one line.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> folder = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).save(tempfile.mkdtemp() + "/a")
    >>> _ = tinygc.fit(folder, methods=("least_squares",)).save()
    >>> tinygc.watch(folder, folder / "log0001.csv.gz").held
    True

    """
    return Watched(tuple(events_of(Path(model), os.fspath(source), SourceOptions(), WatchOptions(**choices))))
