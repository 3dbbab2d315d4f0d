"""Noise figures at rest beside a session: the prior that they give, and when the session contradicts them."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import config
from noise_records import axis_of, figures_of, sensor
from scipy.stats import chi2, f, norm

from session.base.errors import FormatError
from session.base.records import table_of
from session.base.units import DEG
from session.detect.stills import Still
from session.log.samples import Samples
from tinygc.closure.floor import GRID_RPS, BiasInstability, allan_freedom
from tinygc.closure.problem import MeasuredNoise, NoiseComparison
from tinygc.closure.stills import StillSet
from tinygc.inference.choose import ONE_SIDED
from tinygc.noise.figures import AllanBand, SensorNoise
from tinygc.noise.measured import (
    SHOWN,
    _allan_variance_of,
    _drift_comparison,
    _session_instability,
    _white_comparisons,
    measured_noise,
    rms_of_axes,
)
from tinygc.reporting.html.sections import noise_at_rest

DPH = DEG / 3600
FLICKER = 2 * np.log(2) / np.pi


def test_units_of_noise_are_what_an_hour_makes_of_it():
    """N and K grow with the root of the time, of which an hour has 60 roots of a second."""
    g = 9.80665
    for kind, white, flicker in (("gyro", DEG, DPH), ("accel", 1.0, 1e-6 * g)):
        si = {name: value for name, (_, value) in SHOWN[kind].items()}
        assert si == {"N": pytest.approx(white / 60), "B": pytest.approx(flicker), "K": pytest.approx(flicker / 60)}


def test_a_bias_instability_at_rest_is_the_session_s_at_any_length():
    """Of three axes with 20 % each, the rms has 20 / sqrt(3) %."""
    for seconds in (10.0, 7200.0):
        found = _session_instability(sensor(axis_of(B=(3 * DPH, 0.6 * DPH))), seconds)
        assert found.rps == pytest.approx(3 * DPH, rel=1e-12)
        assert found.sigma_rps == pytest.approx(3 * DPH * 0.2 / np.sqrt(3), rel=1e-9)
        assert found.most_rps == pytest.approx(3 * DPH * np.exp(ONE_SIDED * 0.2 / np.sqrt(3)), rel=1e-9)
        assert (found.source, found.of_unit) == ("measured at rest (noise.json)", False)


def test_a_random_walk_counts_by_the_length_of_the_session():
    """Its Allan variance, K^2 tau / 3, has the mean K^2 (T - 1) / (3 ln T) over the logarithm of tau from 1 s to T."""
    walk, seconds = 2e-6, 900.0
    found = _session_instability(sensor(axis_of(K=(walk, 0.1 * walk))), seconds)
    expected = walk**2 * (seconds - 1) / (3 * np.log(seconds)) / FLICKER
    assert found.rps**2 == pytest.approx(expected, rel=1e-3)
    both = _session_instability(sensor(axis_of(K=(walk, 0.1 * walk), B=(1e-5, 3e-6))), seconds)
    assert both.rps**2 == pytest.approx(expected + 1e-10, rel=1e-3)
    # a sigma of each term by its share of the variance, halved twice: of a square, and of its root
    shares = np.array([expected, 1e-10]) / (expected + 1e-10)
    assert both.sigma_rps / both.rps == pytest.approx(np.sqrt(np.sum((shares * [0.1, 0.3]) ** 2) / 3), rel=2e-3)


def test_a_limit_is_twice_its_median_and_no_figure_is_no_prior():
    limited = axis_of(limits={"B": 6 * DPH, "K": 1e-12})
    found = _session_instability(sensor(limited), 600.0)
    assert found.most_rps == pytest.approx(6 * DPH, rel=1e-9)
    assert found.rps == pytest.approx(3 * DPH, rel=1e-9)
    assert found.sigma_rps == pytest.approx(3 * DPH * np.log(2) / ONE_SIDED, rel=1e-9)  # the limit is the 95 % quantile
    assert found.source == "half its limit at rest (noise.json)"
    most = _session_instability(sensor(limited, limited, axis_of(limits={"B": 12 * DPH, "K": 1e-12})), 600.0).most_rps
    assert most == pytest.approx(DPH * np.sqrt((36 + 36 + 144) / 3), rel=1e-9)
    assert _session_instability(sensor(axis_of()), 600.0) is None


def likelihood_at(rps, spread):
    """(B,) of a session that shows a drift of rps with a relative sigma."""
    return np.concatenate([[-1e3], -(((np.log(GRID_RPS[1:] / rps)) / spread) ** 2) / 2])


KNOWN = BiasInstability(5 * DPH, "measured at rest (noise.json)", 1.0 * DPH, 7 * DPH)


@pytest.mark.parametrize("ratio", [0.4, 2.5])
def test_the_ratio_of_two_drifts_has_both_uncertainties(ratio):
    found = _drift_comparison(KNOWN, likelihood_at(5 * DPH * ratio, 0.3))
    sigma = np.hypot(0.2, 0.3)
    assert found.ratio == pytest.approx(ratio, rel=0.01)
    assert found.p_value == pytest.approx(chi2.sf((np.log(ratio) / sigma) ** 2, 1), rel=0.02)
    assert [found.low, found.high] == pytest.approx(ratio * np.exp([-1.96 * sigma, 1.96 * sigma]), rel=0.02)


def test_a_drift_beyond_the_grid_is_at_its_end():
    place = np.arange(len(GRID_RPS))
    for end in (1, -1):
        found = _drift_comparison(KNOWN, -0.1 * np.abs(place - place[end]))
        assert found.ratio == pytest.approx(GRID_RPS[end] / KNOWN.rps, rel=1e-9)


def test_a_limit_is_contradicted_by_more_alone():
    known = BiasInstability(5 * DPH, "half its limit at rest (noise.json)", 2 * DPH, 10 * DPH)
    less, more = (_drift_comparison(known, likelihood_at(at * DPH, 0.2), limit=True) for at in (1, 25))
    assert less.p_value == 0.5
    assert more.p_value == pytest.approx(norm.sf(np.log(2.5) / 0.2), rel=0.05)
    assert more.contradicted
    beyond = _drift_comparison(replace(known, most_rps=1 * DPH), likelihood_at(200 * DPH, 0.2), limit=True)
    assert (beyond.contradicted, beyond.high) == (True, 50.0)  # beyond the ratios that are tried
    assert (less.low, less.ratio) == (0.0, pytest.approx(0.1, rel=0.01))
    assert less.high == pytest.approx(0.1 * np.exp(1.96 * 0.2), rel=0.02)


def at_rest_session(N, seed, lsb=0.0, count=6, rows=300, period_s=0.01):
    """Stills of white noise N, rad/s/sqrt(Hz), two-sided; half a second around each is not still."""
    rng = np.random.default_rng(seed)
    gyro = rng.normal(size=(count * rows, 3)) * N / np.sqrt(period_s) + 0.01
    gyro[::rows] += rng.normal(size=(count, 3)) * 0.1  # what turns does not show the noise, and shows the steps
    gyro = np.rint(gyro / lsb) * lsb if lsb else gyro
    none = np.zeros(3)
    stills = [Still(k * rows + 25, (k + 1) * rows - 25, 0.0, 1.0, none, none, none, none, none, 25.0) for k in range(count)]
    t_ns = (np.arange(len(gyro)) * round(period_s * 1e9)).astype(np.int64)
    return SimpleNamespace(logs=[StillSet(Samples(t_ns, gyro, gyro, None), stills, None, None, None)])


def test_white_noise_is_seen_at_the_time_of_the_stills_whatever_the_figures_hold_besides():
    """Figures with quantisation and drift predict the Allan variance of the stills, 0.2 s."""
    axis = axis_of(N=(3e-5, 3e-7), Q=(2e-6, 2e-7), B=(2e-5, 4e-6))
    total, freedom = _allan_variance_of(axis, 0.2)
    parts = np.array([9e-10 / 0.2, 3 * 4e-12 / 0.04, 4e-10 * FLICKER])
    assert total == pytest.approx(parts.sum(), rel=1e-12)
    sigma = 2 * parts * [0.01, 0.1, 0.2]
    assert freedom == pytest.approx(2 * total**2 / np.sum(sigma**2), rel=1e-9)


def test_white_noise_of_the_stills_over_that_at_rest_follows_f():
    """Overlapping Allan variance of 20 readings, without 0.2 s at the ends of each still; three axes, both sides; 0 is no noise."""
    problem, axis = at_rest_session(3e-5, 1), axis_of(N=(3.2e-5, 1e-6))
    log = problem.logs[0]
    angles = [np.vstack([np.zeros(3), np.cumsum(log.samples.gyro[s.start + 20 : s.stop - 20], axis=0)]) for s in log.stills]
    second = np.concatenate([each[40:] - 2 * each[20:-20] + each[:-40] for each in angles])
    own, freedom = np.mean(second**2, axis=0) / 800, sum(allan_freedom(len(each), 20) for each in angles)
    expected, its = _allan_variance_of(axis, 0.2)
    law = f(freedom, its)
    for found, ratio in zip(_white_comparisons(problem, sensor(axis), 100.0), own / expected, strict=True):
        assert found.p_value == pytest.approx(min(1, 6 * min(law.sf(ratio), law.cdf(ratio))), rel=1e-6, abs=0)
        assert [found.ratio, found.low, found.high] == pytest.approx(np.sqrt(ratio / [1, *law.ppf([0.975, 0.025])]), rel=1e-6)
    assert _white_comparisons(at_rest_session(0.0, 1, 1.0), sensor(axis), 100.0) == ()
    bumped = replace(log, stills=[replace(still, bumps=1) for still in log.stills])
    assert _white_comparisons(SimpleNamespace(logs=[bumped]), sensor(axis), 100.0) == ()


def test_steps_of_a_register_are_no_contradiction_where_they_explain_it():
    """A range whose steps make as much noise as the sensor: the session has more than the rest, and not beyond what its steps can do."""
    N, period_s = 3e-5, 0.01
    lsb = 2 * N / np.sqrt(period_s)
    figures = sensor(axis_of(N=(N, 0.001 * N)))
    stepped = _white_comparisons(at_rest_session(N, 1, lsb, count=20), figures, 100.0)
    assert np.mean([each.ratio for each in stepped]) == pytest.approx(np.sqrt(1 + 4 / 12), rel=0.05)
    assert all(each.p_value > 0.05 for each in stepped)
    louder = _white_comparisons(at_rest_session(2 * N, 1, lsb, count=20), figures, 100.0)
    assert all(each.contradicted for each in louder)


@pytest.mark.parametrize(
    ("ratio", "p", "contradicted"),
    [(1.11, 9e-4, True), (1.09, 1e-9, False), (1.5, 1.1e-3, False), (0.90, 9e-4, True), (0.92, 1e-9, False)],
)
def test_a_contradiction_is_significant_and_large(ratio, p, contradicted):
    assert NoiseComparison(ratio, 0.5, 2.0, p).contradicted is contradicted


def test_a_figure_is_never_confirmed():
    near, far = NoiseComparison(1.02, 0.95, 1.08, 0.4), NoiseComparison(0.7, 0.2, 3.1, 0.6)
    none, more = NoiseComparison(0.1, 0.0, 1.7, 0.6), NoiseComparison(1.42, 1.30, 1.55, 1e-8)
    assert (near.within, far.within, none.within) == (
        "within 8.0 % (95 %)",
        "0.20 to 3.1 times as large (95 %)",
        "at most 1.7 times as large (95 %)",
    )
    (note,) = MeasuredNoise(Path("fit/noise.json"), "", None, (near, near, near), far).findings("s")
    assert (note.level, note.what) == ("note", "noise at rest")
    warning, second = MeasuredNoise(Path("fit/noise.json"), "", None, (near, near, more), more).findings("s")
    assert warning.level == second.level == "warning"
    assert warning.description == "white noise of the stills on z: 1.42 times that of noise.json (95 %: 1.30 to 1.55; p < 0.001)"
    assert second.description.endswith("no prior of this session")
    assert MeasuredNoise(Path("fit/noise.json"), "", None).findings("s") == []


def with_figures(folder, **more):
    white = 5e-3 * DEG / np.sqrt(2)
    figures = figures_of(sensor(axis_of(N=(white, 0.02 * white), B=(3 * DPH, 0.6 * DPH))), **more)
    (folder / "fit").mkdir(exist_ok=True)
    (folder / "fit" / "noise.json").write_text(json.dumps(table_of(figures)))
    return folder / "fit" / "noise.json"


def test_figures_of_another_unit_and_of_the_session_itself(tmp_path):
    folder = tmp_path
    problem = SimpleNamespace(
        session=SimpleNamespace(in_memory=False, folder=folder, config=config(), logs=[SimpleNamespace(path=folder / "log0001.csv")])
    )
    assert measured_noise()(problem) is None
    path = with_figures(folder, serial="another")
    with pytest.raises(FormatError, match=r"noise\.json: of the unit another, and the session is of test; give this unit's"):
        measured_noise()(problem)
    with_figures(folder, logs=("log0001.csv",))
    assert measured_noise()(problem) is None  # the session's own stills
    with pytest.raises(FormatError, match=r"none\.json"):
        measured_noise(tmp_path / "none.json")(problem)
    path.write_text("{}")
    with pytest.raises(FormatError, match="schema"):
        measured_noise()(problem)


def test_an_axis_that_is_not_described_is_no_prior_and_is_compared_with_nothing():
    good, bad = axis_of(N=(1e-4, 1e-6), B=(5 * DPH, 0.1 * DPH)), replace(axis_of(B=(500 * DPH, 1.0 * DPH)), p_value=1e-9, excess=4.0)
    alone, beside = (_session_instability(SensorNoise(axes), 300.0) for axes in ((good,) * 3, (good, good, bad)))
    assert beside.rps == pytest.approx(alone.rps, rel=1e-12)
    assert _session_instability(SensorNoise((bad,) * 3), 300.0) is None
    assert rms_of_axes(SensorNoise((good, good, bad)), "B")[0] == pytest.approx(5 * DPH)


@pytest.mark.parametrize(("session_s", "drawn"), [(600.0, True), (5e4, False), (None, None)])
def test_the_length_of_a_session_is_drawn_among_the_averaging_times_of_a_rest(session_s, drawn):
    """A file without Allan deviations has no picture."""
    figures = figures_of(sensor(axis_of(N=(4e-4, 2e-5), K=(2e-5, 1e-6))))
    if drawn is None:
        assert noise_at_rest._model(figures, 600.0) is None
        return
    tau_s = np.geomspace(0.1, 9e3, 40)
    deviation = np.sqrt(np.stack([axis.allan_variance(tau_s) for axis in figures.gyro.axes], axis=1))
    panel = noise_at_rest._model(replace(figures, allan={"gyro": AllanBand(tau_s, deviation, 0.9 * deviation, 1.1 * deviation)}), session_s)
    assert ("length of this session" in [mark.name for mark in panel.marks]) == drawn
    assert panel.svg(600.0)
