"""A rate that is nominal, or a clock that is known to some ppm: all scales and the bias carry its uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, session_of
from looks import look, of, with_sensor

import tinygc
from session.base.errors import FormatError
from session.log.sensors import CLOCK_WITHIN
from tinygc import FitOptions, read_session
from tinygc.estimation.stated_noise import CLOCK
from tinygc.fitting.fit import fit_session

TRUE_HZ, NOMINAL_HZ = 52.7, 50.0


LEAST_SQUARES = FitOptions(methods=("least_squares",))


#: of a tumble whose gyro reads 2 % too little
E_TRUE = np.eye(3) * 1.02


@pytest.fixture(scope="module")
def stamped():
    return tinygc.simulate(segments=8, closure_s=0.0, odr_hz=62.5, seed=3).session


@pytest.fixture(scope="module")
def bare(stamped):
    return fit_session(stamped, LEAST_SQUARES)


@pytest.fixture(scope="module")
def known(stamped):
    """With a clock to 400 ppm."""
    return fit_session(with_sensor(stamped, clock_sigma_ppm=400.0), LEAST_SQUARES)


def with_stamps(session, ratio):
    fast = [replace(log, samples=replace(log.samples, t_ns=np.rint(log.samples.t_ns * ratio).astype(np.int64))) for log in session.logs]
    return replace(session, logs=tuple(fast))


def test_a_clock_that_is_known_to_so_many_ppm_moves_all_scales_by_as_many(stamped, bare, known):
    """Stamps that run fast by one sigma move E and B as the source says; the rest of the covariance is as without it."""
    moved = fit_session(with_stamps(stamped, 1 + 400e-6), LEAST_SQUARES).linear.model.vector - bare.linear.model.vector
    part = next(source for source in known.sources if source.name == CLOCK)
    assert (part.kind, part.freedom) == ("B", np.inf)
    np.testing.assert_allclose(np.outer(moved, moved)[:9, :9], part.covariance[:9, :9], atol=0.03 * part.covariance[0, 0])
    np.testing.assert_allclose(known.covariance - bare.covariance, part.covariance, atol=1e-3 * part.covariance[0, 0])
    assert known.nominal_rate is None  # measured all the same, so that nothing is in doubt
    assert known.verdict().answer == bare.verdict().answer


def test_a_clock_is_kept_and_counted_logs_have_their_own(stamped, nominal, tmp_path):
    again = read_session(with_sensor(stamped, clock_sigma_ppm=30.0).save(tmp_path / "s"))
    assert (again.config.sensor.clock_sigma_ppm, again.clock.sigma) == (30.0, pytest.approx(30e-6))
    even = with_sensor(stamped, even_sigma_ppm=12.0)
    assert (even.clock.sigma, even.clock_known) == (pytest.approx(12e-6), False)  # a line through stamps says nothing of their clock
    both = with_sensor(stamped, even_sigma_ppm=12.0, clock_sigma_ppm=5.0)
    assert (both.clock.sigma, both.clock_known) == (pytest.approx(13e-6), True)
    known = with_sensor(nominal, clock_sigma_ppm=30.0)
    assert known.clock == known.nominal_rate is not None


def test_a_ratio_that_was_measured_is_a_sigma_until_it_is_taken_out(stamped, known, tmp_path):
    """Stamps that run 0.45 % fast: the ratio is in the sigma of all scales; divided by it, the fit is that of the true stamps."""
    ratio = 1.0045
    folder = with_sensor(with_stamps(stamped, ratio), clock_ratio=ratio, clock_sigma_ppm=400.0).save(tmp_path / "s")
    session, by_arrivals = read_session(folder), replace(LEAST_SQUARES, clock="arrivals")
    assert session.clock.sigma == pytest.approx(np.hypot(4500e-6, 400e-6))
    finding = of(tinygc.check(session), "clock")
    assert finding.level == "warning"
    assert "4500 ± 400 ppm fast" in finding.description
    mended = fit_session(folder, by_arrivals)
    np.testing.assert_allclose(mended.linear.model.vector, known.linear.model.vector, atol=1e-6)
    np.testing.assert_allclose(mended.covariance, known.covariance, rtol=1e-3, atol=1e-13)
    assert mended.session.clock.sigma == pytest.approx(400e-6)
    assert "divided by 1.0045 ± 400 ppm" in mended.session.logs[0].notes[-1]
    stated = [replace(log, comments={"odr_hz": "62.2"}) for log in session.logs]
    by_computer = replace(session, logs=tuple(stated)).on_clock("arrivals").logs[0]  # a rate that the board states is by its own seconds
    assert by_computer.number("odr_hz") == pytest.approx(62.2 * ratio)
    with pytest.raises(FormatError, match=r"sensor.clock_ratio is not given; `record` measures it; leave --clock arrivals out"):
        fit_session(stamped, by_arrivals)


@pytest.fixture(scope="module")
def nominal():
    """A session of a gyro that reads 2 % too little, whose samples are counted at 50 Hz and come at 52.7."""
    made = Table().tumble(9, seed=5).samples(odr_hz=TRUE_HZ, registers=False)
    counted = np.rint(np.arange(len(made)) * 1e9 / NOMINAL_HZ).astype(np.int64)
    session = session_of(
        replace(made, t_ns=counted, gyro=made.gyro @ np.linalg.inv(E_TRUE).T), raw=False, odr_hz=NOMINAL_HZ, model="unknown"
    )
    return replace(session, logs=(replace(session.logs[0], comments={"stamps": "counted"}),))


def test_the_rate_is_as_uncertain_as_the_sensors_profile_or_session_toml_says(nominal):
    """Half of a rectangular width, over the root of three; and nothing at all where it was measured."""
    assert (nominal.nominal_rate.hz, nominal.nominal_rate.sigma) == (NOMINAL_HZ, pytest.approx(CLOCK_WITHIN.value / np.sqrt(3)))
    own = replace(nominal.config.sensor, model="ASM330LHH")
    assert own.nominal_rate.sigma == pytest.approx(own.profile.clock_within.value / np.sqrt(3))
    for given, found in ((0.01, 0.01), (0.0, None)):
        rate = replace(nominal.config.sensor, odr_sigma=given).nominal_rate
        assert (rate and rate.sigma) == found
    finding = of(look(nominal), "sample rate")
    assert (finding.level, "50 Hz is not measured, so all scales are known to ± 2.9 %" in finding.description) == ("warning", True)


def test_the_common_scale_carries_the_rates_uncertainty(nominal):
    """By exactly one rank, along (E, B): a ratio of two scale factors stays as well known as ever, and the truth is covered."""
    fitted, known = fit_session(nominal, LEAST_SQUARES), fit_session(with_sensor(nominal, odr_sigma=0.0), LEAST_SQUARES)
    more, vector = fitted.covariance - known.covariance, fitted.linear.model.vector
    np.testing.assert_allclose(more, fitted.nominal_rate.sigma**2 * np.outer(vector, vector), atol=1e-12)
    np.testing.assert_allclose((fitted.joint_covariance - known.joint_covariance)[9:, 9:], more, atol=1e-12)
    np.testing.assert_allclose(fitted.joint_covariance[:9, :9], known.joint_covariance[:9, :9], atol=1e-15)
    off, sigma = np.diag(vector[:9].reshape(3, 3) - E_TRUE), np.sqrt(np.diag(fitted.covariance))[[0, 4, 8]]
    assert np.all(np.abs(off) < 2.5 * sigma)
    assert np.all(np.abs(off) > 20 * np.sqrt(np.diag(known.covariance))[[0, 4, 8]])  # which nothing else would have told
    decision = fitted.verdict()
    assert (decision.answer, fitted.nominal_rate.doubt in decision.doubts) == ("not decided", True)


def test_a_clock_that_nobody_knows_is_excluded_from_the_scales(bare, known):
    quantities = pytest.importorskip("tinygc.features.unit.budget.quantities", reason="the feature that states a budget is not there")
    excluded = [
        {each.name for each in quantities.sensor_error_budgets(fit) if CLOCK in [row.what for row in each.excluded]}
        for fit in (bare, known)
    ]
    assert excluded == [{f"scale factor error {axis}" for axis in "xyz"}, set()]
