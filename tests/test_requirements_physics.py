"""Decision rules: probability of conformity, guard bands and risks by hand and by another program; limits as they are read."""

import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from session.base.errors import FormatError
from session.base.results import require
from session.base.units import DEG
from session.log.config import Accelerometer
from session.log.requirements import GROUPS, GUARDED, QUANTITIES, SIMPLE, Requirements, RequirementsShape, Rule
from tinygc.deploy.calibration import in_frame_of
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.choice import AgainstRaw
from tinygc.inference.decide import Conformity, Fact, simply_accepted
from tinygc.inference.solve import Source, known_sources, total
from tinygc.models.linear import field_facts, field_jacobian
from tinygc.verdict.acceptance import CandidateFit, _doubts, decide
from tinygc.verdict.requirements import (
    attitude_measured,
    closure_measured,
    run_measured,
    sensor_measured,
)
from tinygc.verdict.requirements import conformity as conformities

INF = float("inf")
BETWEEN = (-2.0, 3.0)


@pytest.mark.parametrize("freedom", [INF, 4.0, 1.5])
@pytest.mark.parametrize("limits", [BETWEEN, (-INF, 3.0), (-2.0, INF)])
def test_probability_of_conformity_is_that_of_scipy(limits, freedom):
    law = stats.norm(0.7, 1.3) if freedom == INF else stats.t(freedom, 0.7, 1.3)
    assert conformity(0.7, Rule(), limits, 1.3, freedom).probability == pytest.approx(law.cdf(limits[1]) - law.cdf(limits[0]))


def test_without_an_uncertainty_the_value_itself_decides():
    assert [conformity(value, Rule(), sigma=0.0).probability for value in (-2.0, 3.0, 3.1)] == [1, 1, 0]
    assert not simply_accepted(float("nan"), BETWEEN)


def conformity(value, rule, limits=BETWEEN, sigma=0.1, freedom=INF, observed=True):
    return Conformity(Fact("bias x", "mdps", value, sigma, freedom, observed, key="gyro_bias_x_mdps"), limits, rule)


TINY = 1e-9
GUARD = 1.959964 * 0.1


@pytest.mark.parametrize(
    ("value", "answer"),
    [
        (3 - GUARD - 1e-6, "pass"),
        (3 - GUARD + 1e-6, "not decided"),
        (3 + GUARD + 1e-6, "fail"),
        (-2 + GUARD - 1e-6, "not decided"),
        (-2 - GUARD - 1e-6, "fail"),
        (float("nan"), "not decided"),
    ],
)
def test_a_guard_band_is_u_wide_on_both_sides_of_each_limit(value, answer):
    assert conformity(value, Rule(GUARDED)).answer == answer


def test_the_guard_band_scales_with_r_and_with_students_k():
    assert conformity(0, Rule(GUARDED, guard=0.5)).band == pytest.approx(GUARD / 2, rel=1e-6)
    assert conformity(0, Rule(GUARDED), freedom=4).band == pytest.approx(0.1 * stats.t(4).ppf(0.975))
    assert conformity(0, Rule()).band == 0


@pytest.mark.parametrize("freedom", [INF, 3.0])
def test_a_largest_risk_is_kept_on_both_sides(freedom):
    away = 0.1 * (stats.norm() if freedom == INF else stats.t(freedom)).ppf(0.95)
    risk = pytest.approx(0.05, abs=1e-6)
    for beyond, expected in ((TINY, [("pass", risk), ("fail", risk)]), (-1e-6, [("not decided", None)] * 2)):
        at = [conformity(3 + side * (away + beyond), Rule(GUARDED, risk=0.05), (-INF, 3.0), freedom=freedom) for side in (-1, 1)]
        assert [(each.answer, each.risk) for each in at] == expected
        assert at[0].band == pytest.approx(away)


def test_simple_acceptance_passes_up_to_the_limit_and_says_the_risk():
    for value, answer, risk in ((3.0, "pass", 0.5), (3.1, "fail", stats.norm.cdf(-1))):
        at = conformity(value, Rule())
        assert (at.answer, at.risk) == (answer, pytest.approx(risk))
    assert "risk that this FAIL is wrong: 16 %" in at.words


def test_a_conformity_is_told_with_what_it_stands_on():
    found = conformity(2.9, Rule(GUARDED))
    assert found.value_words == "2.90 ± 0.20 mdps"
    assert found.risk_words == "a PASS would be wrong with p = 0.16, a FAIL with p = 0.84"
    assert conformity(2.9, Rule(), sigma=0.0).value_words == "2.90 mdps"
    assert conformity(2900.0, Rule(), sigma=100.0).value_words == "2900 ± 200 mdps"
    table = conformity(2.9, Rule(GUARDED), freedom=9.0).to_json()
    k = stats.t(9).ppf(0.975)
    expected = {"value": 2.9, "standard_uncertainty": 0.1, "degrees_of_freedom": 9, "lower": -2.0, "upper": 3.0, "guard_band": 0.1 * k}
    expected |= {"test_uncertainty_ratio": 5 / (0.2 * k), "conformity_probability": stats.t(9).cdf(1.0)}
    assert {key: table[key] for key in expected} == pytest.approx(expected)


def test_a_least_ratio_leaves_a_poor_measurement_undecided():
    ratio = 5 / (2 * GUARD)
    assert conformity(0, Rule()).ratio == pytest.approx(ratio, rel=1e-6)
    assert [conformity(0, Rule(least_ratio=ratio * share)).answer for share in (0.999, 1.001)] == ["pass", "not decided"]
    assert conformity(0, Rule(), limits=(-INF, 3)).ratio is None


def test_what_is_not_observed_or_has_no_uncertainty_is_not_decided_by_a_guard_band():
    for each in (conformity(0.0, Rule(GUARDED), observed=False), conformity(0.0, Rule(GUARDED), sigma=float("nan"))):
        assert (each.answer, each.risk) == ("not decided", None)
        assert each.to_json()["risk"] is each.to_json()["conformity_probability"] is None


def test_the_uncertainty_of_a_closure_by_hand():
    tilts = np.array([30.0, 1.0, 2.0, 40.0]) * 1e-3
    found = closure_measured(np.stack([0.6 * tilts, 0.8 * tilts[::-1], np.full(4, 9.0)], axis=1), [0, 1, 2, 3])
    squares = 0.36 * tilts**2 + 0.64 * tilts[::-1] ** 2
    c, rms = squares - squares.mean(), np.sqrt(squares.mean())
    assert c[1:] @ c[:-1] < 0  # neighbours that differ do not make the mean better known
    assert c @ c / 12 < 1.5 / 4 * rms**4
    assert (found.value, found.freedom, found.relative) == (pytest.approx(rms / DEG), 3, True)
    assert found.sigma == pytest.approx(np.sqrt(1.5 / 4 * rms**4) / (2 * rms) / DEG)


def test_neighbours_that_are_alike_make_a_closure_less_well_known():
    tilts = np.repeat([1e-3, 2e-3, 9e-3, 1e-3], 5)
    c = tilts**2 - np.mean(tilts**2)
    rms = np.sqrt(np.mean(tilts**2))
    together, apart = (closure_measured(np.stack([tilts, 0 * tilts], axis=1), np.arange(20) * step) for step in (1, 2))
    assert together.sigma == pytest.approx(np.sqrt((c @ c + 2 * c[1:] @ c[:-1]) / 380) / (2 * rms) / DEG)
    assert apart.sigma == pytest.approx(np.sqrt(c @ c / 380) / (2 * rms) / DEG)


def test_a_closure_of_one_segment_or_of_nothing_has_no_uncertainty():
    assert np.isnan(closure_measured(np.array([[3e-3, 4e-3]]), [0]).sigma)
    none = closure_measured(np.zeros((9, 2)), range(9))
    assert (none.value, none.relative) == (0, False)
    assert np.isnan(none.sigma)


def closed(value, limits, **rule):
    """A closure that is known to a tenth, with nine degrees of freedom."""
    return Conformity(Fact("closure", "°", value, 0.1 * value, 9.0, key="closure_deg", relative=True), limits, Rule(GUARDED, **rule))


def test_a_closure_is_decided_by_its_logarithm():
    found, law = closed(2.0, (-INF, 2.5)), stats.t(9)
    factor = np.exp(0.1 * law.ppf(0.975))
    assert found.probability == pytest.approx(law.cdf(np.log(2.5 / 2) / 0.1))
    assert (*found.acceptance, found.band) == pytest.approx((0.0, 2.5 / factor, 2.5 - 2.5 / factor))
    assert closed(1.8, (1.5, INF)).band == pytest.approx(1.5 * (factor - 1))
    for value, answer in ((2.5 / factor + TINY, "not decided"), (2.5 * factor + TINY, "fail")):
        assert closed(value, (-INF, 2.5)).answer == answer
    two = closed(2.0, (1.5, 2.5), risk=0.05)
    assert two.probability == pytest.approx(law.cdf(np.log(2.5 / 2) / 0.1) - law.cdf(np.log(1.5 / 2) / 0.1))


@pytest.mark.parametrize("error", [(0.2, -0.1, 0.3), (0.0, 0.0, 0.0)])
def test_the_uncertainty_of_a_closure_run_is_what_its_floor_makes_of_it(error):
    """Far from the floor its scatter; near it what noise adds to the size, too."""
    error, floor = np.array(error) * DEG, np.array([0.1, 0.2, 0.3]) * DEG
    found = run_measured("closure0001.csv", error, floor)
    assert found.value == pytest.approx(np.linalg.norm(error) / DEG / np.sqrt(3))
    many = error + floor * np.random.default_rng(3).normal(size=(20000, 3))
    true = np.sqrt(np.mean(many**2, axis=1)) / DEG
    assert np.sqrt(np.mean((true - found.value) ** 2)) == pytest.approx(found.sigma, rel=0.02)


def test_what_a_closure_run_cannot_have_an_uncertainty_for():
    assert np.isnan(run_measured("a", np.ones(3), None).sigma)
    assert np.isnan(run_measured("a", np.full(3, np.nan), np.ones(3)).sigma)
    exact = run_measured("a", np.full(3, 0.5 * DEG), np.zeros(3))
    assert Conformity(exact, (-INF, 0.6), Rule(GUARDED)).answer == "pass"


@pytest.mark.parametrize(("size", "limit"), [(0.0, 0.3), (0.1, 0.9), (1.9, 0.3), (1.9, 2.2)])
def test_of_equal_floors_an_rmse_is_below_a_limit_as_a_noncentral_chi_square_is(size, limit):
    m = run_measured("a", size * np.array([1.0, -1.0, 1.0]) * DEG, np.full(3, 0.5) * DEG)
    exact = stats.chi2(3).cdf(3 * limit**2 / 0.25) if size == 0 else stats.ncx2(3, 3 * size**2 / 0.25).cdf(3 * limit**2 / 0.25)
    assert Conformity(m, (-INF, limit), Rule()).probability == pytest.approx(exact, abs=1e-5)


def test_a_guard_band_of_a_closure_run_is_that_of_its_distribution():
    error, floor = np.array([0.03, -0.06, 0.06]) * DEG, np.full(3, 0.01) * DEG
    m = run_measured("a", error, floor)
    assert m.value == pytest.approx(0.09 / np.sqrt(3))
    law = stats.ncx2(3, 81)  # of 3 RMSE^2 / floor^2
    passes, fails = np.sqrt(law.ppf([0.975, 0.025]) / 3) * 0.01
    for limits, answer in (
        ((-INF, passes * 1.001), "pass"),
        ((-INF, passes * 0.999), "not decided"),
        ((-INF, fails * 1.001), "not decided"),
        ((-INF, fails * 0.999), "fail"),
        ((0.04, 0.08), "pass"),
        ((0.09, INF), "fail"),
    ):
        assert Conformity(m, limits, Rule(GUARDED)).answer == answer
    for limits, limit, end in (((-INF, 0.08), 0.08, 1), ((0.04, INF), 0.04, 0)):
        found = Conformity(m, limits, Rule(GUARDED))
        at = run_measured("a", error * found.acceptance[end] / m.value, floor)
        assert Conformity(at, limits, Rule()).probability == pytest.approx(0.975, abs=1e-5)
        assert found.band == pytest.approx(abs(limit - found.acceptance[end]))


def test_a_closure_run_below_its_limit_does_not_fail_because_noise_is_above_it():
    def run(size, limit, **rule):
        m = run_measured("a", np.full(3, size) * DEG, np.full(3, 0.03) * DEG)
        return m, Conformity(m, (-INF, limit), Rule(**rule))

    assert run(1e-3, 0.003, kind=GUARDED, risk=0.05)[1].answer == "not decided"
    m, found = run(1e-3, 0.003, kind=GUARDED)
    assert found.band == pytest.approx(0.003)
    four, more = (run(1e-3, 1.0, kind=GUARDED, guard=sigmas / m.factor)[1] for sigmas in (4.0, 4.9))
    assert 1 - run(four.acceptance[1], 1.0)[1].probability == pytest.approx(stats.norm.sf(4), rel=0.01)
    assert more.band == pytest.approx(four.band + 0.9 * m.sigma)  # beyond four sigmas the band is linear


STILL = np.r_[np.eye(3).ravel(), np.zeros(3)]


def vector_and_sources():
    rng = np.random.default_rng(4)
    vector = STILL + 0.01 * rng.normal(size=12)
    roots = rng.normal(size=(2, 12, 12)) * 1e-5
    return vector, [Source("one", "A", 5.0, roots[0] @ roots[0].T), Source("two", "B", INF, roots[1] @ roots[1].T)]


@pytest.mark.parametrize(("missed", "ideal"), [(0.0, False), (1e-5, False), (1e-3, False), (1e-5, True)])
def test_sensor_errors_have_the_u_of_all_sources_and_of_what_the_model_lacks_and_welch_satterthwaites_freedom(missed, ideal):
    """u^2 = sum of the sources + missed^2, of which the last counts as known: u^4 / nu is that of the sources alone."""
    vector, sources = vector_and_sources()
    vector = STILL if ideal else vector  # whose errors are 0, in any unit
    slope, size = field_jacobian(vector), {"ppm": 1e-6, "mrad": 1e-3, "mdps": DEG * 1e-3}
    listed = field_facts(vector, total(sources))
    moved = (lambda slope: np.full(len(slope), missed)) if missed else None
    found = sensor_measured("gyro", field_facts(vector, total(sources), moved=moved, sources=sources))
    for at, (each, q) in enumerate(zip(found, listed, strict=True)):
        more = 1e3 if q.unit == "dps" else 1.0
        assert each.value == pytest.approx(q.value * more)
        own = q.sigma * more
        assert each.u == pytest.approx(np.hypot(own, missed / size[each.unit]))
        one, two = (slope[at] @ source.covariance @ slope[at] for source in sources)
        assert each.freedom == pytest.approx((one + two) ** 2 / (one**2 / 5) * (each.u / own) ** 4)
    assert [each.key for each in found] == [key for key in QUANTITIES if key.startswith("gyro_")]
    none = [q.sigma * (1e3 if q.unit == "dps" else 1.0) for q in field_facts(STILL, total(sources))]
    found = sensor_measured("gyro", field_facts(STILL, total(sources), sources=sources))
    assert [each.sigma for each in found] == pytest.approx(none)  # of errors that are none


def test_sources_count_only_where_they_are_those_of_this_covariance():
    _, sources = vector_and_sources()
    covariance = sources[0].covariance + sources[1].covariance
    assert known_sources(sources, covariance) == tuple(sources)
    assert known_sources(sources[:1], sources[0].covariance) == (sources[0],)
    for others, of in (((), covariance), (sources, (1 + 1e-5) * covariance)):
        (one,) = known_sources(others, of)
        assert one.freedom == INF
        assert one.covariance is of


def test_the_attitude_after_a_minute_at_rest_is_the_bias_integrated():
    """Of the worst axis alone, and with the degrees of freedom of its source."""
    of_two, few = np.diag([*np.zeros(9), 1e-10, 0, 1e-10]), np.diag([*np.zeros(10), 4e-10, 0])
    for freedom, k in ((INF, 1.959964), (4.0, stats.t(4).ppf(0.975))):
        found = attitude_measured(STILL, [Source("few", "A", freedom, few), Source("many", "B", INF, of_two)])
        assert found.value == pytest.approx(k * 2e-5 * 60 / DEG, rel=1e-4)
        assert found.observed


def test_the_attitude_is_an_uncertainty_itself_without_guard_band_and_risk():
    vector, sources = vector_and_sources()
    m = attitude_measured(vector, sources)
    for rule in (Rule(), Rule(GUARDED)):
        for limit, answer in ((m.value * 1.01, "pass"), (m.value * 0.99, "fail")):
            (found,) = conformities(Requirements({"attitude_60s_deg": (0.0, limit)}, rule), [m])
            assert (found.answer, found.risk, found.rule.kind) == (answer, None, SIMPLE)
            assert found.to_json()["conformity_probability"] is None
    unobserved = attitude_measured(vector, sources, ("B_y",))
    assert conformities(Requirements({"attitude_60s_deg": (0.0, 1e6)}, Rule()), [unobserved])[0].answer == "not decided"
    assert attitude_measured(STILL, sources, ("E_xx",)).observed  # at rest without a bias E does not count


def test_an_accelerometer_that_was_given_has_no_uncertainty_and_what_is_not_observed_says_so():
    rows = [("bias", "mg", np.array([1.0, 2.0, 3.0]), None, ["bias x", "bias y", "bias z"])]
    fit = SimpleNamespace(errors=lambda: rows, unobserved=("bias y",), freedoms=np.full(9, np.inf))
    found = sensor_measured("accel", AccelerometerFit.facts.fget(fit))
    assert [(each.key, each.value, each.observed) for each in found] == [
        (f"accel_bias_{axis}_mg", value, axis != "y") for axis, value in zip("xyz", (1.0, 2.0, 3.0), strict=True)
    ]
    assert np.isnan(found[0].sigma)


def judged(**known):
    angles = np.full((40, 2), 1e-3 / np.sqrt(2)) * (1 + 0.2 * (-1) ** np.arange(40))[:, None]
    figures = {"angles": angles, "numbers": list(range(40)), "vector": STILL * 1.001, "floor_rms": 1e-3, "closure_p": 0.5}
    figures |= {"closure_freedom": 68, "run_errors": [], "run_p": [], "run_losses": [], "covariance": np.diag(np.full(12, 1e-8))}
    return CandidateFit(**figures | known)


def required(rule=SIMPLE, **limits):
    return Requirements(limits, Rule(rule), "a data sheet", "session.toml")


def of_scale(ppm, **limits):
    return required(gyro_scale_factor_error_x_ppm=(-ppm, ppm), **limits)


def test_a_requirement_of_the_closure_is_decided_by_its_rule_and_a_limit_takes_its_place():
    size = closure_measured(judged().angles, range(40))
    near = size.value + 0.5 * size.expanded
    for rule, most, limit, answer in (
        (GUARDED, near, None, "not decided"),
        (SIMPLE, near, None, "pass"),
        (GUARDED, near, near, "pass"),
        (GUARDED, size.value / 2, None, "fail"),
    ):
        found = decide(judged(), [], limit, requirements=required(rule, closure_deg=(-INF, most)))
        assert (found.answer, found.by_limit) == (answer, True)
        assert ("Requirements of session.toml" in found.rule) == (limit is None)


@pytest.mark.parametrize(
    ("known", "ppm", "answer"),
    [({}, 500.0, "fail"), ({}, 2e3, "pass"), ({"closure_p": 1e-6}, 2e3, "fail"), ({"unobserved": ("E_xx",)}, 2e3, "not decided")],
)
def test_a_requirement_of_a_sensor_error_counts_beside_the_noise(known, ppm, answer):
    assert decide(judged(**known), [], None, requirements=of_scale(ppm)).answer == answer


def test_an_accelerometer_whose_numbers_are_not_all_observed_is_a_doubt():
    for unobserved, doubts in (((), []), (("bias x", "bias z"), ["bias x, bias z"]), (("one",) * 9, ["all of its numbers"])):
        found = _doubts(judged(), 1.0, SimpleNamespace(unobserved=unobserved))
        assert [text.partition(";")[0] for text in found] == [f"accelerometer: not observed: {text}" for text in doubts]


def test_a_value_beyond_its_limits_is_no_reason_against_the_calibration_itself():
    assert decide(judged(), [], None, requirements=of_scale(500.0, closure_deg=(-INF, 1e-6))).unsound == []
    found = decide(judged(closure_p=1e-6), [], None, requirements=of_scale(500.0))
    assert [text[:15] for text in found.unsound] == ["the turns close"]
    run = {"run_errors": [np.full(3, 1e-3)], "run_p": [1e-6], "run_losses": [""]}
    assert [text[:5] for text in decide(judged(**run), ["c.csv"], None).unsound] == ["c.csv"]
    raw = AgainstRaw("raw", 1e-4 / DEG, {}, 40)
    worse = decide(judged(), [], 1.0, raw)
    assert (worse.answer, "worse than" in worse.unsound[0]) == ("fail", True)
    known = judged(**run, run_floors=[np.full(3, 1e-4)])
    (limited,) = decide(known, ["c.csv"], None, requirements=required(GUARDED, closure_run_deg=(-INF, 1.0))).conformities
    assert limited.measured.sigma == run_measured("c.csv", np.full(3, 1e-3), np.full(3, 1e-4)).sigma


def read(text):
    require(table := tomllib.loads(text), shape := RequirementsShape(), "session.toml")
    return shape.made(table)


def test_requirements_are_read():
    rule = 'rule = "guard band"\nguard = 0.5\nreference = "RX-12"\n'
    limits = "[closure_deg]\nupper = 1\n[gyro_bias_mdps]\nlower = -9\n[gyro_bias_y_mdps]\nupper = 3\n"
    found = read(rule + limits)
    assert (found.rule, found.reference) == (Rule(GUARDED, 0.5), "RX-12")
    of_bias = {"gyro_bias_x_mdps": (-9.0, INF), "gyro_bias_y_mdps": (-INF, 3.0), "gyro_bias_z_mdps": (-9.0, INF)}
    assert found.limits == {"closure_deg": (-INF, 1.0)} | of_bias
    assert {key for keys in GROUPS.values() for key in keys} < set(QUANTITIES)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no limits"),
        ("[closure_degs]\nupper = 1\n", "closure_degs is no quantity that has limits; did you mean closure_deg?"),
        ("[closure_deg]\nupper = 1\nmost = 2\n", "closure_deg.most is no key of limits"),
        ("[closure_deg]\nupper = -1\n", "closure_deg.upper is -1, and it is a size; expected above 0"),
        ("[closure_deg]\nlower = 1\nupper = 1\n", "lower is 1, expected less than upper, 1"),
        ("guard = 1\n[closure_deg]\nupper = 1\n", 'guard goes with rule = "guard band"'),
        ('rule = "guard band"\nguard = 1\nrisk = 0.1\n[closure_deg]\nupper = 1\n', "guard and risk are both given"),
        ('rule = "guard band"\nleast_ratio = 4\n[closure_deg]\nupper = 1\n', "least_ratio goes with"),
        ("least_ratio = 4\n[closure_deg]\nupper = 1\n", "least_ratio needs a lower and an upper limit, and closure_deg has one alone"),
    ],
)
def test_what_is_no_requirement_is_refused_in_one_line(text, says):
    with pytest.raises(FormatError) as caught:
        read(text)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("angle", [0.0, 1e-3, 3.0])
def test_body_frames_are_apart_by_the_angle_of_the_turn_between_them(angle):
    begin = Rotation.from_rotvec([0.4, -0.2, 0.9])
    frames = (begin.as_matrix(), (Rotation.from_rotvec([0, 0, angle]) * begin).as_matrix())
    assert in_frame_of(*map(Accelerometer, frames))[1] == pytest.approx(angle, abs=1e-7)
