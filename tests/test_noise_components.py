"""Each variance component of a session's noise: its covariance of seven turns by numeric derivatives or by sums over every reading."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from small_sessions import DPH, attitudes_by_scipy, closure_of, small_session, tilted_stills
from small_turns import TRUE, angles_by_scipy, numeric_jacobian

from session.detect.check_time import capped, thinning_exponent
from session.detect.stills import Noise
from session.io.units import MG, G
from tinygc.closure.floor import BiasInstability, wander_covariance
from tinygc.closure.residual import Batch
from tinygc.noise import components
from tinygc.noise.components import (
    REFERENCE,
    STILL_RATE,
    TRUTH,
    TRUTH_ACCELERATION,
    TRUTH_RATE,
    TURN,
    TURNED,
    UNDERSAMPLED,
    UNKNOWN_SPREAD,
    UNKNOWN_WANDER_RPS,
    WANDER,
    Component,
    SessionNoise,
    Undersampling,
    Whiteners,
    components_of,
    first_noise,
    known_whitener,
    undersampling,
)
from tinygc.noise.reml import Prior
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Sparse, Whitener

#: nothing missed by any turn
NOTHING = Undersampling(np.zeros(7), 2.0, np.zeros(3), 20.0)


def found_in(problem, missed=NOTHING) -> dict[str, Component]:
    twin = Twin(problem)
    return {c.name: c for c in components_of(twin, sizes_of(twin), missed)}


def sizes_of(twin) -> tuple[int, int, int]:
    return len(twin.segments) * twin.batch.angles, 3 * len(twin.stills), len(twin.stills)


def dense(component: Component) -> np.ndarray:
    return component.V.dense() if isinstance(component.V, Sparse) else component.V


def alike(found, expected, share=3e-3):
    np.testing.assert_allclose(found, expected, atol=share * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["tilt", "known"])
def test_the_wander_is_the_flicker_of_the_bias_in_each_quarter_of_a_second(kind):
    """The closure's derivative by the bias of each reading; of a still's mean rate it is one."""
    problem = small_session(kind=kind, turns=(2, 1))
    batch, d = problem.batch, problem.batch.angles
    began = [0.0, problem.logs[0].samples.duration_s]
    moments, spans, responses = [], [], []
    for i, segment in enumerate(problem.used):

        def moved(by, i=i):  # each reading, rad/s of the calibrated rate
            rate = batch.rate[i] + by.reshape(-1, 3) @ np.linalg.inv(TRUE.E).T
            return angles_by_scipy(replace(batch.pick(slice(i, i + 1)), rate=rate[None]), TRUE.vector).ravel()

        each = numeric_jacobian(moved, np.zeros(3 * batch.rate.shape[1])).reshape(d, -1, 3)
        weight = (np.append(batch.dt[i], 0) + np.append(0, batch.dt[i])) / 2
        pieces = int(np.ceil(segment.duration_s / 0.25))
        at = np.minimum((np.cumsum(weight) - weight / 2) / weight.sum() * pieces, pieces - 1).astype(int)
        for k in range(pieces):
            moments.append(began[segment.log] + segment.start_s + (k + 0.5) * segment.duration_s / pieces)
            spans.append(segment.duration_s / pieces)
            response = np.zeros((3 * d + 20, 3))
            response[d * i : d * i + d] = each[:, at == k].sum(axis=1)
            responses.append(response)
    for q, still in enumerate(still for still in problem.stills if still.problem is None):
        moments.append(problem.still_rates.middle_s[q])
        spans.append(still.duration_s)
        responses.append(np.eye(3 * d + 20)[:, 3 * d + 3 * q : 3 * d + 3 * q + 3])
    flicker = wander_covariance(np.array(moments), np.array(spans), instability_rps=1.0)
    expected = np.einsum("aik,ab,bjk->ij", responses, flicker, responses)
    alike(dense(found_in(problem, replace(NOTHING, predicted_rad=np.zeros(3)))[WANDER]), expected, 0.01)


@pytest.mark.parametrize(("turns", "pieces"), [(1, 20), (100, 20), (101, 20), (106, 19), (1999, 2), (2000, 1)])
def test_a_turn_of_five_seconds_has_twenty_pieces_and_all_together_some_two_thousand(turns, pieces):
    found = components.wander_pieces(np.ones((turns, 11, 2, 3)), np.full((turns, 10), 0.5))
    assert {len(each) for each in found} == {pieces}
    np.testing.assert_allclose(found[0].sum(axis=0), 11.0)


def test_a_reading_belongs_to_the_piece_in_which_the_middle_of_its_time_lies():
    """Half of the time to each neighbour is its own; readings are told apart by powers of two."""
    for seed in range(8):
        dt = np.random.default_rng(seed).uniform(0.02, 0.4, 30)
        t_s = np.cumsum(np.append(0.0, dt))
        edges_s = np.array([0.0, *(t_s[1:] + t_s[:-1]) / 2, t_s[-1]])
        pieces = int(np.ceil(t_s[-1] / 0.25))
        piece = ((edges_s[1:] + edges_s[:-1]) / 2 // (t_s[-1] / pieces)).astype(int)
        marks = 2.0 ** np.arange(31)
        (found,) = components.wander_pieces(np.tile(marks[:, None, None], (1, 1, 2, 3)), dt[None])
        np.testing.assert_array_equal(found[:, 1, 2], np.bincount(piece, marks, pieces))


def test_a_long_turn_among_short_ones_has_pieces_as_short_as_theirs():
    dt = np.full((400, 400), 0.25 / 400)
    dt[7] = 100 / 400
    assert [len(each) for each in components.wander_pieces(np.ones((400, 401, 2, 3)), dt)][6:9] == [1, 400, 1]


def test_flicker_in_a_flip_is_the_double_integral_over_all_its_readings():
    """About x, in the second of three parts of 5 s, so that y and z are reversed: against the covariance of every two readings."""
    T = 401
    dt = np.full((1, T - 1), 5.0 / (T - 1))
    weight = (np.append(dt, 0) + np.append(0, dt)) / 2
    flip = Rotation.from_rotvec(np.pi * np.linspace(-1, 2, T).clip(0, 1)[:, None] * [1.0, 0, 0]).as_matrix()
    sensitivity = weight[:, None, None] * flip[:, :2]
    (pieces,) = components.wander_pieces(sensitivity[None], dt)
    flicker = wander_covariance(np.linspace(0.125, 4.875, 20), 0.25, instability_rps=1.0)
    found = np.einsum("aik,ab,bjk->ij", pieces, flicker, pieces)
    every = wander_covariance(np.linspace(0, 5, T), instability_rps=1.0)
    exact = np.einsum("tik,tu,ujk->ij", sensitivity, every, sensitivity)
    np.testing.assert_allclose(found, exact, rtol=0.005, atol=1e-9)
    mean = wander_covariance(np.array([2.5]), 5.0, instability_rps=1.0)[0, 0] * sensitivity.sum(axis=0)[1] @ sensitivity.sum(axis=0)[1]
    assert mean < 0.7 * exact[1, 1]  # the mean bias alone


@pytest.mark.parametrize(
    ("known", "truths", "prior"),
    [
        (BiasInstability(20 * DPH, "given"), False, (20, 0.1)),
        (BiasInstability(20 * DPH, "typical of some"), False, (20, 0.8)),
        (BiasInstability(20 * DPH, "measured at rest (noise.json)", 4 * DPH, 28 * DPH), False, (20, np.hypot(0.1, 0.2))),
        (BiasInstability(20 * DPH, "estimated", 4 * DPH, 28 * DPH, of_unit=True), False, None),
        (BiasInstability(20 * DPH, "estimated", of_unit=True), False, None),
        (BiasInstability(0.0, "nothing"), False, None),
        (BiasInstability(20 * DPH, "given"), True, (20, 0.1)),
        (BiasInstability(20 * DPH, "estimated", of_unit=True), True, (20, 0.8)),
        (BiasInstability(0.0, "nothing"), True, (10, 1.5)),
    ],
)
def test_what_is_known_of_the_wander_beforehand(known, truths, prior):
    """Given to 10 %, typical to a factor of 2.2; of the unit's own stills nothing more than they say again; with a truth file an order of
    magnitude.  A search begins at it, or at half of a still's white noise."""
    problem = small_session(instability=known, truths=truths)
    component = found_in(problem)[WANDER]
    if prior is None:
        assert component.prior is None
    else:
        assert component.prior == pytest.approx((prior[0] * DPH, prior[1], None))
    white = 20 * DPH if truths else np.median(problem.still_rates.sigma)
    assert component.usual == pytest.approx(known.rps or white / 2)
    assert (component.unit, component.si) == ("°/h", pytest.approx(DPH))
    assert first_noise(Twin(problem), Whitener(Twin(problem)), NOTHING).s[0] == (0.0 if prior is None else component.usual)


@pytest.mark.parametrize("kind", ["tilt", "yaw", "known"])
def test_an_error_of_a_still_tilts_the_ends_of_two_turns_and_lengthens_gravity(kind):
    """1 m/s^2 is 1/g of tilt about either horizontal axis, and one unit of length."""
    problem = small_session(kind=kind)

    def moved(by):
        tilt = np.pad(by.reshape(9, 2), ((0, 0), (0, 1))) / G
        return closure_of(tilted_stills(problem, tilt))(TRUE.vector)

    by_tilt = numeric_jacobian(moved, np.zeros(18), 1e-3)
    component = found_in(problem)[REFERENCE]
    rows = len(by_tilt)
    expected = np.zeros((rows + 36, rows + 36))
    expected[:rows, :rows], expected[-9:, -9:] = by_tilt @ by_tilt.T, np.eye(9)
    alike(dense(component)[:rows, :rows], expected[:rows, :rows], 2e-3)
    np.testing.assert_array_equal(dense(component)[rows:, :], expected[rows:, :])
    assert (component.usual, component.si, component.prior) == (0.1 * MG, MG, None)


@pytest.mark.parametrize("kind", ["tilt", "yaw", "known"])
def test_independent_errors_of_stills_and_turns(kind):
    """Of each still's mean rate; of each turn's closure, but for a stated angle, which has its stop's sigma."""
    problem = small_session(kind=kind)
    found, d = found_in(problem), problem.batch.angles
    np.testing.assert_array_equal(np.diag(dense(found[STILL_RATE])), np.repeat([0.0, 1.0, 0.0], [7 * d, 27, 9]))
    assert found[STILL_RATE].usual == np.median(problem.still_rates.sigma)
    of_angles = {"tilt": [1, 1], "yaw": [1, 1, 1], "known": [1, 1, 0]}[kind]
    np.testing.assert_array_equal(dense(found[TURN]), np.diag([*np.tile(of_angles, 7), *np.zeros(36)]))
    white = problem.floor.own - problem.floor.wider
    variance = np.stack([np.trace(white[:, :2, :2], axis1=1, axis2=2) / 2] * 2 + [white[:, i, i] for i in range(2, d)], axis=1)
    usual = np.sqrt(np.mean(variance[problem.batch.known]))
    assert found[TURN].usual == pytest.approx(usual)
    assert {(c.name, c.prior) for c in found.values() if c.name != WANDER} == {(STILL_RATE, None), (REFERENCE, None), (TURN, None)}
    assert {c.si for c in (found[STILL_RATE], found[TURN])} == {DEG}
    # What missed turns leave is a component from a tenth of this on; each turn has its own share.
    for times, there in ((0.0999, False), (0.1001, True)):
        missed = replace(NOTHING, predicted_rad=times * usual * np.sqrt(np.arange(1.0, 8.0) / 4))
        found = found_in(problem, missed)
        assert (UNDERSAMPLED in found) is there
    np.testing.assert_allclose(dense(found[UNDERSAMPLED]), np.diag([*np.repeat(missed.predicted_rad**2, d), *np.zeros(36)]))
    assert (found[UNDERSAMPLED].prior, found[UNDERSAMPLED].usual) == (Prior(1.0, 1.0, 0.4), 1.0)


def test_an_error_of_a_moment_of_truth_is_shared_by_two_turns():
    """A segment ends at the sample where the next one of its log begins; between logs and behind a rejected one nothing is shared."""
    problem = small_session(kind="yaw", truths=True)
    used = problem.used
    joined = [replace(s, stop=t.start + 1 if t.log == s.log else s.stop) for s, t in pairwise(used)]
    problem = replace(problem, segments=[*joined, used[-1]])
    problem.__dict__["instability"] = BiasInstability(20 * DPH, "given")
    moments = sorted({(s.log, row) for s in problem.used for row in (s.start, s.stop - 1)})
    assert len(moments) == 9
    expected = np.zeros((21, 21))
    for moment in moments:
        sign = np.array([(moment == (s.log, s.stop - 1)) * 1.0 - (moment == (s.log, s.start)) for s in problem.used])
        expected += np.kron(np.outer(sign, sign), np.eye(3))
    found = found_in(problem)
    assert set(found) == {WANDER, TRUTH, TRUTH_RATE, TRUTH_ACCELERATION, TURNED, TURN}  # no still is there
    np.testing.assert_array_equal(dense(found[TRUTH]), expected)
    sigma = problem.session.config.protocol.truth_sigma_deg * DEG
    assert found[TRUTH].prior == (sigma, 1.5, None)
    # Where a search starts: half of a turn's variance from each end, by the median.
    angles = Twin(problem).residuals(Twin(problem).start()).closure
    assert found[TRUTH].usual == pytest.approx(float(np.median(np.abs(angles))) / 0.6745 / np.sqrt(2), rel=1e-3)
    assert found[TRUTH].si == DEG


def test_a_truths_errors_grow_with_the_rate_its_change_and_the_angle_turned():
    """Per moment in proportion to the rate and to its derivative there, per turn to the root of the length of its path."""
    problem = small_session(kind="yaw", truths=True)
    problem.__dict__["instability"] = BiasInstability(20 * DPH, "given")
    used, found = problem.used, found_in(problem)
    rates = [np.asarray(problem.first(log.samples.gyro)) for log in problem.logs]
    times = [log.samples.t_s for log in problem.logs]
    # A sample is longer than the 8 ms over which a derivative is taken of faster logs.
    changes = [np.gradient(rate, log.samples.period_s, axis=0) for rate, log in zip(rates, problem.logs, strict=True)]
    for name, values in ((TRUTH_RATE, rates), (TRUTH_ACCELERATION, changes)):
        expected = np.zeros((21, 21))
        for log, row in {(s.log, row) for s in used for row in (s.start, s.stop - 1)}:
            sign = np.array([((log, row) == (s.log, s.stop - 1)) * 1.0 - ((log, row) == (s.log, s.start)) for s in used])
            expected += np.kron(np.outer(sign, sign), np.eye(3)) * (values[log][row] @ values[log][row])
        np.testing.assert_allclose(dense(found[name]), expected, rtol=1e-9, atol=1e-12 * expected.max())
        assert found[name].prior is None
    paths = [np.trapezoid(np.linalg.norm(rates[s.log][s.start : s.stop], axis=1), times[s.log][s.start : s.stop]) for s in used]
    np.testing.assert_allclose(dense(found[TURNED]), np.diag(np.repeat(paths, 3)), rtol=1e-9)
    assert (found[TRUTH_RATE].si, found[TRUTH_ACCELERATION].si, found[TURNED].si) == (1e-3, 1e-6, DEG)


# Motion faster than half the data rate.


def thinned_by_hand(problem, floor_too=True):
    """(3, S) rad^2: what every 2nd, 3rd and 4th reading differs by from all, about the table's horizontal axes, over all offsets."""
    square = np.zeros((3, len(problem.batch)))
    for i, segment in enumerate(problem.used):
        count = segment.stop - segment.start
        pad = problem.batch.rate.shape[1]
        dt = problem.batch.dt[i]
        body = problem.batch.rate[i] @ TRUE.E.T + TRUE.B - problem.batch.earth[i]
        level = attitudes_by_scipy(Rotation.from_quat(problem.batch.start[i], scalar_first=True), body, dt).apply(body)[:, :2]
        level[count:] = 0.0
        t = np.append(0.0, np.cumsum(dt))
        whole = np.trapezoid(level, t, axis=0)
        walk = np.mean(problem.logs[segment.log].noise.gyro ** 2) / 2 * t[-1]
        for k, step in enumerate((2, 3, 4)):
            apart = []
            for offset in range(step):
                rows = sorted({0, *range(offset, pad, step), pad - 1})
                apart.append(np.mean((np.trapezoid(level[rows], t[rows], axis=0) - whole) ** 2))
            square[k, i] = max(np.mean(apart) - (step - 1) * walk, 0.0)
    return square


@pytest.mark.parametrize("exponent", [0.999, 1.0, None])
def test_what_is_missed_is_what_fewer_readings_miss_more(exponent, monkeypatch):
    """Every k-th reading differs from all by k^2p - 1 of what all miss, beyond white noise; below p = 1 it is no motion."""
    problem = small_session()
    square = thinned_by_hand(problem)
    if exponent is not None:
        monkeypatch.setattr(components, "thinning_exponent", lambda square: exponent)
    p = exponent or thinning_exponent(square)
    found = undersampling(Twin(problem))
    assert found.exponent == p
    weight = np.array([2.0, 3.0, 4.0]) ** (2 * p) - 1
    predicted = np.sqrt(np.mean(square / weight[:, None], axis=0)) * (p >= 1)
    np.testing.assert_allclose(found.predicted_rad, capped(predicted), rtol=2e-3, atol=1e-12)
    np.testing.assert_allclose(found.missed_rad, np.sqrt(square.mean(axis=1)), rtol=2e-3)
    assert found.rate_hz == pytest.approx(1 / np.median([log.samples.period_s for log in problem.logs]))
    assert found.rms_rad == pytest.approx(np.sqrt(2 * np.mean(found.predicted_rad**2)))
    monkeypatch.setattr(components, "thinning_exponent", lambda square: 0.0)  # noise alone
    none = undersampling(Twin(problem))
    assert (none.rms_rad, none.exponent) == (0.0, 2.0)


def test_white_noise_is_taken_off_what_fewer_readings_miss():
    """Four thousand turns of an alternating rate, which every second reading misses, or takes for a steady one: 23 of 23, or 22 where it
    begins at the first of them.  Noise adds one angle random walk, which is known."""
    rng, turns, rows, hz, missed = np.random.default_rng(0), 4000, 25, 20.0, 1e-5
    rate = np.zeros((turns, rows, 3))
    rate[:, 1:-1] = missed * hz / (rows - 2) * np.where(np.arange(rows - 2) % 2, -1.0, 1.0)[:, None]
    rate[:, 1:-1] += 0.5 * missed / np.sqrt((rows - 2) / hz) * np.sqrt(hz) * rng.normal(size=(turns, rows - 2, 3))
    level = np.tile([1.0, 0, 0, 0], (turns, 1))
    batch = Batch(rate, np.full((turns, rows - 1), 1 / hz), np.zeros_like(rate), level, level, False)
    walk = Noise(np.full(3, 0.5 * missed / np.sqrt((rows - 1) / hz) * np.sqrt(2)), np.zeros(3))
    problem = SimpleNamespace(first=lambda measured: measured, logs=[SimpleNamespace(noise=walk, samples=SimpleNamespace(period_s=1 / hz))])
    twin = SimpleNamespace(batch=batch, problem=problem, segments=[SimpleNamespace(log=0, start=0, stop=rows)] * turns)
    assert undersampling(twin).missed_rad[0] == pytest.approx(missed * np.sqrt((1 + (22 / 23) ** 2) / 2), rel=0.015)


def test_the_data_rate_that_is_needed_follows_the_law():
    """An error four times too large that falls as the square of the rate asks for twice the rate."""
    found = Undersampling(np.array([3.0, 4.0]), 2.0, np.zeros(3), 100.0)
    assert found.rate_needed_hz(0.4, 0.1) == pytest.approx(200)
    assert found.rate_needed_hz(0.0, 0.1) == pytest.approx(1e-4)
    assert found.rms_rad == pytest.approx(5.0)


# The noise of one session.


def noise_of(sizes, *, n=6, priors=(None, None, None), names=(TURN, STILL_RATE, WANDER), usual=(1.0, 1.0, 1.0)) -> SessionNoise:
    """Diagonal components of the first three rows, the next two, and a dense one of all."""
    V = [np.diag([1.0, 1, 1, 0, 0, 0]), np.diag([0.0, 0, 0, 1, 1, 0]), np.full((n, n), 0.5) + np.eye(n)]
    V = [Sparse.of(V[0]), Sparse.of_diagonal(np.diag(V[1])), V[2]]
    made = zip(names, V, usual, priors, strict=False)
    parts = tuple(Component(name, each, size, "deg", DEG, f"it is {name}", prior) for name, each, size, prior in made)
    return SessionNoise(parts, [np.arange(n)], NOTHING, np.array(sizes), np.array([0.1 * DEG, np.inf, 0.0]))


def test_the_covariance_is_the_sum_of_squares_times_components():
    noise = noise_of([2.0, 3.0, 0.5])
    expected = np.diag([4.0, 4, 4, 9, 9, 0]) + 0.25 * (0.5 + np.eye(6))
    np.testing.assert_allclose(noise.covariance, expected)
    np.testing.assert_allclose(replace(noise, s=np.array([0.0, 3.0, 0.0])).covariance, np.diag([0.0, 0, 0, 9, 9, 0]))
    assert [noise.size(name) for name in (TURN, STILL_RATE, WANDER, REFERENCE)] == [2.0, 3.0, 0.5, 0.0]
    left = noise.without(STILL_RATE)
    assert [c.name for c in left.components] == [TURN, WANDER]
    np.testing.assert_array_equal(left.s, [2.0, 0.5])
    np.testing.assert_array_equal(left.sigma, [0.1 * DEG, 0.0])


def test_it_is_told_in_its_units():
    noise = noise_of([2.0 * DEG, 0.0, 0.5 * DEG])
    assert noise.words == "it is noise.turn 2 deg; it is noise.bias_wander 0.5 deg"
    assert noise_of([0.0, 0.0, 0.0]).words == "none"
    first, second, _ = noise.to_json()
    assert first == {
        "name": TURN, "size": pytest.approx(2.0), "sigma": pytest.approx(0.1), "unit": "deg", "description": "it is noise.turn",
    }  # fmt: skip
    assert (second["size"], second["sigma"]) == (0.0, None)


@pytest.mark.parametrize(
    ("name", "limit"), [(TURN, 2.0), (STILL_RATE, 2.0), (UNDERSAMPLED, np.exp(0.8)), (WANDER, 3.0 * np.exp(3 * 0.4)), (REFERENCE, np.inf)]
)
def test_noise_is_unusual_above_its_limit(name, limit):
    """A turn's or a still's above white noise, the undersampling above two of its spreads, the wander above three."""
    for times, unusual in ((0.999, False), (1.0, False), (1.001, limit < np.inf)):
        s = times * min(limit, 1e3)
        noise = noise_of([s, 0.0, 0.0], names=(name, "a", "b"), usual=(2.0, 1.0, 1.0), priors=(Prior(3.0, 0.4), None, None))
        assert bool(noise.unusual) is bool(unusual)
    free = noise_of([1e3, 0.0, 0.0], names=(WANDER, "a", "b"))
    assert free.unusual  # no MEMS gyroscope drifts so
    at = UNKNOWN_WANDER_RPS * np.exp(3 * UNKNOWN_SPREAD)  # where nothing is known of this one: 900 °/h
    assert [noise_of([times * at, 0.0, 0.0], names=(WANDER, "a", "b")).unusual for times in (0.999, 1.001)] == [False, True]


def absent(rows):
    """A component that these rows do not show."""
    return Component(REFERENCE, Sparse.of_diagonal(rows), 1.0, "mg", MG, "", None)


def test_the_p_value_of_unusual_noise_is_the_likelihood_ratios():
    """Of all large ones together, each on the edge half the time.  By hand: variances of single rows."""
    r = np.array([3.0, -2.0, 2.5, 2.2, -3.3, 1.0])
    noise = noise_of([1.0, 1.0], names=(TURN, STILL_RATE), priors=(None, None))
    noise = replace(noise, components=(*noise.components, absent(np.eye(6)[5])), s=np.ones(3), sigma=np.zeros(3))
    noise = noise.estimated(SimpleNamespace(white=np.eye(6)), r, np.zeros((6, 1)), steps=60)
    assert np.isnan(noise.sigma).all()  # unless asked for

    def gain(rows):  # -2 log L of white noise and as much of the component, a variance of 2, less the least of it
        def value(v):
            return len(r[rows]) * np.log(v) + r[rows] @ r[rows] / v

        return value(2.0) - minimize_scalar(value, bounds=(1, 50)).fun

    gains = [gain(slice(0, 3)), gain(slice(3, 5))]
    assert noise.unusual
    expected = chi2.sf(sum(gains), 1) / 2 + chi2.sf(sum(gains), 2) / 4
    assert noise.unusual_p(np.eye(6), r, np.zeros((6, 1))) == pytest.approx(expected, rel=1e-3)
    only = replace(noise, s=np.array([noise.s[0], 0.5, 0.0]))
    assert only.unusual_p(np.eye(6), r, np.zeros((6, 1))) == pytest.approx(expected, rel=1e-3)  # what grows beside it is held, too
    small = replace(noise, s=np.array([0.9, 0.9, 0.0]))
    assert small.unusual_p(np.eye(6), r, np.zeros((6, 1))) == 1.0
    # Each counts from its own limit on; where the value is no gain, with the ways in which any is there.
    for name, limit in ((TURN, 2.0), (STILL_RATE, 2.0), (UNDERSAMPLED, np.exp(0.8))):
        for times, p in ((0.999, 0.5), (1.001, 0.75)):
            both = noise_of([times * limit, 100.0, 0.0], names=(name, TURN if name != TURN else STILL_RATE, "a"), usual=(2.0, 1.0, 1.0))
            assert replace(both, value=1e9).unusual_p(np.eye(6), 0.1 * r, np.zeros((6, 1))) == p


@pytest.mark.parametrize(("prior", "limit"), [(Prior(1.0, 0.5), np.exp(1.5)), (None, UNKNOWN_WANDER_RPS * np.exp(3 * UNKNOWN_SPREAD))])
def test_a_drift_is_held_against_the_largest_that_such_a_sensor_has(prior, limit):
    """By hand: the likelihood with it at its limit, the prior's cost with it; also where it grows beyond it once a turn's is held."""
    white = limit**2 * np.eye(6)
    V, r = np.full((6, 6), 0.5) + np.eye(6), 4 * limit * np.array([3.0, -2.0, 2.5, 2.2, -3.3, 1.0])

    def value(s, of_turns=0.0):
        C = white + (s**2 + of_turns**2) * V
        return np.linalg.slogdet(C)[1] + r @ np.linalg.solve(C, r) + (0.0 if prior is None else (np.log(s) / 0.5) ** 2)

    best = minimize_scalar(value, bounds=(limit, 1e3 * limit), method="bounded", options={"xatol": 1e-6 * limit})
    drift = Component(WANDER, V, limit, "deg", DEG, "", prior)
    alone = SessionNoise((absent(1e-9 * np.ones(6)), drift), [np.arange(6)], NOTHING, np.array([0.0, best.x]), np.zeros(2), best.fun)
    gain = value(limit) - best.fun
    assert alone.unusual_p(white, r, np.zeros((6, 1))) == pytest.approx(chi2.sf(gain, 1) / 2, rel=0.01)
    turns = replace(drift, name=TURN, V=Sparse.of(V), prior=None)
    both = replace(alone, components=(*alone.components, turns), s=np.array([0.0, 0.9 * limit, 9 * limit]), sigma=np.zeros(3))
    gain = value(limit, limit) - best.fun
    assert both.unusual_p(white, r, np.zeros((6, 1))) == pytest.approx(chi2.sf(gain, 1) / 2 + chi2.sf(gain, 2) / 4, rel=0.01)


def test_one_component_does_not_hide_another_that_may_take_its_place():
    """Of the same rows: either alone can go without a loss, and the rows are forty times as scattered as white noise."""
    r = np.random.default_rng(4).normal(size=40) * 6.3
    V = Sparse.of_diagonal(np.ones(40))
    parts = (*(Component(name, V, 1.0, "deg", DEG, "", None) for name in (TURN, STILL_RATE)), absent(1e-6 * np.ones(40)))
    noise = SessionNoise(parts, [np.arange(40)], NOTHING, np.array([4.0, 4.0, 0.0]), np.zeros(3))
    noise = noise.estimated_beside(np.eye(40), r, np.zeros((40, 1)), noise.s, steps=60)
    assert len(noise.beyond) == 2
    one = noise.without(TURN).estimated_beside(np.eye(40), r, np.zeros((40, 1)), steps=60)
    assert one.value - noise.value < 0.1
    assert noise.unusual_p(np.eye(40), r, np.zeros((40, 1))) < 1e-20


def test_a_long_session_is_cut_into_blocks_of_turns_with_the_stills_before_them(monkeypatch):
    twin = Twin(small_session())
    whiten = Whitener(twin)

    def blocks(most):
        monkeypatch.setattr(components, "BLOCK", most)
        return first_noise(twin, whiten, NOTHING).blocks

    def rows(turns, stills):
        return [*(2 * t + i for t in turns for i in (0, 1)), *(14 + 3 * q + i for q in stills for i in range(3)), *(41 + q for q in stills)]

    assert components.BLOCK == 60
    assert [len(blocks(most)) for most in (6, 7)] == [2, 1]
    expected = [rows([0, 1], [0, 1]), rows([2, 3, 4], [2, 3, 4, 5]), rows([5, 6], [6, 7, 8])]
    assert [block.tolist() for block in blocks(3)] == expected


def test_before_any_fit_the_noise_is_what_is_known_of_the_bias():
    problem = small_session()
    twin = Twin(problem)
    found = first_noise(twin, Whitener(twin), NOTHING)
    np.testing.assert_array_equal(found.s, [20 * DPH, 0, 0, 0])
    np.testing.assert_array_equal(found.sigma, np.zeros(4))
    np.testing.assert_allclose(known_whitener(twin).covariance, Whitener(twin).white + found.covariance, atol=1e-15)
    assert first_noise(twin, Whitener(twin)).missed.rms_rad == undersampling(twin).rms_rad


def test_the_last_three_whiteners_are_kept():
    twin = Twin(small_session())
    held = Whiteners(twin)
    base = first_noise(twin, held.white, NOTHING)
    noises = [replace(base, s=base.s * k) for k in range(1, 5)]
    first, second, third = (held.of(noise) for noise in noises[:3])
    np.testing.assert_allclose(second.covariance, held.white.white + noises[1].covariance, atol=1e-15)
    assert len(held) == 3
    assert held.of(noises[0]) is first  # and is now the last one used
    held.of(noises[3])
    assert len(held) == 3
    assert held.of(noises[0]) is first
    assert held.of(noises[2]) is third
    assert held.of(noises[1]) is not second
