"""The bias instability that uncertainties reckon with: likelihood and posterior by dense integration, and its data by hand."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import Table, config, session_of
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal, norm, truncnorm

from session.detect.stills import Noise, Still
from session.io.config import Site
from session.io.samples import Samples
from session.io.units import DEG, DEG_PER_HOUR
from tinygc import SimulationOptions, read_session
from tinygc.attitude.earth import EarthRate
from tinygc.closure import floor
from tinygc.closure.build import build_problem
from tinygc.closure.floor import (
    ESTIMATED,
    GIVEN,
    GRID_RPS,
    UNKNOWN,
    bias_instability_of,
    estimated,
    other_causes,
    pieces_at_rest,
    posterior_of_instability,
    restricted_likelihood,
    sideways_columns,
    step_of_bias,
    wander_covariance,
)
from tinygc.closure.stills import StillSet
from tinygc.noise.components import known_whitener
from tinygc.noise.twin import Twin
from tinygc.simulation.write import write_session

DPH = DEG_PER_HOUR


def test_the_grid_reaches_from_nothing_to_three_hundred_degrees_an_hour():
    assert (GRID_RPS[[0, 1, -1]] / DPH).tolist() == pytest.approx([0, 0.1, 300])
    np.testing.assert_allclose(np.diff(np.log(GRID_RPS[1:])), np.log(3000) / 69, rtol=1e-9)


@pytest.mark.parametrize(("at", "width"), [(10, 5), (3, 2), (0, 3), (6, 1), (30, 8)])
def test_posterior_is_the_likelihood_integrated_under_a_flat_prior_from_zero_on(at, width):
    found = posterior_of_instability(-(((GRID_RPS / DPH - at) / width) ** 2) / 2 - 1000)
    exact = truncnorm(-at / width, np.inf, at, width)
    assert found.rps / DPH == pytest.approx(exact.mean(), rel=1e-4)
    assert found.sigma_rps / DPH == pytest.approx(exact.std(), rel=1e-4)
    assert found.most_rps / DPH == pytest.approx(exact.ppf(0.95), rel=0.01)
    assert (found.source, found.of_unit) == (ESTIMATED, True)
    anything = posterior_of_instability(np.zeros(len(GRID_RPS)))  # uniform up to 300
    assert [anything.rps / DPH, anything.sigma_rps / DPH, anything.most_rps / DPH] == pytest.approx(
        [150, 300 / np.sqrt(12), 285], rel=0.005
    )


def problem(count=6, seed=0):
    """Mean rates (N, 3), their white variances (N, 3) and the wander's covariance (N, N) for B = 1 rad/s, of ten degrees an hour."""
    rng = np.random.default_rng(seed)
    t_s = np.cumsum(rng.uniform(5, 60, count))
    flicker = wander_covariance(t_s, np.full(count, 2.0), instability_rps=1.0)
    white = (rng.uniform(1, 6, (count, 3)) * DPH) ** 2
    root = [np.linalg.cholesky(np.diag(white[:, axis]) + (10 * DPH) ** 2 * flicker) for axis in range(3)]
    rate = np.stack([each @ rng.standard_normal(count) for each in root], axis=1) + 100 * DPH
    return t_s, rate, white, flicker


def test_without_outliers_it_is_the_gaussian_likelihood_with_the_columns_integrated_away(monkeypatch):
    """log of the integral of N(y; A b, C) over b, by a dense density: over one column by quadrature, over two by completing the square."""
    monkeypatch.setattr(floor, "OUTLIERS", 0.0)
    t_s, rate, white, flicker = problem()
    y, tried = rate[:, 0], GRID_RPS[[0, 20, 50, 60]]
    one, two = np.ones((6, 1)), np.stack([np.ones(6), t_s / 100], axis=1)
    dense = []
    for B in tried:
        C = np.diag(white[:, 0]) + B**2 * flicker
        sigma = 1 / np.sqrt(np.sum(np.linalg.inv(C)))
        best = np.sum(np.linalg.inv(C) @ y) * sigma**2
        at_best = multivariate_normal(np.full(6, best), C).logpdf(y)
        area, _ = quad(
            lambda z, C=C, best=best, s=sigma, top=at_best: s * np.exp(multivariate_normal(np.full(6, best + z * s), C).logpdf(y) - top),
            -8,
            8,
        )
        wide = C / DPH**2 + 1e8 * two @ two.T  # a prior so wide that it only adds a constant
        dense.append((at_best + np.log(area), multivariate_normal(np.zeros(6), wide).logpdf(y / DPH)))
    for columns, expected in zip((one, two), np.transpose(dense), strict=True):
        found = restricted_likelihood(y, columns, white[:, 0], flicker)[[0, 20, 50, 60]]
        np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-3)


def test_innovations_of_an_outlier_are_twenty_times_as_wide_in_one_case_of_fifty():
    """One column; its coefficient maximises the mixture's likelihood, whose information the weights of the innovations are."""
    _, _, white, flicker = problem(5)
    y = 100 * DPH + np.sqrt(white[:, 1]) * [0.5, -1.2, 0.3, 12.0, -0.6]
    found = restricted_likelihood(y, np.ones((5, 1)), white[:, 1], flicker)
    for k in (0, 10, 40):
        factor = np.linalg.cholesky(np.diag(white[:, 1]) + GRID_RPS[k] ** 2 * flicker)
        whitened, column = np.linalg.solve(factor, y), np.linalg.solve(factor, np.ones(5))

        def mixture(coefficient, whitened=whitened, column=column):
            left = whitened - column * coefficient * DPH
            return 0.98 * norm.pdf(left), 0.02 * norm.pdf(left, scale=20), left

        best = minimize_scalar(
            lambda b: -np.sum(np.log(np.sum(mixture(b)[:2], axis=0))), bounds=(90, 110), method="bounded", options={"xatol": 1e-9}
        )
        usual, wild, _ = mixture(best.x)
        weight = (usual + wild / 400) / (usual + wild)
        value = -best.fun + 2.5 * np.log(2 * np.pi) - np.log(np.diag(factor)).sum() - np.log(np.sum(weight * column**2)) / 2
        assert found[k] == pytest.approx(value, abs=1e-3)


def test_some_instabilities_at_a_time_are_as_good_as_all(monkeypatch):
    _, rate, white, flicker = problem()
    whole = restricted_likelihood(rate[:, 2], np.ones((6, 1)), white[:, 2], flicker)
    assert whole.shape == GRID_RPS.shape
    for at_once in (36 * 7, 1):
        monkeypatch.setattr(floor, "SAMPLES_AT_ONCE", at_once)
        np.testing.assert_allclose(restricted_likelihood(rate[:, 2], np.ones((6, 1)), white[:, 2], flicker), whole, rtol=1e-12)


def test_a_step_is_the_moment_at_which_chi_square_falls_most_by_more_than_twenty_five():
    """Chi-square with and without the step's column, by dense generalised least squares, summed over the axes."""
    _, rate, white, flicker = problem(7)
    wander = (3 * DPH) ** 2 * flicker
    columns = [np.ones((7, 1)), np.ones((7, 1)), np.stack([np.ones(7), np.arange(7.0) ** 2], axis=1)]
    after = (np.arange(7) >= 4).astype(float)
    rate = rate + 40 * DPH * after[:, None] * [1, -2, 0]

    def chi_square(size, step):
        total = 0.0
        for axis in range(3):
            factor = np.linalg.cholesky(np.diag(white[:, axis]) + wander)
            A = np.linalg.solve(factor, np.column_stack([columns[axis], *step]))
            total += np.linalg.lstsq(A, np.linalg.solve(factor, size * rate[:, axis]))[1].sum()
        return total

    gains = [chi_square(1.0, []) - chi_square(1.0, [(np.arange(7) >= k).astype(float)]) for k in range(1, 7)]
    assert np.argmax(gains) == 3
    just = np.sqrt(25 / max(gains))
    assert step_of_bias(0.9999 * just * rate, columns, white, wander) is None
    np.testing.assert_array_equal(step_of_bias(1.0001 * just * rate, columns, white, wander), after)
    assert step_of_bias(rate[:1], [np.zeros((1, 0))] * 3, white[:1], wander[:1, :1]) is None


def test_a_column_is_no_step_where_other_causes_explain_it():
    _, rate, white, flicker = problem(4)
    after = np.tril(np.ones((4, 4)))
    assert step_of_bias(1e3 * rate, [after] * 3, white, DPH**2 * flicker) is None


def test_a_rate_fixed_in_the_table_shows_on_each_axis_as_its_attitude_has_it():
    turns = Rotation.random(4, random_state=1)
    group = np.array([3, 3, 5, 5])
    level = np.array([0.4, -0.7, 0.0]), np.array([-0.2, 0.1, 0.0])  # in the table, of each yaw group
    body = np.stack([turn.inv().apply(level[int(g == 5)]) for turn, g in zip(turns, group, strict=True)])
    for axis in range(3):
        columns = sideways_columns(turns.as_quat(scalar_first=True), group, axis)
        np.testing.assert_allclose(columns @ [0.4, -0.7, -0.2, 0.1], body[:, axis], atol=1e-14)


def span(*columns):
    u, s, _ = np.linalg.svd(np.column_stack(columns), full_matrices=False)
    return u[:, s > 1e-8 * s[0]]


@pytest.mark.parametrize(
    ("count", "taken"),
    [(34, "012345"), (33, "01234"), (24, "01234"), (23, "0123"), (22, "0123"), (21, "012"), (18, "0134"), (8, "03"), (7, "0")],
)
def test_other_causes_are_taken_in_order_up_to_half_the_number_of_pieces(count, taken):
    """A bias of each log and the steps; gravity's direction; a table-fixed rate; drift; temperature; products of gravity's direction."""
    rng = np.random.default_rng(count)
    log, t_s, temp_c = np.arange(count) % 2, np.arange(count) * 7.0, rng.normal(size=count) * 5 + 20
    down, side, step = rng.normal(size=(count, 3)), rng.normal(size=(count, 4)), (np.arange(count) > 3)[:, None] * 1.0
    x, y, z = (down / np.linalg.norm(down, axis=1, keepdims=True)).T
    down = np.stack([x, y, z], axis=1)
    made = [[log == 0, log == 1, step], [down], [side], [t_s], [temp_c], [x * x, y * y, x * y, x * z, y * z]]
    found = other_causes(log, t_s, down, side, temp_c, step)
    expected = span(*(column * 1.0 for block in taken for column in made[int(block)]))
    np.testing.assert_allclose(found.T @ found, np.eye(found.shape[1]), atol=1e-12)
    np.testing.assert_allclose(found @ found.T, expected @ expected.T, atol=1e-8)


def test_a_thermometer_that_hardly_moves_or_is_not_there_tells_nothing():
    t_s, none = np.arange(40.0), np.zeros((40, 0))
    down = np.tile([0.0, 0.0, 1.0], (40, 1))
    for range_c, told in ((0.4999, 0), (0.5001, 1), (np.nan, 0)):
        temp_c = 20 + range_c * (np.arange(40) % 2)
        assert other_causes(np.zeros(40), t_s, down, none, temp_c, none).shape == (40, 2 + told)  # a bias, a drift


def rests(temp=True):
    """Two logs of 100 Hz: a still of 1.2 s, one of 9 s, one that is no reference, one with a bump inside; the second has one of 3 s."""
    rng, logs = np.random.default_rng(4), []
    for number, spans in enumerate((((0, 120), (200, 1100), (1200, 1300), (1400, 1700)), ((50, 350),))):
        rows = spans[-1][1] + 100
        t_ns = (np.arange(rows) * 10_000_000 + 5_000_000_000).astype(np.int64)
        samples = Samples(t_ns, rng.normal(size=(rows, 3)), rng.normal(size=(rows, 3)), rng.normal(size=rows) if temp else None)
        stills = []
        for k, (a, b) in enumerate(spans):
            force, none = rng.normal(size=3) * 9, np.zeros(3)
            still = Still(a, b, a * 0.01, (b - a) * 0.01, rng.normal(size=3), none, force, none, none, 21.0 + k, bumps=int(k == 3))
            stills.append(replace(still, problem="creeps" if k == 2 else None))
        noise = Noise(np.array([1.0, 2, 3]) * (number + 1), np.ones(3))
        q_tb = Rotation.random(len(spans), random_state=number).as_quat(scalar_first=True)
        logs.append(StillSet(samples, stills, noise, q_tb, np.arange(len(spans))))
    return logs


def test_a_still_is_taken_without_its_ends_and_a_long_one_in_parts_of_four_seconds():
    logs = rests()
    pieces = list(pieces_at_rest(0, logs))
    assert [round(piece[3], 9) for piece in pieces] == [0.8, 4.3, 4.3, 3.0]  # a fifth of a second less at both ends; two of 8.6 s
    for piece, (a, b), s in zip(pieces[:3], ((20, 100), (220, 650), (650, 1080)), (0, 1, 1), strict=True):
        rate, number, middle_s, _, walk, down, q, group, temp_c = piece
        samples, still = logs[0].samples, logs[0].stills[s]
        np.testing.assert_allclose(rate, samples.gyro[a:b].mean(axis=0))
        assert (number, middle_s, group) == (0, pytest.approx((a + b - 1) / 2 * 0.01), s)
        np.testing.assert_allclose(walk, np.array([1, 2, 3]) / np.sqrt(2))
        np.testing.assert_allclose(down, still.accel_mean / np.linalg.norm(still.accel_mean))
        np.testing.assert_array_equal(q, logs[0].q_tb[s])
        assert temp_c == pytest.approx(samples.temp_c[a:b].mean())
    rate, _, middle_s, span_s, *_, group, temp_c = pieces[3]  # readings of a bump are none of its mean
    np.testing.assert_array_equal(rate, logs[0].stills[3].gyro_mean)
    assert (middle_s, span_s, group, temp_c) == (pytest.approx(15.5), pytest.approx(3.0), 3, 24.0)


def test_a_later_log_lies_behind_the_former_and_a_short_still_keeps_its_half():
    logs = rests(temp=False)
    ((rate, number, middle_s, span_s, walk, *_, temp_c),) = pieces_at_rest(1, logs)
    assert (number, middle_s, span_s) == (1, pytest.approx(17.99 + 0.01 * (70 + 329) / 2), pytest.approx(2.6))
    np.testing.assert_allclose(rate, logs[1].samples.gyro[70:330].mean(axis=0))
    np.testing.assert_allclose(walk, np.array([2, 4, 6]) / np.sqrt(2))
    assert np.isnan(temp_c)
    short = replace(logs[1].stills[0], stop=50 + 42, duration_s=0.42)
    ((rate, *_),) = pieces_at_rest(1, [logs[0], replace(logs[1], stills=[short])])
    np.testing.assert_allclose(rate, logs[1].samples.gyro[60:82].mean(axis=0))  # a quarter at each end


def test_many_hours_at_rest_are_cut_into_three_hundred_pieces(monkeypatch):
    logs = rests()
    monkeypatch.setattr(floor, "MOST_PIECES", 4)  # of 16.2 s: each longer than 4.05 s
    assert [round(piece[3], 6) for piece in pieces_at_rest(0, logs)][1:3] == [4.3, 4.3]
    monkeypatch.setattr(floor, "MOST_PIECES", 3)
    assert [round(piece[3], 6) for piece in pieces_at_rest(0, logs)][1:] == [8.6, 3.0]
    monkeypatch.undo()
    assert floor.MOST_PIECES == 300


@pytest.mark.parametrize(("source", "steps"), [("given", 0), ("estimated", 0), ("unknown", 0), ("given", 3), ("given", 4)])
def test_the_estimate_is_the_posterior_over_all_axes_without_other_causes(source, steps):
    """Put together from its parts: rates less the Earth's, white variances of their spans, columns, likelihoods of three axes.

    A fourth step of the bias is taken for wander."""
    rng = np.random.default_rng(8)
    rows, count = 6000, 28
    q = Rotation.random(count, random_state=3)
    earth = EarthRate(np.array([3.0, 1.0, -4.0]) * 10 * DPH, 0.3, 0.1, source)
    gyro = rng.normal(size=(rows, 3)) * 60 * DPH
    t_ns = (np.arange(rows) * 10_000_000).astype(np.int64)
    stills, none = [], np.zeros(3)
    after = np.array([[k >= at for at in (5, 11, 17, 23)[:steps]] for k in range(count)]) * 1.0
    for k in range(count):
        part = slice(200 * k, 200 * k + 150)
        gyro[part] += (1000 * after[k] * [1, -2, 3, -3][:steps]).sum() * DPH
        gyro[part] += q[k].inv().apply(earth.rate_t) + [50 * DPH, 0, 0] + rng.normal(size=3) * 15 * DPH
        stills.append(Still(part.start, part.stop, 2.0 * k, 1.5, none, none, q[k].inv().apply([0, 0, -9.8]), none, none, 25.0))
    noise = Noise(np.array([1.0, 1.2, 0.9]) * 60 * DPH * np.sqrt(0.02), np.ones(3))
    log = StillSet(Samples(t_ns, gyro, gyro, np.full(rows, 25.0)), stills, noise, q.as_quat(scalar_first=True), np.zeros(count, dtype=int))
    middles = np.array([(400 * k + 149) / 2 * 0.01 for k in range(count)])
    rate = np.array([gyro[200 * k + 20 : 200 * k + 130].mean(axis=0) - q[k].inv().apply(earth.rate_t) for k in range(count)])
    white, flicker = noise.gyro**2 / 2 / 1.1, wander_covariance(middles, np.full(count, 1.1), instability_rps=1.0)
    total, down = 0, np.array([still.accel_mean / 9.8 for still in stills])
    for axis in range(3):
        side = sideways_columns(log.q_tb, log.group, axis)[:, : 2 * (source == "unknown")]
        columns = other_causes(np.zeros(count), middles, down, side, np.full(count, 25.0), after)
        total = total + restricted_likelihood(rate[:, axis], columns, np.full(count, white[axis]), flicker)
    expected, found = posterior_of_instability(total), estimated([log], {0: earth})
    if steps == 4:
        assert found.rps > 5 * expected.rps
        return
    assert found.rps / DPH == pytest.approx(expected.rps / DPH, rel=1e-6)
    assert found.sigma_rps == pytest.approx(expected.sigma_rps, rel=1e-6)
    # Less than nine degrees of freedom of all axes together are no estimate; a bias and a drift leave N - 2 of each.
    few = [estimated([replace(log, stills=stills[:n], q_tb=log.q_tb[:n], group=log.group[:n])], {0: earth}) for n in (0, 4, 5)]
    assert [(each.source, each.rps > 0) for each in few] == [(UNKNOWN, False), (UNKNOWN, False), (ESTIMATED, True)]


def test_given_comes_before_typical():
    sensor = config().sensor
    typical, given = (bias_instability_of(replace(sensor, gyro_bias_instability_dph=dph), [], {}) for dph in (None, 7.5))
    assert (typical.rps, typical.source, typical.sigma_rps, typical.of_unit) == (
        pytest.approx(3 * DPH),
        "typical of ASM330LHH",
        None,
        False,
    )
    assert (given.rps, given.source, given.of_unit) == (pytest.approx(7.5 * DPH), GIVEN, False)
    assert bias_instability_of(replace(sensor, model="another"), [], {}).source == UNKNOWN


def of_another(session, **known):
    """The same recording of a sensor that nobody knows."""
    return replace(session, config=replace(session.config, sensor=replace(session.config.sensor, model="another", **known)))


#: an ASM330LHH's registers, of a sensor that is not named
UNNAMED = '"unnamed"\ngyro_mdps_per_lsb = 17.5\naccel_mg_per_lsb = 0.122\ntemp_lsb_per_c = 256\ntemp_at_zero_c = 25'


@pytest.mark.broad
def test_the_sigmas_follow_it_and_the_closure_does_not(simulated, run, tmp_path):
    """Through the command line: a sensor of another name, and one with ten times the instability given."""
    tables = {}
    for name, line in (("typical", ""), ("given", "gyro_bias_instability_dph = 30\n"), ("other", "")):
        folder = tmp_path / name
        shutil.copytree(simulated(), folder)
        text = (folder / "session.toml").read_text().replace("[accelerometer]", line + "[accelerometer]")
        (folder / "session.toml").write_text(text.replace('"ASM330LHH"', UNNAMED) if name == "other" else text)
        code, out, _ = run("fit", folder, "--methods", "least_squares", "--verbose", "--json", tmp_path / f"{name}.json")
        assert code == 0
        words = {"typical": "3 °/h, typical of ASM330LHH", "given": "30 °/h, given", "other": ESTIMATED}[name]
        assert words in " ".join(out.split())
        tables[name] = json.loads((tmp_path / f"{name}.json").read_text())
        tables[name]["covariance"] = json.loads((folder / "fit" / "model_least_squares.json").read_text())["covariance"]
    assert tables["typical"]["methods"]["least_squares"]["holdout"] == tables["given"]["methods"]["least_squares"]["holdout"]
    assert tables["typical"]["methods"]["least_squares"]["holdout"] == tables["other"]["methods"]["least_squares"]["holdout"]
    sigma = {name: np.sqrt(np.diag(table["covariance"]))[9:] for name, table in tables.items()}
    assert np.all(sigma["given"] > 3 * sigma["typical"])
    noise = tables["other"]["noise"]
    assert noise["gyro_bias_instability_source"] == ESTIMATED
    assert noise["gyro_bias_instability_sigma_dph"] > 0
    assert tables["typical"]["noise"]["gyro_bias_instability_dph"] == 3.0


def test_what_was_estimated_of_the_unit_is_not_widened_as_a_data_sheet_s_is(simulated):
    session = read_session(simulated())
    own = build_problem(of_another(session))
    same = build_problem(of_another(session, gyro_bias_instability_dph=own.instability.rps / DEG_PER_HOUR))
    narrow, wide = (known_whitener(Twin(problem)).sigma for problem in (own, same))
    assert np.all(narrow <= wide * (1 + 1e-12))
    assert np.any(narrow < 0.99 * wide)


def test_a_step_a_drift_and_gravity_are_not_taken_for_wander():
    """On a sensor without wander: 0.3 dps over the log, a step of 0.1 dps in the middle, and 0.2 dps/g."""
    samples = Table().tumble(30, rest_s=3.0, seed=4).samples(seed=4)
    part = (samples.t_s / samples.t_s[-1])[:, None]
    wrong = samples.gyro + (0.3 * part + 0.1 * (part > 0.5) + 0.2 * samples.accel[:, [1, 2, 0]] / 9.80665) * DEG
    for gyro in (samples.gyro, wrong):
        session = session_of(replace(samples, gyro=gyro), model="another")
        # This table stands on no turning Earth.
        known = build_problem(replace(session, config=replace(session.config, site=Site()))).instability
        assert known.most_rps < 8 * DEG_PER_HOUR  # the step alone is 360 degrees an hour
        assert known.rps < 2 * known.sigma_rps


def estimates(instability_dph: float, seeds: range, tmp_path) -> np.ndarray:
    """(seeds, 3) °/h: estimate, sigma, 95 % limit, of sessions of 20 turns and of a sensor that nobody knows."""
    found = []
    for seed in seeds:
        options = SimulationOptions(segments=20, closure_s=0.0, seed=seed, odr_hz=104.0, bias_instability_dph=instability_dph)
        session = of_another(read_session(write_session(options, tmp_path / f"{instability_dph:g}_{seed}")))
        own = build_problem(session).instability
        found.append(np.array([own.rps, own.sigma_rps, own.most_rps]) / DEG_PER_HOUR)
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize(("true", "least"), [pytest.param(3.0, 0.4, marks=pytest.mark.slow), (10.0, 0.8)])
def test_inject_and_recover(true, least, tmp_path):
    """24 sessions: unbiased within half a stated sigma, and the stated sigma is the scatter's.  3 degrees an hour are hardly seen in 21
    stills: what cannot be negative scatters less than it may be wrong by."""
    found = estimates(true, range(100, 124), tmp_path)
    z = (found[:, 0] - true) / found[:, 1]
    assert abs(z.mean()) < 0.5
    assert least < np.sqrt(np.mean(z**2)) < 1.4
    assert np.mean(found[:, 2] > true) > 0.85


@pytest.mark.slow
def test_no_wander_is_not_seen(tmp_path):
    """An estimate that cannot be negative stands above zero by its sigma; hardly any says that it sees something."""
    found = estimates(0.0, range(100, 124), tmp_path)
    assert np.mean(found[:, 0] / found[:, 1]) < 2
    assert np.mean(found[:, 0] > 2 * found[:, 1]) < 0.2
    assert np.median(found[:, 2]) < 8
