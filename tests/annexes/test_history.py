"""A unit over its sessions, drawn with a known truth: what is recovered, what stays undecided, and until when a requirement is met."""

from dataclasses import replace
from datetime import timedelta
from functools import cache

import numpy as np
import pytest
from conftest import broad
from scipy.special import ndtr
from scipy.stats import t
from unit_sessions import FIRST, OWN, drawn, of

from session.io.errors import CalibrationError
from session.io.units import DEG, MG
from tinygc.annexes.history.curves import panels_of
from tinygc.annexes.history.estimate import NumberHistory, history_of
from tinygc.annexes.history.forecast import (
    FAILS,
    HOLDS,
    UNDECIDED,
    draws_of,
    outlooks_of,
    parse_accuracy,
    parse_limit,
    slope_of,
)
from tinygc.annexes.history.sessions import GYROSCOPE, NUMBERS, ZERO
from tinygc.annexes.history.text import headline, lines, rows, significant
from tinygc.estimation.between_sessions import ONE_SIGMA, TRIED, Between, candidates, course, jump
from tinygc.estimation.session_times import YEAR_S

YEARS = np.linspace(0, 3, 10)
SCATTER = of("bias", 0.03)
PLACE = {number.words: q for q, number in enumerate(NUMBERS)}


def test_what_made_the_sessions_is_recovered():
    sessions = drawn(YEARS, 1, SCATTER, of("bias x", 0.1), {4: of("scale factor error y", 900)})
    history = history_of(sessions[::-1])
    assert [session.name for session in history.sessions] == [f"s{j}" for j in range(1, 11)]
    assert history.span_years == pytest.approx(3, abs=1e-6)
    x = history.numbers[PLACE["bias x"]]
    value, sigma = x.drift
    assert abs(value / DEG - 0.1) < 3 * sigma / DEG < 0.06
    assert x.course.drifts
    low, high = (end / DEG for end in x.scatter_interval)
    assert low < 0.03 < high
    (step,) = history.steps
    assert (step.number.words, step.before, step.after, step.interval) == ("scale factor error y", "s5", "s6", 4)
    assert step.size / 1e-6 == pytest.approx(900, abs=60)
    assert step.sigma / 1e-6 < 40
    said = " ".join(lines(history))
    assert "a drift is significant in bias x" in said
    assert "a shock between s5 and s6: scale factor error y by +9" in said
    assert headline(history) == "ASM330LHH 7: 10 sessions, 2024-01-01 to 2026-12-31 (3.0 years)"
    by_name = {row[0]: row[1:] for row in rows(history)}
    assert by_name["bias x, dps"][2].startswith("0.")
    assert by_name["bias y, dps"][2].startswith("less than")
    assert by_name["misalignment x to y, mrad"][1].startswith("less than")
    assert by_name["bias x, dps"][0] == f"{x.values[-1] / DEG:.4f} ± 0.0010"
    firm = {curve.label[0] + panel.title: curve.shows for panel in panels_of(history) for curve in panel.curves}
    assert {name for name, shows in firm.items() if shows} == {"xbias", "yscale factor error"}


def test_the_bias_of_any_session_is_of_two_draws_and_the_last_calibration():
    """On the screen, in one number: the root of the last fit's variance and twice the spread's."""
    history = history_of(drawn(YEARS, 3, SCATTER))
    sizes = np.sqrt(np.diag(history.sessions[-1].bias_covariance) + 2 * history.any_session.rps**2) / DEG
    assert f"the bias of any other session: ± {' '.join(map(significant, sizes))} dps" in lines(history)[0]


def test_the_accelerometer_of_any_session_is_of_two_draws_and_the_last_calibration():
    history = history_of(drawn(YEARS, 3, of("accelerometer bias", 0.5)))
    for place, (each, sigma) in enumerate(zip(history.numbers[GYROSCOPE:], history.accelerometer_any_session, strict=True)):
        model = each.course.model
        spread = model.counted * t.ppf((1 + ONE_SIGMA) / 2, model.freedom)
        assert sigma == pytest.approx(np.sqrt(each.sigmas[-1] ** 2 + 2 * spread**2), rel=1e-9), place
    bias = history.accelerometer_any_session[6:] / MG
    assert bias == pytest.approx(np.sqrt(2) * 0.5, rel=0.8)
    assert f"bias ± {' '.join(map(significant, bias))} mg" in lines(history)[1]
    assert history_of(drawn(YEARS[:1], 3, SCATTER)).accelerometer_any_session is None


def test_what_does_not_show_is_undecided_with_a_limit():
    history = history_of(drawn(YEARS, 2, SCATTER))
    assert history.steps == ()
    said = " ".join(lines(history))
    assert "a drift is undecided in every number" in said
    assert "a shock is undecided in every interval" in said
    z = history.numbers[PLACE["bias z"]]
    assert 0 < z.drift_limit / DEG < 0.1
    assert 0.03 < z.step_limit / DEG < 0.3


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_sessions_decide_neither_drift_nor_shock(count):
    jumps = {0: of("bias", 5.0)} if count > 1 else None
    history = history_of(drawn(np.arange(count) / 2, 0, SCATTER, steps=jumps))
    assert history.steps == ()
    assert all(each.drift is None and each.step_limit is None for each in history.numbers)
    assert (history.any_session is None) == (count == 1)
    assert f"there are {count}" in " ".join(lines(history))


def test_sessions_without_dates_count_as_they_come():
    history = history_of(drawn(YEARS, 1, SCATTER, dated=False))
    assert not history.dated
    assert history.at.tolist() == list(range(10))
    assert "s1 has no date" in history.remarks[0]
    (outlook,) = outlooks_of(history, [parse_limit("bias 1 dps")])
    assert (outlook.answer, outlook.until) == (UNDECIDED, None)
    assert "needs dates" in outlook.reason


def test_a_drift_that_a_step_explains_as_well_says_so():
    """Two clusters of sessions, half a year apart: whether the zero went there slowly or at once, nobody saw."""
    apart = np.array([0, 0.004, 0.008, 0.012, 0.5, 0.504, 0.508, 0.512])
    clustered = history_of(drawn(apart, 1, of("bias", 0.005), drift=of("bias x", 0.5)))
    x = clustered.numbers[PLACE["bias x"]]
    assert (x.course.drifts, x.drift_or_step) == (True, 3)
    assert "a drift, or a step between s4 and s5, which explains it as well: bias x" in " ".join(lines(clustered))
    even = history_of(drawn(np.linspace(0, 4, 16), 1, of("bias", 0.005), drift=of("bias x", 0.1)))
    assert (even.numbers[PLACE["bias x"]].course.drifts, even.numbers[PLACE["bias x"]].drift_or_step) == (True, None)


def number_history(values, own, at):
    return NumberHistory(NUMBERS[ZERO.start], np.arange(len(values)), values, np.sqrt(own), course(values, own, at))


def test_as_well_is_no_positive_evidence_for_the_drift():
    """Two clusters with two sessions between them: the likelihoods differ by more than 2, which is evidence, and by less than 20."""
    at = np.array([0, 0.02, 0.04, 0.06, 0.45, 0.55, 0.94, 0.96, 0.98, 1.0])
    found = number_history(at + 0.08 * np.random.default_rng(2).normal(size=10), np.full(10, 1e-8), at)
    assert (found.course.drifts, found.drift_or_step) == (True, None)
    sums = []
    for second in (at, jump(10, 3)):
        design = np.column_stack([np.ones(10), second])
        sums.append(np.linalg.lstsq(design, found.values, rcond=None)[1][0] / found.scatter**2)
    assert 2 < sums[1] - sums[0] < 20


def test_the_limit_of_a_step_is_that_of_the_interval_that_shows_it_least():
    """A first session of thirty times the others' sigma: the step after it looks small, and could be the largest."""
    at, own = np.append(np.arange(11) * 0.3, 4.0), np.append(9.0, np.full(11, 0.01))
    values = np.random.default_rng(0).normal(size=12) * np.append(0.1, np.ones(11))
    found = number_history(values, own, at)
    assert found.course.steps == ()
    design = np.column_stack([found.course.model.design, jump(12, 0)])
    expected = np.max(np.abs(Between(values, own, design).interval(np.eye(3)[-1])))
    size, _ = candidates(values, own, found.course.model.design, ())
    assert 0 not in np.argsort(-np.abs(size))[:TRIED]
    assert found.step_limit == pytest.approx(expected, rel=1e-9)


def test_a_history_of_days_says_nothing_of_a_year():
    history = history_of(drawn(np.arange(6) / 365, 1, SCATTER))
    assert not history.is_year_stated
    assert "a drift a year is not known: the history is 5 days long" in " ".join(lines(history))
    assert {row[3] for row in rows(history)} == {"–"}


# Until when.


@cache
def long_history(drift_dps=0.0):
    """Two dozen sessions in twenty years, of which the bias of x drifts."""
    return history_of(drawn(np.linspace(0, 20, 24), 4, SCATTER, of("bias x", drift_dps)))


def test_the_day_is_where_the_known_unit_meets_it_with_95_percent():
    """Of 24 sessions the truth is all but known: the day is that of the normal law."""
    history = long_history(0.05)
    (outlook,) = outlooks_of(history, [parse_limit("bias 150 mdps")], today=history.sessions[-1].moment.when)
    assert outlook.answer == HOLDS
    last = (history.sessions[-1].values[ZERO] / DEG) - np.array([0.05 * 20, 0, 0])

    def share(years):
        middle = np.array([0.05 * years, 0, 0]) - last
        return np.prod(ndtr((0.15 - middle) / 0.03) - ndtr((-0.15 - middle) / 0.03))

    years = np.linspace(0, 20, 4001)
    expected = years[np.array([share(each) for each in years]) < 0.95][0]
    found = (outlook.until - history.sessions[-1].moment.when).total_seconds() / YEAR_S
    assert found == pytest.approx(expected, abs=0.5)
    assert np.interp(found, outlook.years, outlook.shares) == pytest.approx(0.95, abs=1e-6)
    assert not outlook.beyond


def test_nothing_is_said_further_ahead_than_the_history_is_long():
    history = long_history()
    last = history.sessions[-1].moment.when
    far = [last + timedelta(days=365.25 * years) for years in (0, 19, 21)]
    found = [outlooks_of(history, [parse_limit("bias 500 mdps")], today=day)[0] for day in far]
    assert [each.answer for each in found] == [HOLDS, HOLDS, UNDECIDED]
    assert all(each.beyond for each in found)
    assert all(abs((each.until - last).total_seconds() / YEAR_S - 20) < 1e-6 for each in found)


def test_a_requirement_that_is_not_met_even_now_says_so():
    history = long_history()
    (outlook,) = outlooks_of(history, [parse_limit("bias 20 mdps")], today=history.sessions[-1].moment.when)
    assert (outlook.answer, outlook.until) == (FAILS, None)
    assert "at the next switch-on" in outlook.reason


def test_a_day_that_has_passed_fails_only_where_the_chance_is_surely_less():
    """After fifteen years the drift alone is more than the limit; a week after the day, the chance is 95 % but for what nobody knows."""
    history = long_history(0.05)
    (outlook,) = outlooks_of(history, [parse_limit("bias 150 mdps")], today=FIRST + timedelta(days=365 * 35))
    assert outlook.answer == FAILS
    assert outlook.reason.startswith("it was met with 95 % until")
    (soon,) = outlooks_of(history, [parse_limit("bias 150 mdps")], today=outlook.until + timedelta(days=8))
    assert (soon.answer, soon.until) == (UNDECIDED, outlook.until)
    assert "may be met still" in soon.reason


@pytest.mark.parametrize("count", [2, 3, broad(6)])
def test_few_sessions_that_show_nothing_do_not_fail(count):
    """Of a limit of five scatters, which the unit all but always meets, a test of 95 % says "does not hold" in at most 5 % of units."""
    answers = []
    others = of("bias", 1.0) == 0
    for seed in range(20):
        sessions = drawn(np.arange(count) / 2, seed, of("bias", 0.01))
        history = history_of([replace(each, values=np.where(others, np.nan, each.values)) for each in sessions])
        (outlook,) = outlooks_of(history, [parse_limit("bias 50 mdps")], today=history.sessions[-1].moment.when)
        answers.append(outlook.answer)
    assert answers.count(FAILS) <= 3  # of 20 units one is expected at most, and four or more come with 1.6 %
    if count < 4:
        assert HOLDS not in answers


def test_a_chance_that_is_known_to_be_small_fails():
    """Two scatters of 10 mdps with a limit of 1 mdps: whatever s is within reason, it is missed."""
    history = history_of(drawn(np.arange(8) / 2, 1, of("bias", 0.01)))
    known, unknown = outlooks_of(history, [parse_limit("bias 1 mdps"), parse_limit("bias 25 mdps")], today=FIRST)
    assert (known.answer, unknown.answer) == (FAILS, UNDECIDED)
    assert "leave it open" in unknown.reason


def test_few_sessions_do_not_say_until_when():
    for count, words in ((1, "one session"), (3, "needs 4 sessions")):
        history = history_of(drawn(np.arange(count) / 2, 0))
        (outlook,) = outlooks_of(history, [parse_limit("bias 5 dps")], today=FIRST)
        assert outlook.answer == UNDECIDED
        assert words in outlook.reason


def test_a_minute_at_rest_turns_by_the_bias():
    """The zero alone turns a sensor at rest, by a minute's worth of it."""
    history = long_history()
    slope = slope_of(history, 60.0)
    np.testing.assert_allclose(slope[:, ZERO], -60 * np.eye(3), atol=1e-6)
    np.testing.assert_allclose(slope[:, :9], 0, atol=1e-6)
    (as_angle,) = outlooks_of(history, [parse_accuracy("5.4deg/60s")], today=history.sessions[-1].moment.when)
    turned = 60 * np.linalg.norm(draws_of(history).now[:, ZERO], axis=1)
    assert as_angle.shares[0] == pytest.approx(np.mean(turned <= 5.4 * DEG))
    assert 0.5 < as_angle.shares[0] < 0.95
    assert as_angle.requirement.limit == pytest.approx(5.4 * DEG)
    assert as_angle.requirement.seconds == parse_accuracy("1 deg / 1 min").seconds == 60


def test_draws_are_those_of_level_scatter_and_last_value():
    history = history_of(drawn(YEARS, 6, SCATTER))
    draws = draws_of(history)
    q = PLACE["bias y"]
    model, number = history.numbers[q].course.model, history.numbers[q]
    assert draws.now.shape == (4000, len(NUMBERS))
    assert np.median(draws.now[:, q]) == pytest.approx(model.coefficients[0] - number.values[-1], abs=0.1 * model.scatter)
    width = np.diff(np.quantile(draws.now[:, q] + number.values[-1] - model.coefficients[0], [0.025, 0.975]))[0] / 2
    at = history.at - history.at[-1]
    leverage = np.linalg.inv(np.column_stack([np.ones(10), at]).T @ np.column_stack([np.ones(10), at]))[0, 0]
    from scipy.stats import t

    assert width == pytest.approx(t.ppf(0.975, 8) * model.scatter * np.sqrt(1 + leverage), rel=0.06)
    np.testing.assert_array_equal(draws.after(2.0), draws.now + 2 * draws.growth)  # no shock was found, and none is predicted
    shocked = history_of(drawn(YEARS, 6, SCATTER, steps={4: of("bias", 2.0)}))
    more = draws_of(shocked)
    share = np.mean((more.after(1.0) != more.now + more.growth)[:, ZERO].any(axis=1))
    assert share == pytest.approx(1 - np.exp(-1 / 3), abs=0.03)  # one in three years
    moved = (more.after(1.0) - more.now - more.growth)[:, q]
    assert np.sqrt(np.mean(moved[moved != 0] ** 2)) / DEG == pytest.approx(2.0, rel=0.15)


def test_shocks_to_come_have_the_rms_of_those_that_were():
    """Two shocks in three years, each of one number: an arrival moves a number with half of its shock's square."""
    history = history_of(drawn(np.linspace(0, 3, 15), 6, SCATTER, steps={5: of("bias x", 2.0), 9: of("bias y", 4.0)}))
    assert sorted((step.number.words, step.interval) for step in history.steps) == [("bias x", 5), ("bias y", 9)]
    draws = draws_of(history)
    moved = draws.sizes[:, :, [PLACE["bias x"], PLACE["bias y"], PLACE["bias z"]]].reshape(-1, 3) / DEG
    np.testing.assert_allclose(np.sqrt(np.mean(moved**2, axis=0)), [np.sqrt(2), np.sqrt(8), 0.0], rtol=0.08)
    assert np.mean(draws.arrivals[:, 0]) == pytest.approx(3 / 2, rel=0.06)


def test_errors_of_one_fit_are_drawn_with_their_correlation():
    sessions = drawn(YEARS, 8, own=100.0)
    root = np.linalg.cholesky(0.9 * np.ones((21, 21)) + 0.1 * np.eye(21))
    one = [type(s)(**{**vars(s), "covariance": np.outer(100 * OWN, 100 * OWN) * (root @ root.T)}) for s in sessions]
    pairs = [(PLACE["bias x"], PLACE["bias y"]), (PLACE["scale factor error x"], PLACE["bias z"])]
    for q, r in pairs:
        found = [np.corrcoef(draws_of(history_of(each)).growth[:, [q, r]].T)[0, 1] for each in (sessions, one)]
        assert abs(found[0]) < 0.15
        assert found[1] > 0.3


def test_what_all_sessions_share_is_in_every_difference():
    sessions = drawn(YEARS, 8)
    shared = np.zeros((GYROSCOPE, GYROSCOPE))
    shared[ZERO, ZERO] = (0.5 * DEG) ** 2 * np.eye(3)
    last = type(sessions[-1])(**{**vars(sessions[-1]), "shared": shared})
    draws = draws_of(history_of([*sessions[:-1], last]))
    assert np.std(draws.now[:, ZERO]) / DEG == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize(
    "text", ["bias", "bias 5", "bias 5 kg", "5 mdps", "hue 5 mdps", "bias -5 mdps", "bias 0 mdps", "bias nan mdps", "x" * 500]
)
def test_a_limit_that_is_none_is_refused(text):
    with pytest.raises(CalibrationError, match=r"--require .*such as 'bias 50 mdps'"):
        parse_limit(text)


@pytest.mark.parametrize("text", ["1deg", "deg/60s", "0deg/60s", "1deg/0s", "1deg/60h", "1e9deg/60s", "9" * 300])
def test_an_accuracy_that_is_none_is_refused(text):
    with pytest.raises(CalibrationError, match=r"--accuracy .*such as 1deg/60s"):
        parse_accuracy(text)


def test_limits_are_read_in_any_unit_of_theirs():
    assert parse_limit("Bias  50 mdps").limit == pytest.approx(0.05 * DEG)
    assert parse_limit("accelerometer bias 200 ug").limit == pytest.approx(parse_limit("accelerometer bias 0.2 mg").limit)
    assert parse_limit("bias 180 °/h").limit == pytest.approx(0.05 * DEG)
    assert parse_limit("misalignment 0.1deg").limit == pytest.approx(0.1 * DEG)
    assert [NUMBERS[q].words for q in parse_limit("accelerometer bias 5 mg").numbers] == [f"accelerometer bias {axis}" for axis in "xyz"]
    assert len(parse_limit("scale factor error 1 %").numbers) == 3
