"""``tinygc.history``: one unit over its sessions, of a feature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import need
from tinygc.estimation.session_times import Moment, parsed
from tinygc.library.arguments import Progress, is_path, nothing, public


@public()
def history(
    sessions: Path | str | Sequence[Path | str],
    *,
    serial: str = "",
    dates: Any = None,
    accuracy: str = "",
    require: Sequence[str] = (),
    today: Any = None,
    progress: Progress | None = None,
) -> Any:
    """Estimate what the sessions of a unit say together: scatter between switch-ons, drift, shocks, and when to calibrate next.

    Parameters
    ----------
    sessions : path or sequence of paths
        Fitted session folders, folders that hold such, or a fleet's folder.
    serial : str, optional
        Only the unit of this serial number.
    dates : mapping of str to date or str, or path, optional
        Dates of sessions by the names of their folders, or a CSV of them.
    accuracy : str, optional
        Largest attitude error after a time at rest, such as ``1deg/60s``.
    require : sequence of str, optional
        Largest differences from the last calibration, such as ``bias 50 mdps``.
    today : date or str, optional
        The day to answer for; today by default.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    History
        ``units``, each with ``sessions``, ``numbers``, ``steps``, ``any_session``; ``outlooks`` of the requirements; ``summary()``,
        ``html()``, ``to_json()``, ``save(folder)``, ``plot(path)``.

    Raises
    ------
    CalibrationError
        For a folder without a fitted session, one session twice, a requirement or a date that cannot be read, and if the history feature
        was removed; its message is one line.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> folders = [f"{tempfile.mkdtemp()}/day{seed}" for seed in (1, 2)]
    >>> for seed, folder in zip((1, 2), folders):
    ...     session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=seed, unit_seed=1).session
    ...     _ = session.save(folder)
    ...     _ = tinygc.fit(folder, methods=("least_squares",)).save()
    >>> len(tinygc.history(folders).units[0].sessions)
    2

    """
    feature = need("the history of a unit")
    given = [Path(each) for each in (sessions if isinstance(sessions, Sequence) and not isinstance(sessions, str) else [sessions])]
    requirements = feature.requirements_of(accuracy, [require] if isinstance(require, str) else require)
    moments = feature.read_dates(Path(dates)) if is_path(dates) else {name: _moment(name, when) for name, when in (dates or {}).items()}
    day = None if today is None else _moment("today", today).when
    return feature.history_of_paths(given, moments, requirements, serial, day, progress or nothing)


def _moment(name: str, when: Any) -> Moment:
    found = parsed(str(when))
    if found is None:
        raise CalibrationError(f"dates: {name} has {when!r:.60}, expected a date in ISO 8601")
    return Moment(found, "given")
