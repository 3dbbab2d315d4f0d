"""The truth's clock beside what delays the gyro's axes: what they share is the clock's; and fit --physics beside a truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from test_explain_truth import write as write_with_effects
from truth_sessions import Wrong, made, write

import calibrate
from tinygc.closure.prepared import prepare
from tinygc.effects import AppliedEffect, catalogue
from tinygc.explanation.claims import common_delays
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.physics import fit_physics
from tinygc.explanation.truth_names import OFFSET, TruthTwin
from tinygc.noise.channels import in_gauge
from tinygc.noise.refit import refit


@pytest.fixture(scope="module")
def twin() -> TruthTwin:
    return TruthTwin(prepare(made(Wrong())[0]).problem)


def test_these_delay_all_axes_alike():
    assert set(common_delays()) == {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew"}


@pytest.mark.parametrize("name", ["gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew"])
def test_what_all_axes_share_looks_like_the_clock_and_goes_there(twin, name):
    effect = catalogue()[name]
    late = getattr(effect.gauge_convention, "late", 1.0)
    theta = np.zeros(effect.parameter.size)
    theta[list(effect.gauge_convention.delays)] = 0.002

    def residuals(*claims):
        return twin.residuals(replace(twin.start(), claims=claims)).closure - twin.residuals(twin.start()).closure

    delayed, clock = residuals(AppliedEffect(effect, theta)), residuals(AppliedEffect(OFFSET, np.array([late * 0.002])))
    # To first order one column; two milliseconds of a turn's bell bend it by some percent.
    assert np.linalg.norm(delayed - clock) < 0.05 * np.linalg.norm(clock)
    theta[effect.gauge_convention.delays[1]] += 0.001
    whiten = Evidence(twin).first_whiten
    state = replace(twin.start(), claims=(AppliedEffect(OFFSET, np.array([0.001])), AppliedEffect(effect, theta)))
    fit = refit(twin, whiten, [OFFSET, effect], state, max_steps=0)
    gauged = in_gauge(twin, whiten, fit)
    moved, kept = (claim.theta for claim in gauged.state.claims)
    shared = np.mean if name == "gyro.angular_acceleration" else np.min
    assert shared(kept[list(effect.gauge_convention.delays)]) == pytest.approx(0, abs=1e-12)
    assert np.ptp(kept[list(effect.gauge_convention.delays)]) == pytest.approx(0.001)
    assert moved[0] == pytest.approx(0.001 + late * shared(theta[list(effect.gauge_convention.delays)]))
    assert gauged.chi_square == pytest.approx(fit.chi_square, rel=0.02)
    # The clock's sigma is that of the sum, which the recording knows, not of a share of it, which nothing tells.
    assert np.sqrt(gauged.theta_covariance(0)[0, 0]) < 0.3 * np.sqrt(fit.theta_covariance(0)[0, 0]) < 0.05


@pytest.mark.broad
def test_physics_beside_a_truth_is_fitted_and_saved(tmp_path):
    folder = write_with_effects(tmp_path / "g", dps_per_g=0.3, late_s=0.004)
    words = ["fit", str(folder), "--physics", "auto", "--methods", "least_squares", "--quiet", "--json", str(tmp_path / "fit.json")]
    assert calibrate.main(words) == 0
    told = json.loads((tmp_path / "fit.json").read_text())
    held = {name: method["holdout"]["tilt_rms_deg"] for name, method in told["methods"].items()}
    assert held["physics"] < 0.2 * held["least_squares"]
    model = json.loads((folder / "fit" / "model_physics.json").read_text())
    (effect,) = model["effects"]
    assert effect["id"] == "gyro.g_sensitivity"
    cyclic = lambda values: np.reshape(values, (3, 3))[[0, 1, 2], [1, 2, 0]] / DEG  # noqa: E731
    sigma = np.sqrt(np.diag(np.array(model["covariance"]))[12:])
    assert np.abs((cyclic(effect["theta_si"]) - 0.3) / cyclic(sigma)).max() < 4
    assert told["truth"]["offset_used_s"] == pytest.approx(-0.004, abs=0.0008)


@pytest.mark.broad
def test_physics_by_name_has_the_clock_beside_a_delay_and_a_still_effect_is_one_line(tmp_path, capsys):
    found = fit_physics(prepare(made(Wrong(delays_s=(0.003, 0, 0), late_s=0.004))[0]).problem, ("timing.axis_skew",))
    assert [claim.effect.id for claim in found.model.claims] == ["timing.axis_skew"]
    assert np.abs(found.model.claims[0].theta - [0.003, 0, 0]).max() < 0.0007
    folder = write(tmp_path, Wrong(turns=8))
    for name in ("reference.accelerometer", "earth.rotation"):
        assert calibrate.main(["fit", str(folder), "--physics", name, "--methods", "least_squares", "--quiet"]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert f"{name} cannot be fitted beside a truth file" in said
