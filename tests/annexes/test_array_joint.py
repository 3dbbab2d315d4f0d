"""An array's joint estimate on a few turns: its optimum, its covariance, its events, and the split of the closure, each by another road."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from scipy.optimize import minimize
from scipy.stats import chi2, f
from small_array import small_array

from tinygc.annexes.arrays import joint as joint_module
from tinygc.annexes.arrays.joint import (
    COMMON_STILL,
    COMMON_TURN,
    OWN_STILL,
    OWN_TURN,
    RARE_P,
    ArrayEvent,
    NoiseBlocks,
    VarianceSplit,
    blocks_of,
    candidates,
    estimate,
    gains_of,
    own_p_values,
    split_of,
    unit_block,
    units_covariance,
    worst_of_each_turn,
)
from tinygc.annexes.arrays.system import MOUNTING, System, array_system
from tinygc.closure.floor import wander_covariance
from tinygc.closure.joint import GRAVITY_SIGMA_MPS2, KNOWN_MPS2
from tinygc.models.linear import BIAS, MATRIX

ERRORS = {"turn_rad": np.array([1e-3, 2e-3, 1e-3]), "force_mps2": 0.01, "common_rad": 2e-3, "level_mps2": 0.01}
MISSED_RAD = np.linspace(0.5e-3, 2e-3, 11)


@pytest.fixture(scope="module")
def small():
    made = small_array(3, 12, seed=4, **ERRORS)
    for unit in made.units:
        for k, turn in enumerate(unit.problem.used):
            turn.duration_s += 0.2 * k
    return made


@pytest.fixture(scope="module")
def joint(small):
    return estimate(small.units, small.same, MISSED_RAD)


def again(joint, state=None):
    """The system of a joint estimate, linearised anew at its end."""
    system, _ = array_system(state or joint.state, joint.start, joint.rows, joint.same, joint.missed_rad, 1e-2)
    return replace(system, out=joint.solution.system.out, prior=joint.solution.system.prior)


# The optimum.


def test_the_estimate_is_where_its_own_system_says_no_further_change(joint):
    assert not joint.events
    further = again(joint).solved(joint.solution.t).x[: joint.layout.attitudes.stop]
    assert np.abs(further).max() < 1e-6


def test_the_components_are_those_of_the_greatest_likelihood(joint):
    system, t = again(joint), joint.solution.t
    here = system.solved(t).value
    for k in range(len(t)):
        for factor in (0.8, 1.25):
            other = t.copy()
            other[k] = max(t[k], 1e-9) * factor
            assert system.solved(other).value > here - 1e-4


def test_gravity_is_as_well_known_as_the_site_where_the_stills_gave_all_accelerometers():
    made = small_array(2, 3)
    for stated, joints, sigma in (
        (1e-3, "ff", 1e-3),
        (0.0, "ff", KNOWN_MPS2),
        (1e-3, "f-", GRAVITY_SIGMA_MPS2),
        (0.0, "fp", GRAVITY_SIGMA_MPS2),
    ):
        for unit, mode in zip(made.units, joints, strict=True):
            unit.problem.joint = {"f": SimpleNamespace(mode="fit"), "p": SimpleNamespace(mode="prior"), "-": None}[mode]
            unit.problem.session.config.site.gravity_sigma_mps2 = stated if unit.number == 0 else 0.5  # the first unit's site counts
        found = estimate(made.units, made.same, np.zeros(2))
        assert found.solution.system.prior[found.layout.gravity] == sigma


def test_a_unit_alone_has_no_common_part():
    made = small_array(1, 12, turn_rad=3e-3, force_mps2=0.01)
    found = estimate(made.units, made.same, np.zeros(11), alone=True)
    assert not found.solution.t[-3:].any()
    assert found.solution.t[0] > 0


def test_without_the_earth_its_rate_is_left_in():
    made = small_array(2, 3)
    assert not estimate(made.units, made.same, np.zeros(2), use_earth=False).rows[0].batch.earth.any()
    assert estimate(made.units, made.same, np.zeros(2)).rows[0].batch.earth.any()


def test_the_search_ends_with_the_first_change_below_a_millionth_or_after_twelve_rounds(monkeypatch):
    def ended(made):
        told = []
        found = estimate(made.units, made.same, np.zeros(2), progress=told.append)
        assert told == [f"joint estimate, round {k + 1}" for k in range(len(told))]
        return len(told), np.abs(found.solution.x[: found.layout.attitudes.stop]).max()

    rounds, change = ended(small_array(2, 3, turn_rad=1e-3, force_mps2=0.01))
    assert rounds == 12
    assert change > 1e-6
    rounds, change = ended(small_array(2, 3))
    assert change < 1e-6
    monkeypatch.setattr(joint_module, "ROUNDS", rounds - 1)
    assert ended(small_array(2, 3))[1] > 1e-6


# Covariance of the units' numbers.


def test_bias_wander_turns_ends_and_moves_the_numbers(small, joint):
    """Each unit's bias moved in one turn and on one axis: the solution's own answer, summed over the wander's covariance."""
    layout, system, t = joint.layout, joint.solution.system, joint.solution.t
    expected = joint.covariance[: layout.gravity, : layout.gravity].copy()
    plain = joint.solution.x
    for i, unit in enumerate(small.units):
        middle_s = np.array([s.start_s + s.duration_s / 2 for s in unit.problem.used])
        wander = wander_covariance(middle_s, instability_rps=unit.problem.instability.rps)
        moved = np.empty((layout.gravity, len(middle_s), 3))
        for s, rows in enumerate(joint.where.closure[i]):
            for axis in range(3):
                values = system.values.copy()
                values[rows] += system.design[rows][:, layout.unit(i)][:, BIAS][:, axis]
                moved[:, s, axis] = (replace(system, values=values).solved(t).x - plain)[: layout.gravity]
        expected += np.einsum("psa,st,qta->pq", moved, wander, moved)
    found = units_covariance(small.units, joint)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(unit_block(found, 1), found[24:48, 24:48])


def test_a_rejected_turn_has_no_part_in_the_wander(small, joint):
    out = joint.solution.system.out.copy()
    out[joint.where.closure[0][2]] = True
    solution = replace(joint.solution.system, out=out).solved(joint.solution.t)
    rejected = replace(joint, solution=solution)
    quiet = [
        replace(u, prepared=SimpleNamespace(problem=SimpleNamespace(**{**vars(u.problem), "instability": SimpleNamespace(rps=0.0)})))
        for u in small.units
    ]
    more = units_covariance(small.units, rejected) - units_covariance(quiet, rejected)
    times = np.array([s.start_s + s.duration_s / 2 for s in small.units[0].problem.used])
    # without the wander of that turn's own moment: another instability there changes nothing
    small.units[0].problem.used[2].start_s += 1000.0
    try:
        moved = units_covariance(small.units, rejected) - units_covariance(quiet, rejected)
    finally:
        small.units[0].problem.used[2].start_s = times[2] - small.units[0].problem.used[2].duration_s / 2
    np.testing.assert_allclose(moved, more, rtol=1e-9, atol=1e-12 * np.abs(more).max())


def test_a_bias_of_the_stills_has_their_error_and_follows_E(small):
    """B = -E b: derivatives by finite differences, and the covariance of b, the mean of the stills: white noise and wander."""
    found = estimate(small.units, small.same, MISSED_RAD, bias="stills")
    whole = units_covariance(small.units, found)
    for i, (unit, rows) in enumerate(zip(small.units, found.rows, strict=True)):
        rates, E = unit.problem.still_rates, found.models[i].E
        count = len(rates.sigma)
        wander = wander_covariance(rates.middle_s, instability_rps=unit.problem.instability.rps)
        mean = np.full(count, 1 / count)
        of_b = np.diag(mean**2 @ rates.sigma**2) + mean @ wander @ mean * np.eye(3)
        own = found.covariance[found.layout.unit(i), found.layout.unit(i)][MATRIX, MATRIX]
        steps = np.eye(9) * 1e-6
        by_E = np.stack([(-(E + s.reshape(3, 3)) @ rows.rest + E @ rows.rest) / 1e-6 for s in steps], axis=1)
        block = unit_block(whole, i)
        np.testing.assert_allclose(found.models[i].B, -E @ rows.rest)
        np.testing.assert_allclose(block[BIAS, BIAS], by_E @ own @ by_E.T + E @ of_b @ E.T, rtol=1e-6)
        np.testing.assert_allclose(block[BIAS, MATRIX], by_E @ own, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(block[MATRIX, MATRIX], own)
        np.testing.assert_allclose(
            block[MOUNTING, MOUNTING], found.covariance[found.layout.unit(i, MOUNTING), found.layout.unit(i, MOUNTING)]
        )


# Sizes of components.


def test_a_components_size_is_its_root_and_near_zero_that_of_its_sigma(joint):
    """Of a variance t with sigma s: sqrt(t) and s / 2 sqrt(t); where t is below s, the root of s."""
    k = joint.where.names.index("turn.1")

    def component(t, sigma):
        changed = replace(joint, solution=replace(joint.solution, t=np.full(len(joint.solution.t), t)))
        changed.__dict__["sigmas"] = np.where(np.arange(len(joint.solution.t)) == k, sigma, 99.0)
        return changed.component("turn.1")

    assert component(4.0, 2.0) == pytest.approx((2.0, 0.5))
    assert component(4.0, 3.999) == pytest.approx((2.0, 3.999 / 4))
    assert component(4.0, 4.0) == pytest.approx((2.0, 2.0))
    assert component(0.0, 9.0) == pytest.approx((0.0, 3.0))
    assert component(0.0, np.inf) == (0.0, np.inf)
    np.testing.assert_allclose(joint.sigmas, joint.solution.sigma())
    assert joint.component("common.level") == pytest.approx((joint.solution.t[-1] ** 0.5, joint.component("common.level")[1]))


# Events.


def rows_alone(errors, t=None, base=1e-9):
    """Blocks of two rows that nothing else touches, errors (B, 2), and the component that is their mean square."""
    errors = np.asarray(errors, dtype=float)
    n = errors.size
    system = System(np.zeros((n, 1)), errors.ravel(), np.full(n, base), np.ones((1, n)), np.ones(1), np.zeros(1), np.zeros(n, dtype=bool))
    rows = np.arange(n).reshape(-1, 2)
    spans = np.column_stack([np.arange(len(rows)), np.arange(len(rows)) + 1])
    return system.solved(np.array([np.mean(errors**2) if t is None else t])), [NoiseBlocks(OWN_TURN, 0, rows, spans)]


def test_an_event_is_an_F_test_of_a_block_against_the_others():
    errors = np.random.default_rng(1).normal(size=(6, 2))
    found = candidates(*rows_alone(errors))
    for b, event in enumerate(found):
        own, others = np.sum(errors[b] ** 2) / 2, np.sum(np.delete(errors, b, axis=0) ** 2) / 10
        assert event.p_value == pytest.approx(min(1.0, 6 * f.sf(own / others, 2, 10)), rel=1e-6)
        assert event.size == pytest.approx(np.linalg.norm(errors[b]))
        assert (event.what, event.unit, event.first, event.last, event.rows.tolist()) == (OWN_TURN, 0, b, b + 1, [2 * b, 2 * b + 1])


def test_a_rejected_block_is_judged_by_all_that_are_kept():
    errors = np.random.default_rng(3).normal(size=(6, 2))
    errors[2] = [4.0, -3.0]
    solution, blocks = rows_alone(errors)
    out = np.zeros(12, dtype=bool)
    out[4:6] = True
    t = np.mean(np.delete(errors, 2, axis=0) ** 2)
    event = candidates(replace(solution.system, out=out).solved(np.array([t])), blocks)[2]
    assert event.p_value == pytest.approx(6 * f.sf(12.5 / t, 2, 12 - 2), rel=1e-6)
    assert event.size == pytest.approx(5.0)


def test_a_block_that_is_nearly_all_of_its_component_counts_at_most_ten_times():
    """One of 6: the others' share has a floor of a twentieth of one block's, and the ratio is at most ten of the block's own."""
    errors = np.full((6, 2), 1e-4)
    errors[2] = 5.0
    event = candidates(*rows_alone(errors))[2]
    chi = 12.0  # all of it, since the component is the mean of all
    assert event.p_value == pytest.approx(6 * f.sf(min((chi / 2) / (0.1 / 10), 10 * chi / 2), 2, 10), rel=1e-4)
    small = candidates(*rows_alone(errors, t=100.0))[2]
    assert small.p_value == pytest.approx(min(1.0, 6 * f.sf(0.25 / ((12 - 0.5) / 10), 2, 10)), rel=1e-4)


def test_blocks_are_of_every_turn_and_still_and_of_what_is_common(small, joint):
    found = blocks_of(joint.rows, joint.same, joint.where)
    assert [(each.what, each.unit) for each in found] == [
        *((OWN_TURN, i) for i in range(3)), *((OWN_STILL, i) for i in range(3)), (COMMON_TURN, None), (COMMON_STILL, None),
    ]  # fmt: skip
    turns, stills = [[q, q + 1] for q in range(11)], [[q, q] for q in range(12)]
    assert [each.spans.tolist() for each in found] == [*[turns] * 3, *[stills] * 3, turns, stills]
    expected = (*joint.where.closure, *joint.where.force, joint.where.common, joint.where.level)
    for each, rows in zip(found, expected, strict=True):
        np.testing.assert_array_equal(each.rows, rows)


def event(what=OWN_TURN, unit=0, first=1, last=2, size=1.0, p=1e-4, rows=(0, 1)):
    return ArrayEvent(what, unit, first, last, size, p, np.array(rows))


@pytest.mark.parametrize(("p", "count"), [(RARE_P, 1), (np.nextafter(RARE_P, 1), 0)])
def test_an_event_is_one_at_its_family_wise_probability(p, count):
    assert (
        len(worst_of_each_turn([event(p=p), event(unit=1, first=5, last=6, p=1.0), event(unit=2, first=7, p=1.0)], np.zeros(9, dtype=bool)))
        == count
    )


def test_of_each_turn_and_each_still_only_the_least_probable_is_an_event():
    out = np.zeros(9, dtype=bool)
    turn, worse = event(p=1e-4), event(unit=1, p=1e-6)
    still, other = event(OWN_STILL, 2, 1, 1, p=1e-3), event(unit=2, first=3, last=4, p=1e-3)
    assert worst_of_each_turn([turn, worse, still, other], out) == [worse, still, other]
    assert worst_of_each_turn([worse, turn, still, other], out) == [worse, still, other]
    larger, third = event(unit=1, p=1e-4, size=1.5), event(unit=2, first=8, last=9, p=1.0)
    assert worst_of_each_turn([turn, larger, third], out) == [larger]
    assert worst_of_each_turn([larger, turn, third], out) == [larger]
    equal = event(unit=1, p=1e-4)
    assert worst_of_each_turn([turn, equal, third], out) == [turn]


def test_what_is_rejected_already_is_no_new_event():
    out = np.array([True, True, False])
    third = event(unit=2, first=8, last=9, p=1.0)
    assert worst_of_each_turn([event(), third], out) == []
    assert len(worst_of_each_turn([event(rows=(1, 2)), third], out)) == 1


def test_of_two_units_the_other_is_a_rival_where_it_contradicts_as_much():
    out = np.zeros(9, dtype=bool)
    one, other = event(p=1e-5), event(unit=1, p=RARE_P)
    (found,) = worst_of_each_turn([one, other], out)
    assert (found.unit, found.rival) == (0, 1)
    for different in (
        event(unit=1, p=1.01 * RARE_P),
        event(unit=1, last=3, p=1e-4),
        event(OWN_STILL, 1, p=1e-4),
        event(COMMON_TURN, None, p=1e-4),
    ):
        (found,) = worst_of_each_turn([one, different, event(unit=1, first=7, last=8, p=1.0)], out)
        assert (found.unit, found.rival) == (0, None)
    (common,) = worst_of_each_turn([event(COMMON_TURN, None, p=1e-7), one, other], out)
    assert (common.unit, common.rival) == (None, None)
    three = [one, other, event(unit=2, first=7, last=8, p=1.0)]
    assert worst_of_each_turn(three, out)[0].rival is None


def test_events_of_other_units_in_the_same_turn_go_together():
    one, other, still, later, common = event(), event(unit=1), event(OWN_STILL, 1), event(unit=1, last=3), event(COMMON_TURN, None)
    assert one.together([one, other, still, later, common]) == (one, other)


def test_a_false_turn_is_found_rejected_and_spoils_no_number():
    """The third unit's third turn errs by 3°, beside errors of 0.06°."""
    clean = small_array(3, 12, seed=8, turn_rad=1e-3, force_mps2=0.01)
    false = small_array(3, 12, seed=8, turn_rad=1e-3, force_mps2=0.01)
    batch = false.units[2].problem.batch
    rate = batch.rate.copy()
    rate[2, -2:] += [1.5, 1.5, 1.5]  # rad/s for 0.02 s
    false.units[2].problem.batch = replace(batch, rate=rate)
    found, before = (estimate(each.units, each.same, np.zeros(11)) for each in (false, clean))
    assert not before.events
    (told,) = found.events
    assert (told.what, told.unit, told.first, told.last) == (OWN_TURN, 2, 2, 3)
    assert told.size == pytest.approx(np.sqrt(3) * 1.5 * 0.02, rel=0.2)
    np.testing.assert_array_equal(np.flatnonzero(found.solution.system.out), np.sort(found.where.closure[2][2]))
    sigma = np.sqrt(np.diag(before.covariance))
    for i in range(3):
        off = (found.state.models[i].vector - before.state.models[i].vector) / sigma[before.layout.unit(i)][:12]
        assert np.abs(off).max() < 3


# The split.


@pytest.fixture(scope="module")
def few():
    """Two units over ten turns of two angles, and what both miss by in each, which follows a prediction: a joint of nothing else."""
    rng, turns = np.random.default_rng(13), 20
    missed = np.repeat(np.linspace(0.3, 3, 10), 2)
    gamma = 1.5 * missed * rng.normal(size=turns)
    values = -np.concatenate([gamma + 1.0 * rng.normal(size=turns), gamma + 2.0 * rng.normal(size=turns), np.zeros(turns)])
    design = np.vstack([np.eye(turns)] * 3)
    V = np.zeros((5, 3 * turns))
    V[0, :turns] = V[1, turns : 2 * turns] = V[2, 2 * turns :] = 1.0
    V[3, 2 * turns :] = missed**2
    base = np.concatenate([np.full(2 * turns, 0.25), np.full(turns, 1e-9)])
    system = System(design, values, base, V, np.full(turns, 1e3), np.zeros(turns), np.zeros(3 * turns, dtype=bool))
    solution = system.estimated(np.array([1.0, 1, 1, 1, 0]))
    return SimpleNamespace(solution=solution, missed_rad=missed[::2], rows=[None, None])


def least(joint, *held) -> float:
    """-2 log of the greatest likelihood with components at zero, by a search of its own."""
    free = np.setdiff1d(np.arange(4), held)

    def value(x):
        t = np.zeros(5)
        t[free] = np.square(x)
        return joint.solution.system.solved(t).value

    options = {"xatol": 1e-5, "fatol": 1e-8, "maxiter": 2000, "maxfev": 2000}
    return min(minimize(value, np.full(len(free), begin), method="Nelder-Mead", options=options).fun for begin in (0.3, 1.0, 2.0))


def test_gains_are_drops_of_the_likelihood_from_no_common_part(few):
    found, none = gains_of(few), least(few, 2, 3)
    assert found["turn"] == pytest.approx(none - least(few, 3), abs=1e-3)
    assert found["undersampled"] == pytest.approx(none - least(few, 2), abs=1e-3)
    assert found["undersampled"] > found["turn"] + 2 > 12


def test_without_a_prediction_nothing_follows_it(few):
    system = few.solution.system
    V = system.V.copy()
    V[3] = 0.0
    unknown = SimpleNamespace(solution=replace(system, V=V).solved(np.array([1.0, 1, 1, 0.25, 0])), missed_rad=np.zeros(10), rows=few.rows)
    found = gains_of(unknown)
    assert found["undersampled"] == -np.inf
    assert found["turn"] == pytest.approx(gains_of(few)["turn"], abs=1e-3)


def test_an_own_excess_is_tested_by_the_likelihood_without_it(few):
    """Half of a chi square of one degree of freedom (Self and Liang 1987), over both units."""
    best, found = least(few), own_p_values(few)
    for i in range(2):
        assert found[i] == pytest.approx(2 * chi2.sf(least(few, i) - best, 1) / 2, rel=2e-2)
    assert found[1] < 0.05
    assert found[1] < found[0] < 1


def test_a_unit_without_an_excess_has_a_p_value_of_one(few):
    without = SimpleNamespace(**{**vars(few), "solution": few.solution.system.solved(np.array([0.0, 4.0, 1, 1, 0]))})
    assert own_p_values(without)[0] == 1.0


@pytest.mark.parametrize(("gain", "p"), [(0.4, chi2.sf(0.4, 1)), (0.0, 1.0), (-0.1, 1.0)])
def test_a_small_excess_has_its_p_value_and_a_search_that_ends_early_has_one(gain, p):
    """Twice, for two units, half of the chi square's."""
    system = SimpleNamespace(estimated=lambda begin, held: SimpleNamespace(value=7.0 + gain))
    solution = SimpleNamespace(t=np.array([1.0, 0.0]), system=system, value=7.0)
    np.testing.assert_allclose(own_p_values(SimpleNamespace(solution=solution, rows=[0, 1])), [p, 1.0])


@pytest.fixture(scope="module")
def split(joint):
    return split_of(joint)


def test_sizes_are_of_both_angles_together(joint, split):
    both = np.sqrt(2)
    for i in range(3):
        np.testing.assert_allclose(split.own[i], both * np.array(joint.component(f"turn.{i}")))
    np.testing.assert_allclose(split.turn, both * np.array(joint.component("common.turn")))
    assert split.predicted == pytest.approx(np.sqrt(2 * np.mean(MISSED_RAD**2)))
    np.testing.assert_allclose(split.fast, split.predicted * np.array(joint.component("common.undersampled")))
    assert split.level_mps2 == joint.component("common.level")


def test_a_unit_minus_the_mean_is_of_turns_that_all_have(small):
    """Residuals of tilt by hand; the second unit lacks the first turn."""
    part = small_array(2, 4, seed=2, turn_rad=1e-3, turns=[[(0, 1), (1, 2), (2, 3)], [(1, 2), (2, 3)]])
    joint = estimate(part.units, part.same, np.zeros(3))
    split = split_of(joint)
    tilt = np.array([joint.solution.residual[joint.where.closure[0][1:]], joint.solution.residual[joint.where.closure[1]]])[..., :2]
    apart = np.sum((tilt[0] - tilt[1]) ** 2, axis=1) / 4  # half the difference, for either
    assert split.fast == (0.0, 0.0)  # nothing is predicted
    assert split.minus_mean_rad == pytest.approx(np.sqrt(apart.mean()))
    np.testing.assert_allclose(split.minus_mean_of, np.sqrt(apart.mean()))
    own = [turn.own_rad for turn in split.turns]
    assert np.isnan(own[0][1])
    assert own[0][0] == pytest.approx(np.linalg.norm(joint.solution.residual[joint.where.closure[0][0]]))
    assert own[2][1] == pytest.approx(np.linalg.norm(joint.solution.residual[joint.where.closure[1][1]]))


def test_a_turn_over_two_intervals_has_the_common_part_of_both():
    part = small_array(2, 4, seed=2, turn_rad=1e-3, common_rad=1e-3, turns=[[(0, 1), (1, 2), (2, 3)], [(0, 2), (2, 3)]])
    joint = estimate(part.units, part.same, np.zeros(3))
    told = ArrayEvent(OWN_TURN, 1, 0, 2, 1.0, 1e-9, np.zeros(0, dtype=int))
    still = replace(told, what=OWN_STILL)
    turns = {(turn.first, turn.last): turn for turn in split_of(replace(joint, events=(told, still))).turns}
    assert list(turns) == [(0, 1), (0, 2), (1, 2), (2, 3)]
    lacks = [np.isnan(turn.own_rad).tolist() for turn in turns.values()]
    assert lacks == [[False, True], [True, False], [False, True], [False, False]]
    np.testing.assert_allclose(turns[0, 2].common_rad, turns[0, 1].common_rad + turns[1, 2].common_rad)
    np.testing.assert_allclose(turns[0, 2].sigma_rad ** 2, turns[0, 1].sigma_rad ** 2 + turns[1, 2].sigma_rad ** 2)
    np.testing.assert_allclose(turns[2, 3].common_rad, joint.solution.x[joint.layout.common][4:6])
    variance = np.diag(joint.covariance)[joint.layout.common]
    np.testing.assert_allclose(turns[2, 3].sigma_rad, np.sqrt(variance[4:6]))
    assert turns[0, 2].events == (told,)
    assert turns[0, 1].events == turns[2, 3].events == ()


def a_split(**changed) -> VarianceSplit:
    plain = VarianceSplit(
        np.zeros((2, 2)), np.ones(2), (0.3 * DEG, 0.1 * DEG), (0.4 * DEG, 0.2 * DEG), 0.8 * DEG, (0.0, 0.0),
        {"turn": 20.0, "undersampled": 30.0}, 0.0, np.zeros(2), (),
    )  # fmt: skip
    return replace(plain, **changed)


def test_the_common_part_is_both_parts_and_its_test_the_better_likelihood():
    """Half of a chi square with one degree of freedom where the likelihood rises."""
    assert a_split().common == pytest.approx(0.5 * DEG)
    assert a_split(gains={"turn": 4.0, "undersampled": 3.0}).p_value == pytest.approx(chi2.sf(4.0, 1))
    assert a_split(gains={"turn": -1.0, "undersampled": 0.0}).p_value == 1.0
    assert a_split(gains={"turn": 0.5, "undersampled": -np.inf}).p_value == pytest.approx(chi2.sf(0.5, 1))


def test_fast_motion_is_borne_out_by_two_more_of_likelihood():
    bar = chi2.isf(0.05, 1)
    assert a_split(gains={"turn": bar, "undersampled": bar + 2.01}).is_fast_motion
    assert not a_split(gains={"turn": bar, "undersampled": bar + 2.0}).is_fast_motion
    assert a_split(gains={"turn": -np.inf, "undersampled": bar + 1e-6}).is_fast_motion
    assert not a_split(gains={"turn": -np.inf, "undersampled": bar - 1e-6}).is_fast_motion


def test_the_words_say_size_cause_and_what_of_the_prediction_was_found():
    assert a_split().words == (
        "0.5° rms a turn in common, which no unit's sensor has made: motion beyond the data rate, predicted 0.8° (found 0.50 ± 0.25 of it)"
    )
    filtered = a_split(fast=(0.26 * DEG, 0.2 * DEG)).words
    assert filtered.endswith("(found 0.33 ± 0.25 of it; a filter below half the data rate leaves so little)")
    assert "filter" not in a_split(fast=(0.27 * DEG, 0.2 * DEG)).words
    same = {"turn": 30.0, "undersampled": 30.0}
    assert a_split(gains=same).words.endswith(
        "the motion, the table or the reference; motion beyond the data rate is predicted to make 0.8°"
    )
    assert a_split(gains=same, predicted=0.0).words.endswith("the motion, the table or the reference")
    weak = {"turn": chi2.isf(0.0501, 1), "undersampled": 0.0}
    assert a_split(gains=weak, common_upper=0.7 * DEG).words == (
        "undecided whether turns have more than noise in common: 0.5° rms a turn, below 0.7° with 95 % (p = 0.05)"
    )
    assert "with 95 %" not in a_split(gains=weak).words  # no limit was found
    assert re.match("0.5° rms", a_split(gains={"turn": chi2.isf(0.0499, 1), "undersampled": 0.0}).words)
