"""Public sets as session folders (``benchmarks/public``): what is in the authors' files is in the folders, to the digit; what is damaged
is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from public_files import (
    write_euroc,
)

from benchmarks.public.__main__ import main
from tinygc import read_session

NO_TRUTH = "the feature that reads truth files is not there"


def made(capsys, *arguments):
    """The folders that the command printed, read."""
    assert main(list(map(str, arguments))) == 0
    return {Path(path).name: read_session(path) for path in capsys.readouterr().out.splitlines()}


def test_euroc_as_its_authors_publish_it_and_from_archives(tmp_path, capsys):
    to_down = pytest.importorskip("benchmarks.public.euroc", reason=NO_TRUTH).to_down
    t_ns, gyro, accel, truth_ns, q_wxyz = write_euroc(tmp_path / "V1_01_easy")
    session = made(capsys, "euroc", tmp_path, "--out", tmp_path / "a")["V1_01"]
    samples, (truth,) = session.logs[0].samples, session.reference.truths
    for name, expected in (("t_ns", t_ns), ("gyro", gyro), ("accel", accel)):
        np.testing.assert_array_equal(getattr(samples, name), expected)
    np.testing.assert_array_equal(truth.t_ns, truth_ns)
    np.testing.assert_allclose(truth.q_nb, to_down(q_wxyz, tmp_path), rtol=0, atol=1e-15)
    np.savez(tmp_path / "euroc_V1_01_easy.npz", t_ns=t_ns, gyro=gyro, acc=accel, gt_t_ns=truth_ns, gt_q_wxyz=q_wxyz)
    made(capsys, "euroc", tmp_path, "--out", tmp_path / "b")
    for name in ("session.toml", "log_V1_01.csv", "truth_V1_01.csv"):
        assert (tmp_path / "a" / "V1_01" / name).read_bytes() == (tmp_path / "b" / "V1_01" / name).read_bytes()


@pytest.fixture(scope="module")
def wild(shared):
    if not (shared / "wild").is_dir():
        pytest.skip(f"no public recordings: {shared / 'wild'} is not there")
    return shared / "wild"


def test_the_real_cameras_of_repoimu_saw_what_the_gyro_turned(wild, tmp_path, capsys):
    """Over a tenth of a second, component by component: columns, order, units and sense are right."""
    pytest.importorskip("tinygc.features.truth", reason=NO_TRUTH)
    session = made(capsys, "repoimu", wild / "repoimu", "--out", tmp_path / "r")["Test06_Trial1"]
    samples, (truth,) = session.logs[0].samples, session.reference.truths
    np.testing.assert_array_equal(samples.t_ns, truth.t_ns)
    assert len(samples.t_ns) == 8732
    np.testing.assert_allclose(np.linalg.norm(samples.accel[:200], axis=1).mean(), 9.77, atol=0.05)
    (w, *v), (c, *u) = truth.q_nb[:-10].T, truth.q_nb[10:].T
    v, u = np.array(v).T, np.array(u).T
    turned = 2 * np.sign(w * c + np.sum(v * u, axis=1))[:, None] * (w[:, None] * u - c[:, None] * v - np.cross(v, u))
    summed = np.lib.stride_tricks.sliding_window_view(samples.gyro, 10, axis=0)[1:].sum(axis=2) * 0.01
    held = slice(0, -160)  # the cameras lose the stick in the last 1.3 s
    for axis in range(3):
        assert np.corrcoef(turned[held, axis], summed[held, axis])[0, 1] > 0.9  # another column, order or sense leaves less than 0.5
