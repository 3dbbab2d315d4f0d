"""``attitudes.csv`` of a session that a machine turned: the attitude of each still, from the machine's angles in ``table.csv``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.base.files import read_text
from session.base.results import write_text_whole
from session.base.units import NS
from session.bench.rawfile import put_aside
from session.detect.check_references import with_own_accelerometer
from session.detect.stills import SessionStills
from session.log.folder import ATTITUDES, read_session
from session.log.samples import Samples
from session.log.written import attitudes_text
from tinygc.features.tables.machines import angles, description
from tinygc.features.tables.machines.angles import AngleLog, read_angles
from tinygc.features.tables.machines.description import attitudes, read_description, roll_pitch_yaw

MOST_BYTES = 100_000_000
#: answers in a still that differ by more of an axis's sigma are none of one attitude
SIGMAS = 5.0
#: s at both ends of a still that an answer may be late
LATE_S = 0.2


def write_attitudes(folder: Path) -> int:
    """Write ``attitudes.csv``, a row for each still that the machine's angles tell the attitude of; returns how many there are.

    Stills are counted as the core does, over all logs.  Raises the errors of reading the folder.
    """
    table = read_description(folder / description.NAME)
    said = read_angles(folder / angles.NAME, table)
    session, _ = with_own_accelerometer(read_session(folder))
    known, rows = SessionStills(session), []
    spread = np.array([SIGMAS * axis.sigma_rad + axis.backlash_rad for axis in table.axes])
    for log in session.logs:
        of_log = said.get(log.path.name.removesuffix(".gz"))
        for still in known.of(log).stills:
            at = None if of_log is None else _angles_in(of_log, log.samples, still.start, still.stop, spread)
            rows.append(np.full(3, np.nan) if at is None else roll_pitch_yaw(attitudes(table, at[None]))[0])
    found = np.array(rows).reshape(-1, 3)
    path, text = folder / ATTITUDES, attitudes_text(found)
    if path.exists():
        if text.startswith(read_text(path, MOST_BYTES)):  # of an earlier part of this recording
            path.unlink()
        else:
            put_aside(path)
    write_text_whole(path, text)
    return int(np.isfinite(found).all(axis=1).sum())


def _angles_in(said: AngleLog, samples: Samples, start: int, stop: int, spread: np.ndarray) -> np.ndarray | None:
    """(K,) median of the answers at rest within a still; None where there are none, or where they differ."""
    late_ns = LATE_S / NS
    within = (said.t_ns >= samples.t_ns[start] + late_ns) & (said.t_ns <= samples.t_ns[stop - 1] - late_ns)
    among = said.angles[within & ~said.moving]  # a verb counts as motion a moment before the stage moves
    return None if not len(among) or (np.ptp(among, axis=0) > spread).any() else np.median(among, axis=0)
