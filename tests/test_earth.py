"""The Earth's rotation, and the heading that the stills tell."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from session.io.units import DEG, DEG_PER_HOUR
from tinygc import read_session
from tinygc.attitude import rotation
from tinygc.attitude.earth import estimate_heading, no_earth, vertical_only, with_heading
from tinygc.closure.build import build_problem

SIDEREAL_DPH = 15.041


def stills(seed, count=41, latitude_deg=31.03, heading_deg=70.0, sigma_dps=0.0023, bias_dps=(0.4, -0.2, 0.1)):
    """Attitudes (Q, 4), rates (Q, 3) and sigmas of stills all around, as a gyro with a bias reads them."""
    rng = np.random.default_rng(seed)
    q = Rotation.random(count, random_state=rng).as_quat(scalar_first=True)
    body = with_heading(latitude_deg, heading_deg).in_body(q)
    sigma = np.full((count, 3), sigma_dps * DEG)
    return q, body + np.multiply(bias_dps, DEG) + sigma * rng.standard_normal((count, 3)), sigma


def wrapped(angle_rad):
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize(
    ("latitude_deg", "down_dph", "north_dph"), [(90, -15.041, 0), (0, 0, 15.041), (31.03, -7.754, 12.888), (-90, 15.041, 0)]
)
def test_earth_rate_at_the_pole_the_equator_and_shanghai(latitude_deg, down_dph, north_dph):
    """North-east-down: at the north pole the rotation points up, at the equator north."""
    rate = with_heading(latitude_deg, 0.0).rate_t / DEG_PER_HOUR
    np.testing.assert_allclose(rate, [north_dph, 0, down_dph], atol=0.002)
    np.testing.assert_allclose(vertical_only(latitude_deg).rate_t / DEG_PER_HOUR, [0, 0, down_dph], atol=0.002)
    assert np.linalg.norm(rate) == pytest.approx(SIDEREAL_DPH, abs=1e-3)


def test_a_table_that_points_east_has_north_on_its_left():
    rate = with_heading(0.0, 90.0).rate_t / DEG_PER_HOUR
    np.testing.assert_allclose(rate, [0, -SIDEREAL_DPH, 0], atol=1e-3)


def test_a_level_body_facing_east_reads_north_on_its_left():
    q_level_east = rotation.from_euler(0.0, 0.0, 90 * DEG)
    body = with_heading(0.0, 0.0).in_body(q_level_east) / DEG_PER_HOUR
    np.testing.assert_allclose(body, [0, -SIDEREAL_DPH, 0], atol=1e-3)


def test_without_a_latitude_there_is_nothing():
    earth = no_earth()
    assert not earth.rate_t.any()
    assert (earth.source, earth.heading_rad) == ("none", None)


@pytest.mark.parametrize("heading_deg", [-170, -45, 0, 90, 179])
def test_noise_free_stills_tell_the_heading_exactly(heading_deg):
    q, rate, sigma = stills(0, heading_deg=heading_deg, sigma_dps=1e-6)
    earth = estimate_heading(31.03, q, rate, sigma)
    assert wrapped(earth.heading_rad - heading_deg * DEG) == pytest.approx(0, abs=0.01 * DEG)
    assert earth.source == "estimated"
    np.testing.assert_allclose(earth.rate_t, with_heading(31.03, heading_deg).rate_t, rtol=0, atol=1e-8)


def test_heading_lies_within_its_sigma_as_often_as_it_should():
    """300 sets of 41 stills of 2.3 s at 5 mdps per root hertz: about 8 degrees each, and that is what it says."""
    errors, sigmas = [], []
    for seed in range(300):
        heading_deg = (seed * 67.0) % 360 - 180
        earth = estimate_heading(31.03, *stills(seed, heading_deg=heading_deg))
        errors.append(wrapped(earth.heading_rad - heading_deg * DEG))
        sigmas.append(earth.heading_sigma_rad)
    errors, sigmas = np.array(errors), np.array(sigmas)
    assert np.sqrt(np.mean(errors**2)) / DEG == pytest.approx(8, abs=2)
    assert np.mean((errors / sigmas) ** 2) == pytest.approx(1, abs=0.25)
    assert np.mean(np.abs(errors) < sigmas) == pytest.approx(0.683, abs=0.06)


def test_a_wandering_bias_makes_the_heading_less_certain_not_wrong():
    """Rates that scatter three times more than the white noise says: the sigma follows."""
    ratios = []
    for seed in range(150):
        q, rate, sigma = stills(seed, sigma_dps=0.0069)
        earth = estimate_heading(31.03, q, rate, sigma / 3)
        ratios.append(wrapped(earth.heading_rad - 70 * DEG) / earth.heading_sigma_rad)
    assert np.mean(np.abs(ratios) < 1) == pytest.approx(0.683, abs=0.09)


def test_stills_of_one_attitude_tell_no_heading():
    """The bias takes it all: only the vertical part remains, within what noise adds to a mean over all headings."""
    q, _, sigma = stills(0)
    same = np.tile(q[:1], (41, 1))
    rate = with_heading(31.03, 70).in_body(same) + sigma * np.random.default_rng(1).standard_normal(sigma.shape)
    earth = estimate_heading(31.03, same, rate, sigma)
    assert earth.source == "unknown"
    np.testing.assert_array_equal(earth.rate_t, vertical_only(31.03).rate_t)


def test_stills_about_the_vertical_only_still_tell_it():
    """A level body that yaws sees north go round: that is enough."""
    yaw = np.linspace(0, 2 * np.pi, 40)
    q = rotation.from_euler(0 * yaw, 0 * yaw, yaw)
    sigma = np.full((40, 3), 1e-4 * DEG)
    earth = estimate_heading(31.03, q, with_heading(31.03, -20).in_body(q) + 0.01, sigma)
    # The two unknowns of the vertical, bias and Earth, do not matter: the vertical Earth is known.
    assert earth.heading_rad / DEG == pytest.approx(-20, abs=0.1)


def test_few_noisy_stills_shrink_the_horizontal_part():
    """Where the heading is not known, the best guess of the horizontal vector is short."""
    earth = estimate_heading(31.03, *stills(3, count=4, sigma_dps=0.05))
    assert earth.source == "unknown"
    assert np.hypot(*earth.rate_t[:2]) < 0.5 * np.hypot(*with_heading(31.03, 0).rate_t[:2])


def test_recorded_stills_tell_the_heading_that_the_file_gives(shared):
    """../shared/closure/case002 gives its heading; ignored, it is found again."""
    session = read_session(shared / "closure" / "case002")
    given_deg = session.config.site.heading_deg
    blind = replace(session, config=replace(session.config, site=replace(session.config.site, heading_deg=None)))
    earth = build_problem(blind).earth
    assert earth.source == "estimated"
    assert earth.heading_sigma_rad / DEG < 12
    assert abs(wrapped(earth.heading_rad - given_deg * DEG)) < 3 * earth.heading_sigma_rad
