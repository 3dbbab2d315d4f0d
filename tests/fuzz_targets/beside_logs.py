"""What lies beside the logs of a session: truth files, dial readings, known turns, and what ``explain`` asked for."""

import numpy as np

from fuzz_targets.material import UNIT_HEADER, UNIT_LINES
from fuzz_targets.rules import choose, finite
from session.log.folder import read_session
from tinygc.planning.proposals import requested_by_explain

SENSOR = 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 104\ngyro_fs_dps = 500\naccel_fs_g = 4\n'
GIVEN = 'offset_s = 0.5\nframe = "enu"\nsense = "world_to_body"\norder = "xyzw"\n'
#: file -> what session.toml says besides
FILES = (
    ("truth0001.csv", '[protocol]\nreference = "truth"\n'),
    ("truth0001.csv.gz", '[protocol]\nreference = "truth"\n'),
    ("truth0001.csv", f'[protocol]\nreference = "truth"\n[truth]\n{GIVEN}'),
    ("attitudes.csv", '[protocol]\nreference = "table"\n'),
    ("turns.csv", ""),
    ("explain/explain.json", ""),
)


def run(data, folder):
    """The file is read with its session."""
    (name, toml), data = choose(data, FILES)
    (folder / "log0001.csv").write_text(f"{UNIT_HEADER}\n{UNIT_LINES}")
    (folder / "session.toml").write_text(SENSOR + toml)
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    if name.startswith("explain"):
        words = requested_by_explain(folder)
        assert words is None or words.isprintable()
        return
    session = read_session(folder)
    for truth in () if session.reference is None else session.reference.truths:
        finite(truth.q_nb)
        np.testing.assert_allclose(np.linalg.norm(truth.q_nb, axis=1), 1, atol=1e-9)
        assert (np.diff(truth.t_ns) > 0).all()
        assert truth.window is None or truth.window.dtype == np.int64
        assert len(truth) == len(truth.q_nb) == len(truth.t_ns if truth.window is None else truth.window)
    for turn in session.turns:
        finite(turn.axis, turn.angle_rad, turn.sigma_rad)
        assert abs(np.linalg.norm(turn.axis) - 1) < 1e-9
        assert turn.description.isprintable()
        assert turn.name.isprintable()
    assert session.attitudes is None or np.isfinite(session.attitudes).all(axis=1).any()
