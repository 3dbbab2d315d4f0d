"""``tinygc.watch``: whether a calibration holds while its sensor is in use, of a feature."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import need
from session.log.dialects import Answers
from tinygc.library.arguments import answers_of, is_number, is_path, public

#: s: mean time at rest to a false alarm, where nobody says another
USUAL_S = 30 * 86400.0


@public(Answers)
def watch(
    model: Path | str,
    source: Path | str,
    *,
    false_alarm_every_s: float = USUAL_S,
    noise: Path | str | None = None,
    session: Path | str | None = None,
    **answers: Any,
) -> Any:
    """Hold a log's rests, its gravity and its turns against a calibration, one after the other, as the command ``watch`` does.

    Parameters
    ----------
    model : str or Path
        A model file, or the folder of a session: the model that its fit recommends.
    source : str or Path
        A log of any program, a port, ``udp:HOST:PORT``, or ``-`` for standard input; it is watched to its end.
    false_alarm_every_s : float, optional
        Mean time at rest to a false alarm, s; 30 days by default.
    noise : str or Path, optional
        ``noise.json`` of this unit, or its folder; the one beside the model by default.
    session : str or Path, optional
        Folder with the ``session.toml`` that holds: place, full scales, accelerometer.
    **answers
        What a log does not say, as of ``tinygc.import_log``.

    Returns
    -------
    Watched
        ``held`` (None where nothing could be judged), ``alarms``, ``events`` with ``t_s``, ``words`` and ``table``, ``summary()``.

    Raises
    ------
    CalibrationError
        For what cannot be read, and if the watch feature was removed; its message is one line.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> folder = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).save(tempfile.mkdtemp() + "/a")
    >>> _ = tinygc.fit(folder, methods=("least_squares",)).save()
    >>> tinygc.watch(folder, folder / "log0001.csv.gz").held
    True

    """
    library = need("the watch of a calibration")
    for name, value in (("model", model), ("source", source)):
        if not is_path(value):
            raise CalibrationError(f"{name} is of type {type(value).__name__}, expected a path")
    if not is_number(false_alarm_every_s):
        raise CalibrationError(f"false_alarm_every_s is {false_alarm_every_s!r:.40}, expected seconds")
    options = library.SourceOptions(answers=answers_of(answers))
    places = [None if path is None else Path(path) for path in (noise, session)]
    every_s = float(false_alarm_every_s)
    return library.watch(Path(model), os.fspath(source), options, false_alarm_every_s=every_s, noise=places[0], session=places[1])
