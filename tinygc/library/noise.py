"""``tinygc.estimate_noise``: the noise of one unit at rest, of a feature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import need
from session.log.dialects import Answers
from session.log.folder import Session
from tinygc.library.arguments import Progress, answers_of, is_number, is_path, nothing, public
from tinygc.library.logs import asking_for_keywords, columns_of


@public(Answers)
def estimate_noise(
    logs: Any = None,
    *,
    curve: Path | str | None = None,
    curve_units: str | None = None,
    duration_s: float | None = None,
    serial: str = "",
    columns: Sequence[str] | None = None,
    progress: Progress | None = None,
    **answers: Any,
) -> Any:
    """Estimate the noise of one unit at rest: the terms of IEEE 952 of each axis, with their sigmas.

    Parameters
    ----------
    logs : str, Path, Session, tuple of arrays, or sequence of them
        Session folders, folders of rest logs, logs of any program, sessions, or ``(t_s, gyro_rps, accel_mps2)``: (N,) s, (N, 3) rad/s,
        (N, 3) m/s².  Several are one estimate of one unit.  Of a log that moves, its stills are used.
    curve : str or Path, optional
        A file with an Allan curve, in place of logs.
    curve_units : str, optional
        Units of its deviations, where its header does not say them: ``"m/s2,deg/s"``.
    duration_s : float, optional
        How long the recording of the curve was, s.
    serial : str, optional
        Serial number of the sensor.
    columns : str or sequence of str, optional
        Which column is what, as of ``tinygc.import_log``.
    progress : callable, optional
        Called with what is done, how far, and of how much.
    **answers
        What a log does not say, as of ``tinygc.import_log``: ``sensor="MPU-6050"``, ``gyro_unit="dps"``, ``odr_hz=100`` and others.

    Returns
    -------
    Noise
        ``figures`` in SI, ``allan``, ``remarks``, ``summary()``, ``to_json()``, ``save(folder)``, ``plot(path)``.

    Raises
    ------
    CalibrationError
        For what cannot be read, for logs of two units or data rates, and if the noise feature was removed; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> found = tinygc.estimate_noise(["rest0001.csv", "rest0002.csv"])  # doctest: +SKIP
    >>> found.figures.gyro.values("N")  # doctest: +SKIP

    """
    feature = need("noise figures")
    told = answers_of(answers)
    if curve is not None:
        if logs is not None:
            raise CalibrationError("estimate_noise: give logs or curve, not both")
        return feature.noise_of_curve(Path(curve), curve_units, duration_s, told.odr_hz, told.sensor or "", serial)
    inputs = [_input(each) for each in (logs if isinstance(logs, list) else [logs])]
    with asking_for_keywords():
        own = columns_of(columns)
        return feature.noise_of(inputs, told, own, serial, progress or nothing)


def _input(given: Any) -> Any:
    """A path, a session, or three arrays; CalibrationError for anything else."""
    if is_path(given):
        return Path(given)
    if isinstance(given, Session) or (isinstance(given, tuple) and len(given) == 3 and not any(map(is_number, given))):
        return given
    raise CalibrationError(
        f"logs is of type {type(given).__name__}, expected the path of a log or folder, a tinygc.Session, a tuple of three arrays "
        "(t_s, gyro_rps, accel_mps2), or a list of these"
    )
