"""``tinygc.sensors`` and ``tinygc.list_sessions``: the sensors that are known, and the sessions of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from session.base.errors import CalibrationError
from session.base.texts import command_line
from session.log.registers import PROFILES, nearest_name, profile_of
from session.log.sensors import Profile
from tinygc.library.arguments import public

if TYPE_CHECKING:
    from tinygc.fitting.listing import ListedSession


@public()
def sensors(name: str | None = None) -> list[Profile]:
    """List the sensors that are known, or one of them.

    Parameters
    ----------
    name : str, optional
        Of a sensor, in any spelling.

    Returns
    -------
    list of Profile
        ``name``, ``also``, what one count is at each full scale (``gyro``, ``accel``), data rates, typical ``figures``.

    Raises
    ------
    CalibrationError
        For a sensor that is not known; its message names the nearest.

    Examples
    --------
    >>> import tinygc
    >>> tinygc.sensors("asm330lhh")[0].name
    'ASM330LHH'

    """
    if name is None:
        return list(PROFILES)
    if (one := profile_of(name)) is None:
        near = nearest_name(name)
        meant = f"; is {near} meant?" if near else ""
        raise CalibrationError(f"{name[:60]!r} is no sensor that is known{meant} (`{command_line('sensors')}`)")
    return [one]


@public()
def list_sessions(folder: Path | str = ".") -> list[ListedSession]:
    """List the sessions of a folder, three folders deep, with the last result of each; nothing is computed.

    Parameters
    ----------
    folder : str or Path, optional
        Where to look.

    Returns
    -------
    list of ListedSession
        ``folder``, ``date``, ``model``, ``serial``, ``segments``, ``held_out_deg``, ``floor_deg``, ``verdict``; ``problem`` of one that
        cannot be read.

    Raises
    ------
    CalibrationError
        If there is no such folder.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> _ = tinygc.simulate(segments=8, closure_s=0.0, odr_hz=104.0, seed=1).save((where := tempfile.mkdtemp()) + "/one")
    >>> [each.serial for each in tinygc.list_sessions(where)]
    ['SIM-1']

    """
    if not Path(folder).is_dir():
        raise CalibrationError(f"{folder}: no folder; give one with session folders in it")
    from tinygc.fitting.listing import list_sessions as listed  # which reads results of fits

    return listed(Path(folder))
