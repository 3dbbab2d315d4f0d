"""The temperature between the steps of a thermometer, what is uncertain of it, and what that adds to the zero's covariance."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from small_rests import small_rest

from tinygc.annexes.temperature import axis_fit
from tinygc.annexes.temperature.axis_fit import BY_CHANCE, about, columns, estimate_noise, fit_axis, line_in, make_knots
from tinygc.annexes.temperature.output import of_rests, order_word, remarks
from tinygc.annexes.temperature.rest_fit import fit_rests
from tinygc.annexes.temperature.sessions_fit import of_rests_alone
from tinygc.annexes.temperature.sweeps import between_steps, sweeps_of

T = np.arange(400.0)
#: rms of a uniform error, of its width; of a parabola about its chord, as ``sweeps`` has it
UNIFORM, BENT = 0.5 / np.sqrt(3), 0.046


def read(temp_c, step=1.0):
    return np.round(np.asarray(temp_c) / step) * step


@pytest.mark.parametrize("step", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("on", [0.0, 0.13])
def test_a_steady_sweep_is_a_straight_line(step, way, on):
    """Passages fall between two blocks, each half a block off at most."""
    temp_c = 30 + way * 0.0371 * T
    found = between_steps(T, on + read(temp_c - on, step), (step, on + 8 * step))
    assert np.abs(found.temp_c - temp_c).max() < 0.06
    assert np.abs(read(temp_c - on, step) + on - temp_c).max() > 0.4 * step
    assert found.sigma_c[(found.interval > 0) & (found.interval < found.interval.max())].max() < 0.05 * step


def test_passages_by_hand():
    """Steps at 10, 20, 40, 60 of readings 0 to 4: rates 1/10, 1/20, 1/20; the ends go on as beside, the first to the reading's own edge."""
    reading = np.repeat([0.0, 1, 2, 3, 4], [10, 10, 20, 20, 10])
    t = np.arange(70) + 0.5
    found = between_steps(t, 5 + 2 * reading, (2.0, 5.0))
    assert np.interp([10, 20, 40, 60], t, found.temp_c) == pytest.approx([6, 8, 10, 12], abs=0.02)
    assert found.interval.tolist() == np.repeat([0, 1, 2, 3, 4], [10, 10, 20, 20, 10]).tolist()
    sigma = [UNIFORM * 0.95, BENT * 0.5, BENT, 0.0, UNIFORM * 9.5 / 20]
    assert found.sigma_c == pytest.approx(2 * np.repeat(sigma, [10, 10, 20, 20, 10]))
    assert found.temp_c[-1] == pytest.approx(5 + 2 * (3.5 + 9.5 / 20))
    assert found.temp_c[0] == pytest.approx(5 + 2 * (0.5 - 0.95))


def test_where_it_stays_the_reading_holds():
    """Quickly to 3, half an hour there, and on: half a step beyond what it passed at each end, a uniform error."""
    reading = np.repeat([0.0, 1, 2, 3], [5, 5, 5, 385])
    found = between_steps(T, reading, (1.0, 0.0))
    assert found.temp_c[-1] == pytest.approx(3)
    assert found.sigma_c[-1] == pytest.approx(UNIFORM)
    stays = between_steps(T, np.repeat([0.0, 1, 2, 3, 4, 5], [5, 5, 5, 375, 5, 5]), (1.0, 0.0))
    assert stays.sigma_c[200] == pytest.approx(UNIFORM)


@pytest.mark.parametrize(("rests", "by"), [(8, 0.2), (18, 0.45), (100, 0.5)])
def test_where_it_turns_it_goes_half_of_a_parabolas_way(rests, by):
    """Up a step in ten, down as fast; what it passed twice ``rests`` apart."""
    reading = np.concatenate([np.repeat([0.0, 1, 2], 10), np.full(rests, 3.0), np.repeat([2.0, 1, 0], 10)])
    t = np.arange(len(reading)) + 0.5
    found = between_steps(t, reading, (1.0, 0.0))
    middle = 30 + rests // 2
    assert found.temp_c[middle] == pytest.approx(2.5 + by, abs=0.01)
    assert found.sigma_c[middle] == pytest.approx(UNIFORM * min(rests / 40, 1))


def test_to_and_fro_between_two_steps_is_one_passage_where_both_are_as_frequent():
    reading = np.concatenate([np.zeros(10), np.tile([0.0, 1], 5), np.ones(20), np.full(20, 2.0)])
    t = np.arange(len(reading)) + 0.5
    found = between_steps(t, reading, (1.0, 0.0))
    assert found.interval.max() == 2
    assert np.flatnonzero(np.diff(found.interval)).tolist() == [10, 39]


@pytest.mark.parametrize("noise", [0.05, 0.2])
def test_noise_below_a_step_does_not_spoil_it(noise):
    rng = np.random.default_rng(0)
    temp_c = 20 + 6 * np.sin(T / 130)
    means = read(temp_c[:, None] + noise * rng.standard_normal((400, 10))).mean(axis=1)
    found = between_steps(T, means, (1.0, 0.0))
    assert np.std(found.temp_c - temp_c) < 0.4 * np.std(means - temp_c)


def test_what_is_left_as_it_is():
    """No grid; fine steps; noise that carries the means across the steps."""
    temp_c = np.linspace(20, 40, 400)
    rng = np.random.default_rng(0)
    wide = read(temp_c) + 0.18 * rng.standard_normal(400)
    for means, grid in ((temp_c, (0.0, 0.0)), (read(temp_c, 0.01), (0.01, 0.0)), (wide, (1.0, 0.0)), (temp_c[:1], (1.0, 0.0))):
        found = between_steps(np.arange(len(means)), means, grid)
        assert found.temp_c is means
        assert not found.sigma_c.any()
    flat = between_steps(T, np.full(400, 20.0), (2.0, 0.0))
    assert set(flat.temp_c) == {20.0}
    assert flat.sigma_c == pytest.approx(2 * UNIFORM)


# In the knots and the fit


def stepped(slope=0.02, step=1.0, seed=0, noise=0.003, back=False):
    rng = np.random.default_rng(seed)
    temp_c = 20.3 + 9 * (1 - np.abs(T / 200 - 1) if back else T / 400)
    log = small_rest(read(temp_c, step), slope * (temp_c - 20) + noise * rng.standard_normal(400), block_s=4.0)
    return replace(log, grid=(step, 20.0)), temp_c


def test_the_knots_carry_the_errors_of_the_steps():
    """Of each interval one, alike in all its blocks; of a knot the mean."""
    logs = [stepped()[0], stepped()[0]]
    knots = make_knots(logs, [])
    one = between_steps(logs[0].t_s, logs[0].temp_c, logs[0].grid)
    expected = np.zeros((len(knots), 2 * (one.interval.max() + 1)))
    stops = np.append(knots.starts[1:], 800)
    for k, (start, stop) in enumerate(zip(knots.starts, stops, strict=True)):
        for block in range(start, stop):
            expected[k, one.interval[block % 400] + (block >= 400) * (one.interval.max() + 1)] += one.sigma_c[block % 400] / (stop - start)
    assert knots.off_c @ knots.off_c.T == pytest.approx(expected @ expected.T)
    assert knots.temp_c == pytest.approx(knots.mean(np.tile(one.temp_c, 2)))


def test_the_errors_weigh_with_the_slope_there():
    """Of 0.5 + 0.02 T + 0.001 T^2 the slope is 0.02 + 0.002 T; a constant has none."""
    knots = make_knots([stepped()[0]], [])
    away = knots.temp_c - knots.reference_c
    y = 0.5 + columns(knots, 0.0, 2)[:, 1:] @ [0.02 * knots.half_c, 0.001 * knots.half_c**2]
    off = (0.02 + 0.002 * away)[:, None] * knots.off_c
    assert knots.of_steps(y, 0.0, 2) == pytest.approx(off @ off.T, abs=1e-12)
    assert not knots.of_steps(y, 0.0, 0).any()
    V = knots.covariances()
    with_them = about(knots, y, V, 0.01, 2)
    of_noise = sum(v * s**2 for v, s in zip(V, with_them.sizes, strict=True))
    np.testing.assert_allclose(with_them.C, of_noise + off @ off.T, atol=1e-12)
    plain = estimate_noise(y, columns(knots, 0.0, 2), V, 0.01, off @ off.T)
    np.testing.assert_allclose(plain.C, with_them.C)


@pytest.mark.parametrize("step", [0.5, 1.0])
@pytest.mark.parametrize("back", [False, True])
def test_a_strong_slope_is_found_by_a_coarse_thermometer(step, back):
    log, _ = stepped(0.05, step, back=back)
    fit = fit_axis(make_knots([log], sweeps_of(log.temp_c)), log.gyro[:, 0])
    assert fit.order == 1
    assert fit.line is None
    assert abs(fit.terms[1] - 0.05) < 3 * fit.sigma[1]
    assert fit.sigma[1] < 0.05 * 0.03


# What a constant may hide


@pytest.mark.parametrize(("noise", "shows"), [(0.003, 2), (0.3, 0)])
def test_the_line_of_a_constant_by_full_matrices(noise, shows):
    """Slope by equal weights, sigma in the noise of the constant; whether the parabola shows in the noise that it leaves itself."""
    log, _ = stepped(noise=noise, back=True)
    knots = make_knots([log], sweeps_of(log.temp_c))
    y, V = knots.mean(log.gyro[:, 0]) * 4, knots.covariances()
    of_constant, of_parabola = about(knots, y, V, noise, 0), about(knots, y, V, noise, 2)
    found = line_in(knots, y, V, noise, of_constant, 2, 0.25)
    G = np.linalg.pinv(columns(knots, 0.0, 1))[1] / knots.half_c
    assert found.slope == pytest.approx(G @ knots.mean(log.gyro[:, 0]))
    assert found.sigma == pytest.approx(np.sqrt(G @ of_constant.C @ G) / 4)
    G = np.linalg.pinv(columns(knots, 0.0, 2))[1:]
    square = (G @ y) @ np.linalg.solve(G @ of_parabola.C @ G.T, G @ y)
    assert (stats.chi2.sf(square, 2) < BY_CHANCE) == bool(shows)
    assert found.order == shows


def test_a_line_or_a_walk_is_said_and_no_constant(monkeypatch):
    """A strong line that the test of chance does not let through."""
    log, _ = stepped()
    chance = axis_fit.none_by_chance
    monkeypatch.setattr(axis_fit, "none_by_chance", lambda *given: 1.0)
    rests = fit_rests([(log, None)], (0, 1), with_accel=False)
    assert rests.gyro[0].order == 0
    assert rests.gyro[0].line.order == 1
    said = remarks(of_rests_alone("x", rests, {}))
    assert any(line.startswith("x: straight line or walk, 1.1") and "not told apart" in line for line in said)
    table = of_rests(rests)["gyro"][0]
    assert table["line_or_walk"] is True
    assert table["line_dps"] == pytest.approx(np.degrees(rests.gyro[0].line.slope))
    assert table["line_std_dps"] == pytest.approx(np.degrees(rests.gyro[0].line.sigma))
    monkeypatch.setattr(axis_fit, "none_by_chance", chance)
    rests = fit_rests([(log, None)], (0, 1), with_accel=False)
    assert rests.gyro[0].line is None
    assert not any("walk" in line for line in remarks(of_rests_alone("x", rests, {})))
    assert {key: of_rests(rests)["gyro"][0][key] for key in ("line_dps", "line_std_dps", "line_or_walk")} == {
        "line_dps": None,
        "line_std_dps": None,
        "line_or_walk": False,
    }


def test_without_a_range_there_is_no_line():
    rest = small_rest(np.full(100, 20.0), np.random.default_rng(0).standard_normal(100))
    assert fit_axis(make_knots([rest], []), rest.gyro[:, 0]).line is None


def test_orders_have_words():
    assert [order_word(order) for order in (0, 1, 2, 3, 4, 9)] == ["constant", "straight line", "parabola", "cubic", "order 4", "order 9"]


def test_the_errors_of_the_steps_are_not_taken_for_noise():
    knots = make_knots([stepped()[0]], [])
    off = 0.05 * knots.off_c
    y = columns(knots, 0.0, 1) @ [0.5, 0.3] + off @ np.random.default_rng(1).standard_normal(off.shape[1])
    A, V = columns(knots, 0.0, 1), knots.covariances()
    told, untold = (estimate_noise(y, A, V, 1e-4, steps) for steps in (off @ off.T, 0.0))
    assert told.sizes[1:].max() < 0.2 * untold.sizes[1:].max()
