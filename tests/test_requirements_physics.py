"""Decision rules: probability of conformity, guard bands and risks by hand and by another program; limits as they are read."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from session.io.errors import FormatError
from session.io.requirements import GROUPS, GUARDED, QUANTITIES, SIMPLE, Requirements, Rule, read_requirements
from session.io.units import DEG
from tinygc.estimation.choice import AgainstRaw
from tinygc.estimation.compare import _frame_angle
from tinygc.estimation.requirements import (
    Conformity,
    Measured,
    accelerometer_measured,
    attitude_measured,
    closure_measured,
    field_measured,
    known_sources,
    run_measured,
    simply_accepted,
)
from tinygc.estimation.requirements import conformity as conformities
from tinygc.estimation.sources import Source
from tinygc.estimation.verdict import JudgedFit, decide
from tinygc.models.linear import MATRIX, field_jacobian, field_quantities

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
    return Conformity(Measured("gyro_bias_x_mdps", "bias x", "mdps", value, sigma, freedom, observed), limits, rule)


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
    law = stats.norm() if freedom == INF else stats.t(freedom)
    away = 0.1 * law.ppf(0.95)

    def at(value):
        return conformity(value, Rule(GUARDED, risk=0.05), (-INF, 3.0), freedom=freedom)

    inside, outside = at(3 - away - TINY), at(3 + away + TINY)
    assert (inside.answer, outside.answer) == ("pass", "fail")
    assert inside.risk == pytest.approx(0.05, abs=1e-6)
    assert outside.risk == pytest.approx(0.05, abs=1e-6)
    assert at(3 - away + 1e-6).answer == at(3 + away - 1e-6).answer == "not decided"
    assert inside.band == pytest.approx(away)


def test_simple_acceptance_passes_up_to_the_limit_and_says_the_risk():
    at = conformity(3.0, Rule())
    assert (at.answer, at.risk) == ("pass", pytest.approx(0.5))
    above = conformity(3.1, Rule())
    assert (above.answer, above.risk) == ("fail", pytest.approx(stats.norm.cdf(-1)))
    assert "risk that this FAIL is wrong: 16 %" in above.words
    assert conformity(2.9, Rule(GUARDED)).value_words == "2.90 mdps ± 0.20 mdps (k = 1.96)"
    assert conformity(2.9, Rule(), sigma=0.0).value_words == "2.90 mdps"
    assert conformity(2.9, Rule(GUARDED)).risk_words == "a PASS would be wrong with p = 0.16, a FAIL with p = 0.84"
    table = conformity(2.9, Rule(GUARDED), freedom=9.0).to_json()
    expected = {"value": 2.9, "standard_uncertainty": 0.1, "degrees_of_freedom": 9, "lower": -2.0, "upper": 3.0}
    k = stats.t(9).ppf(0.975)
    expected |= {"guard_band": 0.1 * k, "test_uncertainty_ratio": 5 / (0.2 * k), "conformity_probability": stats.t(9).cdf(1.0)}
    assert {key: table[key] for key in expected} == pytest.approx(expected)


def test_a_least_ratio_leaves_a_poor_measurement_undecided():
    ratio = 5 / (2 * GUARD)
    assert conformity(0, Rule()).ratio == pytest.approx(ratio, rel=1e-6)
    assert conformity(0, Rule(least_ratio=ratio * 0.999)).answer == "pass"
    assert conformity(0, Rule(least_ratio=ratio * 1.001)).answer == "not decided"
    assert conformity(0, Rule(), limits=(-INF, 3)).ratio is None


def test_what_is_not_observed_or_has_no_uncertainty_is_not_decided_by_a_guard_band():
    for each in (conformity(0.0, Rule(GUARDED), observed=False), conformity(0.0, Rule(GUARDED), sigma=float("nan"))):
        assert (each.answer, each.risk) == ("not decided", None)
        assert each.to_json()["risk"] is each.to_json()["conformity_probability"] is None


def test_the_uncertainty_of_a_closure_by_hand():
    tilts = np.array([30.0, 1.0, 2.0, 40.0]) * 1e-3
    angles = np.stack([0.6 * tilts, 0.8 * tilts[::-1], np.full(4, 9.0)], axis=1)
    squares = 0.36 * tilts**2 + 0.64 * tilts[::-1] ** 2
    c = squares - squares.mean()
    alone, shared = np.sum(c**2), c[0] * c[1] + c[1] * c[2] + c[2] * c[3]
    assert shared < 0  # neighbours that differ do not make the mean better known
    assert alone / 12 < 1.5 / 4 * squares.mean() ** 2
    found = closure_measured(angles, [0, 1, 2, 3])
    rms = np.sqrt(squares.mean())
    assert found.value == pytest.approx(rms / DEG)
    assert found.sigma == pytest.approx(np.sqrt(max(alone / 12, 1.5 / 4 * rms**4)) / (2 * rms) / DEG)
    assert (found.freedom, found.relative) == (3, True)


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


def test_a_closure_is_decided_by_its_logarithm():
    m = Measured("closure_deg", "closure", "°", 2.0, 0.2, 9.0, relative=True)
    found, law = Conformity(m, (-INF, 2.5), Rule(GUARDED)), stats.t(9)
    assert found.probability == pytest.approx(law.cdf(np.log(2.5 / 2) / 0.1))
    most = 2.5 * np.exp(-0.1 * law.ppf(0.975))
    assert found.acceptance == pytest.approx((0.0, most))
    assert found.band == pytest.approx(2.5 - most)
    least = 2.5**2 / most
    for value, answer in ((most + TINY, "not decided"), (least + TINY, "fail")):
        at = Measured("closure_deg", "closure", "°", value, 0.1 * value, 9.0, relative=True)
        assert Conformity(at, (-INF, 2.5), Rule(GUARDED)).answer == answer
    two = Conformity(m, (1.5, 2.5), Rule(GUARDED, risk=0.05))
    assert two.probability == pytest.approx(law.cdf(np.log(2.5 / 2) / 0.1) - law.cdf(np.log(1.5 / 2) / 0.1))
    assert Conformity(m, (1.5, INF), Rule(GUARDED)).band == pytest.approx(1.5 * (np.exp(0.1 * law.ppf(0.975)) - 1))


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
    passes, fails = (float(np.sqrt(law.ppf(share) / 3) * 0.01) for share in (0.975, 0.025))
    for limit, answer in (
        (passes * 1.001, "pass"),
        (passes * 0.999, "not decided"),
        (fails * 1.001, "not decided"),
        (fails * 0.999, "fail"),
    ):
        assert Conformity(m, (-INF, limit), Rule(GUARDED)).answer == answer
    within = Conformity(m, (-INF, 0.08), Rule(GUARDED))
    at = run_measured("a", error * within.acceptance[1] / m.value, floor)
    assert Conformity(at, (-INF, 0.08), Rule()).probability == pytest.approx(0.975, abs=1e-5)
    assert within.band == pytest.approx(0.08 - within.acceptance[1])
    above = Conformity(m, (0.04, INF), Rule(GUARDED))
    at = run_measured("a", error * above.acceptance[0] / m.value, floor)
    assert Conformity(at, (0.04, INF), Rule()).probability == pytest.approx(0.975, abs=1e-5)
    assert Conformity(m, (0.04, 0.08), Rule(GUARDED)).answer == "pass"
    assert Conformity(m, (0.09, INF), Rule(GUARDED)).answer == "fail"


def test_a_closure_run_below_its_limit_does_not_fail_because_noise_is_above_it():
    m = run_measured("a", np.full(3, 1e-3) * DEG, np.full(3, 0.03) * DEG)
    assert Conformity(m, (-INF, 0.003), Rule(GUARDED, risk=0.05)).answer == "not decided"
    assert Conformity(m, (-INF, 0.003), Rule(GUARDED)).band == pytest.approx(0.003)

    def band(sigmas):
        return Conformity(m, (-INF, 1.0), Rule(GUARDED, guard=sigmas / m.factor))

    at = run_measured("a", np.full(3, band(4.0).acceptance[1]) * DEG, np.full(3, 0.03) * DEG)
    assert 1 - Conformity(at, (-INF, 1.0), Rule()).probability == pytest.approx(stats.norm.sf(4), rel=0.01)
    assert band(4.9).band == pytest.approx(band(4.0).band + 0.9 * m.sigma)  # beyond four sigmas the band is linear


def vector_and_sources():
    rng = np.random.default_rng(4)
    vector = np.concatenate([np.eye(3).ravel() + 0.01 * rng.normal(size=9), 0.01 * rng.normal(size=3)])
    roots = rng.normal(size=(2, 12, 12)) * 1e-5
    return vector, [Source("one", "A", 5.0, roots[0] @ roots[0].T), Source("two", "B", INF, roots[1] @ roots[1].T)]


def test_sensor_errors_have_the_sigma_of_the_sum_and_welch_satterthwaites_freedom():
    vector, sources = vector_and_sources()
    covariance = sources[0].covariance + sources[1].covariance
    found, slope = field_measured(vector, sources), field_jacobian(vector)
    listed = field_quantities(vector, covariance)
    for at, (each, q) in enumerate(zip(found, listed, strict=True)):
        more = 1e3 if q.unit == "dps" else 1.0
        assert each.value == pytest.approx(q.value * more)
        assert each.sigma == pytest.approx(q.expanded / 2 * more)
        one, two = (slope[at] @ source.covariance @ slope[at] for source in sources)
        assert each.freedom == pytest.approx((one + two) ** 2 / (one**2 / 5))
    assert [each.key for each in found] == [key for key in QUANTITIES if key.startswith("gyro_")]


def test_a_sensor_errors_u_holds_the_effect_that_the_model_lacks():
    """u^2 = sum of the sources + moved^2, of which the last counts as known: u^4 / nu is that of the sources alone."""
    vector, sources = vector_and_sources()
    moved = np.linspace(1e-5, 1e-3, 18)
    plain = field_measured(vector, sources)
    found = field_measured(vector, sources, moved=lambda slope: moved[: len(slope)])
    si = [{"ppm": 1e-6, "mrad": 1e-3, "mdps": DEG * 1e-3}[each.unit] for each in plain]
    for before, after, size, unit in zip(plain, found, moved, si, strict=True):
        assert after.sigma == pytest.approx(np.sqrt(before.sigma**2 + (size / unit) ** 2), rel=1e-9)
        assert after.freedom == pytest.approx(before.freedom * (after.sigma / before.sigma) ** 4, rel=1e-9)
        assert (after.value, after.key) == (before.value, before.key)


def test_sources_count_only_where_they_are_those_of_this_covariance():
    _, sources = vector_and_sources()
    covariance = sources[0].covariance + sources[1].covariance
    assert known_sources(sources, covariance) == tuple(sources)
    for others, of in (((), covariance), (sources, 2 * covariance)):
        (one,) = known_sources(others, of)
        assert one.freedom == INF
        assert one.covariance is of


def test_the_attitude_after_a_minute_at_rest_is_the_bias_integrated():
    covariance = np.zeros((12, 12))
    covariance[9:, 9:] = np.diag([1.0, 4.0, 1.0]) * 1e-10
    vector = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    found = attitude_measured(vector, [Source("all", "A", INF, covariance)])
    assert found.value == pytest.approx(1.959964 * 2e-5 * 60 / DEG, rel=1e-4)
    few = np.zeros((12, 12))
    few[10, 10] = 4e-10  # all of the worst axis, of another none
    told = attitude_measured(vector, [Source("few", "A", 4.0, few), Source("many", "B", INF, covariance - few)])
    assert told.value == pytest.approx(stats.t(4).ppf(0.975) * 2e-5 * 60 / DEG, rel=1e-4)
    assert told.observed


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
    still = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    assert attitude_measured(still, sources, ("E_xx",)).observed  # at rest without a bias E does not count


def test_an_accelerometer_that_was_given_has_no_uncertainty_and_what_is_not_observed_says_so():
    rows = [("bias", "mg", np.array([1.0, 2.0, 3.0]), None, ["bias x", "bias y", "bias z"])]
    found = accelerometer_measured(SimpleNamespace(errors=lambda: rows, unobserved=("bias y",), freedoms=np.full(9, np.inf)))
    assert [(each.key, each.value, each.observed) for each in found] == [
        ("accel_bias_x_mg", 1.0, True),
        ("accel_bias_y_mg", 2.0, False),
        ("accel_bias_z_mg", 3.0, True),
    ]
    assert np.isnan(found[0].sigma)


def judged(**known):
    angles = np.full((40, 2), 1e-3 / np.sqrt(2)) * (1 + 0.2 * (-1) ** np.arange(40))[:, None]
    vector = np.concatenate([np.eye(3).ravel() * 1.001, np.zeros(3)])
    figures = {"angles": angles, "numbers": list(range(40)), "vector": vector, "floor_rms": 1e-3, "closure_p": 0.5}
    figures |= {"closure_freedom": 68, "run_errors": [], "run_p": [], "run_losses": [], "covariance": np.diag(np.full(12, 1e-8))}
    return JudgedFit(**figures | known)


def required(rule=SIMPLE, **limits):
    return Requirements(limits, Rule(rule), "a data sheet", "session.toml")


def test_a_requirement_of_the_closure_is_decided_by_its_rule_and_a_limit_takes_its_place():
    size = closure_measured(judged().angles, range(40))
    near = size.value + 0.5 * size.expanded
    found = decide(judged(), [], None, requirements=required(GUARDED, closure_deg=(-INF, near)))
    assert (found.answer, found.by_limit) == ("not decided", True)
    assert decide(judged(), [], None, requirements=required(closure_deg=(-INF, near))).answer == "pass"
    assert "Requirements of session.toml. Guard bands" in found.rule
    limited = decide(judged(), [], near, requirements=required(GUARDED, closure_deg=(-INF, near)))
    assert limited.answer == "pass"
    assert "Requirements" not in limited.rule
    assert decide(judged(), [], None, requirements=required(GUARDED, closure_deg=(-INF, size.value / 2))).answer == "fail"


def test_a_requirement_of_a_sensor_error_counts_beside_the_noise():
    tight = required(gyro_scale_factor_error_x_ppm=(-500.0, 500.0))
    found = decide(judged(), [], None, requirements=tight)
    assert found.answer == "fail"
    assert decide(judged(closure_p=1e-6), [], None, requirements=required(gyro_scale_factor_error_x_ppm=(-2e3, 2e3))).answer == "fail"
    assert decide(judged(), [], None, requirements=required(gyro_scale_factor_error_x_ppm=(-2e3, 2e3))).answer == "pass"
    unknown = judged(unobserved=("E_xx",))
    assert decide(unknown, [], None, requirements=required(gyro_scale_factor_error_x_ppm=(-2e3, 2e3))).answer == "not decided"


def test_a_value_beyond_its_limits_is_no_reason_against_the_calibration_itself():
    tight = required(gyro_scale_factor_error_x_ppm=(-500.0, 500.0), closure_deg=(-INF, 1e-6))
    assert decide(judged(), [], None, requirements=tight).unsound == []
    found = decide(judged(closure_p=1e-6), [], None, requirements=required(gyro_scale_factor_error_x_ppm=(-500.0, 500.0)))
    assert [text[:31] for text in found.unsound] == ["closure of the fitted segments,"]
    run = {"run_errors": [np.full(3, 1e-3)], "run_p": [1e-6], "run_losses": [""]}
    assert [text[:5] for text in decide(judged(**run), ["c.csv"], None).unsound] == ["c.csv"]
    raw = AgainstRaw("raw", 1e-4 / DEG, {}, 40)
    worse = decide(judged(), [], 1.0, raw)
    assert (worse.answer, "worse than" in worse.unsound[0]) == ("fail", True)
    known = judged(**run, run_floors=[np.full(3, 1e-4)])
    (limited,) = decide(known, ["c.csv"], None, requirements=required(GUARDED, closure_run_deg=(-INF, 1.0))).conformities
    assert limited.measured.sigma == run_measured("c.csv", np.full(3, 1e-3), np.full(3, 1e-4)).sigma


def written(tmp_path, text):
    path = tmp_path / "required.toml"
    path.write_text('schema = "tinygc-requirements/1"\n' + text)
    return path


def test_a_file_of_requirements(tmp_path):
    rule = 'rule = "guard band"\nguard = 0.5\nreference = "RX-12"\n'
    limits = "[closure_deg]\nupper = 1\n[gyro_bias_mdps]\nlower = -9\n[gyro_bias_y_mdps]\nupper = 3\n"
    found = read_requirements(written(tmp_path, rule + limits))
    assert found.rule == Rule(GUARDED, 0.5)
    assert found.reference == "RX-12"
    assert found.limits == {
        "closure_deg": (-INF, 1.0),
        "gyro_bias_x_mdps": (-9.0, INF),
        "gyro_bias_y_mdps": (-INF, 3.0),
        "gyro_bias_z_mdps": (-9.0, INF),
    }
    assert {key for keys in GROUPS.values() for key in keys} < set(QUANTITIES)
    assert slice(0, 9) == MATRIX


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no limits"),
        ("[closure_degs]\nupper = 1\n", "closure_degs is no quantity that has limits; did you mean closure_deg?"),
        ("[closure_deg]\nupper = true\n", "closure_deg.upper is True, expected a number"),
        ("[closure_deg]\nupper = 1\nmost = 2\n", "closure_deg.most is no key of limits"),
        (f"[closure_deg]\nupper = {'9' * 400}\n", "closure_deg.upper is 9999999999999999999999999999999999999999, expected a number"),
        ("[closure_deg]\nupper = -1\n", "closure_deg.upper is -1, and it is a size; expected above 0"),
        ("[closure_deg]\nlower = 1\nupper = 1\n", "lower is 1, expected less than upper, 1"),
        ("closure_deg = 1\n", "closure_deg is 1, expected a section"),
        ('rule = "best"\n[closure_deg]\nupper = 1\n', 'rule is "best", expected one of simple acceptance, guard band'),
        ("guard = 1\n[closure_deg]\nupper = 1\n", 'guard goes with rule = "guard band"'),
        ('rule = "guard band"\nguard = 1\nrisk = 0.1\n[closure_deg]\nupper = 1\n', "guard and risk are both given"),
        ('rule = "guard band"\nrisk = 0.6\n[closure_deg]\nupper = 1\n', "risk is 0.6, expected"),
        ('rule = "guard band"\nleast_ratio = 4\n[closure_deg]\nupper = 1\n', "least_ratio goes with"),
        ("least_ratio = 4\n[closure_deg]\nupper = 1\n", "least_ratio needs a lower and an upper limit, and closure_deg has one alone"),
    ],
)
def test_what_is_no_requirement_is_refused_in_one_line(tmp_path, text, says):
    path = written(tmp_path, text)
    with pytest.raises(FormatError) as caught:
        read_requirements(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("angle", [0.0, 1e-3, 1.0, 3.0])
def test_body_frames_are_apart_by_the_angle_of_the_turn_between_them(angle):
    begin = Rotation.from_rotvec([0.4, -0.2, 0.9])
    triads = [
        SimpleNamespace(calibration=SimpleNamespace(frame=q.as_matrix())) for q in (begin, Rotation.from_rotvec([0, 0, angle]) * begin)
    ]
    assert _frame_angle(*triads) == pytest.approx(angle, abs=1e-7)
