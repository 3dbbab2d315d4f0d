"""The covariance that a fit states is the sum of its sources, and each source is what it says."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG, broad
from small_sessions import small_session
from test_floor import DIAL_RAD, made
from test_stated_noise import loud, under

from session.detect.stills import BLOCK_S, NOISE_BLOCKS, _allan_steps
from session.io.units import DEG_PER_HOUR
from tinygc.closure.floor import (
    ACCEL_NOISE,
    DIALS,
    GYRO_NOISE,
    SINGLE_SEGMENTS,
    STOPS,
    UNKNOWN_RAD2,
    BiasInstability,
    allan_freedom,
    closure_floor,
    gyro_variance,
    still_tilt_variance,
)
from tinygc.closure.residual import attitudes, directions
from tinygc.closure.uncertainty import BIAS_DRIFT, EARTH, covariance_parts, parameter_covariance
from tinygc.estimation import assembly
from tinygc.estimation.assembly import CLOCK, LOT, MISFIT, ROUNDING, stated_uncertainty
from tinygc.estimation.options import FitOptions
from tinygc.estimation.sources import freedom_of, total
from tinygc.estimation.stated_noise import (
    CALIBRATION,
    COMPONENTS,
    channel_sources,
    kind_of,
    rounding_covariance,
    stated_covariance,
    stated_sources,
)
from tinygc.models.linear import LinearModel
from tinygc.noise.components import REFERENCE, STILL_RATE, TURN, WANDER

PLAIN = FitOptions(methods=("least_squares",))
NOISE_OF_TEST = SimpleNamespace(angle_random_walk=np.array([1e-4, 2e-4, 3e-4]), velocity_random_walk=np.array([1e-3, 2e-3, 3e-3]))


def floor_of(kind):
    batch, ends = made(kind)
    at = attitudes(batch, batch.rate)
    return batch, ends, at, closure_floor(batch, at, ends, [NOISE_OF_TEST] * len(batch), DIAL_RAD)


@pytest.mark.parametrize("kind", ["tilt", "yaw", "known"])
def test_a_floor_is_the_sum_of_its_causes(kind):
    """The gyroscope's noise is its own of each segment; the accelerometer's tilts both ends; dials and stops have their sigmas."""
    batch, ends, at, floor = floor_of(kind)
    parts = floor.parts
    assert [*parts] == [GYRO_NOISE, ACCEL_NOISE, *{"tilt": [], "yaw": [DIALS], "known": [STOPS]}[kind]]
    np.testing.assert_allclose(sum(part.dense() for part in parts.values()), floor.dense(), rtol=1e-12, atol=0)
    axes, d = directions(batch, at[:, -1]), batch.angles
    gyro = (axes @ gyro_variance(batch, at, [NOISE_OF_TEST] * len(batch)) @ axes.transpose(0, 2, 1))[:, :d, :d]
    np.testing.assert_allclose(parts[GYRO_NOISE].own, gyro, rtol=1e-9, atol=1e-20)
    assert np.abs(parts[GYRO_NOISE].shared).max() < 1e-20
    each = np.array([[still_tilt_variance(still, NOISE_OF_TEST) for still in pair] for pair in ends])
    np.testing.assert_allclose(parts[ACCEL_NOISE].own[:, 0, 0], each.sum(axis=1))
    np.testing.assert_allclose(parts[ACCEL_NOISE].shared[:, 1, 1], [-each[0, 1], 0.0])  # the third turn begins with a still of its own
    if kind == "yaw":
        np.testing.assert_allclose(parts[DIALS].own[:, 2, 2], 2 * DIAL_RAD**2)
        np.testing.assert_allclose(parts[DIALS].shared[:, 2, 2], [-(DIAL_RAD**2), 0.0])
    if kind == "known":
        expected = np.where(batch.turns.known, np.nan_to_num(batch.turns.sigma_rad) ** 2, UNKNOWN_RAD2)
        np.testing.assert_allclose(parts[STOPS].own[:, 2, 2], expected)


def test_what_is_known_less_of_one_segment_is_a_cause_and_scales_with_it():
    _, _, _, floor = floor_of("yaw")
    more = np.array([0.0, 1e-6, 0.0])[:, None, None] * np.eye(3)
    wider = floor.widened(more).scaled(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(wider.parts[SINGLE_SEGMENTS].own, 4 * more)
    np.testing.assert_allclose(wider.parts[DIALS].own[:, 2, 2], 2 * DIAL_RAD**2 * np.array([1, 4, 9]))
    np.testing.assert_allclose(wider.parts[DIALS].shared[0, 2, 2], -2 * DIAL_RAD**2)
    np.testing.assert_allclose(sum(part.dense() for part in wider.parts.values()), wider.dense(), rtol=1e-12, atol=0)


@pytest.mark.parametrize("source", ["given", "estimated", "unknown"])
def test_the_parts_of_a_covariance_add_up_to_it(source):
    problem = under(small_session(kind="tilt"), source)
    given = (problem.batch, problem.floor, problem.first, problem.earth, problem.still_rates)
    parts = covariance_parts(*given, problem.wander)
    np.testing.assert_array_equal(sum(parts.values(), np.zeros((12, 12))), parameter_covariance(*given, problem.wander))
    assert (EARTH in parts) == (source != "given")
    without = parameter_covariance(*given)
    np.testing.assert_allclose(parts[BIAS_DRIFT], parameter_covariance(*given, problem.wander) - without, rtol=1e-6, atol=1e-22)


def test_the_sources_of_the_channels_are_its_noise():
    """White noise by its cause, each component with its size, the Earth's rate, the accelerometer's calibration: the whole covariance."""
    problem = under(small_session(kind="yaw"), "estimated")
    noise = loud(problem)
    sources = {source.name: source for source in channel_sources(problem, noise)}
    names = [GYRO_NOISE, *(COMPONENTS[name] for name in (WANDER, STILL_RATE, REFERENCE, TURN)), SINGLE_SEGMENTS, EARTH, CALIBRATION]
    assert sorted(sources) == sorted(names)
    earth = sources.pop(EARTH).covariance
    np.testing.assert_allclose(total(sources.values()), noise.covariance, rtol=1e-9, atol=1e-22)
    assert np.linalg.matrix_rank(earth / earth.max(), tol=1e-9) == 1  # across an estimated heading
    lengths = len(noise.twin.stills)
    assert np.diag(sources[SINGLE_SEGMENTS].covariance)[noise.closure].all()
    assert not np.diag(sources[SINGLE_SEGMENTS].covariance)[noise.closure.stop :].any()
    np.testing.assert_array_equal(np.diag(sources[COMPONENTS[REFERENCE]].covariance)[-lengths:], noise.noise.size(REFERENCE) ** 2)


def test_a_length_of_gravity_has_the_accelerometers_noise():
    """A floor that knows its references gives the accelerometer what the lengths of gravity scatter by, and the gyroscope none of it."""
    problem = small_session(kind="tilt")
    accel = replace(problem.floor, own=0.2 * problem.floor.own, shared=0.5 * problem.floor.shared, wider=None)
    problem = problem.changed(floor=replace(problem.floor, references={ACCEL_NOISE: accel}))
    noise = loud(problem)
    sources = {source.name: source.covariance for source in noise.sources()}
    lengths, closure = slice(-len(noise.twin.stills), None), noise.closure
    np.testing.assert_array_equal(sources[ACCEL_NOISE][lengths, lengths], noise.white[lengths, lengths])
    np.testing.assert_allclose(sources[ACCEL_NOISE][closure, closure], accel.dense())
    assert not sources[GYRO_NOISE][lengths, lengths].any()


def test_a_calibration_from_its_own_stills_has_the_freedom_that_they_leave():
    """Nine numbers of gravity's length in so many stills: what is left, and at least one; one that was given is taken as known."""
    problem = under(small_session(kind="tilt"), "given")
    noise = loud(problem)

    def calibration(matrix):
        config = problem.session.config
        config = replace(config, accelerometer=replace(config.accelerometer, matrix=matrix))
        changed = problem.changed(session=SimpleNamespace(**{**vars(problem.session), "config": config}))
        return next(source for source in channel_sources(changed, noise) if source.name == CALIBRATION)

    upper = np.eye(3) + np.triu(np.full((3, 3), 1e-3), 1)
    own, given = calibration(upper), calibration(np.eye(3))
    assert (own.kind, own.freedom) == ("A", max(1.0, len(noise.twin.stills) - 9.0))
    assert (given.kind, given.freedom) == ("B", np.inf)


def test_each_source_is_the_response_to_its_errors():
    """L C L' of each; the calibration's part is the one that sessions share."""
    problem = under(small_session(kind="tilt"), "unknown")
    noise, model = loud(problem), problem.first
    sources = stated_sources(problem, model, noise, False)
    whole, shared = stated_covariance(problem, model, noise, False)
    np.testing.assert_array_equal(total(sources), whole)
    np.testing.assert_array_equal(shared, next(each.covariance for each in sources if each.name == CALIBRATION))
    quiet = replace(noise, noise=replace(noise.noise, s=np.where([c.name == TURN for c in noise.noise.components], 0.0, noise.noise.s)))
    turn = next(each.covariance for each in sources if each.name == COMPONENTS[TURN])
    difference = whole - stated_covariance(problem, model, quiet, False)[0]
    sigma = np.sqrt(np.diag(turn))
    np.testing.assert_allclose(turn / np.outer(sigma, sigma), difference / np.outer(sigma, sigma), atol=1e-6)


# Kinds and degrees of freedom.


def test_degrees_of_freedom_of_a_size_with_a_sigma():
    """GUM G.4.2: a relative standard uncertainty of 25 % has eight; a tenth of a degree of freedom is none."""
    assert freedom_of(4.0, 1.0) == pytest.approx(8.0)
    assert freedom_of(1.0, 0.0) == np.inf
    assert freedom_of(1.0, 10.0) == 1.0


def test_white_noise_has_the_degrees_of_freedom_that_its_estimates_scatter_with():
    """The variance from overlapping differences of three blocks, as the stills give it: var = 2 mean^2 / freedom."""
    count, blocks = 4000, 30
    rng = np.random.default_rng(1)
    each = [np.mean(_allan_steps(rng.normal(size=(blocks, 3)), NOISE_BLOCKS) ** 2, axis=0) for _ in range(count)]
    scatter = 2 * np.mean(each) ** 2 / np.var(each)
    assert allan_freedom(blocks + 1, NOISE_BLOCKS) == pytest.approx(scatter, rel=0.1)
    stills = [SimpleNamespace(duration_s=blocks * BLOCK_S)] * 5 + [SimpleNamespace(duration_s=0.3)]
    problem = SimpleNamespace(stills=stills)
    assert kind_of(GYRO_NOISE, problem) == ("A", pytest.approx(5 * allan_freedom(blocks + 1, NOISE_BLOCKS)))
    assert kind_of(ACCEL_NOISE, SimpleNamespace(stills=[])) == ("A", np.inf)
    assert kind_of(DIALS, problem) == ("B", np.inf)


@pytest.mark.parametrize(
    ("instability", "kind", "freedom"),
    [
        (BiasInstability(1.0, "typical of X"), "B", 1.0),  # a spread of 0.8: 1 / 0.8^2 / 2, and one at least
        (BiasInstability(1.0, "given"), "B", 50.0),
        (BiasInstability(1.0, "estimated from this recording", 0.2, 2.0, of_unit=True), "A", 12.5),
    ],
)
def test_the_drift_has_the_spread_of_what_tells_it(instability, kind, freedom):
    assert kind_of(BIAS_DRIFT, SimpleNamespace(instability=instability)) == (kind, pytest.approx(freedom))


# From the sources to what a fit states.


def plain_session(**more):
    """A problem of one session, without registers or a lot."""
    problem = small_session(kind="tilt", **more)
    return problem.changed(session=SimpleNamespace(folder="made", config=problem.session.config, clock=None, truths=None))


def stated_with(monkeypatch, problem, noise, widened=1.0, lot=None):
    found = SimpleNamespace(freedom=20, excess=widened)
    monkeypatch.setattr(assembly, "require_plausible", lambda *given: None)
    monkeypatch.setattr(assembly, "stated_goodness", lambda *given: (found, widened))
    monkeypatch.setattr(assembly, "goodness", lambda *given: found)
    return stated_uncertainty(problem, problem, problem.first, noise, PLAIN, lot)


@pytest.mark.parametrize("estimated", [True, False])
def test_a_misfit_is_a_source_of_its_own(monkeypatch, estimated):
    """(f - 1) times the rest; its variance is known by that of f = chi-square / nu: sigma f sqrt(2 / nu), so nu ((f - 1) / f)^2."""
    problem = plain_session()
    noise = loud(problem) if estimated else None
    plain, wide = (stated_with(monkeypatch, problem, noise, widened) for widened in (1.0, 2.5))
    assert [source.name for source in wide.sources if source.name not in {each.name for each in plain.sources}] == [MISFIT]
    misfit = next(source for source in wide.sources if source.name == MISFIT)
    rest = total([source for source in plain.sources if source.name != ROUNDING])
    np.testing.assert_allclose(misfit.covariance, 1.5 * rest, rtol=1e-12)
    assert (misfit.kind, misfit.freedom) == ("A", pytest.approx(20 * (1.5 / 2.5) ** 2))
    np.testing.assert_array_equal(wide.parts["covariance"], total(wide.sources))
    if estimated:
        np.testing.assert_allclose(wide.accelerometer, 2.5 * plain.accelerometer, rtol=1e-12)


def test_clock_lot_and_rounding_are_added_as_they_are(monkeypatch):
    """Not inflated: no misfit of the closure shows them."""
    problem = plain_session()
    covariance = np.diag(np.arange(1.0, 13.0)) * 1e-8
    problem.session.clock = SimpleNamespace(covariance=lambda vector: 4e-6 * np.outer(vector, vector))
    monkeypatch.setattr(assembly, "rounding_covariance", lambda problem, model: 3 * covariance)
    found = stated_with(monkeypatch, problem, loud(problem), 2.0, SimpleNamespace(more=covariance))
    sources = {source.name: source for source in found.sources}
    assert [*sources][-3:] == [ROUNDING, LOT, CLOCK]
    np.testing.assert_array_equal(sources[ROUNDING].covariance, 3 * covariance)
    np.testing.assert_array_equal(sources[LOT].covariance, covariance)
    np.testing.assert_array_equal(sources[CLOCK].covariance, 4e-6 * np.outer(problem.first.vector, problem.first.vector))
    assert {sources[name].freedom for name in (ROUNDING, LOT, CLOCK)} == {np.inf}


def test_a_source_that_is_not_there_is_left_out(monkeypatch):
    problem = plain_session()
    found = stated_with(monkeypatch, problem, loud(problem))
    assert not rounding_covariance(problem, problem.first).any()
    assert ROUNDING not in [source.name for source in found.sources]


@pytest.mark.parametrize(
    "options",
    [
        {},
        broad({"accelerometer": "given", "bias": "ends"}),
        broad({"accelerometer": "fit", "still_rates": True}),
        broad({"bias_per_log": True}),
    ],
    ids=["auto", "given", "fitted", "days"],
)
def test_a_fits_covariance_is_the_sum_of_its_sources_to_the_bit(simulated_fit, options):
    result = simulated_fit(**options)
    np.testing.assert_array_equal(total(result.sources), result.covariance)
    assert isinstance(result.linear.model, LinearModel)
    if result.joint_covariance is not None:
        np.testing.assert_array_equal(result.joint_covariance[9:, 9:], result.covariance)
    for source in result.sources:
        assert np.linalg.eigvalsh(source.covariance / np.abs(source.covariance).max()).min() > -1e-9, source.name


@pytest.fixture(scope="module")
def simulated_fit():
    import tinygc

    session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=3).session
    return lambda **options: tinygc.fit(session, methods=("least_squares",), **options).result


def test_the_drift_of_a_simulated_session_is_in_its_sources(simulated_fit):
    """The sizes are the session's: 3 deg/h within the prior's spread of one half."""
    result = simulated_fit()
    size = result.noise.noise.size(WANDER) / DEG_PER_HOUR
    assert 1.0 < size < 9.0
    names = [source.name for source in result.sources]
    assert {GYRO_NOISE, ACCEL_NOISE, BIAS_DRIFT} <= set(names)
    assert len(names) == len(set(names))
    assert result.covariance[9, 9] ** 0.5 < 0.01 * DEG
