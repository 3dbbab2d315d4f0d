"""``explain`` where a truth file is the reference: sensor, truth and clocks, each wrong by a known amount."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table
from rich.console import Console
from scipy.spatial.transform import Rotation
from truth_sessions import TOML

import calibrate
from tinygc import read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.explanation.claims import SMALLEST_P, p_entry, p_words
from tinygc.explanation.result import truth_to_json
from tinygc.explanation.truth_engine import chance_of, explain_truth
from tinygc.reporting.explanation_text import TruthReport, refusals, truth_page


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


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_wrong(tmp_path):
    found = [explain_truth(write(tmp_path / str(seed), seed=seed)) for seed in range(4)]
    assert sum(e.verdict == "no_mismatch" for e in found) >= 3
    for e in found:
        assert abs(e.offset[0]) < 4 * e.offset[1] < 0.4e-3
        assert np.abs(e.turned / e.turned_sigma).max() < 4
        assert not e.jumps
        assert 0.012 < e.truth_rad / DEG < 0.03
        assert e.neighbours[0] < -0.1  # the truth's own noise


@pytest.mark.broad
def test_a_bias_that_drifts(tmp_path):
    e = explain_truth(write(tmp_path, drift_dps=(0.2, 0, -0.15)))
    named = {claim.effect.id: claim for claim in e.claimed}
    assert set(named) & {"gyro.bias_drift", "unknown.slow_bias"}
    if "gyro.bias_drift" in named:
        claim = named["gyro.bias_drift"]
        assert np.abs((claim.theta / DEG - [0.2, 0, -0.15]) / (claim.sigma / DEG)).max() < 4
    assert e.closure_rms[1] < 0.6 * e.closure_rms[0]


@pytest.mark.slow
def test_a_size_that_no_gyroscope_has_is_no_name(tmp_path):
    """0.3 dps/g is a gyroscope's; 4 dps/g fits as well, but whatever it is, it is not that."""
    small, large = (explain_truth(write(tmp_path / str(size), dps_per_g=size)) for size in (0.3, 4.0))
    claim = next(claim for claim in small.claimed if claim.effect.id == "gyro.g_sensitivity")
    sizes, sigmas = (x.reshape(3, 3)[[0, 1, 2], [1, 2, 0]] / DEG for x in (claim.theta, claim.sigma))
    assert np.abs((sizes - 0.3) / sigmas).max() < 4
    assert not small.refused
    assert [claim.effect.id for claim in large.refused].count("gyro.g_sensitivity") == 1
    assert "gyro.g_sensitivity" not in [claim.effect.id for claim in large.claimed]
    assert large.verdict in ("unexplained", "partly_explained")
    assert truth_to_json(large)["refused"][0]["id"] == "gyro.g_sensitivity"
    assert "more than such a gyro has" in refusals(large)[0]


@pytest.mark.slow
def test_a_turned_frame_is_asked_for_by_gyro_and_accelerometer(tmp_path):
    e = explain_truth(write(tmp_path, frame_deg=(2.0, -1.0, 0.5)))
    claim = next(claim for claim in e.claimed if claim.effect.id == "reference.truth_frame")
    assert np.abs(np.abs(claim.theta / DEG) - [2.0, 1.0, 0.5]).max() < 0.1
    assert np.linalg.norm(e.force.turned) < 0.3 * np.linalg.norm(e.force.bias)


@pytest.mark.slow
def test_the_page_is_drawn_with_wrong_moments_and_with_next_to_nothing(tmp_path):
    pytest.importorskip("matplotlib")
    whole = explain_truth(write(tmp_path / "whole", jumps=(20.3, 40.3)))
    bare = replace(whole, lengths_s=np.zeros(0), closure_rad=np.zeros((0, 3)), alignment=None, force=None)
    for name, e in (("whole", whole), ("bare", bare)):
        TruthReport(e).save(tmp_path / name)
        assert (tmp_path / name / "explain.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


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


def test_a_p_value_that_underflows_is_said_to_be_a_bound():
    assert p_entry("p_value", 0.0) == {"p_value": SMALLEST_P, "p_value_is_upper_bound": True}
    assert p_entry("p_before", 1e-12) == {"p_before": 1e-12}
    assert p_words(0.0) == "< 1e-99"


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


@pytest.mark.slow
def test_each_day_has_its_bias_and_the_stored_one_is_the_median(tmp_path):
    """Four days, one far off: E is common, and the offsets are the days' own."""
    biases = [(0.5, -0.3, 0.6), (0.52, -0.31, 0.58), (0.49, -0.28, 0.61), (0.9, -0.7, 0.2)]
    for day, bias in enumerate(biases):
        write(tmp_path, seed=day, bias_dps=bias, name=f"{day:04}")
    expected = np.median(biases, axis=0) - biases
    assert calibrate.main(["fit", str(tmp_path), "--bias-per-log", "--methods", "least_squares", "--quiet"]) == 0
    saved = json.loads((tmp_path / "fit" / "model_least_squares.json").read_text())
    # 0.02 deg at both ends of 30 segments of 2 s know a bias to 0.0026 dps; three of that.
    assert np.abs(np.array(saved["weights"]["B"]) / DEG + np.median(biases, axis=0)).max() < 0.008
    assert np.abs(np.array(saved["weights"]["E"]) - np.eye(3)).max() < 3e-4
    assert np.allclose(np.array(saved["bias_sigma_rps"]) / DEG, np.sqrt(np.sum(expected**2, axis=0) / 3), atol=0.01)
    problem = build_problem(read_session(tmp_path))
    told = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert told["noise"]["closure_floor_rms_deg"] == pytest.approx(problem.floor.tilt_rms / DEG)  # the weights of the days are no noise
    one = fit_least_squares(problem.batch, problem.floor.sigma, problem.first).model
    assert np.abs(one.B / DEG + np.median(biases, axis=0)).max() > 0.05
