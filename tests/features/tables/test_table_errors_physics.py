"""The table's own errors: exact columns, slopes of the state, terms of the noise, evidence and limits, and what is named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from imperfect_tables import AxisErrors, TableErrors, true_attitudes
from scipy.linalg import block_diag
from scipy.ndimage import maximum_filter1d
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm
from simulated_tables import Summary, draw, fixed_moves

from session.base.errors import DataError
from session.base.numeric import rms_of
from session.base.units import DEG, EARTH_RATE_RPS
from tinygc.features.tables.explanation import TableShown
from tinygc.features.tables.machines.description import LATENCY_SIGMA_S, Axis, Description
from tinygc.features.tables.observed import held_up_from, stamp_offsets
from tinygc.features.tables.rows import (
    DROPPED,
    Comparison,
    _most_cycles,
    _right_jacobian,
    candidates_of,
    cubic_weights,
    moved,
    parts_of,
    prior_of,
)
from tinygc.features.tables.rows_noise import (
    AT_REST,
    BLUR,
    IN_TURN,
    JITTER,
    REPEATABILITY,
    RESOLUTION,
    STAMPS_S,
    WANDER,
    NoiseModel,
    RowsNoise,
)
from tinygc.features.tables.selection import (
    Named,
    _late,
    _Look,
    _odd_inside,
    _Scored,
    _Search,
    select,
)
from tinygc.inference.choose import PRIOR_ODDS, STEPS
from tinygc.inference.noise import Prior, wander_covariance

X, Y, Z = np.eye(3)


SMALL = 1e-6


def table(*directions, sigma_deg=0.01):
    axes = (Axis(n, d, 200 * DEG, 400 * DEG, sigma_deg * DEG, -np.pi, np.pi) for n, d in zip("abc", directions, strict=False))
    return Description("bench", "virtual", tuple(axes))


def errors(of, axis=0, tilt=(0, 0, 0), latency_s=0.0, **more):
    axes = tuple(AxisErrors(**more) if number == axis else AxisErrors() for number in range(len(of.axes)))
    return TableErrors(axes, np.array(tilt) * DEG, latency_s)


def session(of, seed=0, moves=16, wrong=None, **more):
    options = {"block_s": 0.2, "still_s": 2.0} | more
    return draw(Summary(of, fixed_moves(of, moves, 80 * DEG, seed), wrong or TableErrors.none(of), **options), seed)


def named(selected):
    return [each.candidate.id for each in selected.named]


@pytest.fixture(scope="module")
def exact():
    of = table(Z, Y, X)
    return Comparison(session(of, mounting_rad=0.0))


def moved_rows(comparison, wrong):
    """Rows of force and rotation that a table's errors make, without any linearisation."""
    seen = comparison.observed
    before = true_attitudes(seen.table, TableErrors.none(seen.table), seen.reported, seen.senses)
    after = true_attitudes(seen.table, wrong, seen.reported, seen.senses)
    force = before[:, 2] - after[:, 2]
    turn = [at[seen.first].transpose(0, 2, 1) @ at[seen.last] for at in (before, after)]
    rotation = Rotation.from_matrix(turn[0].transpose(0, 2, 1) @ turn[1]).as_rotvec()
    return np.concatenate([force.ravel(), rotation.ravel()])


def test_columns_are_the_slopes_of_the_mechanics(exact):
    of, count, unit = exact.observed.table, 3 * len(exact.observed.reported) + 3 * len(exact.observed.first), SMALL * np.eye(4)
    columns = {(each.id, each.where): each.columns for each in candidates_of(exact)}
    pairs = [(column, errors(of, tilt=step[:3] / DEG)) for column, step in zip(columns["table.tilt", "base"].T, unit, strict=False)]
    for axis, name in enumerate("abc"):
        for number, step in enumerate(unit):
            pairs.append((columns["table.index", f"axis {name}"][:, number], errors(of, axis, index=step)))
            pairs.append((columns["table.wobble", f"axis {name}"][:, number], errors(of, axis, wobble=step)))
    for axis in (1, 2):
        carrier, own = of.axes[axis - 1].direction, of.axes[axis].direction
        away = np.cross(np.cross(carrier, own), own)  # larger by 1 rad between the two
        between = "abc"[axis - 1], "abc"[axis]
        pairs.append((columns["table.nonorthogonal", "axes {}, {}".format(*between)][:, 0], errors(of, axis, skew=SMALL * away)))
        pairs.append((columns["table.backlash", f"axis {between[1]}"][:, 0], errors(of, axis, backlash=SMALL)))
    for number, (column, wrong) in enumerate(pairs):
        assert np.abs(column[:count] - moved_rows(exact, wrong) / SMALL).max() < 1e-5, number


def test_the_states_columns_are_the_slopes_of_its_residuals():
    seen = session(table(Z, Y), moves=8)
    state, sigma = prior_of(seen)
    for _ in range(4):  # to where the residuals are small, since they bend
        comparison = Comparison(seen, state)
        design = np.concatenate([comparison.of_state() * sigma, 1e-3 * np.eye(len(sigma))])
        r = np.append(comparison.residuals(), np.zeros(len(sigma)))
        state = moved(state, sigma * np.linalg.lstsq(design, r, rcond=None)[0])
    columns = Comparison(seen, state).of_state()
    names = [name for name, size in parts_of(seen).items() for _ in size]
    for number in range(len(state)):
        step = 1e-6 * np.eye(len(state))[number]
        difference = [Comparison(seen, moved(state, sign * step)).residuals() for sign in (1, -1)]
        true = (difference[0] - difference[1]) / 2e-6
        # The word's rate is a central difference, as that of the gyroscope in its lag; between two answers it is interpolated otherwise.
        bar = 0.3 if "lag" in names[number] or "latency" in names[number] else 1e-3
        assert np.abs(columns[:, number] + true).max() < bar * max(1.0, np.abs(true).max()), (number, names[number])


def test_a_loss_is_in_the_sense_of_its_turn(exact):
    columns = {(each.id, each.where): each.columns for each in candidates_of(exact)}
    for turn in range(len(exact.observed.first)):
        axis = int(exact.observed.alone[turn])
        lost, dropped = columns["table.lost_steps", f"turn {turn}"], columns[DROPPED, f"turn {turn}"]
        rows = slice(3 * len(exact.observed.reported) + 3 * turn, 3 * len(exact.observed.reported) + 3 * turn + 3)
        # A motor that falls behind turns less than it says, as a sensor reads less that drops samples.
        assert np.sign(exact.observed.turned[turn, axis]) * (exact.axis[turn] @ lost[rows, 0]) == pytest.approx(-1, abs=1e-6)
        assert np.allclose(lost[rows], dropped[rows], atol=1e-6)


def test_a_right_jacobian_is_the_slope_of_the_exponential():
    for vector in np.array([[0.3, -1.2, 0.7], [3e-5, 6e-5, -3e-5], [5e-3, 0, 0], [0.0, 3.0, 0]]):
        R = Rotation.from_rotvec(vector)
        for number, found in enumerate(_right_jacobian(vector[None])[0].T):
            step = 1e-6 * np.eye(3)[number]
            moved_by = [(R.inv() * Rotation.from_rotvec(vector + sign * step)).as_rotvec() for sign in (1, -1)]
            assert found == pytest.approx((moved_by[0] - moved_by[1]) / 2e-6, abs=1e-9)


def test_priors_of_the_state():
    """Axes: zeros of 1°, play of 0.2°; the Earth's rate as the latitude has it, to 1 % of the vertical one."""
    seen = session(table(Z, Y), moves=4)
    assert list(map(len, parts_of(seen).values())) == [9, 3, 6, 3, 3, 3, 2, 2, 1, 1, 1]
    for latitude in (None, 50 * DEG):
        mean, sigma = prior_of(replace(seen, latitude_rad=latitude, accel_sigma_g=0.02))
        horizontal, vertical = (EARTH_RATE_RPS, EARTH_RATE_RPS) if latitude is None else EARTH_RATE_RPS * np.array([np.cos(latitude), 0.01])
        expected = [0.05] * 9 + [5 * DEG] * 3 + [0.02] * 9 + [3 * DEG] * 3 + [horizontal] * 2 + [vertical] + [1 * DEG] * 2 + [0.2 * DEG] * 2
        assert sigma == pytest.approx([*expected, LATENCY_SIGMA_S, 0.02, 0.02**2])
        assert mean == pytest.approx(np.where(np.arange(34) == 26, 0.0 if latitude is None else -EARTH_RATE_RPS * np.sin(latitude), 0.0))


def test_sizes_that_errors_of_a_table_may_have(exact):
    of = candidates_of(exact)
    found = {each.id: np.unique(each.plausible / DEG).tolist() for each in of if each.id.startswith("table.") or each.id == DROPPED}
    sizes = {"tilt": 0.5, "index": 0.2, "wobble": 0.1, "backlash": 0.3, "nonorthogonal": 0.3, "rate_ripple": 0.1, "lost_steps": 2}
    assert found == {f"table.{name}": [pytest.approx(size)] for name, size in sizes.items()} | {DROPPED: [pytest.approx(2)]}


def test_the_fastest_ripple_is_what_the_blocks_resolve():
    """Of a turn of 0.1 rad a block, 0.8 of half a wave a block; at most 100; none of an axis that never turns alone."""
    edges = np.zeros((3, 6, 3))
    edges[:, :, 0] = 0.1 * np.minimum(np.arange(6), 4)
    edges[:, :, 1] = 0.001 * np.arange(6)
    for axis, most in ((0, int(0.8 * np.pi / 0.1)), (1, 100), (2, 0)):
        assert _most_cycles(SimpleNamespace(alone=np.full(3, min(axis, 1)), reported_edges=edges), axis) == most


# Noise, term by term.


def test_white_noise_of_rests_and_turns_is_that_of_means_and_integrals():
    seen = session(table(Z), moves=8)
    model = NoiseModel(Comparison(seen))
    rests, turns = 3 * len(seen.reported), 3 * len(seen.first)
    white, _ = model.blocks[0]
    assert np.diag(white)[:rests] == pytest.approx(seen.accel_walk[0] ** 2 / 2.0, rel=1e-9, abs=0)
    assert np.diag(white)[rests + turns :] == pytest.approx(seen.gyro_walk[0] ** 2 / 2.0, rel=1e-9, abs=0)
    last = np.diag(white)[rests : rests + turns].reshape(-1, 3)
    along = last @ np.array([0, 0, 1.0])  # about the turning axis nothing rotates
    assert along == pytest.approx(seen.gyro_walk[0] ** 2 * seen.blocks * seen.block_s, rel=0.01)


def test_the_walk_within_a_turn_is_that_of_a_bridge():
    seen = session(table(Z), moves=8, mounting_rad=0.0)
    comparison = Comparison(seen)
    for number, (walk, of) in enumerate(NoiseModel(comparison).blocks[1:]):
        t_s = seen.block_s[number] * np.arange(1, seen.blocks[number])
        share, length_s = comparison.share[number, 1 : seen.blocks[number]], seen.blocks[number] * seen.block_s[number]
        bridge = seen.gyro_walk[0] ** 2 * (t_s - 2 * share * t_s + share**2 * length_s)
        assert np.diag(walk - 3e-4**2 * of[JITTER]) - 1e-6**2 == pytest.approx(bridge, rel=1e-5, abs=1e-18)


def test_repeatability_is_one_angle_of_each_rest_in_units_of_the_declared():
    seen = session(table(X, sigma_deg=0.02), moves=8, mounting_rad=0.0)
    V = NoiseModel(Comparison(seen)).blocks[0][1][REPEATABILITY]
    rests = 3 * len(seen.reported)
    tilt = V[:rests, :rests].reshape(len(seen.reported), 3, len(seen.reported), 3)
    for i in range(len(seen.reported)):
        assert np.trace(tilt[i, :, i]) == pytest.approx((0.02 * DEG) ** 2, rel=1e-6)  # gravity moves by the angle, across the axis
        assert np.abs(tilt[i, :, (i + 1) % len(seen.reported)]).max() < 1e-20
    first = V[rests : rests + 3, rests : rests + 3]
    assert first[0, 0] == pytest.approx(2 * (0.02 * DEG) ** 2, rel=1e-6)  # a turn has two ends
    assert V[rests, rests + 3] == pytest.approx(-((0.02 * DEG) ** 2), rel=1e-6)  # and shares one with its neighbour


def test_rows_are_whitened_by_the_factor_of_their_covariance():
    rng = np.random.default_rng(1)
    factors = [np.tril(rng.normal(size=(n, n))) + 3 * np.eye(n) for n in (4, 2, 3)]
    whole = np.zeros((9, 9))
    for start, factor in zip((0, 4, 6), factors, strict=True):
        here = slice(start, start + len(factor))
        whole[here, here] = factor
    rows = rng.normal(size=(9, 2))
    noise = RowsNoise({}, 0.0, factors)
    assert noise.whiten(rows) == pytest.approx(np.linalg.solve(whole, rows))
    assert noise.whiten(rows[:, 0]) == pytest.approx(np.linalg.solve(whole, rows[:, 0]))


@pytest.mark.parametrize(("instability_rps", "usual"), [(2e-5, 2e-5), (0.0, 1e-9)])
def test_the_wander_is_looked_for_about_what_is_known_of_it(instability_rps, usual):
    model = NoiseModel(Comparison(replace(session(table(Z), moves=4), instability_rps=instability_rps)))
    assert model.usual[WANDER] == (usual, Prior(usual, 0.7))
    V = model.blocks[0][1][WANDER]
    seen = model._comparison.observed
    rates = 3 * (len(seen.reported) + len(seen.first)) + 3 * np.arange(len(seen.rest_s))
    expected = wander_covariance(seen.rest_s, seen.rest_span_s, instability_rps=1.0)  # of an instability of 1 rad/s, each axis by itself
    for one, other in np.ndindex(3, 3):
        assert V[np.ix_(rates + one, rates + other)] == pytest.approx(expected * (one == other), rel=1e-9)


def test_an_edge_has_of_its_answers_what_cubic_convolution_gives():
    """Of Keys (1981): exact for parabolas, and an answer's own where the edge is there."""
    at = np.array([1.0, 2.5, 3.0, 4.25])
    found = cubic_weights(at, 7)
    for power in range(3):
        assert found @ np.arange(float(found.shape[1])) ** power == pytest.approx(at**power)
    assert found[0].tolist() == [0, 1, 0, 0, 0, 0, 0]
    assert found[1] == pytest.approx(np.array([0, -1, 9, 9, -1, 0, 0]) / 16)


def test_jitter_and_wander_of_the_stamps_are_angles_by_the_rate_and_blur_by_its_change():
    """Covariances of the rows within a turn, of each size alone, and of a resolution; where the axis rests stamps make no error."""
    seen = session(table(Z, Y), moves=8)
    for number, (_, of) in enumerate(NoiseModel(Comparison(seen)).blocks[1:]):
        way, block_s = seen.reported_edges[number, :, seen.alone[number]], seen.block_s[number]
        edges = slice(1, seen.blocks[number])
        rate = np.gradient(way) / block_s
        change = maximum_filter1d(np.abs(np.gradient(rate)) / block_s, 3)[edges]
        rate, t_s = rate[edges], block_s * np.arange(seen.blocks[number] - 1)
        wanders = {s: np.outer(rate, rate) * np.exp(-np.abs(t_s[:, None] - t_s) / s) for s in (0.3, 5.0)}
        expected = {JITTER: np.diag(rate**2), RESOLUTION: np.eye(len(rate)), BLUR: np.diag(change**2), **wanders}
        assert of.keys() == expected.keys()
        for name, covariance in expected.items():
            assert of[name] == pytest.approx(covariance, abs=2e-3 * covariance.max() + 1e-15), name


def test_sizes_are_those_of_the_greatest_likelihood_of_all_rows():
    """Each as it is, a tenth larger and smaller; and none, where it is zero."""
    model, rng = NoiseModel(Comparison(session(table(Z, Y), moves=16))), np.random.default_rng(6)
    drawn = {name: usual for name, (usual, _) in model.usual.items()} | {JITTER: 3e-3, STAMPS_S[0]: 5e-3}
    r = np.concatenate([factor @ rng.normal(size=len(factor)) for factor in model.of_sizes(drawn)._factors])
    found = model.estimated(r, 1e-9 * rng.normal(size=(len(r), 2)))

    def cost(sizes):
        noise = model.of_sizes(sizes)
        logs = sum(np.log(np.diag(factor)).sum() for factor in noise._factors)
        return 2 * logs + np.sum(noise.whiten(r) ** 2) + (np.log(sizes[WANDER] / model.usual[WANDER][0]) / 0.7) ** 2

    least = cost(found.sizes)
    assert found.value == pytest.approx(least, abs=0.01)
    assert least < cost(drawn)
    for name, size in found.sizes.items():
        for other in (1.1 * size, 0.9 * size) if size else (0.1 * model.usual[name][0],):
            assert cost(found.sizes | {name: other}) > least, name


def test_stamps_have_the_least_jitter_and_the_wander_of_both_times():
    model = NoiseModel(Comparison(session(table(Z, Y), moves=4)))
    sizes = dict.fromkeys(model.usual, 1.0) | {JITTER: 4e-4, STAMPS_S[0]: 3e-3, STAMPS_S[1]: 4e-3}
    noise = model.of_sizes(sizes)
    assert noise.stamps == pytest.approx((5e-4, 5e-3, (9 * 0.3 + 16 * 5) / 25))
    assert replace(noise, sizes=sizes | dict.fromkeys(STAMPS_S, 0.0)).stamps[1:] == (0.0, 0.0)
    assert {name for name, size in model.known_alone(noise).sizes.items() if size == 0} == {REPEATABILITY, AT_REST, IN_TURN}


@pytest.fixture
def turn():
    """Answers of a turn of 90 degrees that begins and ends within it, stamped with a jitter of 1 ms."""
    rng, t_s = np.random.default_rng(4), np.arange(0, 3, 0.005)
    way = np.interp(t_s, [0.5, 2.5], [0, 90 * DEG])
    requested_s = np.arange(0.03, 2.95, 0.06)
    return t_s, way, requested_s, requested_s + 1e-3 * rng.normal(size=len(requested_s))


@pytest.mark.parametrize("late_s", [0.02, -0.02])
def test_an_answer_that_was_held_up_is_found_and_no_other(turn, late_s):
    t_s, way, requested_s, stamp_s = turn
    stamp_s[20] += late_s
    offset_s = stamp_offsets(stamp_s, np.interp(requested_s, t_s, way), t_s, way)
    assert np.flatnonzero(np.abs(offset_s) > held_up_from([offset_s])).tolist() == [20]
    assert offset_s[20] == pytest.approx(late_s, abs=3e-3)


@pytest.mark.parametrize("error_deg", [lambda a: 2.0 * (a > 45 * DEG), lambda a: 0.5 * np.sin(9 * a)])
def test_an_error_of_the_table_is_no_answer_that_was_held_up(turn, error_deg):
    """Lost steps, a ripple and an index error: neighbours have them too."""
    t_s, way, requested_s, stamp_s = turn
    reported = np.interp(requested_s, t_s, way)
    offset_s = stamp_offsets(stamp_s, reported + error_deg(reported) * DEG, t_s, way)
    assert not (np.abs(offset_s) > held_up_from([offset_s])).any()


# What is named, and with what certainty.


@pytest.fixture(scope="module")
def clean():
    """A clean table, and what is selected there."""
    of = table(Z, Y)
    return of, select(session(of, 1, moves=8))


def test_an_error_of_the_table_is_named_with_its_size():
    of = table(Z, Y)
    selected = select(session(of, 3, moves=8, wrong=errors(of, tilt=(0.1, -0.05, 0))))
    assert named(selected) == ["table.tilt"]
    (found,) = selected.named
    assert found.equivalent == ()
    assert (np.abs(found.theta - np.array([0.1, -0.05]) * DEG) < 4 * found.sigma).all()
    assert found.p_value < 0.01


@pytest.mark.parametrize("size_deg", [0.002, 1.2])
def test_a_set_has_the_evidence_of_its_best_scale_and_a_name_the_chance_of_least_squares(size_deg):
    """Chi-square of the tilt with the state fitted beside it, where no prior draws it to zero; an error larger than plausible (0.5 degrees)
    has its position in the prior besides."""
    of = table(Z, Y)
    search = _Search(session(of, 3, moves=8, wrong=errors(of, tilt=(size_deg, -0.8 * size_deg, 0))))
    nothing = search.of([])
    tilt = next(each.candidate for each in nothing.look.scored if each.candidate.id == "table.tilt")
    best = search.of([replace(tilt, tried=1)], nothing)
    found = search.named(best, best.named[0], lambda p_value: p_value)
    state, own = np.split(best.fitted, [-2], axis=1)
    at = -best.prior_left[-2:]  # where the slopes are taken, in plausible sizes
    whole = np.concatenate(
        [best.noise.whiten(np.column_stack([state, own, best.r - own @ at])), np.eye(state.shape[1], state.shape[1] + 3)]
    )
    J, A, y = np.split(whole, [state.shape[1], -1], axis=1)
    y[len(best.r) :, 0] = best.prior_left[:-2]
    left = [np.linalg.lstsq(design, y[:, 0])[1][0] for design in (J, np.column_stack([J, A]))]
    assert found.p_value == pytest.approx(chi2(2).sf(left[0] - left[1]), rel=1e-4)
    assert found.log_evidence == (nothing.score - best.score) / 2
    scale = min(rms_of(at), 1.0)
    expected = 2 * np.log(10) + 2 - 2 * np.log(PRIOR_ODDS) + max(np.sum((at / scale) ** 2) - 2, 0)
    assert best.score - best.noise.value == pytest.approx(expected)
    assert (rms_of(at) > 1) == (size_deg > 1)


def test_each_form_of_an_error_has_its_share_of_the_odds():
    of = table(Z, Y)
    search = _Search(session(of, 3, moves=8))
    forms = [each.candidate for each in search.of([]).look.scored if each.candidate.id == "table.lost_steps"]
    lost = search.of([forms[2]])
    price = 2 * np.log(10 * len(forms)) + 1 - 2 * np.log(PRIOR_ODDS)
    assert lost.score - lost.noise.value == pytest.approx(price)


@pytest.fixture(scope="module")
def base(clean):
    """All that is judged beside the state alone, and those of it of which every direction is seen, either sense alike."""
    _, selected = clean
    look = _Search(selected.observed).of([]).look
    one_sided = {"table.lost_steps", DROPPED}
    whole = [e for e in look.scored if e.seen.all() and not e.candidate.one_sided and e.candidate.id not in one_sided]
    return look, whole


def test_evidence_is_the_ratio_of_two_likelihoods(base):
    base, whole = base
    single = [each for each in whole if len(each.s) == 1]
    for each in single:
        column = base.columns[:, each.place.start]
        own = column @ column - np.sum((base.basis[: len(base.columns)].T @ column) ** 2)
        pull = column @ base.left[: len(base.columns)]
        # Two Gaussians, with and without a column whose prior has each scale in turn: determinant lemma and Sherman-Morrison.
        ratios = (pull**2 * STEPS**2 / (1 + own * STEPS**2) - np.log(1 + own * STEPS**2)) / 2
        expected = np.log(np.mean(np.exp(ratios))) + np.log(PRIOR_ODDS / each.candidate.tried)
        assert each.log_evidence == pytest.approx(expected, abs=1e-6)
    assert single


def test_a_limit_is_what_nine_of_ten_would_show(clean, base):
    (_, selected), (base, _) = clean, base
    bar = norm.isf(0.025 / len(base.scored)) + norm.isf(0.1)
    skew = next(each for each in base.scored if each.candidate.id == "table.nonorthogonal")
    limit, unit = selected.limits["table.nonorthogonal", "axes a, b"]
    assert unit == "deg"
    column = base.columns[:, skew.place.start]
    sigma = skew.candidate.plausible[0] / np.sqrt(column @ column - np.sum((base.basis[: len(base.columns)].T @ column) ** 2))
    assert limit * DEG == pytest.approx(bar * sigma, rel=1e-3)


def test_a_p_value_has_as_many_degrees_of_freedom_as_directions_are_seen(base):
    """What a candidate takes of the residuals beside all that is fitted already, by least squares; chi-square of its numbers."""
    base, whole = base
    for each in whole:
        columns = np.concatenate([base.columns[:, each.place], np.zeros((len(base.left) - len(base.columns), len(each.s)))])
        columns = columns - base.basis @ (base.basis.T @ columns)
        left = base.left - columns @ np.linalg.lstsq(columns, base.left, rcond=None)[0]
        gain = base.left @ base.left - left @ left
        assert each.p_value == pytest.approx(chi2.sf(gain, len(each.s)), rel=1e-6, abs=0)
    assert len({len(each.s) for each in whole}) > 1


def test_the_smallest_p_of_independent_directions_is_that_of_sidak():
    """Five candidates, of 1, 1, 1, 2 and 2 directions that no other sees, one without any: P(smallest < p) = 1 - (1 - p)^5."""
    size, start, scored = [1, 1, 1, 2, 2], 0, []
    for count in size:
        scored.append(_Scored(None, slice(start, start + count), np.full(count, 7.0), np.eye(count), 1.0, 0.0))
        start += count
    scored.append(_Scored(None, slice(start, start + 1), np.array([1.9]), np.eye(1), 1.0, 0.0))
    chance = _Look.chance(SimpleNamespace(gram=np.diag([49.0] * 7 + [1.9**2]), scored=scored), 1)
    for p in (0.01, 0.05, 0.2):
        expected = 1 - (1 - p) ** 5
        assert chance(p) == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / 1000))
    alone = [replace(scored[-1], place=slice(0, 1))]
    assert _Look.chance(SimpleNamespace(gram=np.eye(1), scored=alone), 1)(1.0) == 1.0


def test_a_set_has_the_evidence_of_its_rows_with_the_price_of_its_errors():
    """-2 log N(r; 0, N D N' + C) but for a constant, D of an error by the rms of its parameters, about the state's prior mean."""
    of = table(Z)
    search = _Search(session(of, 2, moves=6, wrong=errors(of, backlash=0.3 * DEG)))
    tilt, play = (next(e for e in candidates_of(Comparison(search._observed)) if e.id == id) for id in ("table.tilt", "table.backlash"))
    scores = []
    for named in ([], [play], [play, tilt]):
        fit = search.of(named)
        factor = block_diag(*fit.noise._factors)
        size = np.ones(fit.fitted.shape[1])
        prices = 0.0
        for each in fit.named:
            theta = fit.theta[fit.keys[each.key]] / each.plausible
            scale = min(np.sqrt(np.mean(theta**2)), 1.0)
            size[fit.keys[each.key]] = scale
            prices += 2 * np.log(30 * 10 * each.tried) + len(theta) + max(np.sum((theta / scale) ** 2) - len(theta), 0.0)
        count = len(fit.comparison.state)
        N = fit.fitted * size
        r = fit.r - fit.fitted[:, :count] @ fit.prior_left[:count]
        C = factor @ factor.T + N @ N.T
        wander = fit.model.usual[WANDER]
        prior = (np.log(fit.noise.sizes[WANDER] / wander[0]) / 0.7) ** 2
        score = np.linalg.slogdet(C)[1] + r @ np.linalg.solve(C, r) + prior + prices
        assert fit.score == pytest.approx(score, abs=0.05)
        scores.append(fit.score)
    assert scores[1] < scores[0] - 20
    assert scores[2] > scores[1]
    assert set(search._known[frozenset([play.key])].keys) == {play.key}
    assert {frozenset(fit.keys) for fit in search.near(search.of([play, tilt]))} >= {frozenset([play.key]), frozenset([tilt.key])}


@pytest.mark.parametrize(("far", "size", "odd"), [(1, 5.9, False), (3, 6.1, True), (4, 6.1, False)])
def test_a_turn_is_odd_inside_from_six_times_the_usual_square_where_few_are(far, size, odd):
    """Of 12 turns of one axis, a quarter at most; beside them one of another axis, and one of several without rows."""
    squares = 0.5 * np.where(np.arange(12) < far, size, 1.0)
    inner = np.ones((14, 4), dtype=bool)
    inner[13] = False
    inner[0, 2:] = False
    left = np.concatenate([np.zeros(5), np.sqrt(np.repeat([*squares, 100.0, 0.0], inner.sum(axis=1))), np.full(3, 9.0)])
    seen = SimpleNamespace(reported=np.zeros((15, 2)), alone=np.array([0] * 12 + [1, -1]))
    base = SimpleNamespace(
        comparison=SimpleNamespace(observed=seen, inner=inner),
        look=SimpleNamespace(left=left),
        model=SimpleNamespace(outer=5),
        r=np.zeros(5 + int(inner.sum())),
    )
    assert _odd_inside(base).tolist() == [odd and number < far for number in range(14)]


@pytest.mark.parametrize(
    ("latency_s", "id", "values"), [(0.03, "table.latency", {"latency_ms": 30.0}), (-0.03, "gyro.bandwidth", {"tau_s": [0.03] * 3})]
)
def test_a_late_word_is_the_machines_and_an_early_one_a_late_sensors(latency_s, id, values):
    found = _late(SimpleNamespace(of_latency=lambda: np.zeros((9, 1))), latency_s, 2e-3, 0.01, 5.0)
    assert (found.candidate.id, found.p_value, found.log_evidence, found.equivalent) == (id, 0.01, 5.0, ("timing.axis_skew",))
    assert found.candidate.values(found.theta) == {name: pytest.approx(value) for name, value in values.items()}
    assert (found.sigma == 2e-3).all()
    assert len(found.sigma) == len(found.theta) == len(found.candidate.plausible)


# Verdicts.


def test_a_verdict_is_never_clean_beyond_what_is_declared(clean):
    of, selected = clean
    assert TableShown(of, selected).verdict == "clean"
    for name in (REPEATABILITY, AT_REST, IN_TURN):
        found = TableShown(of, replace(selected, excess={name: 4.0}))
        assert found.verdict == "unexplained"
        assert "4.0 times" in found.doubts[0]


@pytest.mark.parametrize(("p", "verdict"), [(0.0009, "unexplained"), (0.002, "suspected"), (0.06, "clean")])
def test_a_mismatch_without_a_name_is_claimed_as_far_as_its_p_value_goes(clean, p, verdict):
    of, selected = clean
    found = TableShown(of, replace(selected, first_p=p))
    assert found.verdict == found.to_json()["table"]["verdict"] == verdict
    assert ("no effect of the catalogue fits" in found.rows[0][1]) == (verdict == "unexplained")


def test_limits_stand_where_there_are_any(clean):
    of, selected = clean
    of_gyroscope = {("gyro.scale_asymmetry", ""): (0.1, "fraction")}
    for limits, begins in ((selected.limits, "not seen, and would be from: "), (of_gyroscope, "inseparable here: a part of ")):
        assert dict(TableShown(of, replace(selected, limits=limits)).rows)["limits"].startswith(begins)
    assert "limits" not in dict(TableShown(of, replace(selected, limits=of_gyroscope, hidden={})).rows)


def test_sizes_beyond_what_is_declared_are_known(clean):
    _, selected = clean
    model, declared = NoiseModel(Comparison(selected.observed)), 0.01 * DEG
    quiet = selected.noise.sizes | {REPEATABILITY: 2.9, AT_REST: 0.9e-3, IN_TURN: 2.9 * np.sqrt(2) * declared}
    assert model.excess(replace(selected.noise, sizes=quiet)) == {}
    in_turn = 6 * np.hypot(model.usual[IN_TURN][0], np.sqrt(2) * declared)
    for name, size in ((REPEATABILITY, 6.0), (AT_REST, 2e-3), (IN_TURN, in_turn)):
        assert model.excess(replace(selected.noise, sizes=quiet | {name: size})) == {name: pytest.approx(2.0)}


def of_name(selected, id, where="", equivalent=(), called=None):
    candidate = next(each for each in candidates_of(Comparison(selected.observed)) if each.id == id)
    return Named(replace(candidate, id=called or id, where=where), np.ones(1), np.ones(1), 1e-3, 9.0, equivalent)


def test_verdicts_follow_from_whose_errors_are_named(clean):
    of, selected = clean
    mine, theirs = of_name(selected, "table.backlash"), of_name(selected, "gyro.scale_asymmetry")
    either = replace(mine, equivalent=("gyro.scale_asymmetry",))
    late = of_name(selected, "table.backlash", equivalent=("timing.axis_skew",), called="table.latency")
    loss = [of_name(selected, "table.lost_steps", f"turn {turn}") for turn in range(3)]
    for verdict, *cases in (
        ("table", [mine], [mine, late], loss[:2]),
        ("sensor", [theirs]),
        ("both", [mine, theirs]),
        ("ambiguous", [either], [mine, either], [late]),
        ("partly_explained", loss),
    ):
        for some in cases:
            assert TableShown(of, replace(selected, named=some)).verdict == verdict


def test_an_axis_that_turns_the_other_way_and_gravity_far_off_are_one_line(clean):
    of, selected = clean
    seen = selected.observed
    wrong = replace(of, axes=(replace(of.axes[0], direction=-Z), of.axes[1]))
    with pytest.raises(DataError, match=r"axis a turns the other way than it reports: the gyroscope reads -1\.0"):
        select(replace(seen, table=wrong))
    leaning = replace(of, mounting=Rotation.from_euler("x", 15, degrees=True).as_matrix())
    with pytest.raises(
        DataError, match=r"gravity is up to 1\d deg from where the reported angles have it \(rest \d+\), expected within 10 deg"
    ):
        select(replace(seen, table=leaning))
