"""Verdicts of ``verify``: what a changed sensor is said to be, and whether B anew is proposed."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from verify_rows import made_rows
from verify_units import OPTIONS, SIGMA, rest_log, session_of, write

import tinygc
from session.io.errors import DataError
from session.io.units import DEG
from tinygc.annexes.verification import causes, verdict
from tinygc.annexes.verification.causes import Cause, beyond_linear, candidate_causes
from tinygc.annexes.verification.cost import BOUND, Bound, Cost, effects_deg, estimated_change, left_open
from tinygc.annexes.verification.old import COUNT, GYROSCOPE
from tinygc.annexes.verification.questions import GRAVITY, NOISE, PLAUSIBLE, B, E, todays_noise
from tinygc.annexes.verification.verdict import BIAS, FAILS, HOLDS, UNDECIDED, Options
from tinygc.attitude import rotation
from tinygc.models.linear import LinearModel
from tinygc.simulation.simulator import unit_of

NONE = LinearModel(np.eye(3), np.zeros(3))
#: noise of the old fit, as fit.json holds it
WANDER = {"name": "noise.bias_wander", "size": 2.0, "sigma": 1.0}
STILL = {"name": "noise.still_rate", "size": 0.001, "sigma": 0.001}
CALM = {"schema": "tinygc-fit/2", "noise": {"components": [WANDER, STILL, {"name": "noise.turn", "size": 1, "sigma": 1}]}}


@pytest.fixture(scope="module")
def unit():
    return unit_of(OPTIONS)


@pytest.fixture(scope="module")
def today(unit):
    return session_of(unit)


@pytest.fixture(scope="module")
def model(unit, today, tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    (folder / "fit.json").write_text(json.dumps(CALM))
    return write(folder / "model.json", np.r_[unit.E.ravel(), unit.B], today.config, covariance=np.diag(SIGMA**2).tolist())


def turned(unit, vector):
    R = rotation.matrix(rotation.exp(np.asarray(vector)))
    return replace(unit, E=R @ unit.E, B=R @ unit.B)


def change_of(matrix):
    return np.r_[np.zeros(9), LinearModel(matrix, np.zeros(3)).vector]


def test_a_misalignment_shows_half_way_round_a_turn_though_a_full_one_closes():
    skew = np.array([[0, 0, 0], [0, 0, -1], [0, 1, 0.0]])
    found = effects_deg(made_rows(), NONE, change_of(0.02 * skew), np.zeros((COUNT, COUNT)), True)
    assert found[E] == pytest.approx(2 * 0.02 / DEG, rel=1e-3)  # about y and z: twice the angle
    scaled = effects_deg(made_rows(), NONE, change_of(0.01 * np.diag([1.0, 0, 0])), np.zeros((COUNT, COUNT)), True)
    assert scaled[E] == pytest.approx(3.6, rel=1e-3)


def test_an_effect_is_the_length_of_the_error_and_its_sigma_that_of_its_worst_direction():
    change, covariance = np.zeros(COUNT), np.zeros((COUNT, COUNT))
    change[-3:] = [3e-4, 4e-4, 0]
    covariance[-3:, -3:] = 1e-8 * np.array([[1, 0.9, 0], [0.9, 1, 0], [0, 0, 1]])
    found = effects_deg(made_rows(), NONE, change, covariance, True)
    assert found[B] == pytest.approx(60 * (5e-4 + BOUND * 1e-4 * np.sqrt(1.9)) / DEG, rel=1e-3)


def test_what_a_rotation_is_beyond_its_linear_columns():
    old = LinearModel(np.eye(3) + 0.01 * np.arange(9).reshape(3, 3), np.array([0.01, -0.02, 0.03]))
    vector = np.array([0.1, -0.05, 0.08])
    R, cross = rotation.matrix(rotation.exp(vector)), np.array([[0, -0.08, -0.05], [0.08, 0, -0.1], [0.05, 0.1, 0]])
    expected = LinearModel((R - np.eye(3) - cross) @ old.E, (R - np.eye(3) - cross) @ old.B).vector
    assert beyond_linear(old, vector)[GYROSCOPE] == pytest.approx(expected, abs=1e-15)
    assert not beyond_linear(old, vector)[:9].any()


def test_without_a_cause_a_change_is_as_large_as_the_data_say(model, unit, monkeypatch):
    today = session_of(replace(unit, E=unit.E @ np.diag([1.01, 1, 1])))
    real = candidate_causes
    monkeypatch.setattr(verdict, "candidate_causes", lambda *given: [cause for cause in real(*given) if cause.name == "zero"])
    monkeypatch.setattr(causes, "PRIOR_ODDS", 1e-300)
    found = tinygc.verify(model, today)
    assert found.result.diagnosis.best.causes == ()
    assert found.answer == FAILS
    assert "no cause of the list explains it" in found.headline


def test_a_change_is_estimated_with_plausible_changes_as_prior():
    change = np.zeros(COUNT)
    change[[9, 14, 20]] = 0.3, -0.2, 0.5
    rows = made_rows(3, change, noise=0.01)
    noise = todays_noise(rows)
    found = estimated_change(rows, noise, left_open(rows, noise))
    assert found / PLAUSIBLE == pytest.approx(change, abs=0.02)


@pytest.mark.parametrize("dps_per_g", [0.0, 0.1])
def test_a_zero_that_differs_from_rest_to_rest_is_seen_where_the_old_rests_were_calm(model, unit, dps_per_g):
    def distort(t_s, rate, force, temp_c):
        return rate + dps_per_g * DEG * force / 9.80665

    found = tinygc.verify(model, session_of(unit, distort, segments=12))
    noise = {question.name: question for question in found.result.questions}[NOISE]
    assert noise.holds == (dps_per_g == 0)
    assert found.answer == (FAILS if dps_per_g else HOLDS)
    if dps_per_g:
        assert 60 * noise.left_rps / DEG == pytest.approx(60 * 0.1 / np.sqrt(3), rel=0.7)


def decided(matters=(), small=(), open_=(), as_it_is=0.2, anew=0.1, names=(), turned=True, anew_sigma=0.01):
    """The decision on a cost, degrees, with causes of these names."""
    bounds = [Bound(name, 2.0 if name in open_ else 0.1, 1.0, f"a use of {name}") for name in (E, B, GRAVITY)]
    sigma = np.full(3, 0.01 * DEG)
    cost = Cost("a minute", np.array([as_it_is, 0, 0]) * DEG, sigma, np.array([anew, 0, 0]) * DEG, np.array([0, anew_sigma, 0]) * DEG)
    found = [Cause(name, name, *[np.zeros(0)] * 3, "", 1.0, (), f"mend {name}") for name in names]
    diagnosis = SimpleNamespace(best=SimpleNamespace(causes=found, words=list(names)))
    changed = dict.fromkeys(matters, 3.0) | dict.fromkeys(small, 0.87)
    return verdict._decide(changed, bounds, cost, "NEW", diagnosis if changed else None, Options(), turned)


def test_nothing_is_called_insignificant_that_was_refuted():
    assert decided(open_=(E,)).headline.startswith("nothing significant")
    found = decided(small=(GRAVITY,), open_=(E,))
    assert found.answer == UNDECIDED
    assert found.headline.startswith("changed beyond chance, and by less than 1° (95 %): the accelerometer (up to 0.87°")


def test_the_headline_has_each_change_with_its_own_cost_the_largest_first():
    """A moved accelerometer costs a tilt, whatever the gyroscope costs in a minute."""
    found = decided(small=(GRAVITY,), as_it_is=0.025)
    assert found.answer == HOLDS
    assert "the accelerometer (up to 0.87° in a use of gravity's length); it costs 0.025° in the next minute" in found.headline
    both = verdict._decide(
        {E: 1.5, GRAVITY: 4.0},
        [Bound(name, 0.1, 1.0, "a use") for name in (E, B, GRAVITY)],
        Cost("a minute", *[np.zeros(3)] * 4),
        "NEW",
        None,
        Options(),
    )
    assert both.headline.startswith("departs from the calibration: the accelerometer (up to 4.0° in a use), E (up to 1.5° in a use) (95 %)")


def test_a_rest_holds_for_what_a_rest_shows():
    found = decided(open_=(E, GRAVITY), turned=False)
    assert (found.answer, found.headline.split(":")[0]) == (HOLDS, "the zero holds")
    assert decided(open_=(E, B), turned=False).answer == UNDECIDED
    assert decided(open_=(E, GRAVITY), turned=False, as_it_is=24.0).answer == UNDECIDED
    assert decided(open_=(GRAVITY,)).answer == UNDECIDED


def test_the_power_of_a_recording_is_named():
    bounds = [Bound(E, 1.3, 1.0, "a turn"), Bound(B, 0.38, 1.0, "a rest"), Bound(GRAVITY, 12.0, 1.0, "a tilt")]
    assert verdict.power_words(bounds) == "this recording tells E to 1.3°, the zero to 0.38°, the accelerometer to 12° (95 %)"


def test_b_is_taken_anew_where_that_helps_and_e_left_open_where_it_was_not_asked():
    assert decided(as_it_is=5.0).answer == BIAS
    left = decided(as_it_is=5.0, open_=(E,))
    assert (left.answer, left.bias_serves) == (UNDECIDED, True)
    assert left.headline.startswith("take B anew: B = NEW")
    assert "costs 5.0° in the next minute; whether E holds stays open" in left.headline
    moved = decided(matters=(B,), as_it_is=5.0, open_=(E,))
    assert (moved.answer, moved.bias_serves) == (FAILS, True)
    assert "--write" in moved.advice
    in_vain = decided(as_it_is=5.0, anew=2.0)
    assert (in_vain.answer, in_vain.bias_serves) == (FAILS, False)
    assert "with B anew the minute still misses 2.0°" in in_vain.headline
    assert decided(as_it_is=5.0, anew=2.0, open_=(E,), anew_sigma=0.99).answer == FAILS
    by_noise = decided(as_it_is=5.0, anew=2.0, open_=(E,), anew_sigma=1.01)  # nothing that this recording tells
    assert (by_noise.answer, by_noise.bias_serves) == (UNDECIDED, True)
    assert by_noise.headline.endswith("whether E holds stays open")


@pytest.mark.parametrize("name", [E, GRAVITY, NOISE])
def test_b_anew_is_no_answer_where_another_change_matters(name):
    found = decided(matters=(B, name), as_it_is=5.0)
    assert (found.answer, found.bias_serves) == (FAILS, False)
    assert decided(matters=(B,), as_it_is=5.0, names=("step",)).bias_serves is False


def test_what_noise_does_not_explain_is_said_beside_what_departs():
    left = f"more than noise is left: up to 3.0° in a use of {B} (95 %); "
    assert decided(matters=(NOISE,)).headline.startswith(left)
    both = decided(matters=(NOISE, E)).headline
    assert both.startswith(f"departs from the calibration: E (up to 3.0° in a use of {E}); {left}")


def test_one_factor_on_all_rates_is_named_as_the_factor():
    rows, old = replace(made_rows(), session=session_of(unit_of(OPTIONS))), SimpleNamespace(linear=NONE, accelerometer=object())
    found = {cause.name: cause for cause in candidate_causes(rows, old)}
    # The correction is E / 2 of rates that are doubled: theta = 1/2.
    assert found["common scale"].words(np.array([0.5]), np.array([1e-3])).endswith("+100 ± 0.4 %")
    assert found["common scale"].words(np.array([-1.0]), np.array([4e-3])).endswith("-50 ± 0.1 %")
    assert "x +1.01e+04 ± 1e+02" in found["scale"].words(np.array([0.01, 0, 0]), np.full(3, 1e-4))
    assert "x +10 " in found["rotation"].words(np.array([0.01, 0, 0]), np.full(3, 1e-4))


def test_the_temperature_is_that_of_the_model_file_or_a_note(model, unit, today, tmp_path):
    assert any("the model does not say how warm" in note for note in tinygc.verify(model, today).result.notes)
    table = json.loads(model.read_text()) | {"temperature_c": today.temperature_c - 20}
    (tmp_path / "then.json").write_text(json.dumps(table))
    found = tinygc.verify(tmp_path / "then.json", session_of(replace(unit, B=unit.B - 2 * DEG)))
    assert not any("how warm" in note for note in found.result.notes)
    assert "temperature" in found.result.diagnosis.alone
    written = json.loads(found.save_model(tmp_path / "anew.json").read_text())
    assert written["temperature_c"] == pytest.approx(today.temperature_c, abs=0.5)


def test_a_fit_writes_its_temperature(unit, tmp_path):
    folder = tinygc.fit(session_of(unit, segments=14), methods=("least_squares",)).save(tmp_path)
    assert json.loads((folder / "model_least_squares.json").read_text())["temperature_c"] == pytest.approx(25.0, abs=3.0)


def test_rates_in_another_unit_are_said_to_be(model, today):
    log = today.logs[0]
    wrong = replace(log, samples=replace(log.samples, gyro=np.asarray(log.samples.gyro) * DEG), raw=False)
    found = tinygc.verify(model, replace(today, logs=(wrong,)))
    assert (found.answer, found.result.bias_serves) == (FAILS, False)
    assert "the rates are in rad/s" in found.headline


@pytest.mark.parametrize(("factor", "axis", "said"), [(2.0, 1.0, "gravity: 2"), (1.0, 0.0, "gyro stuck: y")])
def test_a_minute_at_rest_refuses_what_the_first_look_refuses(model, today, tmp_path, factor, axis, said):
    log = today.logs[0]
    samples = replace(log.samples, gyro=log.samples.gyro * np.array([1, axis, 1]), accel=log.samples.accel * factor)
    path = rest_log(tmp_path / "rest.csv", replace(today, logs=(replace(log, samples=samples),)))
    with pytest.raises(DataError, match=said.replace("gravity: 2", "gravity: 19") if factor > 1 else said):
        tinygc.verify(model, path)


def rests_with(path, session, jump_dps):
    """Six rests of 8 s in one attitude, moved to and fro between them; the zero jumps after the third."""
    lines = rest_log(path, session, seconds=60).read_text().splitlines()
    for number, line in enumerate(lines[1:]):
        t, *rates, ax, ay, az = line.split(",")
        moved = jump_dps if number >= 30 * 104 else 0.0
        knock = 2.0 * np.sin(2 * np.pi * (number % 1040) / 208) if number >= 1040 and number % 1040 < 208 else 0.0
        lines[1 + number] = ",".join([t, *(f"{float(rate) + moved + knock:.7f}" for rate in rates), ax, ay, az])
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("jump_dps", [0.0, 0.1])
def test_a_jump_between_rests_is_seen_and_knocks_are_no_turns(model, today, tmp_path, jump_dps):
    found = tinygc.verify(model, rests_with(tmp_path / "rests.csv", today, jump_dps))
    assert (found.result.rows.turns, found.result.rows.stills) == (0, 6)
    noise = {question.name: question for question in found.result.questions}[NOISE]
    assert noise.rank == 15
    assert noise.holds == (jump_dps == 0)
    if jump_dps:
        assert found.result.diagnosis.best.names == ("step",)
        assert found.answer == FAILS


def test_what_its_own_screen_rejects_is_not_written(model, unit, tmp_path):
    found = tinygc.verify(model, session_of(replace(unit, E=unit.E @ np.diag([1.02, 1, 1]))))
    with pytest.raises(DataError, match=r"not written with B anew: .* departs from the calibration: E \("):
        found.save_model(tmp_path / "anew.json")
    assert not (tmp_path / "anew.json").exists()


def test_a_recording_does_not_verify_the_model_that_was_fitted_to_it(unit, today, tmp_path):
    from session.io.folder import input_hashes

    path = write(tmp_path / "own.json", np.r_[unit.E.ravel(), unit.B], today.config, sha256=input_hashes(today))
    found = tinygc.verify(path, today)
    assert (found.answer, found.exit_code) == (UNDECIDED, 5)
    assert "agrees with itself" in found.headline


def test_the_written_covariance_of_b_is_that_of_b_anew(model, today, tmp_path):
    found = tinygc.verify(model, today)
    written = np.array(json.loads(found.save_model(tmp_path / "anew.json").read_text())["covariance"])
    assert written[9:, 9:] == pytest.approx(found.result.bias_covariance)
    assert not written[9:, :9].any()
    assert written[:9, :9] == pytest.approx(np.diag(SIGMA**2)[:9, :9])


def test_the_white_noise_of_a_rest_is_that_of_its_mean(model, today, tmp_path):
    rows = tinygc.verify(model, rest_log(tmp_path / "rest.csv", today, seconds=30)).result.rows
    spread = today.logs[0].samples.gyro[:90].std(axis=0)  # of which the rest's readings are drawn
    assert np.sqrt(np.diag(rows.white)[:3]) == pytest.approx(spread / np.sqrt(30 * 104), rel=0.15)
    assert rows.noise_freedom == pytest.approx(3 * 30 / 0.1 * 0.66, rel=0.05)


def test_a_board_whose_clock_is_off_is_compared_by_the_clock_of_the_model(unit, today, model, tmp_path):
    """Stamps that run 0.45 % fast, E by either clock: it holds, as sharply as by true stamps; a clock that is not to be had is said."""
    ratio = 1.0045
    logs = tuple(replace(log, samples=replace(log.samples, t_ns=np.rint(log.samples.t_ns * ratio).astype(np.int64))) for log in today.logs)

    def on(logs, **clock):
        return replace(today, logs=logs, config=replace(today.config, sensor=replace(today.config.sensor, **clock)))

    def of(clock, scale):
        how = {"covariance": np.diag(SIGMA**2).tolist(), "clock": clock}
        return write(tmp_path / f"{clock}.json", np.r_[unit.E.ravel(), unit.B] * scale, today.config, **how)

    bare = tinygc.verify(model, on(today.logs, clock_sigma_ppm=20.0))
    for clock, scale in (("arrivals", 1.0), ("board", 1 / ratio)):
        found = tinygc.verify(of(clock, scale), on(logs, clock_ratio=ratio, clock_sigma_ppm=20.0))
        assert found.answer == bare.answer == HOLDS
        assert found.result.bounds[0].bound_deg == pytest.approx(bare.result.bounds[0].bound_deg, rel=0.01)
    assert "the model goes by the computer's clock" in tinygc.verify(tmp_path / "arrivals.json", on(logs)).headline
