"""Effects beside one another: the small one beside a great one, and the lookalike that was named while another was in the way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from session.io.units import DEG
from tinygc import SimulationOptions
from tinygc.explanation.engine import explain_session
from tinygc.simulation.write import write_session

OPTIONS = SimulationOptions(segments=18, closure_s=0.0, warm_up_c=3.0, seed=8)
FULL_SCALE = OPTIONS.gyro_fs_dps * DEG


def skewed(t, rate, seconds):
    return np.stack([np.interp(t - s, t, rate[:, axis]) for axis, s in enumerate(seconds)], axis=-1)


def explained(folder, distort, segments=OPTIONS.segments):
    return explain_session(write_session(replace(OPTIONS, segments=segments), folder / "session", distort=distort))


def ids(result):
    return {claim.effect.id for claim in result.claimed}


@pytest.mark.slow
def test_an_effect_of_half_a_percent_is_named_where_it_is_all_that_is_left(tmp_path):
    """17 ms of skew make a hundred times the misfit of the cubic; but the cubic takes up all that the skew leaves, to the noise."""
    cubic, seconds = np.array([0.011, 0.026, -0.016]), np.array([0.0095, 0.0, 0.017])
    result = explained(tmp_path, lambda t, rate, force, temp: skewed(t, rate * (1 + cubic * (rate / FULL_SCALE) ** 2), seconds))
    assert ids(result) == {"timing.axis_skew", "gyro.scale_nonlinearity"}
    (skew,) = (claim for claim in result.claimed if claim.effect.id == "timing.axis_skew")
    assert skew.probability > 0.5 > skew.rivals["gyro.bandwidth"]
    assert set(skew.equivalent) <= {"gyro.bandwidth"}  # 30 turns leave it a chance, and say which
    (claim,) = (claim for claim in result.claimed if claim.effect.id == "gyro.scale_nonlinearity")
    errors = (np.array(claim.parameters["cubic_at_fs"]) - cubic) / np.array(claim.std["cubic_at_fs"])
    assert np.abs(errors).max() < 4


@pytest.mark.slow
def test_what_a_model_simplifies_of_a_great_effect_gets_no_second_name(tmp_path):
    """A low-pass of second order, another on each axis, is neither a delay nor a lag of first order; what they leave is no effect."""

    def low_pass(t, rate, force, temp):
        nyquist = 0.5 / np.median(np.diff(t))
        return np.stack([lfilter(*butter(2, hz / nyquist), rate[:, axis]) for axis, hz in enumerate((8, 14, 30))], axis=-1)

    result = explained(tmp_path, low_pass)
    assert result.claimed
    assert ids(result) <= {"timing.axis_skew", "gyro.bandwidth", "timing.gyro_accel_offset"}


@pytest.mark.slow
def test_a_product_of_rates_that_turns_like_a_skew_is_said_beside_it(tmp_path):
    """To first order no closure tells two axes that make a third read from two that are read too late."""
    size = 0.0035 * np.array([-1.0, -0.7, 1.3])
    result = explained(
        tmp_path, lambda t, rate, force, temp: rate + size * np.roll(rate, -1, axis=1) * np.roll(rate, -2, axis=1) / FULL_SCALE
    )
    assert result.verdict == "ambiguous"
    assert all("unknown.rate_products" in claim.equivalent for claim in result.claimed)
