"""By how much a filter's densities are to be inflated: each term against its formula, and factors injected and recovered."""

import json
from dataclasses import replace

import numpy as np
import pytest
from noise_records import axis, figures, sensor
from scipy.optimize import brentq

from session.base import rotation
from session.base.errors import DataError, FormatError
from session.base.records import table_of
from session.base.units import DEG, DEG_PER_HOUR
from session.log.folder import read_session
from tinygc.closure import residual
from tinygc.estimation.options import FitOptions
from tinygc.features.noise.inflation import (
    _MISALIGNMENT,
    _UNDERSAMPLING,
    _UNNAMED,
    LONGEST_S,
    SCALE,
    _back_and_forth,
    at_rest,
    inflations,
    inflations_of_folder,
    one_way,
    walk_density,
)
from tinygc.fitting.fit import fit_session
from tinygc.fitting.fit_file import save_models
from tinygc.inference.choose import ONE_SIDED
from tinygc.models.linear import LinearModel
from tinygc.noise.figures import FILE, AxisNoise, Term
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

N = 1e-4
OPTIONS = SimulationOptions(segments=8, closure_s=0.0, odr_hz=104.0, seed=3)


# The walk at rest.


@pytest.mark.parametrize(
    ("terms", "walk"),
    [
        ({"K": 1e-5}, 1e-5),
        ({"B": 1e-4}, 2 * np.log(2) / np.pi * np.sqrt(3) * 1e-8 / N),  # its Allan variance where white noise ceases to hide it
        ({"K": 1.0}, 1.0),  # which shows at once
        ({"R": 1e-7}, 1e-7 * np.sqrt(1.5 * LONGEST_S)),
        ({"R": 1e-10}, 1e-10 * np.sqrt(1.5 * LONGEST_S)),  # which white noise hides
        ({"Q": 1e-6}, 0.0),
    ],
)
def test_the_walk_of_one_term(terms, walk):
    assert walk_density(axis(**terms), N) == pytest.approx(walk, rel=1e-9)


@pytest.mark.parametrize("terms", [{"K": 1e-6, "B": 2e-5}, {"G": 3e-4, "tau_s": 20.0}, {"G": 1e-5, "B": 1e-6, "R": 1e-8, "tau_s": 0.3}])
def test_the_walk_covers_all_slow_terms_that_are_seen_and_no_more(terms):
    slow_axis = axis(**terms)

    def slow(tau_s):
        return sum(slow_axis.allan_variance(tau_s, name) for name in "GBKR")

    first_s = brentq(lambda tau_s: slow(tau_s) * tau_s - N**2, 0.01, LONGEST_S)
    tau_s = np.geomspace(first_s, LONGEST_S, 5000)
    assert walk_density(slow_axis, N) ** 2 == pytest.approx(np.max(3 * slow(tau_s) / tau_s), rel=2e-4)


def test_slow_terms_that_are_not_told_apart_count_as_the_sets_that_have_one_of_them():
    """One set of terms has B, another K: the Allan variance is the mean of both."""
    B, K, share = 1e-5, 1e-6, 0.2
    of = {name: Term(w * size, np.sqrt(w - w**2) * size, w, 2 * size) for name, size, w in (("B", B, share), ("K", K, 1 - share))}
    apart = AxisNoise({**axis().terms, **of})
    tau_s = np.geomspace(0.02, LONGEST_S, 50)
    both = [axis(B=B).allan_variance(tau_s), axis(K=K).allan_variance(tau_s)]
    np.testing.assert_allclose(apart.allan_variance(tau_s), share * both[0] + (1 - share) * both[1])
    assert walk_density(apart, N) == pytest.approx(walk_density(axis(B=np.sqrt(share) * B, K=np.sqrt(1 - share) * K), N))


def test_the_angle_of_motion_is_the_integral_of_its_autocorrelation():
    rate, c = 1.3, 0.4
    assert one_way(rate, 4.0) * 4.0 == pytest.approx((rate * 4.0) ** 2)
    for window_s in (0.05, 9.0):  # lags t from -T to T, each T - |t| long
        t = (np.arange(2000) + 0.5) * window_s / 2000
        expected = 2 * rate**2 * np.mean((window_s - t) * np.exp(-t / c)) * window_s
        assert _back_and_forth(rate, c, window_s) * window_s == pytest.approx(expected, rel=1e-5)


def test_at_rest_nothing_is_inflated_but_the_walk():
    found = at_rest(figures(sensor(axis(N=N, K=1e-6), axis(N=N, B=1e-5), axis(N=N)), None))
    assert found.white.tolist() == [1.0, 1.0, 1.0]
    assert found.walk.tolist() == pytest.approx([1.0, 1.0, 1.0])  # no factor without a K
    assert found.walk_density.tolist() == pytest.approx([1e-6, 2 * np.log(2) / np.pi * np.sqrt(3) * 1e-10 / N, 0.0])
    assert found.parts == {}
    with pytest.raises(DataError, match=r"no N on gyroscope axis y.*record a longer rest"):
        at_rest(figures(sensor(axis(N=N), axis(Q=1e-6), axis(N=N)), None))


# A session.


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_session(OPTIONS, tmp_path_factory.mktemp("session") / "unit")


@pytest.fixture(scope="module")
def result(folder):
    return fit_session(folder, FitOptions(methods=("least_squares",)))


@pytest.fixture(scope="module")
def rest():
    return figures(sensor(axis(N=OPTIONS.gyro_noise_dps_rthz * DEG / np.sqrt(2), B=3 * DEG_PER_HOUR)), None)


def bare(result, elements=(), **more):
    """The fit with these variances of the matrix and the bias alone: place of twelve -> variance, SI; more: of its noise."""
    covariance = np.zeros((12, 12))
    for place, variance in dict(elements).items():
        covariance[place, place] = variance
    return replace(result, covariance=covariance, allowed=None, noise=replace(result.noise, noise=replace(result.noise.noise, **more)))


@pytest.mark.parametrize("part", [SCALE, _MISALIGNMENT])
def test_a_part_of_the_matrix_is_the_square_of_the_turns_errors_that_it_makes(result, rest, part):
    sigma = 2e-3
    i, j = (1, 1) if part == SCALE else (1, 2)
    # The same by integration: the turn's end with and without the error.
    batch, model = result.problem.batch, result.linear.model
    step = 1e-5
    wrong = model.E.copy()
    wrong[i, j] += step
    ends = [residual.end_attitude(batch, each(batch.rate)) for each in (model, LinearModel(wrong, model.B))]
    apart = rotation.log(rotation.multiply(rotation.conjugate(ends[0]), ends[1])) / step
    added = sigma**2 * np.mean(np.sum(apart**2, axis=1)) / np.mean(batch.duration_s)
    _, turns, _, _ = inflations(bare(result, {3 * i + j: sigma**2}), rest)
    expected = np.ones(3)
    expected[i] = np.sqrt(1 + added / rest.gyro.values("N")[i] ** 2)
    assert turns.parts[part] == pytest.approx(expected, rel=1e-3)
    assert expected[i] > 3


def test_a_scale_factor_on_other_motion_by_hand(result, rest):
    _, _, slow, both = inflations(bare(result, {0: 1e-6, 1: 4e-6}), rest)  # E_xx, E_xy: both are of axis x
    window_s, white = np.mean(result.problem.batch.duration_s), rest.gyro.values("N")[0]
    third = (10 * DEG) ** 2 * window_s / 3
    assert slow.parts[SCALE][0] == pytest.approx(np.sqrt(1 + 1e-6 * third / white**2))
    assert slow.parts[_MISALIGNMENT][0] == pytest.approx(np.sqrt(1 + 4e-6 * third / white**2))
    assert slow.parts[SCALE][1:].tolist() == [1.0, 1.0]
    # The rate over the turns, and half a second.
    model, batch = result.linear.model, result.problem.batch
    squares = np.concatenate([np.sum(model(rate[:-1][dt > 0]) ** 2, axis=1) for rate, dt in zip(batch.rate, batch.dt, strict=True)])
    third = np.mean(squares) / 3 * 2 * 0.5 * (1 - 0.5 / window_s * (1 - np.exp(-window_s / 0.5)))
    assert both.parts[SCALE][0] == pytest.approx(np.sqrt(1 + 1e-6 * third / white**2), rel=1e-6)


def test_parts_add_up_in_squares_and_the_limit_lies_above(result, rest):
    assert len(inflations(replace(result, noise=None), rest)) == 1  # at rest alone
    for found in inflations(result, rest):
        total = 1 + sum((part**2 - 1 for part in found.parts.values()), np.zeros(3))
        assert found.white**2 == pytest.approx(total)
        assert np.all(found.at_most >= found.white)
        assert found.white_density == pytest.approx(found.white * rest.gyro.values("N"))


def with_noise(result, **sizes):
    """The fit with noise components of these sizes (size, sigma), SI."""
    names = [component.name.partition(".")[2] for component in result.noise.noise.components]
    s, sigma = (np.array([sizes.get(name, (0.0, 0.0))[k] for name in names]) for k in (0, 1))
    return bare(result, s=s, sigma=sigma)


def test_the_unnamed_is_what_each_turn_errs_by_over_its_duration(result, rest):
    size, sigma = 4e-4, 1e-4
    _, turns, slow, _ = inflations(with_noise(result, turn=(size, sigma)), rest)
    white, window_s = rest.gyro.values("N"), np.mean(result.problem.batch.duration_s)
    expected = np.sqrt(1 + size**2 / window_s / white**2)
    assert turns.parts[_UNNAMED] == pytest.approx(expected)
    assert slow.parts[_UNNAMED] == pytest.approx(expected)
    # A square of a normal variable: its variance is 4 m^2 s^2 + 2 s^4.
    of_square = np.sqrt(4 * size**2 * sigma**2 + 2 * sigma**4) / window_s / white**2
    assert turns.white_sigma == pytest.approx(of_square / (2 * turns.white))
    assert turns.at_most**2 - turns.white**2 == pytest.approx(ONE_SIDED * of_square)


def test_the_drift_of_the_session_replaces_the_flicker_at_rest(result, rest):
    rest, turns, _, _ = inflations(with_noise(result, bias_wander=(30 * DEG_PER_HOUR, 0.0)), rest)
    assert turns.walk_density == pytest.approx(100 * rest.walk_density)


def test_undersampling_is_its_factor_times_what_is_predicted(result, rest):
    noise = result.noise.noise
    missed = replace(noise.missed, predicted_rad=np.full(len(result.problem.batch), 2e-4))
    kind = next(c for c in noise.components if c.name == "noise.turn")
    components = (replace(kind, name="motion.undersampled"),)
    undersampled = bare(result, components=components, s=np.array([1.5]), sigma=np.array([np.nan]), missed=missed)
    _, turns, slow, both = inflations(undersampled, rest)
    window_s = np.mean(result.problem.batch.duration_s)
    expected = np.sqrt(1 + (1.5 * 2e-4) ** 2 / window_s / rest.gyro.values("N") ** 2)
    assert turns.parts[_UNDERSAMPLING] == pytest.approx(expected)
    assert both.parts[_UNDERSAMPLING] == pytest.approx(expected)
    assert _UNDERSAMPLING not in slow.parts  # slow motion is not faster than the samples
    assert np.all(turns.white_sigma == 0)


def test_what_the_recording_allows_is_in_the_limit_alone_as_much_as_if_it_were_named(result, rest):
    named = bare(with_noise(result), {7: 4e-6, 8: 1e-6})
    none = replace(named, covariance=np.zeros((12, 12)))
    allowed = replace(result.allowed, by_effect={"one": named.covariance, "less": named.covariance / 2})
    fits = none, replace(none, allowed=allowed), named
    for without, found, named in zip(*(inflations(each, rest)[1:] for each in fits), strict=True):
        assert found.white == pytest.approx(without.white)
        assert found.at_most**2 - found.white**2 == pytest.approx(named.white**2 - without.white**2)
        assert found.at_most[2] > 1.5 * found.white[2]


def test_the_inflations_of_a_folder_are_those_of_its_fit_with_these_figures_as_prior(folder, result, rest, tmp_path):
    assert inflations_of_folder(folder, rest) == ()
    save_models(result, folder / "fit")
    other = replace(rest, gyro=sensor(axis(N=N, B=1e-3)))
    (folder / "fit" / FILE).write_text(json.dumps(table_of(other)))  # an earlier run's, which does not count
    found = inflations_of_folder(folder, rest)
    prior = tmp_path / "prior.json"
    prior.write_text(json.dumps(table_of(rest)))
    expected = inflations(fit_session(read_session(folder), FitOptions(methods=("least_squares",), noise=prior)), rest)
    assert [each.motion for each in found] == [each.motion for each in expected]
    assert found[1].white == pytest.approx(expected[1].white)
    (folder / "fit" / "fit.json").write_text("{}")
    with pytest.raises(FormatError, match=r"fit\.json"):
        inflations_of_folder(folder, rest)
