"""A method that cannot run on a session says so in its row; the others stand."""

import pytest
from conftest import Table, session_of

import tinygc


def test_a_method_whose_window_is_longer_than_the_stills_is_left_out_and_refused_alone():
    """A session at 20 Hz: its stills hold fewer samples than the denoiser's window."""
    slow = session_of(Table().tumble(9, rest_s=1.5, seed=5).samples(odr_hz=20.0), odr_hz=20.0)
    ((name, why),) = tinygc.fit(slow, methods=("least_squares", "tinygc_denoised")).result.not_run.items()
    assert (name, "is longer than the stills" in why) == ("tinygc_denoised", True)
    with pytest.raises(tinygc.CalibrationError, match="its window of 49 samples"):
        tinygc.fit(slow, methods=("tinygc_denoised",))
