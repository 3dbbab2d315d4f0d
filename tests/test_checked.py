"""Effects checked on another recording, with the numbers of the first: odds, power, outcomes, and sessions of one simulated unit."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from explained_sessions import g_sensitive
from scipy.stats import multivariate_normal

from session.io.errors import DataError
from session.io.siblings import others_beside, recordings_at
from session.io.units import DEG, EARTH_RATE_RPS
from tinygc import SimulationOptions, explain
from tinygc.effects import catalogue
from tinygc.explanation.checked import (
    OUTCOMES,
    STRONG,
    Checked,
    CheckedEffect,
    Outcome,
    SizedEffect,
    check_on,
    headings,
    named_in,
    odds_of,
    of_recording,
    of_unit,
    outcome_of,
    predicted,
    size_of,
    weighed_by,
)
from tinygc.explanation.decision import tilt_rms
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.standing import Standing
from tinygc.explanation.truth_names import OFFSET
from tinygc.noise.refit import refit
from tinygc.reporting.checked_text import checked_page, odds_words
from tinygc.reporting.terminal import Group, as_text
from tinygc.simulation.write import write_session

ASYMMETRY = catalogue()["gyro.scale_asymmetry"]
EARTH = catalogue()["earth.rotation"]
THETA = np.array([3e-3, -1e-3, 2e-3])
COVARIANCE = 1e-8 * np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])
NAMED = SizedEffect(ASYMMETRY, THETA, COVARIANCE, 0.99)


def there(theta, covariance):
    return SizedEffect(ASYMMETRY, np.asarray(theta, float), np.asarray(covariance, float), 0.99)


# The numbers of a check.


def test_the_odds_are_those_of_the_two_normal_densities():
    estimates, covariance = np.array([[2e-3, -1e-3, 1e-3], [0.0, 1e-4, 0.0]]), 2 * COVARIANCE
    expected = [
        2 * (multivariate_normal.logpdf(x, THETA, covariance + COVARIANCE) - multivariate_normal.logpdf(x, np.zeros(3), covariance))
        for x in estimates
    ]
    assert odds_of(estimates, NAMED, covariance) == pytest.approx(expected, rel=1e-9)


def test_the_size_there_is_the_share_along_the_named_one():
    share, sigma = size_of(NAMED, there(0.7 * THETA, 3 * COVARIANCE))
    assert share == pytest.approx(0.7)
    assert sigma == pytest.approx(1 / np.sqrt(THETA @ np.linalg.solve(4 * COVARIANCE, THETA)))


def test_the_same_size_is_confirmed_none_is_contradicted_and_too_little_to_see_is_neither():
    assert weighed_by(NAMED, there(THETA, COVARIANCE), 0).outcome is Outcome.CONFIRMED
    small = weighed_by(NAMED, there(0.35 * THETA, COVARIANCE), 0)
    assert small.odds < -STRONG  # nearer to none than to the named size, and there
    assert small.outcome is Outcome.OTHER_SIZE
    assert weighed_by(NAMED, there(-0.35 * THETA, COVARIANCE), 0).outcome is Outcome.CONTRADICTED
    nothing = weighed_by(NAMED, there(np.zeros(3), COVARIANCE), 0)
    assert nothing.outcome is Outcome.CONTRADICTED
    assert nothing.standing is Standing.AGAINST
    blind = weighed_by(NAMED, there(np.zeros(3), 1e4 * COVARIANCE), 0)
    assert blind.outcome is Outcome.NO_POWER
    assert blind.power < 0.01
    assert blind.standing is Standing.UNDECIDED


def test_odds_of_twenty_to_one_decide():
    assert pytest.approx(2 * np.log(20)) == STRONG
    seen = there(THETA, COVARIANCE)
    assert weighed_by(NAMED, seen, 0, STRONG).outcome is Outcome.CONFIRMED
    assert weighed_by(NAMED, seen, 0, STRONG - 1e-6).outcome is Outcome.NOT_CONFIRMED
    unseen = there(0 * THETA, COVARIANCE)
    assert weighed_by(NAMED, unseen, 0, -STRONG).outcome is Outcome.CONTRADICTED
    assert weighed_by(NAMED, unseen, 0, -STRONG + 1e-6).outcome is Outcome.NOT_CONFIRMED


def test_odds_against_a_size_that_agrees_do_not_contradict_it():
    """A name with a wide sigma is worth less than none, and is not wrong for that."""
    wide = replace(NAMED, theta=0.5 * THETA, covariance=1e6 * COVARIANCE)
    found = weighed_by(wide, there(np.zeros(3), COVARIANCE), 0)
    assert found.odds < -STRONG
    assert found.same_p > 0.9
    assert found.outcome is Outcome.NOT_CONFIRMED


def test_an_effect_of_another_size_is_confirmed_and_said_to_be_of_another_size():
    found = weighed_by(NAMED, there(0.8 * THETA, COVARIANCE), 0)
    assert found.outcome is Outcome.CONFIRMED
    assert found.other_size


def test_the_test_of_one_size_is_uniform_and_the_power_is_the_share_that_decides():
    rng = np.random.default_rng(7)
    named = replace(NAMED, theta=0.06 * THETA)
    root_here, root_there = np.linalg.cholesky(COVARIANCE), np.linalg.cholesky(0.5 * COVARIANCE)
    # The effect is truly where the named sigma allows.
    true = named.theta + rng.standard_normal((600, 3)) @ root_here.T
    found = [weighed_by(named, there(x + root_there @ rng.standard_normal(3), 0.5 * COVARIANCE), 1) for x in true]
    assert np.mean([each.same_p < 0.05 for each in found]) == pytest.approx(0.05, abs=0.027)  # three sigmas
    assert np.mean([each.same_p < 0.5 for each in found]) == pytest.approx(0.5, abs=0.062)
    seen = np.mean([each.odds >= STRONG for each in found])
    assert 0.1 < seen < 0.9
    assert found[0].power == pytest.approx(seen, abs=0.077)  # three sigmas of both draws


def test_the_earths_rate_is_turned_about_the_vertical_with_its_uncertainty():
    rate = EARTH_RATE_RPS * np.array([0.6, 0.0, -0.8])
    named = SizedEffect(EARTH, rate, EARTH_RATE_RPS**2 * np.diag([0.04, 0.01, 0.09]), 0.99)
    turned = headings(named)
    assert len(turned) == 72
    quarter = turned[18]
    assert quarter.theta == pytest.approx(EARTH_RATE_RPS * np.array([0.0, 0.6, -0.8]), abs=1e-12)
    assert np.diag(quarter.covariance) == pytest.approx(EARTH_RATE_RPS**2 * np.array([0.01, 0.04, 0.09]))


def test_what_belongs_to_one_recording_is_not_taken_to_another():
    known = catalogue()
    moments = ("gyro.bias_drift", "gyro.bias_step", "data.glitches", "timing.dropped_samples", "reference.not_still", "motion.undersampled")
    assert all(of_recording(known[name]) for name in moments)
    assert of_recording(known["accelerometer.zero_drift"])
    lasting = ("gyro.g_sensitivity", "gyro.bandwidth", "gyro.thermal_bias", "earth.rotation", "timing.gyro_accel_offset")
    assert not any(of_recording(known[name]) for name in lasting)


def test_devices_share_the_earth_and_the_truth():
    known = catalogue()
    assert all(of_unit(known[name]) for name in ("gyro.g_sensitivity", "timing.gyro_accel_offset", "timing.axis_skew"))
    assert not any(map(of_unit, (known["earth.rotation"], OFFSET)))


def test_a_contradiction_anywhere_counts_and_blindness_does_not():
    of = lambda *outcomes: outcome_of([CheckedEffect(NAMED, each) for each in outcomes])  # noqa: E731
    assert of(Outcome.CONFIRMED, Outcome.CONTRADICTED) is Outcome.CONTRADICTED
    assert of(Outcome.NO_POWER, Outcome.CONFIRMED, Outcome.NOT_CONFIRMED) is Outcome.CONFIRMED
    assert of(Outcome.NO_POWER, Outcome.NOT_CONFIRMED) is Outcome.NOT_CONFIRMED
    assert set(OUTCOMES) == set(Outcome)


def test_odds_in_words():
    assert odds_words(2 * np.log(35)) == "35 : 1"
    assert odds_words(-2 * np.log(200)) == "1 : 200"
    assert odds_words(1e9) == "> 1e6 : 1"
    assert odds_words(0.0) == "1 : 1"


# Sessions of one simulated unit.


@pytest.fixture(scope="module", name="unit")
def of_one_unit(tmp_path_factory):
    """Folder of three sessions of one serial number: two of a g-sensitive unit, and a sound one."""
    place = tmp_path_factory.mktemp("unit")
    for name, distort, seed in (("first", g_sensitive, 5), ("second", g_sensitive, 8), ("sound", None, 9)):
        made = write_session(SimulationOptions(segments=16, closure_s=0.0, seed=seed, odr_hz=62.5), place / name, distort=distort)
        path = made / "session.toml"
        path.write_text(re.sub('serial = ".*"', 'serial = "SIM-1"', path.read_text()))
    return place


@pytest.fixture(scope="module", name="explained")
def explained_sessions(unit):
    return {path.name: explain(path).explanation for path in unit.iterdir()}


def test_the_sessions_of_a_unit_are_found_by_its_serial_number(unit):
    assert [path.name for path in others_beside(unit / "first")] == ["second", "sound"]
    assert [path.name for path in recordings_at(unit, unit / "first", "SIM-1")] == ["second", "sound"]
    assert recordings_at(unit / "sound", unit / "first", "SIM-1") == [unit / "sound"]
    with pytest.raises(DataError, match="is the recording itself"):
        recordings_at(unit / "first", unit / "first", "SIM-1")
    with pytest.raises(DataError, match="not found"):
        recordings_at(unit / "nowhere", unit / "first", "SIM-1")
    with pytest.raises(DataError, match="sessions of the unit 'SIM-2' other than first"):
        recordings_at(unit, unit / "first", "SIM-2")


def test_a_sensors_effect_is_confirmed_in_its_other_session(explained):
    (found,) = check_on(explained["first"], explained["second"]).effects
    assert found.named.effect.id == "gyro.g_sensitivity"
    assert found.outcome is Outcome.CONFIRMED
    assert not found.other_size
    assert found.size[0] == pytest.approx(1, abs=3 * found.size[1])
    before, after = found.closure_rad
    assert after < 0.2 * before
    own = explained["second"]
    assert before == pytest.approx(tilt_rms(own.proof.before), rel=1e-6)  # the figure that fit states of that session
    assert after == pytest.approx(tilt_rms(own.proof.named), rel=0.2)  # as well as with its own numbers


def test_an_effect_that_is_not_there_is_contradicted(explained):
    (found,) = check_on(explained["first"], explained["sound"]).effects
    assert found.outcome is Outcome.CONTRADICTED
    assert found.size[0] == pytest.approx(0, abs=3 * found.size[1])
    before, after = found.closure_rad
    assert after > 5 * before


def test_a_copy_of_the_recording_confirms_nothing(explained):
    with pytest.raises(DataError, match="holds a log of first itself"):
        check_on(explained["first"], explained["first"])


def test_a_recording_that_cannot_be_explained_does_not_cost_the_first_result(unit, tmp_path):
    short = write_session(SimulationOptions(segments=4, closure_s=0.0, seed=9, odr_hz=62.5), tmp_path / "short")
    why = explain(unit / "first", check_on=[short])
    assert why.effects
    assert "expected at least" in why.to_json()["checked"][0]["error"]
    assert "Not checked on short: " in why.summary()


def test_another_units_own_effect_is_not_checked(explained):
    session = explained["second"].session
    config = replace(session.config, sensor=replace(session.config.sensor, serial="SIM-2"))
    stranger = replace(explained["second"], session=replace(session, config=config))
    checked = check_on(explained["first"], stranger)
    assert checked.same_unit is False
    (found,) = checked.effects
    assert found.outcome is Outcome.OF_UNIT
    assert found.there.theta == pytest.approx(found.named.theta, abs=0.01 * DEG)


def test_a_lookalike_that_the_other_recording_names_gives_way(explained):
    """What stands in the effect's place there is taken out before the effect is weighed."""
    (named,), second = named_in(explained["first"]), explained["second"]
    twin, whiten = second.twin, second.whiten
    copy = replace(named.effect, id="gyro.copy")
    fit = refit(twin, whiten, [copy], twin.start())
    other = replace(second, naming=replace(second.naming, fit=fit))
    evidence = Evidence(twin)
    beside = predicted(named, other, evidence, 0)
    instead = predicted(replace(named, lookalikes=frozenset({"gyro.copy"})), other, evidence, 0)
    assert beside.outcome is not Outcome.CONFIRMED  # the copy takes it all up
    assert instead.outcome is Outcome.CONFIRMED
    assert instead.size[0] == pytest.approx(1, abs=3 * instead.size[1])


def test_the_page_and_the_json_give_sizes_closures_and_outcomes_side_by_side(unit):
    why = explain(unit / "first", check_on=[unit])  # all that is of this unit
    assert [each["session"] for each in why.to_json()["checked"]] == ["second", "sound"]
    (entry,) = why.to_json()["checked"][0]["effects"]
    assert entry["outcome"] == "confirmed"
    assert entry["standing"] == "for"
    assert entry["there"]["parameters"].keys() == {"matrix_dps_per_g"}
    assert entry["closure_rms_deg"]["after"] < entry["closure_rms_deg"]["before"]
    assert json.loads(json.dumps(why.to_json()))["checked"][1]["effects"][0]["outcome"] == "contradicted"
    text = as_text(Group(*checked_page(why.checked)))
    assert "gyro.g_sensitivity: contradicted in 1, confirmed in 1 of 2 recordings" in text
    assert "1 : > 1e6" in text


def test_nothing_named_is_nothing_to_check():
    assert "nothing is named" in as_text(Group(*checked_page([Checked(None, True)])))
