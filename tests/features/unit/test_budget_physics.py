"""The budget: tables that add up, the attitude in use by hand, draws through the real fit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm, t

import tinygc
from session.base import rotation
from session.base.errors import CalibrationError
from session.base.units import DEG
from session.detect.accelerometer import NAMES as NAMES_OF_FORCE
from tinygc.closure.build import bias_shares
from tinygc.closure.floor import GYRO_NOISE, UNKNOWN, BiasInstability
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.motion import at_rest
from tinygc.closure.uncertainty import BIAS_DRIFT
from tinygc.estimation.spread import USUAL, ZERO, Spread
from tinygc.estimation.stated_noise import CALIBRATION, CLOCK, GRAVITY_LENGTH, MISFIT, joint_response, stated_response
from tinygc.features.unit.budget.library import cells_of
from tinygc.features.unit.budget.quantities import (
    _DRIFT_OF_USE,
    _NOISE_OF_USE,
    Budget,
    Excluded,
    Row,
    _source_sizes,
    accelerometer_budgets,
    parameter_budgets,
    sensor_error_budgets,
    sources_in_use,
    use_budgets,
)
from tinygc.features.unit.options import BudgetOptions
from tinygc.inference.noise import wander_covariance
from tinygc.models.linear import BIAS, NAMES, field_jacobian

RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def fit():
    session = tinygc.simulate(segments=8, closure_s=0.0, odr_hz=62.5, seed=3).session
    return tinygc.fit(session, methods=("least_squares",))


@pytest.fixture(scope="module")
def fitted(fit):
    return fit.result


def budget(*rows, si=1.0, unit="1", value=None, excluded=()):
    return Budget("made", unit, si, value, tuple(Row(f"source {i}", "A", nu, v) for i, (v, nu) in enumerate(rows)), excluded)


# Tables.


@pytest.mark.parametrize("seed", range(2))
def test_a_printed_column_adds_up_to_its_last_row(seed):
    rng = np.random.default_rng(seed)
    made = budget(*((float(v), 5.0) for v in rng.exponential(size=9) ** 4), si=10.0 ** float(rng.integers(-6, 6)))
    *rows, last = cells_of(made)
    assert round(sum(float(row[-1]) for row in rows), 1) == float(last[-1]) == 100.0


def test_the_expanded_uncertainty_is_by_welch_and_satterthwaite():
    """GUM H.1.6: 25 nm with 18, 9.7 nm with 25.6, 2.9 nm with 50, 16.6 nm with 2 degrees of freedom and more: 32 nm with 16."""
    made = budget((25.0**2, 18.0), (9.7**2, 25.6), (2.9**2, 50.0), (16.6**2, 2.0))
    expected = made.variance**2 / (25**4 / 18 + 9.7**4 / 25.6 + 2.9**4 / 50 + 16.6**4 / 2)
    assert made.freedom == pytest.approx(expected)
    assert made.k == pytest.approx(t.ppf(0.975, int(expected)))
    assert made.expanded == pytest.approx(made.k * np.sqrt(25**2 + 9.7**2 + 2.9**2 + 16.6**2))
    assert budget((1.0, np.inf)).k == pytest.approx(norm.ppf(0.975))


def test_a_table_is_in_the_unit_of_its_quantity():
    made = budget((9.0, 5.0), (16.0, np.inf), si=0.5, value=3.0, excluded=(Excluded("more", 2.0, ""), Excluded("unknown", None, "")))
    table = replace(made, rows=(replace(made.rows[0], size=4.0), made.rows[1])).to_json()
    assert (table["value"], table["u"], table["variance_si"]) == (6.0, 10.0, 25.0)
    assert table["expanded_uncertainty"] == made.expanded / 0.5
    shown = [[row[key] for key in ("u", "share", "sensitivity", "degrees_of_freedom")] for row in table["sources"]]
    assert shown == [[6.0, 0.36, 1.5, 5.0], [8.0, 0.64, None, np.inf]]
    assert [each["u"] for each in table["not_in_the_sum"]] == [4.0, None]
    assert [row.source for row in made.largest] == ["source 1", "source 0"]


# Parameters.


def test_the_variance_of_each_parameter_is_the_fits_to_the_bit(fitted):
    sizes = _source_sizes(fitted)
    assert sizes[GYRO_NOISE][0] == pytest.approx(0.005, rel=0.15)  # dps / sqrt(Hz), as simulated
    assert sizes[BIAS_DRIFT][1] == "°/h"
    for i, found in enumerate(parameter_budgets(fitted)):
        table, again = found.to_json(), 0.0
        for row, entry in zip(found.rows, table["sources"], strict=True):
            again += entry["variance_si"]
            if row.size and row.variance > 0:
                assert entry["size"] * entry["sensitivity"] == pytest.approx(abs(entry["u"]))
        assert (found.name, found.variance) == (NAMES[i], fitted.covariance[i, i])
        assert again == table["variance_si"] == fitted.covariance[i, i]


def test_the_size_of_a_source_is_the_rms_of_its_parts_in_its_unit(fitted):
    problem, one_and_seven = fitted.problem.changed(), np.array([1.0, 7.0]) * DEG
    stamps = "rounding and jitter of the stamps"
    made = {
        "widened": [SimpleNamespace(sigma_rad=sigma) for sigma in one_and_seven],
        "batch": replace(problem.batch, turns=SimpleNamespace(sigma_rad=np.append(one_and_seven, np.nan))),
        "floor": SimpleNamespace(references={stamps: SimpleNamespace(own=np.array([np.diag([9.0, 16.0, 25.0]) * DEG**2] * 2))}),
    }
    problem.__dict__.update(made)
    sizes = _source_sizes(replace(fitted, problem=problem, widened=26.0))
    for name in ("bridged readings and impacts", "known angles of turns", stamps, MISFIT):
        assert sizes[name][0] == pytest.approx(5.0), name


def with_a_clock(fitted, **sensor):
    config = fitted.session.config
    return fitted.problem.changed(session=replace(fitted.session, config=replace(config, sensor=replace(config.sensor, **sensor))))


def test_sizes_that_are_given_are_in_the_units_of_who_gives_them(fitted):
    sizes = _source_sizes(fitted)
    assert (sizes[CALIBRATION], sizes[GRAVITY_LENGTH]) == ((pytest.approx(0.1), "mg"), (pytest.approx(2e4), "ppm"))
    for sensor, size, unit in (({"odr_sigma": 0.01}, 1.0, "%"), ({"clock_sigma_ppm": 50.0}, 50.0, "ppm")):
        problem = with_a_clock(fitted, **sensor)
        problem.__dict__["joint"] = None
        sizes = _source_sizes(replace(fitted, problem=problem))
        assert (sizes[CALIBRATION], sizes[CLOCK]) == ((pytest.approx(0.1), "mg"), (pytest.approx(size), unit))
        assert GRAVITY_LENGTH not in sizes


def test_a_sensor_error_is_the_slope_on_the_parameters(fit, fitted):
    slope = field_jacobian(fitted.linear.model.vector)
    found = {each.name: each for each in sensor_error_budgets(fitted)}
    for name, row in (("bias x", 15), ("scale factor error y", 1)):
        assert found[name].variance == pytest.approx(slope[row] @ fitted.covariance @ slope[row], rel=1e-9)
    for name, error in fit.sensor_errors.items():
        shown = found[name.replace("_", " ")]
        assert (shown.unit, shown.value / shown.si) == (error.unit, pytest.approx(error.value))


def test_what_is_known_besides_stands_beside_the_sum(fitted):
    again = replace(fitted, spread=Spread.of(ZERO, 0.02 * DEG, "two other sessions"))
    bias, scale = (parameter_budgets(again)[i] for i in (9, 0))
    of_bias, of_scale = ({each.what: each.u for each in made.excluded} for made in (bias, scale))
    assert of_bias["bias of another switch-on"] == pytest.approx(np.sqrt(2) * 0.02 * DEG)
    assert bias.variance == again.covariance[9, 9]
    assert "bias of another switch-on" not in of_scale
    assert of_scale["one effect missing from the model"] == pytest.approx(fitted.allowed.sigma[0])


# Use.


def test_the_attitude_at_rest_by_hand(fitted):
    """After 60 s at rest: 60 s times the zero as calibrated, the root of 60 s times the white noise, and the drift's mean over 60 s."""
    use = BudgetOptions(motion="rest")
    motion, found = use_budgets(fitted, use)
    axes, model = {each.name: each for each in found}, fitted.linear.model
    E, density = model.E, fitted.problem.noise.angle_random_walk
    slope = 60 * np.hstack([np.kron(np.eye(3), -np.linalg.solve(E, model.B)), np.eye(3)])
    of_parameters = sum(row.variance for row in axes["attitude y"].rows[: len(fitted.sources)])
    assert of_parameters == pytest.approx(slope[1] @ fitted.covariance @ slope[1], rel=1e-9)
    sources = {source.name: source.covariance for source in sources_in_use(fitted, use, motion).sources}
    assert_allclose(sources[_NOISE_OF_USE], 60 * E @ np.diag(density**2) @ E.T, rtol=1e-9)
    mean = wander_covariance(np.array([30.0]), 60.0, instability_rps=fitted.noise.noise.size("noise.bias_wander"))[0, 0]
    assert_allclose(np.diag(sources[_DRIFT_OF_USE]), 3600 * mean * np.diag(E @ E.T), rtol=0.02)
    x, y, z, whole = found
    assert whole.variance == pytest.approx(x.variance + y.variance + z.variance, rel=1e-12)
    # 0.1 dps each of session and use: 60 s at rest miss 60 s x 0.1 dps x sqrt(2) about each axis, the largest source.
    assert (motion.words, x.largest[0].source) == ("60 s at rest", "bias of another switch-on, as usual")
    assert x.largest[0].u == pytest.approx(60 * np.sqrt(2) * 0.1 * DEG, rel=1e-3)


def test_the_accelerometer_has_budgets_with_another_switch_on_beside(fitted, monkeypatch):
    """Their variances are those of the fit's own sigmas; beside them stand two draws of the spread."""
    own, triad = {each.name: each for each in accelerometer_budgets(fitted)}, fitted.accelerometer
    for word, unit, values, sigmas, names in triad.errors():
        for value, sigma, name in zip(values, sigmas, names, strict=True):
            found = own[f"accelerometer {word} {name.split()[-1]}"]
            assert (found.unit, found.value / found.si, found.u / found.si) == (unit, pytest.approx(value), pytest.approx(sigma, rel=1e-6))
            spread = np.sqrt(2) * triad.between.sigma[NAMES_OF_FORCE.index(name)]
            assert [each.u for each in found.excluded] == ([pytest.approx(spread)] if spread else [])
    first, hidden, *others = own
    (_, _, _, _, (_, name, *_)), *_ = triad.errors()
    monkeypatch.setitem(vars(fitted), "accelerometer", replace(triad, unobserved=(name,)))
    assert [each.name for each in accelerometer_budgets(fitted)] == [first, *others], hidden


def test_another_switch_on_counts_twice_its_spread_and_a_temperature_as_assumed(fitted):
    spread = Spread.of(ZERO, np.array([1.0, 2.0, 3.0]) * 1e-3 * DEG, "two other sessions")
    known, motion = replace(fitted, spread=spread), at_rest(fitted.linear.model, 10)
    sources, _, assumed = sources_in_use(known, BudgetOptions(motion="rest", seconds=10.0, warmer_k=5.0), motion)
    # Nobody knows it: in the sum is the usual spread.
    usual = sources_in_use(fitted, BudgetOptions(motion="rest", seconds=10.0), motion).sources
    found = {source.name: source.covariance for source in (*sources, *usual)}
    for name, expected in (
        ("bias of another switch-on", 2 * spread.sigma[ZERO] ** 2),
        ("temperature of the use", np.full(3, (0.01 * DEG * 5) ** 2)),
        ("bias of another switch-on, as usual", 2 * USUAL.sigma[ZERO] ** 2),
    ):
        assert_allclose(found[name], 100 * np.diag(np.broadcast_to(expected, 3)), rtol=1e-9, atol=1e-20)
    assert assumed == ("temperature of the use",)
    estimated = replace(fitted, spread=Spread.of(ZERO, spread.scatter[ZERO], "two other sessions", [5.0, 4.0, 6.0]))
    (own,) = (
        each
        for each in sources_in_use(estimated, BudgetOptions(motion="rest", seconds=10.0), motion).sources
        if each.name == "bias of another switch-on"
    )
    assert (own.kind, own.freedom) == ("A", 4.0)  # what is estimated is not widened, but counts with its freedom
    assert_allclose(np.diag(own.covariance), 200 * spread.scatter[ZERO] ** 2, rtol=1e-9)


@pytest.mark.parametrize("elapsed_s", [1.0, 1e6])
def test_within_one_switch_on_the_drift_is_that_of_the_use_less_that_of_the_session(fitted, elapsed_s):
    """At rest: 60 s times the standard deviation of the mean of the use less that of the session, C00 + C11 - 2 C01, counted once."""
    use = BudgetOptions(motion="rest", elapsed_s=elapsed_s)
    motion, found = use_budgets(fitted, use)
    own = sources_in_use(fitted, use, motion).sources[len(fitted.sources) :]
    (row,) = (row for row in found[0].rows if "drift" in row.source)
    assert (row.source, [source.name for source in own]) == ("drift of the bias since the session", [_NOISE_OF_USE])
    problem, rps = fitted.problem, fitted.noise.noise.size("noise.bias_wander")
    moments = np.r_[problem.began_s[-1] + elapsed_s + 30.0, problem.middle_s]
    C = wander_covariance(moments, np.r_[60.0, problem.batch.duration_s], instability_rps=rps)
    assert row.u == pytest.approx(60 * np.sqrt(C[0, 0] + C[1:, 1:].mean() - 2 * C[0, 1:].mean()), rel=0.05)
    drift = next(source for source in fitted.sources if source.name == BIAS_DRIFT)
    assert (row.kind, row.freedom) == (drift.kind, drift.freedom)


def test_a_drift_that_nobody_knows_is_said(fitted):
    problem = fitted.problem.changed()
    problem.__dict__["instability"] = BiasInstability(0.0, UNKNOWN)
    sources = tuple(source for source in fitted.sources if source.name != BIAS_DRIFT)
    unknown = replace(fitted, noise=None, problem=problem, sources=sources)
    _, (about_x, *_) = use_budgets(unknown, BudgetOptions(motion="rest", elapsed_s=10.0))
    beside = {each.what: each for each in about_x.excluded}
    assert beside["drift of the bias since the session"].u is None


def test_what_the_model_lacks_turns_each_axis_by_its_own_part_and_the_total_by_their_root_sum_square(fitted):
    motion, found = use_budgets(fitted, BudgetOptions(motion="rest"))
    each = [next(one.u for one in made.excluded if one.what == "one effect missing from the model") for made in found]
    assert_allclose(each[:3], fitted.allowed.of(motion.slope(fitted.linear.linear)))
    assert each[3] == pytest.approx(np.linalg.norm(each[:3]))


# The sources through the real fit.


def refit(fitted, *, channels=None, known=None, reading=0.0, clock=0.0):
    """(12,) least squares of the data with these errors: of the channels (n,), stacked as the noise has them; of what was known of
    the accelerometer and gravity beforehand (k,), sigmas; of all readings (3,) rad/s; of all durations, as a share."""
    problem, joint = fitted.problem, fitted.problem.joint
    count, batch, rates = len(problem.batch), problem.batch, problem.still_rates
    channels = np.zeros(len(fitted.noise.white)) if channels is None else channels
    known = np.zeros(joint.beforehand.shape[1]) if known is None else known
    moved = np.zeros(len(joint.system.x))
    moved[joint.own] = joint_response(problem, joint) @ channels + joint.beforehand @ known
    batch = joint.shifted(batch, moved)
    rows = count * batch.angles
    ends, still = np.zeros((count, 3)), channels[rows : rows + 3 * len(rates.rate)].reshape(-1, 3)
    ends[:, : batch.angles] = channels[:rows].reshape(count, -1)
    first, last, share = bias_shares(problem)
    apart = still[first][:, None] * (1 - share[..., None]) + still[last][:, None] * share[..., None] - still.mean(axis=0)
    batch = replace(
        batch,
        end=rotation.multiply(rotation.exp(-ends), batch.end),
        rate=batch.rate + reading,
        dt=batch.dt * (1 + clock),
        earth=batch.earth + apart,
    )
    rest = problem.rest_rps + reading + np.linalg.solve(problem.first.E, still.mean(axis=0))
    return fit_least_squares(batch, problem.floor.sigma, problem.first, rest_rps=rest, begin=fitted.linear.model).model.vector


def moved_by(fitted, size, **errors):
    """Derivative of the refitted parameters by errors of one kind, both ways."""
    ((kind, values),) = errors.items()
    return (refit(fitted, **{kind: values * size}) - refit(fitted, **{kind: values * -size})) / (2 * size)


def test_a_refit_moves_by_the_response_to_the_errors(fitted):
    """Errors of the channels, in every kind of row, through the actual fit: L y, to first order."""
    noise = fitted.noise
    L = stated_response(fitted.problem, fitted.linear.model)
    sigma, stop, lengths = np.sqrt(np.diag(fitted.covariance)), noise.closure.stop, -len(noise.twin.stills)
    size = np.sqrt(np.diag(noise.white))
    for part in (slice(0, stop), slice(stop, lengths), slice(lengths, None)):
        y = np.zeros(len(size))
        y[part] = size[part] * RNG.normal(size=len(y[part]))
        found, expected = moved_by(fitted, 0.3, channels=y), L @ y
        assert_allclose(found / sigma, expected / sigma, atol=0.02 * max(1.0, np.abs(expected / sigma).max()))


def test_a_refit_moves_by_what_was_wrong_before_the_session(fitted):
    """The accelerometer's given calibration and gravity, as the sources have them."""
    by_name = {source.name: source.covariance for source in fitted.sources}
    scale, last = np.sqrt(np.outer(*[np.diag(fitted.covariance)] * 2)), fitted.problem.joint.beforehand.shape[1] - 1
    steps = np.array([moved_by(fitted, 1.0, known=each) for each in np.eye(last + 1)])
    for name, part in ((CALIBRATION, steps[:last]), (GRAVITY_LENGTH, steps[last:])):
        assert_allclose(part.T @ part / scale, by_name[name] / scale, atol=1e-4)


def test_readings_and_clock_move_the_parameters_as_stated(fitted):
    """A reading e too large takes E e from B; durations longer by a share take it from E and B."""
    model, sigma = fitted.linear.model, np.sqrt(np.diag(fitted.covariance))
    e = np.array([1.0, -2.0, 0.5]) * 1e-4 * DEG
    found = refit(fitted, reading=e) - model.vector
    assert_allclose(found[BIAS], -model.E @ e, atol=1e-3 * sigma[9])
    assert_allclose(found[:9] / sigma[:9], 0, atol=1e-2)
    found = refit(fitted, clock=1e-3) - model.vector
    assert_allclose(found[:9], -1e-3 * model.vector[:9], atol=2e-5)


def test_a_use_without_a_length_is_refused():
    for seconds in (1e9, 0.0, float("nan")):
        with pytest.raises(CalibrationError, match="seconds"):
            BudgetOptions(motion="rest", seconds=seconds)
