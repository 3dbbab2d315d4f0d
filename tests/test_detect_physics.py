"""The first look's numbers by hand: axes by closure, stamps' jitter, clipping, held readings, dead axes, copies and dials."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from looks import look, of, with_sensor
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from session.base import rotation
from session.base.rotation import angle_between
from session.detect import dials
from session.detect.axes import (
    _SIGNED_PERMUTATIONS,
    IDENTITY,
    Turns,
    _carried,
    _closures,
    _counted_at,
    _cut_turns,
    _mistakes,
    _refined,
    _regress,
    _scale_correction,
    _shows_scale,
    agreement,
    check_gravity_moves,
)
from session.detect.check_references import check_dials
from session.detect.check_samples import (
    LEAST_DEAD_READINGS,
    SCATTERS,
    _same,
    _stands,
    _usual_step,
    _without_force,
    check_dead,
    check_quantised,
    check_stamps,
    find_ceiling,
)
from session.detect.dials import without_wrong_dials
from session.detect.events import clips, plateau, run_bar
from session.detect.segments import APART_RAD, APART_SHARE, session_segments
from session.detect.stills import SessionStills, find_stills
from session.log.logfile import Log
from session.log.samples import Samples


@pytest.fixture(scope="module")
def good():
    return session_of(Table().tumble(8, seed=5).samples())


def test_a_run_that_noise_hardly_makes():
    """Two neighbours fall on one step with a chance of step / (2 sqrt(pi) sigma); n of them by chance^(n - 1), once in ten thousand."""
    chance = 1 / (2 * np.sqrt(np.pi) * 3)
    bar = run_bar(3.0, 1.0)
    assert chance ** (bar - 1) <= 1e-4 < chance ** (bar - 2)
    assert run_bar(0.0, 1.0) == 200
    assert run_bar(1 / (2 * np.sqrt(np.pi) * 0.9), 1.0) == 200
    assert run_bar(1 / (2 * np.sqrt(np.pi) * 0.89), 1.0) < 100
    assert run_bar(1e9, 1.0) == 4
    assert run_bar(1.0, 0.0) == 4


def test_a_plateau_has_as_many_readings_in_a_row():
    values = np.array([1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 1.0])
    assert np.flatnonzero(plateau(values, 1.0, 3)).tolist() == [3, 4, 5, 7, 8, 9, 10]
    assert np.flatnonzero(plateau(values, 1.0, 4)).tolist() == [7, 8, 9, 10]


def test_readings_clip_at_the_registers_end_or_standing_at_the_full_scale():
    assert clips(np.array([1.0, 573.4]), 500.0, 573.4)
    assert not clips(np.array([1.0, 573.3]), 500.0, 573.4)
    assert clips(np.array([1.0, 500.0, 500.0, 500.0, 500.0]), 500.0, 573.4)
    assert not clips(np.array([1.0, 500.0, 500.0, 500.0]), 500.0, 573.4)
    assert clips(np.full(4, 499.6), 500.0, 573.4)
    assert not clips(np.full(4, 499.4), 500.0, 573.4)


def test_a_ceiling_is_the_mean_of_both_sides_and_has_all_their_rows():
    t = np.arange(4000) / 100
    gyro = np.stack([np.sin(t), np.sin(1.3 * t), 0.1 * np.sin(t)], axis=1) * 200 * DEG
    gyro += np.random.default_rng(1).normal(size=gyro.shape) * 0.05 * DEG
    limited = gyro.copy()
    limited[:, 0] = np.clip(limited[:, 0], -149 * DEG, 151 * DEG)
    levels_dps, stands = find_ceiling(limited)
    at = (limited[:, 0] == 151 * DEG) | (limited[:, 0] == -149 * DEG)
    assert levels_dps[0] == pytest.approx(np.abs(limited[at, 0]).mean() / DEG, abs=0.02)
    assert np.isnan(levels_dps[1:]).all()
    assert stands[at].mean() > 0.97
    assert not stands[~at].any()
    assert find_ceiling(gyro) is None
    assert find_ceiling(np.minimum(gyro, 151 * DEG)) is None  # of one side alone


def test_jitter_is_what_a_stamp_misplaces():
    """A stamp that errs by e moves e times the change of the rate around it; over a segment these add up as a random walk."""
    (log,) = session_of(Table().tumble(16, seed=5).samples()).logs
    rng, t_ns = np.random.default_rng(1), log.samples.t_ns
    stamps = t_ns + np.rint(rng.normal(size=len(t_ns)) * 2e5).astype(np.int64)
    stamps[0] = t_ns[0] - 10**6
    samples = replace(log.samples, t_ns=stamps)
    _, noise = find_stills(log.samples)
    findings = check_stamps(replace(log, samples=samples), noise, 5.0)
    (jitter,) = [finding for finding in findings if finding.what == "jitter"]
    size, period_s = 2e-4, log.samples.period_s
    change = (samples.gyro[2:] - samples.gyro[:-2]) / 2
    angle = np.sqrt((change**2).sum(axis=0).max() / len(samples) * 5.0 / period_s) * size / DEG
    assert float(jitter.description.split(" µs rms")[0].split()[-1]) * 1e-6 == pytest.approx(size, rel=0.02)
    # A line through 5 s on either side takes up what is slower: of so many samples, correlated as the movement is, some hundredths.
    assert float(jitter.description.split(" deg per turn")[0].split()[-1]) == pytest.approx(angle, rel=0.04, abs=5e-5)
    # Beside less noise it matters; where a row is missing and no gap says so, --even would refuse.
    quiet, kept = replace(noise, gyro=noise.gyro / 100), np.arange(len(samples)) != len(samples) // 2
    each = [check_stamps(replace(log, samples=some), quiet, 5.0) for some in (samples, samples.pick(kept))]
    offered, refused = (finding.do for findings in each for finding in findings if finding.what == "jitter")
    assert "import the log with --even" in offered
    assert refused == "stamp on the board, not on arrival"


def test_a_signed_permutation_and_its_scale_are_found_exactly():
    """From turns whose gravity and rates are exact, in any of the 48 orders; closure from still to still is nought."""
    table = Table().tumble(10, seed=3)
    samples = table.samples(gyro_mdps=1e-6, accel_ug=1e-6, registers=False, odr_hz=104)
    stills, _ = find_stills(samples)
    for axes in _SIGNED_PERMUTATIONS[::12]:
        wrong = replace(samples, gyro=samples.gyro @ axes / 1.25)
        found = agreement(wrong, [replace(still, gyro_mean=still.gyro_mean @ axes / 1.25) for still in stills])
        assert_array_equal(found.axes, axes)
        assert found.scale == pytest.approx(1.25, rel=3e-3)
        assert found.scale_std == 0.03
        assert found.residual < 0.6 * DEG
        assert found.others == ()
        assert found.misfit < 0.02
        assert (found.turns, found.ends) == (9, 9)  # one stays about the vertical
    assert np.trace(_SIGNED_PERMUTATIONS[IDENTITY]) == 3


def test_turns_are_cut_into_blocks_that_add_up_to_their_angle():
    """The integral of the rate, less the stills' means and the line between them: about a fixed axis, the turn's angle."""
    samples = Table().rest(2).turn(150, (1, 2, 0), 3.0).rest(2).samples(gyro_mdps=1e-6, accel_ug=1e-6, registers=False, odr_hz=104)
    drifted = np.interp(samples.t_ns * 1e-9, [2, 5], [0, 0.1 * DEG])
    samples = replace(samples, gyro=samples.gyro + drifted[:, None])
    stills, _ = find_stills(samples)
    turns = _cut_turns(samples, [tuple(stills)])
    axis = np.array([1, 2, 0]) / np.sqrt(5)
    assert_allclose(turns.angle.sum(axis=(0, 1)), 150 * DEG * axis, atol=2e-4)
    turned = Rotation.from_rotvec(150 * DEG * axis).inv()
    assert_allclose(turns.first, [[0, 0, 1]], atol=1e-6)
    assert_allclose(turns.last, turned.apply([[0, 0, 1]]), atol=1e-6)
    apart = np.linalg.norm(np.diff(turns.down[0], axis=0), axis=1)
    assert np.nanmax(apart) < 150 * DEG * 2 / 3 * 0.05 * 1.05


@pytest.mark.parametrize(("follows", "stays"), [(0.0, "0"), (0.09, "8.1"), (0.11, ""), (1.0, "")])
def test_gravity_must_move_by_a_tenth_of_the_angle_that_the_rates_tilt_it_by(follows, stays):
    table = Table().rest(2)
    for angle in (90, -90, 90, -90):
        table.turn(angle, (1, 0, 0)).rest(2)
    samples = table.samples(gyro_mdps=1e-6, accel_ug=1e-6, registers=False, odr_hz=104)
    _, y, z = -samples.accel.T  # downwards
    angle = follows * np.arctan2(y, z)
    moved = samples.with_accel(-9.8 * np.column_stack([0 * angle, np.sin(angle), np.cos(angle)]))
    found = check_gravity_moves("log", moved, list(pairwise(find_stills(samples)[0])))
    says = [f"stays within {stays} deg in 4 of 4 turns in which the rates tilt it by 90 deg"] if stays else []
    assert [finding.description for finding in found] == says


@pytest.mark.parametrize(
    ("factor", "raw", "kind", "by", "settings"),
    [
        (0.5, True, "", 1.0, (("gyro_fs_dps", 250.0),)),
        (3.0, True, None, None, None),
        (4.0, False, "gyro", 4.0, (("gyro_fs_dps", 2000.0),)),
        (DEG, False, "gyro", DEG, ()),
    ],
)
def test_what_undoes_a_wrong_sensitivity(good, factor, raw, kind, by, settings):
    found = _scale_correction(factor, replace(good.config.sensor, model="unknown"), raw)
    assert (found and (found.kind, found.factor, found.settings)) == (None if kind is None else (kind, by, settings))


def test_what_undoes_a_wrong_sensitivity_of_registers(good):
    sensor = replace(good.config.sensor, gyro_mdps_per_lsb=17.5)
    assert _scale_correction(2.0, sensor, True).settings == (("gyro_fs_dps", 1000.0), ("gyro_mdps_per_lsb", 35.0))
    assert _scale_correction(1 / 64, sensor, True) is None  # the sensor has no such full scale


def test_samples_counted_at_a_wrong_rate(good):
    found = _counted_at(1.25, replace(good.config.sensor, odr_hz=104.0))
    assert (found.description, found.factor, found.settings) == (
        "the samples were counted at 104 Hz, and came at 83.2",
        1.25,
        (("odr_hz", 83.2),),
    )


def test_usual_mistakes_have_their_factors(good):
    """Degrees for radians, mdps, us for ns, powers of two up to 32, and ST's 17.5 mdps of 500 dps against 32768 counts."""
    sensor = replace(good.config.sensor, model="unknown")
    st = 17.5e-3 * 32768 / 500
    usual = {DEG, 1 / DEG, 1e-3, 1e3, st, 1 / st} | {2.0**power for power in range(-5, 6)} - {1.0}
    assert set(_mistakes(sensor, True, 0.0)) == usual
    assert not any("does not have" in says for says in _mistakes(sensor, True, 0.0).values())
    known = _mistakes(good.config.sensor, True, 0.0)
    assert ["does not have" in known[factor] for factor in (0.5, 2.0, 0.125, 16.0)] == [False, False, True, True]
    # A step of the registers that is already what the mistake says they should be is none.
    to_span = 500 / 32.768
    for step, missing in ((to_span, 1 / st), (st * to_span, st)):
        assert set(_mistakes(sensor, True, step * 1.0019)) == usual - {missing}
        assert set(_mistakes(sensor, True, step * 1.0021)) == usual


def turned_by(vector, blocks=7):
    """Turns of z by rotation vectors (S, 3) rad in equal blocks."""
    vector = np.atleast_2d(vector).astype(float)
    first = np.tile([0.0, 0, 1], (len(vector), 1))
    last = Rotation.from_rotvec(vector).inv().apply(first)
    return Turns(np.repeat(vector[:, None] / blocks, blocks, axis=1), np.full((len(vector), blocks, 3), np.nan), first, last)


def test_a_closure_is_the_angle_by_which_the_median_turn_misses_gravity():
    turns = turned_by([[0.5, 0, 0], [0, 1.0, 0], [0, 0, 2.0]])
    factors = np.array([np.eye(3), 1.1 * np.eye(3), np.diag([1, -1, 1.0])])
    assert _closures(turns, factors) == pytest.approx([0, 0.05, 0], abs=1e-9)  # of 0.05, 0.1 and 0; of 0, 2 and 0
    assert _refined(turned_by([[0.5, 0, 0]] * 3), np.eye(3)[None], np.array([1 / 1.1]))[0] == pytest.approx(1.0, abs=0.003)


def test_turns_of_like_lengths_are_carried_together_to_the_same_bits():
    whole = Turns(*(np.repeat(part, 3, axis=0) for part in vars(turned_by(np.array([0.5, 1.0, 0.2]), 37)).values()))
    whole.angle[0, 7:], whole.angle[1, 20:] = 0.0, 0.0
    factors = np.linspace(0.9, 1.1, 9)[:, None, None] * np.eye(3)
    down = _carried(whole, factors)
    angle = np.arctan2(np.linalg.norm(np.cross(down, whole.last), axis=-1), (down * whole.last).sum(axis=-1))
    assert (_closures(whole, factors) == np.median(angle, axis=-1)).all()


def test_a_turn_tells_the_scale_where_a_tenth_more_moves_its_end_by_two_degrees():
    there = np.array([[1.0, 0, 0]])
    for degrees, tells in ((19.5, False), (20.5, True), (360, True)):
        assert _shows_scale(turned_by(degrees * DEG * there), np.eye(3)).tolist() == [tells]
    assert _shows_scale(turned_by([[0, 0, 2.0]]), np.eye(3)).tolist() == [False]


def test_a_regression_finds_the_scale_and_what_it_leaves():
    """Gravity that moves as the rates say, in small steps; and the mirrored axis with the other sign."""
    turned = Rotation.from_rotvec(np.arange(400)[:, None] * 0.002 * [1, 0, 0])
    down = turned.inv().apply([0, 0, 1.0])
    turns = Turns(np.full((1, 400, 3), 0.002 / 1.25) * [1, 0, 0], down[None], down[:1], down[-1:])
    scales, misfits = _regress(turns)
    assert (scales[IDENTITY], misfits[IDENTITY]) == (pytest.approx(1.25, rel=1e-4), pytest.approx(0, abs=1e-4))
    mirrored = next(i for i, axes in enumerate(_SIGNED_PERMUTATIONS) if (axes == np.diag([-1, 1, 1])).all())
    assert (scales[mirrored], misfits[mirrored]) == (pytest.approx(-1.25, rel=1e-4), pytest.approx(0, abs=1e-4))


def of_rows(gyro, accel, rate_hz=104.0):
    return Log(Path("log0001.csv"), Samples(np.rint(np.arange(len(gyro)) * 1e9 / rate_hz).astype(np.int64), gyro, accel))


def test_gaps_are_counted_and_those_beyond_three_samples_apart(good):
    samples = good.logs[0].samples
    lost = np.r_[500:502, 1000:1080, 2000:2080]
    kept = np.delete(np.arange(len(samples)), lost)
    found = of(check_stamps(replace(good.logs[0], samples=samples.pick(kept)), None, 5.0), "gaps")
    assert found.description.startswith("3 gaps, 162 samples lost, the longest 0.389 s")
    assert found.description.endswith("2 of them longer than 3 samples")


@pytest.mark.parametrize(("rate_hz", "least"), [(2.0, 9), (104.0, 105)])
def test_steps_are_looked_for_in_stretches_of_a_second_and_eight_steps(good, rate_hz, least):
    """Of an axis that repeats all but its last reading; the noise of the data sheet is its density times the root of half the rate."""
    gyro = np.zeros((least, 3))
    gyro[-1, 0] = 0.5 * DEG
    (found,) = check_quantised(of_rows(gyro, gyro, rate_hz), good.config.sensor)
    density = good.config.sensor.typical("gyro_noise_mdps_rthz")[1]
    assert found.description.startswith("the gyro (x) moves")  # the others are stuck
    assert f"in steps of 500 mdps, and repeats {(least - 2) / (least - 1):.0%} of its readings" in found.description
    assert f"({density * np.sqrt(rate_hz / 2):.3g} mdps rms for the ASM330LHH" in found.description
    assert check_quantised(of_rows(gyro[1:], gyro[1:], rate_hz), good.config.sensor) == []


@pytest.mark.parametrize(("seconds", "found"), [(4.8, []), (5.4, ["accelerometer dead"])])
def test_an_axis_clips_for_five_seconds_at_most(good, seconds, found):
    log = good.logs[0]
    accel = np.array(log.samples.accel)
    accel[1000 : 1000 + round(208 * seconds), 0] = accel[:, 0].max()
    assert [each.what for each in check_dead(replace(log, samples=log.samples.with_accel(accel)))] == found


def test_rows_without_force_are_no_dead_axis_where_that_is_agreed():
    rng = np.random.default_rng(1)
    gyro, accel = rng.normal(size=(1000, 3)), rng.normal(size=(1000, 3))
    accel[300:700] = 0.0
    log = of_rows(gyro, accel)
    assert np.flatnonzero(_without_force(log.samples)).tolist() == list(range(300, 700))
    assert [each.what for each in check_dead(log)] == ["accelerometer dead"] * 3
    assert "ax reads 0 g from row 300 to row 699, 2.9 to 6.7 s" in check_dead(log)[0].description
    assert "such places" not in check_dead(log)[0].description
    accel[800:950] = 0.0
    assert "(2 such places)" in check_dead(log)[0].description
    assert check_dead(log, True) == []


def test_equal_neighbours_that_noise_leaves_in_one_step():
    """Two normal readings differ by d of sqrt(2) sigma, and share a step by chance 1 - |d|; sigma such that a run stays in it by 1e-5."""
    sigma = 0.5 / norm.isf((1 - 1e-5 ** (1 / LEAST_DEAD_READINGS)) / 2)
    assert quad(lambda d: 2 * (1 - d) * norm.pdf(d, scale=np.sqrt(2) * sigma), 0, 1)[0] == pytest.approx(SCATTERS, abs=0.01)


@pytest.mark.parametrize(("count", "same"), [(99, False), (100, True)])
def test_a_copy_has_a_hundred_readings_or_more(count, same):
    rows = np.random.default_rng(1).normal(size=(150, 3))
    assert _same(rows, rows[:count]) == _same(rows[:count], rows) == same
    assert not _same(np.ones((150, 3)), np.ones((150, 3)))  # nothing that a sensor reads
    other = rows.copy()
    other[-1, 2] += 1
    assert not _same(rows, other)
    assert _same(rows[:-1], other)


def test_readings_stand_at_both_ends_for_twenty_each_and_far_from_rest():
    """Of a wave between 0 and 1: twice 10 readings in a row at each end; from 20 steps of the noise on."""
    wave = np.tile(np.r_[np.linspace(-0.9, 0.9, 50), np.ones(10), np.linspace(0.9, -0.9, 50), -np.ones(10)], 2)
    level, at = _stands(wave, 0.049)
    assert (level, at.sum()) == (1.0, 40)
    assert _stands(wave, 0.051) is None
    assert _stands(wave[:-1], 0.049) is None  # 19 at one end
    assert _usual_step(np.array([0.0, 0, 1, 4, 4, -1])) == 3.0
    assert _usual_step(np.zeros(4)) == 0.0


def test_rotations_of_dials_are_those_of_scipy():
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.5, 1.5, size=(20, 3))
    of = Rotation.from_euler("ZYX", angles[:, ::-1])
    assert dials.down_of_dials(angles) == pytest.approx(of.inv().apply([0, 0, 1.0]))
    assert angle_between(np.eye(3), np.eye(3)[[0, 2, 1]]) == pytest.approx([0, np.pi / 2, np.pi / 2])


def test_parts_of_a_segment_are_equal_in_time_without_the_line_between_its_stills():
    rate, first, last = np.array([0.3, -0.2, 0.1]), np.array([0.01, 0.02, 0.03]), np.array([-0.02, 0.0, 0.05])
    t_s = np.sort(np.append(np.random.default_rng(0).uniform(0, 4, 99), [0, 4]))
    drifting = first + t_s[:, None] / 4 * (last - first)
    samples = Samples(np.rint(t_s * 1e9).astype(np.int64), rate + drifting, np.zeros((101, 3)), None)
    segment = SimpleNamespace(start=0, stop=101, stills=(SimpleNamespace(gyro_mean=first), SimpleNamespace(gyro_mean=last)))
    assert_allclose(dials._blocks(samples, segment), np.tile(rate * 4 / dials.BLOCKS, (dials.BLOCKS, 1)), rtol=1e-6)


def test_what_dials_miss_is_beside_scale_and_mounting_and_one_turn_has_no_say():
    """Of 12 turns, of a gyroscope of scales and a mounting within their priors; the last dial is off by 10°."""
    rng = np.random.default_rng(1)
    turn, whole = rng.normal(size=(12, 5, 3)) * 0.3, Rotation.identity(12)
    for part in range(5):
        whole = whole * Rotation.from_rotvec(turn[:, part])
    first, mounting = Rotation.random(12, random_state=1), Rotation.from_rotvec([6e-3, -4e-3, 1e-2])
    of = [(each * mounting).as_quat(scalar_first=True) for each in (first, first * whole)]
    read = np.repeat(turn / 40, 40, axis=1) / [1.005, 0.996, 1.002]
    missed, usual = dials._missed(read, *of, 1e-4)
    assert missed.max() < 5e-4
    assert usual == pytest.approx(np.median(missed))
    of[1][-1] = rotation.multiply(of[1][-1], rotation.exp(np.array([0, 10 * DEG, 0])))
    missed, _ = dials._missed(read, *of, 1e-4)
    assert missed[-1] == pytest.approx(10 * DEG, rel=0.05)
    assert missed[:-1].max() < 1e-3


def test_the_scale_of_turns_is_held_by_its_prior_of_five_per_cent():
    """Five turns about x, of 1 rad by the gyroscope and 1.1 by the dials: weights are Cauchy's, by the median of three normal errors."""
    identity = np.tile([1.0, 0, 0, 0], (5, 1))
    missed, _ = dials._missed(np.full((5, 100, 3), 0.01) * [1, 0, 0], identity, np.tile(rotation.exp(np.array([1.1, 0, 0])), (5, 1)), 0.04)
    left = 0.1
    for _ in range(30):
        weight = 1 / (max(left / 1.5382, 0.04) ** 2 + left**2)
        left = 0.1 * (1 - 5 * weight / (5 * weight + 0.05**-2))
    assert missed == pytest.approx(np.full(5, left), rel=1e-6)


TURNS, DIAL_DEG = 12, 0.6


PITCH, YAW = 1, 2


@pytest.fixture(scope="module")
def exact():
    """A session of exact readings, its parts, and the angles of its stills in degrees."""
    plan = Table().tumble(TURNS, seed=5)
    session = session_of(plan.samples(odr_hz=52, gyro_mdps=0.1, accel_ug=1.0, registers=False))
    protocol = replace(session.config.protocol, reference="table", dial_sigma_deg=DIAL_DEG)
    session = replace(session, config=replace(session.config, protocol=protocol))
    parts = session_segments(session, SessionStills(session))
    _, attitude = plan.truth(np.array([(start + stop) / 2 for start, stop in plan.rests]))
    return session, parts, attitude.as_euler("ZYX", degrees=True)[:, ::-1]


def left_out(exact, off_deg):
    """Numbers of the rows, and of the turns, that are left out of dial readings that are off by (13, 3) degrees."""
    session, parts, angles = exact
    session, parts, _ = without_wrong_dials(replace(session, attitudes=(angles + off_deg) * DEG), parts)
    assert session.attitudes is not None
    turns = [segment.number for segment in parts[0].segments if not segment.accepted]
    return np.flatnonzero(np.isnan(session.attitudes).any(axis=1)).tolist(), turns


def off(rows, column, by):
    found = np.zeros((TURNS + 1, 3))
    found[rows, column] = by
    return found


def test_the_bar_of_a_row_against_gravity(exact):
    """Of 13 rows chance alone takes one out once in 1000 sessions, if each is off by the declared error."""
    bar = DIAL_DEG * np.sqrt(2 * np.log(13 / 1e-3))
    assert left_out(exact, off(4, PITCH, 0.98 * bar)) == ([], [])
    assert left_out(exact, off(4, PITCH, 1.02 * bar)) == ([4], [])


def test_up_to_a_quarter_of_the_rows_are_left_out_or_none(exact):
    """Of 13: three."""
    assert left_out(exact, off([1, 5, 9], PITCH, 10.0)) == ([1, 5, 9], [])
    assert left_out(exact, off([1, 4, 7, 10], PITCH, 10.0)) == ([], [])


def test_the_bar_of_a_turn_that_dials_miss(exact):
    """Two dials err in a turn; a sigma more, since three components are off together.  Turns on both sides of the row miss it."""
    bar = np.sqrt(2) * DIAL_DEG * (np.sqrt(2 * np.log(12 / 1e-3)) + 1)
    assert left_out(exact, off(7, YAW, 0.95 * bar)) == ([], [])
    assert left_out(exact, off(7, YAW, 1.07 * bar)) == ([7], [])


def test_a_turn_alone_is_missed_by_a_movement_of_its_own(exact):
    """From the next row on, all dials agree again."""
    turn = exact[1][0].segments[6]
    bar = APART_RAD / DEG + APART_SHARE * turn.turn_deg
    assert left_out(exact, off(slice(7, None), YAW, 0.95 * bar)) == ([], [])
    assert left_out(exact, off(slice(7, None), YAW, 1.07 * bar)) == ([], [6])


@pytest.mark.parametrize(("askew_deg", "level"), [(9.8, "ok"), (10.2, "warning"), (149.8, "warning"), (150.2, "error")])
def test_dials_may_stand_ten_degrees_askew_and_from_150_on_upside_down(exact, askew_deg, level):
    session, _, angles = exact
    session = replace(session, attitudes=(angles + off(slice(None), PITCH, askew_deg)) * DEG)
    assert [each.level for each in check_dials(session, SessionStills(session))] == [level]


def flat_turns(share, seed=4, turns=12, push_g=0.16, odr_hz=83.0):
    """Turns about axes in the sensor's level plane, z with this share, the hand pushing by so much: (session, its samples)."""
    rng, table = np.random.default_rng(seed), Table().rest(2.2)
    for _ in range(turns):
        table.turn(rng.uniform(90, 260) * rng.choice([-1, 1]), rng.normal(size=3) * [1, 1, share], 2.0).rest(2.2)
    made = session_of(table.samples(odr_hz=odr_hz, registers=False), odr_hz=odr_hz)
    samples = made.logs[0].samples
    push = np.apply_along_axis(np.convolve, 0, rng.normal(size=(len(samples), 3)), np.hanning(40) / 20, mode="same")
    moves = np.linalg.norm(samples.gyro - np.median(samples.gyro, axis=0), axis=1) > 8 * DEG
    return made, samples.with_accel(samples.accel + moves[:, None] * push * push_g * 9.80665 / push.std())


def test_axes_are_decided_by_how_turns_end_and_not_by_a_hands_pushes():
    """Within the turns several orders leave as much of gravity's movement; from still to still the right one closes ten times better."""
    signs, (made, samples) = [-1, 1, -1], flat_turns(0.12)
    finding = of(look(made, gyro=samples.gyro * signs, accel=samples.accel), "axes")
    assert finding.level == "error"
    assert finding.description.startswith("the gyro's x and z have the wrong sign:")
    (gyro, *_) = finding.corrections
    assert np.diag(gyro.axes).tolist() == signs
    assert of(look(made, gyro=samples.gyro, accel=samples.accel), "axes").level == "ok"


def test_where_two_orders_fit_none_is_chosen():
    """z never turns: its sign is open, so nothing is named, corrected, or said of the scale; as logged, it stays."""
    made, samples = flat_turns(0.0)
    findings = look(made, gyro=samples.gyro * [-1, -1, 1], accel=samples.accel)
    finding = of(findings, "axes")
    assert finding.level == "error"
    assert finding.corrections == ()
    assert "the gyro's x and y have the wrong sign" in finding.description
    assert "all three axes of the gyro have the wrong sign" in finding.description
    assert "2 orders fit alike, and none is chosen" in finding.description
    assert not [each for each in findings if each.what == "gyro scale"]
    assert of(look(made, gyro=samples.gyro, accel=samples.accel), "axes").level == "ok"


def test_whole_circles_tell_the_scale_by_where_they_end():
    """They end as they began, so they tell no axes; a scale that is 12 % off ends 43 degrees away, and is no push of the hand."""
    table, rng = Table().rest(2.2), np.random.default_rng(1)
    for _ in range(6):
        axis = rng.normal(size=3) * [1, 1, 0.1]
        table.turn(360 * rng.choice([-1, 1]), axis, 3.0).rest(2.2)
    made = session_of(table.samples(registers=False))
    samples = made.logs[0].samples
    for factor in (1.0, 1.12):
        found = agreement(replace(samples, gyro=samples.gyro * factor), find_stills(samples)[0])
        assert found.ends == 0
        assert (found.scale, found.scale_std) == (pytest.approx(1 / factor, abs=0.006), 0.03)


def test_gravity_within_the_turns_alone_accuses_no_scale_that_pushes_can_make():
    """Out and back, no end tells a scale: 0.888 is twice what pushes usually make, and a half is not."""
    table = Table().rest(2.2)
    for i in range(8):
        table.turn(120, (1, i % 3 - 1, 0), 2.0).turn(-120, (1, i % 3 - 1, 0), 2.0).rest(2.2)
    made = session_of(table.samples(registers=False))
    gyro = made.logs[0].samples.gyro
    for scale, level in ((0.82, "ok"), (0.78, "error"), (1.18, "ok"), (1.22, "error")):
        assert of(look(made, gyro=gyro / scale), "gyro scale").level == level


@pytest.mark.parametrize(("lsb_dps", "named"), [(500 / 32768, False), (17.5e-3, True)])
def test_the_step_of_the_readings_refutes_a_sensitivity(lsb_dps, named):
    """Rates that are 15 % too large, in ST's steps: converted with these.  In steps of 500 dps / 32768 they were not."""
    table = Table().tumble(12, seed=5)
    samples = table.samples(registers=False)
    made = session_of(samples, raw=False, model="unknown")
    gyro = np.round(samples.gyro * 1.147 / (lsb_dps * DEG)) * lsb_dps * DEG
    finding = of(look(made, gyro=gyro), "gyro scale")
    assert finding.description.startswith("gravity requires rates x 0.87")
    assert ("sensitivity" in finding.do) == named
    assert finding.level == ("error" if named else "warning")


@pytest.mark.parametrize(
    ("three", "found"),
    [
        ((0.8, 0.9, -1.0), True),  # on to 1.0, which is -1.0
        ((0.8, 0.9, -0.91), True),  # within a tenth of the end from where it went
        ((0.8, 0.9, -0.89), False),
        ((0.1, 0.55, -1.0), True),  # a jump of 1.55
        ((-0.09, 0.46, -0.99), False),  # of 1.45
        ((-0.8, -0.9, 1.0), True),
    ],
)
def test_a_jump_is_a_wrap_where_the_movement_goes_on(good, three, found):
    end = 60 * DEG
    gyro = 0.1 * good.logs[0].samples.gyro
    gyro[4000:4003, 1] = np.array(three) * end * 32767 / 32768
    narrow = with_sensor(good, gyro_mdps_per_lsb=60e3 / 32768)
    wraps = [finding for finding in look(narrow, gyro=gyro) if finding.what == "gyro wraps"]
    assert bool(wraps) == found
