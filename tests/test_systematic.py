"""How far one effect that the model lacks moves the parameters, against an injected effect."""

import numpy as np
import pytest

import tinygc

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
