"""An accelerometer's nine numbers from stills, beside scipy's fits and numeric derivatives; what stills do not fix; its section."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from conftest import GRAVITY, Table, session_of
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq, least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import f as fisher_f
from small_turns import numeric_jacobian

from session.base.errors import FormatError
from session.base.units import MG
from session.detect.accelerometer import (
    _RUNGS,
    IDENTITY,
    NAMES,
    SPREAD_MPS2,
    attitudes_of,
    fit_lengths,
    length_columns,
    matrix_of,
    units,
    unobserved_of,
    why_not,
    with_section,
    write_calibrated_copy,
)
from session.detect.check_references import _check_zero, own_fit
from session.log.config import Accelerometer, Sensor

MATRIX = np.array([[0.99, 0.01, -0.02], [0, 1.01, 0.005], [0, 0, 0.995]])


BIAS = np.array([0.3, -0.2, 0.5])


SIGMA = 2e-4  #: of a still's force, of gravity


QUARTER = Rotation.from_euler("z", 90, degrees=True).as_matrix()


def attitudes(count, rng):
    up = rng.normal(size=(count, 3))
    return up / np.linalg.norm(up, axis=1, keepdims=True)


def measured(count, rng):
    """What the sensor with these errors reads (S, 3) m/s^2 in stills of random attitudes."""
    return as_measured(GRAVITY * (attitudes(count, rng) + rng.normal(0, SIGMA, (count, 3))))


def as_measured(force):
    return force @ np.linalg.inv(MATRIX).T + BIAS


#: of the nine numbers, one m/s^2 in each
UNITS = np.array([1 / GRAVITY] * 6 + [1.0] * 3)


def missing(x, force):
    """m/s^2 by which lengths miss gravity's under nine numbers, by hand."""
    return np.linalg.norm((force - x[6:]) @ np.array([x[:3], [0, x[3], x[4]], [0, 0, x[5]]]).T, axis=1) - GRAVITY


def evenly(count):
    """(count, 3): directions on a spiral from pole to pole, turned so that no axis is special."""
    z = 1 - (2 * np.arange(count) + 1) / count
    about = np.pi * (1 + np.sqrt(5)) * np.arange(count)
    up = np.stack([np.sqrt(1 - z**2) * np.cos(about), np.sqrt(1 - z**2) * np.sin(about), z], axis=1)
    return up @ Rotation.from_rotvec([0.4, 0.7, -0.3]).as_matrix().T


@pytest.mark.parametrize("bad", [0, 2])
def test_the_numbers_are_those_of_cauchys_weights(bad):
    """Beside scipy's, at the stated bar: twice the misses' spread, as far as nine numbers leave it.  A bad still hardly moves them."""
    rng = np.random.default_rng(bad)
    force = measured(24, rng)
    force[:bad] *= np.array([[1.03], [0.98]])[:bad]
    found = fit_lengths(force, GRAVITY)
    miss = missing(found.x, force)
    assert_allclose(found.after, miss, atol=1e-12)
    assert_allclose(found.before, np.linalg.norm(force, axis=1) - GRAVITY)
    bar = 2 * np.median(np.abs(miss)) / 0.6745 * np.sqrt(24 / 15)
    best = least_squares(lambda u: missing(u * UNITS, force), found.x / UNITS, loss="cauchy", f_scale=bar, xtol=1e-12, ftol=1e-14)
    assert_allclose(best.x * UNITS, found.x, atol=2e-6)
    assert np.all(found.weight[:bad] < 1e-3)


@pytest.mark.parametrize("stills", [9, 17, 18])
def test_the_covariance_is_that_of_the_estimate_and_of_gravity_in_common(stills):
    """Huber (1981), 6.5, with numeric derivatives.  Where fewer stills are to spare than numbers are fitted, no less than the median miss,
    what a MEMS sensor wanders by, and the white noise say.  Gravity's length moves the matrix as a whole, in all stills alike."""
    up = evenly(stills)
    drawn = np.random.default_rng(stills).normal(0, 2 * MG / 20, (stills, 3))
    for scale, white in ((1.0, 0.0), (1e-3, 0.0), (1e-3, 0.12 * MG)):
        force = as_measured(GRAVITY * up + scale * drawn)
        found = fit_lengths(force, GRAVITY, None, 0.01, white)
        miss = found.after
        slope = numeric_jacobian(lambda u, found=found, force=force: missing(found.x + u * UNITS, force), np.zeros(9), 1e-5)
        spare, least = stills - 9, np.hypot(0.05 * MG, white) if stills < 18 else 0.0
        sigma = 0.0
        if spare:
            bar = np.median(np.abs(miss) * np.sqrt(found.weight / (1 - found.weight)))
            assert bar == pytest.approx(2 * np.median(np.abs(miss)) / 0.6745 * np.sqrt(stills / spare), rel=0.011)
            pull = lambda x, bar=bar: x / (1 + (x / bar) ** 2)  # noqa: E731
            rise = (pull(miss + 1e-6 * bar) - pull(miss - 1e-6 * bar)) / (2e-6 * bar)
            sigma = (1 + 9 / stills * rise.var() / rise.mean() ** 2) * np.sqrt(np.sum(pull(miss) ** 2) / spare) / rise.mean()
            sigma = max(sigma, np.median(np.abs(miss)) / 0.6745 * np.sqrt(stills / spare) if stills < 18 else 0.0)
        assert found.sigma_mps2 == pytest.approx(max(sigma, least), rel=1e-5)
        longer = fit_lengths(force * 1.001 - 0.001 * found.x[6:], GRAVITY * 1.001).x  # the same lengths under another gravity
        assert_allclose(longer, found.x, atol=1e-6)
        common = np.append(found.x[:6], [0, 0, 0]) * 0.01 / GRAVITY
        expected = np.linalg.inv(slope.T @ slope) * found.sigma_mps2**2 * np.outer(UNITS, UNITS) + np.outer(common, common)
        size = np.sqrt(np.diag(expected))
        assert_allclose(found.covariance / np.outer(size, size), expected / np.outer(size, size), atol=1e-4)


@pytest.mark.parametrize(("slope", "told"), [(0.99, True), (1.01, False)])
def test_attitudes_that_tell_the_numbers_too_weakly_are_refused(slope, told):
    """The gain of the worst direction, of numbers in m/s^2 a still: up to ten.  Attitudes on a cap that grows to just there."""

    def cap(half):
        about, away = np.arange(20) * 2.4, half * np.sqrt(np.arange(20) / 19)
        return GRAVITY * np.stack([np.sin(away) * np.cos(about), np.sin(away) * np.sin(about), np.cos(away)], axis=1)

    def gain(half):
        slopes = numeric_jacobian(lambda u: missing(IDENTITY + u * UNITS, cap(half)), np.zeros(9), 1e-4)
        return 1 / np.linalg.svd(slopes, compute_uv=False)[-1]

    half = brentq(lambda half: gain(half) - 10 * slope, 1.0, 3.0, xtol=1e-10)
    assert (fit_lengths(cap(half), GRAVITY).rung is _RUNGS[0]) == told


@pytest.mark.parametrize(("width", "rung"), [(0.35, 1), (0.2, 2)])
def test_what_a_rung_leaves_alone_is_in_the_sigmas_of_what_it_fits(width, rung):
    """Least squares of sensors that differ by one number each: their errors, a spread each, are the covariance."""
    rng = np.random.default_rng(8)
    force = np.array([0.3, -0.2, 1.0]) + width * rng.normal(size=(30, 3))
    force *= GRAVITY / np.linalg.norm(force, axis=1)[:, None]
    found = fit_lengths(force, GRAVITY)
    assert found.rung is _RUNGS[rung]
    spread, columns, directions = SPREAD_MPS2 * units(GRAVITY), length_columns(IDENTITY, force), _RUNGS[rung].directions
    linear = np.zeros((9, 9))
    for step in np.eye(9) * spread:
        error = directions @ np.linalg.lstsq(columns @ directions, columns @ step, rcond=None)[0] - step
        linear += np.outer(error, error)
    assert found.covariance == pytest.approx(linear, abs=1e-6 * np.abs(linear).max())


@pytest.mark.parametrize(
    ("mg", "sigma_mg", "told"),
    [(471.0, 9.0, True), (3.0, 9.0, False), (3.0, 5.9, True), (3.0, 6.1, False), (26.0, 9.0, False), (28.0, 9.0, True)],
)
def test_a_number_is_observed_by_its_sigma(mg, sigma_mg, told):
    """Below a tenth of the spread of 60 mg, or three sigmas from none."""
    size, sigma = np.zeros(9), np.full(9, 1e-9)
    size[6], sigma[6] = mg * MG, sigma_mg * MG
    assert unobserved_of(size, sigma, GRAVITY) == (() if told else ("bias x",))


def test_a_correction_of_a_calibration_is_a_calibration():
    """From what another calibration gives, the same forces follow as from what was measured."""
    rng = np.random.default_rng(5)
    rough = Accelerometer(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), rng.normal(size=3) * 10 * MG)
    force = measured(24, rng)
    found = fit_lengths(rough.correct(force), GRAVITY, rough)
    expected = fit_lengths(force, GRAVITY)
    lengths = np.linalg.norm(found.accelerometer.correct(force), axis=1)
    assert_allclose(lengths, np.linalg.norm(expected.accelerometer.correct(force), axis=1), atol=1e-8)


def test_attitudes_that_come_back_count_once():
    """Ten degrees apart they are two, whatever their lengths; a reading of nothing is none."""
    assert attitudes_of(GRAVITY * np.array([[0, 0, 1], [0, 0.05, 1], [0, 0, -1], [1, 0, 0], [0, 0, 1]])) == 3
    for apart_deg, count in ((9.99, 1), (10.01, 2)):
        for length in (0.5, 2.0):
            second = length * np.array([0, np.sin(np.radians(apart_deg)), np.cos(np.radians(apart_deg))])
            assert attitudes_of(np.array([[0, 0, 1.0], [0, 0, 0], second])) == count


def test_as_many_numbers_as_there_are_attitudes():
    """Nine random attitudes fix nine numbers, eight of them six, five four; three fix none, and what is missing is said."""
    force = as_measured(GRAVITY * evenly(9))
    counts = [found.rung and found.rung.count for found in (fit_lengths(force[:many], GRAVITY) for many in (9, 8, 6, 3))]
    assert counts == [9, 6, 6, None]
    assert [fit_lengths(force[:many], GRAVITY).fixes_all for many in (9, 8)] == [True, False]
    assert fit_lengths(force, GRAVITY).unobserved == ()
    for many, words in ((1, "1 attitude"), (8, "8 attitudes")):
        assert why_not(fit_lengths(force[:many], GRAVITY)) == f"the stills lie in {words}, too few for an accelerometer's 9 numbers"
    ring = GRAVITY * np.stack([np.cos(np.arange(9) * 0.6), np.sin(np.arange(9) * 0.6), np.zeros(9)], axis=1)
    assert why_not(fit_lengths(ring, GRAVITY)) == "the 9 attitudes of the stills do not fix an accelerometer's 9 numbers"


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_the_drifts_p_value_is_fishers_f_of_three_numbers(drift):
    """Beside scipy's fits with and without a drift, of the same weights."""
    rng, count = np.random.default_rng(7), 26
    middle_s = np.linspace(5, 595, count)
    share = middle_s / 600 - 0.5
    force = measured(count, rng) + drift * np.outer(share, [0.3, -1.0, 0.5])
    found = fit_lengths(force, GRAVITY, middle_s=middle_s, duration_s=600.0)
    root = np.sqrt(found.weight)
    left = lambda u: root * missing(u[:9] * UNITS, force - np.outer(share, u[9:]))  # noqa: E731
    with_it = least_squares(left, np.append(found.x / UNITS, np.zeros(3)), xtol=1e-14)
    without = least_squares(lambda u: left(np.append(u, np.zeros(3))), found.x / UNITS, xtol=1e-14)
    F = (without.cost - with_it.cost) / 3 / (with_it.cost / (count - 12))
    assert found.drift.p_value == pytest.approx(fisher_f.sf(F, 3, count - 12), rel=1e-4, abs=0)
    for spare in (3, 4, 29, 30, 2000):
        for ratio in (0.0, 0.3, 3.78, 3.79, 40.0):
            alone = replace(found.drift, ratio=ratio, spare=spare)
            assert alone.p_value == pytest.approx(fisher_f.sf(ratio, 3, spare), rel=1e-9, abs=0)
            assert alone.significant == (fisher_f.sf(ratio, 3, spare) < 0.01)
    assert found.sigma_mps2 == pytest.approx(np.sqrt(2 * with_it.cost / (count - 12)), rel=1e-5)
    assert found.drift.mps2 == pytest.approx(with_it.x[9:], abs=1e-6)
    sigma = np.sqrt(np.diag(np.linalg.inv(with_it.jac.T @ with_it.jac)))[9:] * found.sigma_mps2
    assert found.drift.sigma_mps2 == pytest.approx(sigma, rel=1e-3)
    assert found.drift.significant == (drift > 0)
    force, middle_s = measured(15, np.random.default_rng(2)), np.arange(15.0)
    few = [fit_lengths(force[:stills], GRAVITY, middle_s=middle_s[:stills], duration_s=15.0).drift for stills in (14, 15)]
    assert [drift is None for drift in few] == [True, False]  # five stills to spare


def test_the_zero_of_a_triad_behind_a_frame_has_its_sigma_in_the_sensors_axes():
    """After a quarter turn the correction's x is the sensor's y."""
    found = fit_lengths(measured(30, np.random.default_rng(5)), GRAVITY)
    turned = Accelerometer(matrix_of(found.x) @ QUARTER, found.accelerometer.bias_mps2)
    turned = replace(found, accelerometer=turned, covariance=np.diag([0] * 6 + [1.0, 4.0, 9.0]))
    assert turned.zero[1] == pytest.approx([2.0, 1.0, 3.0], rel=1e-9)


@pytest.mark.parametrize("force", [np.zeros((12, 3)), np.zeros((0, 3)), np.tile([GRAVITY, 0, 0], (9, 1))])
def test_one_pose_fixes_nothing_and_nothing_is_changed(force):
    found = fit_lengths(force, GRAVITY)
    assert (found.rung, found.unobserved) == (None, NAMES)
    assert_allclose(np.sqrt(np.diag(found.covariance)), SPREAD_MPS2 * UNITS)
    assert_array_equal(found.accelerometer.correct(force), force)


@pytest.mark.parametrize(("model", "bar"), [("ASM330LHH", 65), ("unknown", 80)])
def test_a_zero_beyond_the_data_sheet_is_a_warning(model, bar):
    force, sensor = measured(24, np.random.default_rng(4)) - BIAS, Sensor(model, "A", 104.0, 500.0, 4.0)
    for mg in (bar - 2, -470.0, bar + 2):
        found = fit_lengths(force + np.array([0.0, mg, 0.0]) * MG, GRAVITY)
        said = _check_zero(found, sensor)
        assert [each.level for each in said] == ["warning"] * (abs(mg) > bar)
        assert all(f"bar {bar} (" in each.description for each in said)
    assert _check_zero(replace(found, covariance=found.covariance + np.eye(9) * (200 * MG) ** 2), sensor) == []  # within what is known


def test_a_drift_is_in_the_axes_of_the_sensor():
    """Under a calibration that turns the frame by a quarter, it is the same drift of what was measured."""
    rng = np.random.default_rng(4)
    up, t_s = attitudes(30, rng), np.arange(30.0)
    drift = MG * np.array([5.0, -1.0, 2.0])
    measured = GRAVITY * up + (t_s / 30 - 0.5)[:, None] * drift + 1e-3 * MG * rng.normal(size=up.shape)
    turned = Accelerometer(QUARTER, np.zeros(3))
    found = fit_lengths(turned.correct(measured), GRAVITY, turned, middle_s=t_s, duration_s=30.0)
    assert_allclose(found.drift.mps2, drift, atol=0.02 * MG)


def test_a_still_that_misses_by_far_makes_no_drift():
    """A knock moves the zero of the last still alone, which leans on a line in time more than any other."""
    rng = np.random.default_rng(5)
    up, t_s = attitudes(21, rng), np.r_[25.0 * np.arange(20), 600.0]
    force = GRAVITY * up + 0.1 * MG * rng.normal(size=up.shape)
    force[-1] += 5 * MG * up[-1]
    assert not fit_lengths(force, GRAVITY, middle_s=t_s, duration_s=610.0).drift.significant


# A calibration in session.toml

MULTILINE = """schema = "tinygc-session/1"  # [accelerometer] is below

[sensor]
serial = "[odd]"
odr_hz = 208.0

[accelerometer]  # mine
matrix = [
  [1.0, 0.0, 0.0]
]
more = { rows = [
  [1, 2],
] }

[[exclude]]
at_s = 3.5

[notes]
said = '[protocol]'
"""


@pytest.mark.parametrize(
    "text",
    [
        *(MULTILINE, MULTILINE.replace("[accelerometer]  # mine", "[other]"), MULTILINE.rstrip(), "", "a = 1\n[protocol]\n"),
        "accelerometer = { bias_mps2 = [0, 0, 0] }\n",
        'said = """\n[accelerometer]\n[x]\n"""\n[accelerometer]\nown_stills = true\n',
    ],
)
def test_a_calibration_is_put_into_a_file_and_nothing_else_is_touched(text):
    made = with_section(text, Accelerometer(MATRIX, BIAS))
    before, found = tomllib.loads(text), tomllib.loads(made)
    section = found.pop("accelerometer")
    before.pop("accelerometer", None)
    assert before == found
    assert_allclose(section["matrix"], MATRIX)
    assert_allclose(section["bias_mps2"], BIAS)
    assert section["own_stills"] is True


def test_a_copy_holds_the_files_of_the_folder_and_nothing_is_written_over(tmp_path):
    folder, out = tmp_path / "s", tmp_path / "out"
    (folder / "fit").mkdir(parents=True)
    for name in ("session.toml", "log0001.csv", ".hidden"):
        (folder / name).write_bytes(b"a = 1\r\n")
    out.mkdir()
    write_calibrated_copy(folder, out, Accelerometer(MATRIX, BIAS))
    assert {path.name for path in out.iterdir()} == {"session.toml", "log0001.csv"}
    assert (out / "log0001.csv").read_bytes() == b"a = 1\r\n"
    for place, said in ((out, "is there already"), (folder / "new", "lies within the session folder")):
        with pytest.raises(FormatError, match=said):
            write_calibrated_copy(folder, place, Accelerometer())


def test_white_noise_scatters_a_still_by_its_density_over_twice_the_stills_length():
    """One-sided density n: variance n² / 2T of a mean over T.  Six faces fix six numbers, and no still is to spare to say more."""
    lengths_s = np.array([1.5, 2.0, 3.0, 4.0, 6.0, 9.0])
    turns = [(90, (1, 0, 0))] * 3 + [(90, (0, 0, 1)), (180, (0, 0, 1))]
    table = Table().rest(lengths_s[0])
    for (degrees, axis), seconds in zip(turns, lengths_s[1:], strict=True):
        table.turn(degrees, axis).rest(seconds)
    found = own_fit(session_of(table.samples(accel_ug=1000.0)))
    assert found.sigma_mps2 == pytest.approx(np.sqrt(np.mean(MG**2 / (2 * lengths_s))), rel=0.1)
