"""How far one effect that the model lacks moves the parameters, against an injected effect."""

import numpy as np
import pytest

import tinygc
from tinygc.closure.build import build_problem
from tinygc.effects import catalogue
from tinygc.estimation.stated_noise import stated_noise
from tinygc.estimation.systematic import PRIOR_ODDS, SUSPECTED, penalty
from tinygc.explanation.evidence import Evidence
from tinygc.noise.twin import Twin

OPTIONS = {"segments": 13, "closure_s": 0.0, "odr_hz": 104.0, "seed": 4, "latitude_deg": 47.0}


def fitted(**effects):
    return tinygc.fit(
        tinygc.simulate(**OPTIONS, effects=effects).session, methods=("least_squares",), bias="ends", earth=False, accelerometer="given"
    ).result


@pytest.fixture(scope="module")
def clean():
    return fitted()


def test_where_something_is_missing_the_recording_allows_more(clean):
    """A scale asymmetry of 1 % that the fit leaves out: E is off by more than three of its sigmas, and not of both."""
    spoilt = fitted(**{"gyro.scale_asymmetry": {"half_difference": [5e-3, -5e-3, 5e-3]}})
    off = np.abs(spoilt.linear.model.vector - clean.linear.model.vector)
    sigma, moved = np.sqrt(np.diag(spoilt.covariance)), spoilt.systematic
    assert np.max(off / sigma) > 3
    assert np.max(off / np.hypot(sigma, moved)) < 2
    assert np.median(np.hypot(1, clean.systematic / np.sqrt(np.diag(clean.covariance)))) < 2.5


def test_a_drift_that_the_noise_has_absorbed_has_the_odds_that_explain_gives_it():
    """A zero that rises by 0.04 dps, which the bias drift of the noise takes up: the noise is estimated again beside it."""
    session = tinygc.simulate(**OPTIONS, effects={"gyro.bias_drift": {"dps_over_log": [0.04, 0.0, 0.0]}}).session
    problem, drift = build_problem(session, use_earth=False), catalogue()["gyro.bias_drift"]
    noise, evidence = stated_noise(problem), Evidence(Twin(problem))
    columns = evidence.columns(drift) * drift.parameter.plausible
    odds = (noise.gain_of(columns) - penalty(drift, 1)) / 2
    expected = (evidence.nothing.score - evidence.guess(evidence.nothing, add=drift).score) / 2 - np.log(PRIOR_ODDS)
    assert odds > SUSPECTED
    assert odds == pytest.approx(expected, abs=0.7)
