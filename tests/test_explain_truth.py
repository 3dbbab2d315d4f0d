"""``explain`` where a truth file is the reference: sensor, truth and clocks, each wrong by a known amount."""

import io
import json

import numpy as np
import pytest
from conftest import DEG, Table
from rich.console import Console
from scipy.spatial.transform import Rotation
from truth_sessions import TOML

import calibrate
from tinygc.explanation.result import truth_to_json
from tinygc.explanation.truth_engine import chance_of, explain_truth
from tinygc.reporting.explanation_text import truth_page


def write(
    folder, *, seed=1, drift_dps=(0, 0, 0), dps_per_g=0.0, late_s=0.0, frame_deg=(0, 0, 0), jumps=(), bias_dps=(0.5, -0.3, 0.6), name="0001"
):
    """60 s of turning without a rest, seen every 0.1 s by a truth with 0.02 deg of noise of its own; and what is wrong with them."""
    table, rng = Table(), np.random.default_rng(seed)
    for _ in range(30):
        table.turn(rng.uniform(40, 120), rng.normal(size=3), 2.0)
    samples = table.samples(seed=seed, bias_dps=bias_dps, registers=False)
    gyro = samples.gyro + np.multiply(drift_dps, DEG) * (samples.t_s / samples.t_s[-1])[:, None]
    gyro = gyro + dps_per_g * DEG * samples.accel[:, [1, 2, 0]] / 9.80665
    moments = np.arange(0.3, table.duration_s - 0.3, 0.1)
    _, attitude = table.truth(moments - late_s)
    attitude = (
        attitude * Rotation.from_rotvec(rng.normal(size=(len(moments), 3)) * 0.02 * DEG) * Rotation.from_rotvec(np.multiply(frame_deg, DEG))
    )
    for at in jumps:
        row = int(np.argmin(np.abs(moments - at)))
        attitude[row] = attitude[row] * Rotation.from_rotvec([3 * DEG, 0, -2 * DEG])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "session.toml").write_text(TOML.format(sigma_deg=0.02))
    rows = np.column_stack([samples.t_ns * 1e-9, gyro, samples.accel])
    header = "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
    np.savetxt(folder / f"log{name}.csv", rows, fmt="%.10f", delimiter=",", header=header, comments="")
    q = np.column_stack([moments, attitude.as_quat(scalar_first=True)])
    np.savetxt(folder / f"truth{name}.csv", q, fmt="%.10f", delimiter=",", header="t_s,qw,qx,qy,qz", comments="")
    return folder


@pytest.mark.broad
def test_wrong_moments_are_found_and_left_out(tmp_path):
    e = explain_truth(write(tmp_path, jumps=(20.3, 40.3)))
    assert sorted(round(at) for _, at in e.jumps) == [20, 40]
    assert e.closure_rms[0] < 0.1 * DEG
    entry = truth_to_json(e)["effects"][0]
    assert entry["id"] == "reference.truth_jump"
    np.testing.assert_allclose(sorted(entry["parameters"]["at_s"]), [20.3, 40.3], atol=0.2)
    assert entry["std"] == {"at_s": None}
    assert entry["share"] is None
    # By the largest: some hundred times the usual miss, in the tail of Fisher's F with 1.58 x 30 degrees of freedom.
    assert 1e-60 < entry["p_value"] < 1e-9
    text = io.StringIO()
    Console(file=text, width=200).print(truth_page(e))
    assert "at_s: 20.2" in text.getvalue() or "at_s: 20.3" in text.getvalue()
    assert "± 0" not in text.getvalue().split("Evidence")[0]


@pytest.mark.parametrize("segments", [12, 40])
def test_the_chance_of_a_wrong_moment_bounds_what_normal_errors_do(segments):
    """Neighbours that share a moment's noise, as a truth's do, and segments whose scale is taken from their median."""
    rng = np.random.default_rng(segments)
    p = []
    for _ in range(2000):
        moments = rng.standard_normal((segments + 1, 3))
        size = np.linalg.norm(np.diff(moments, axis=0), axis=1)
        both = np.minimum(size[:-1], size[1:]).max()
        p.append(chance_of(float(both / np.median(size)), segments - 1, segments))
    assert np.mean(np.array(p) < 0.05) <= 0.05 + 3 * np.sqrt(0.05 / 2000)
    assert np.mean(np.array(p) < 0.01) <= 0.01 + 3 * np.sqrt(0.01 / 2000)
    assert chance_of(10.0, segments - 1, segments) < chance_of(5.0, segments - 1, segments)


@pytest.mark.broad
def test_the_command_says_it_and_writes_it(tmp_path, capsys):
    folder = write(tmp_path, late_s=0.008)
    assert calibrate.main(["explain", str(folder), "--quiet", "--strict"]) == 1
    table = json.loads((folder / "explain" / "explain.json").read_text())
    assert table["schema"] == "tinygc-explain/2"
    assert "timing.truth_offset" in [effect["id"] for effect in table["effects"]]
    assert (folder / "explain" / "explain.png").stat().st_size > 50_000
    assert calibrate.main(["explain", str(folder), "--no-pictures", "--out", str(tmp_path / "bare")]) == 0
    assert not (tmp_path / "bare" / "explain.png").exists()
    assert "cannot know" in capsys.readouterr().out
