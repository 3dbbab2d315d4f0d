"""Effects concealed in a recording of one's own: only what they change is added, blind, and counted by size."""

import io
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from formats_page import strangers
from rich.console import Console

import calibrate
from session.io.errors import FormatError
from session.io.units import DEG
from tinygc import read_session
from tinygc.annexes.challenge import recording as injection
from tinygc.annexes.challenge import recording_examination
from tinygc.annexes.challenge.cases import STRENGTHS
from tinygc.annexes.challenge.examination import OPENED, SEALED, SESSIONS
from tinygc.annexes.challenge.other_effects import OUTSIDERS
from tinygc.annexes.challenge.recording import (
    FAULTS,
    MULTIPLES,
    STRONG,
    InjectionTrial,
    draw_trials,
    drawn_parameter,
    inject,
    rate_changes,
    recording_of,
    requantised,
    steps_of,
    write_spoilt,
)
from tinygc.annexes.challenge.recording_examination import Power, Tried, not_tried, power_tables, powers, sentences
from tinygc.effects import Movement, catalogue

SIZES = {"gyro.g_sensitivity": 0.05, "gyro.bias_step": 0.2, "gyro.bandwidth": 0.01, "gyro.thermal_bias": 0.1, "outside.telegraph": 1.0}


@pytest.fixture(scope="module")
def folder(simulated):
    return simulated(segments=14, closure_s=0.0, seed=6)


@pytest.fixture(scope="module")
def recording(folder):
    return recording_of(folder)


@pytest.fixture(scope="module")
def in_si(recording, tmp_path_factory):
    """The same recording, its log in rad/s and m/s^2."""
    folder = tmp_path_factory.mktemp("si") / "session"
    samples = recording.session.logs[0].samples
    folder.mkdir()
    shutil.copyfile(recording.session.folder / "session.toml", folder / "session.toml")
    table = np.column_stack([samples.t_s, samples.gyro, samples.accel])
    head = "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
    np.savetxt(folder / "log0001.csv", table, fmt=["%.9f"] + ["%.7f"] * 6, delimiter=",", header=head, comments="")
    return recording_of(folder)


def trial(name, size, seed=3):
    return InjectionTrial("case001", name, size, "", None, seed)


@pytest.mark.parametrize("name", sorted(SIZES))
@pytest.mark.parametrize("units", ["recording", "in_si"])
def test_what_is_added_is_the_effect_seen_through_the_calibration_within_one_step(name, units, request, tmp_path):
    recording = request.getfixturevalue(units)
    if units == "in_si" and name == "gyro.thermal_bias":
        pytest.skip("that log has no temperature")
    old = recording.session.logs[0].samples
    spoilt = inject(recording, trial(name, SIZES[name]))
    write_spoilt(recording.session, spoilt.logs, tmp_path / "spoilt")
    new = read_session(tmp_path / "spoilt").logs[0].samples
    (movement,) = recording.movements
    if name in OUTSIDERS:
        (change,), _ = rate_changes(recording, trial(name, SIZES[name]), np.random.default_rng(3))
    else:
        effect = catalogue()[name]
        effect = effect.at(spoilt.truth["at_s"]) if effect.scan else effect
        theta = np.ravel(spoilt.truth[effect.parameter.name]) * effect.parameter.si
        own = theta - theta.mean() if name == "gyro.bandwidth" else theta
        assert np.linalg.norm(own) == pytest.approx(SIZES[name] * effect.parameter.si)
        change = (effect.distort(movement, theta) - movement.rate) @ np.linalg.inv(recording.problem.first.E).T
    step = steps_of(recording.session, 0).gyro
    assert step == pytest.approx(17.5e-3 * DEG, rel=1e-3)
    assert np.abs(new.gyro - old.gyro - change).max() <= step * 1.001
    assert abs(np.mean(new.gyro - old.gyro - change)) < 0.02 * step, "rounding must not add a bias"
    assert np.abs(change).max() > step
    np.testing.assert_array_equal(new.t_ns, old.t_ns)
    np.testing.assert_allclose(new.accel, old.accel, rtol=1e-8)
    if old.temp_c is not None:
        np.testing.assert_allclose(new.temp_c, old.temp_c, atol=1e-9)


def test_less_than_a_step_is_not_lost():
    rng, old = np.random.default_rng(1), np.zeros((20000, 3))
    new = requantised(old, np.full_like(old, 0.2), 1.0, rng)
    assert set(np.unique(new)) == {0.0, 1.0}
    assert new.mean() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("name", sorted(FAULTS))
def test_faults_of_the_registers_grow_with_their_strength(recording, name):
    old = recording.session.logs[0].samples
    changed = []
    for strength in (1.0, 0.2):
        (new,) = inject(recording, trial(name, strength)).logs
        rows = min(len(old), len(new))
        assert len(old) - len(new) == {"timing.dropped_samples": 12 * round(9 * strength)}.get(name, 0)
        np.testing.assert_array_equal(new.t_ns, old.t_ns[:rows])
        changed.append(np.abs(new.gyro[:rows] - old.gyro[:rows]).sum())
    assert changed[0] > changed[1] > 0


def test_a_bias_of_the_accelerometer_is_one_of_the_calibrated_force(recording):
    spoilt = inject(recording, trial("reference.accelerometer", 5.0))
    session = recording.session
    difference = session.config.accelerometer.correct(spoilt.logs[0].accel) - session.calibrated(session.logs[0]).accel
    np.testing.assert_allclose(difference.mean(axis=0) / 9.80665e-3, spoilt.truth["bias_mg"], atol=0.01)


@pytest.mark.parametrize("name", sorted(name for name, effect in catalogue().items() if effect.kind == "force"))
def test_an_effect_of_the_accelerometer_is_in_its_force(recording, name):
    """The calibrated force without the effect is that of the untouched log, to a register's step and its mean to far less."""
    effect = catalogue()[name]
    spoilt, session = inject(recording, trial(name, 0.2 * effect.parameter.plausible / effect.parameter.si)), recording.session
    theta = np.ravel(spoilt.truth[effect.parameter.name]) * effect.parameter.si
    (old,), force_g = recording.movements, session.config.accelerometer.correct(spoilt.logs[0].accel) / 9.80665
    back = effect.correct_force(old.with_force(force_g), theta)
    done = np.abs(force_g - old.force_g).max()
    assert np.abs(back - old.force_g).max() < 2 * 0.122e-3
    np.testing.assert_allclose((back - old.force_g).mean(axis=0), 0, atol=0.02 * done)


# What is drawn


def test_every_effect_before_any_at_another_size():
    detection_limits = {"gyro.g_sensitivity": 0.01, "gyro.bias_drift": 0.02}
    every = draw_trials(detection_limits, (), True, None, 1)
    names = {each.id for each in every}
    assert names >= set(OUTSIDERS)
    assert {each.id for each in draw_trials(detection_limits, (), True, len(names), 2)} == names
    sizes = sorted(each.size for each in every if each.id == "gyro.bias_drift")
    assert sizes == pytest.approx(sorted(0.02 * multiple for multiple in MULTIPLES))
    assert {each.size for each in every if each.id == "data.glitches"} == set(STRENGTHS)
    assert {each.unit for each in every if each.id in OUTSIDERS} == {STRONG}
    assert len({each.name for each in every}) == len({each.seed for each in every}) == len(every)
    assert draw_trials(detection_limits, (), True, None, 1) == every


def test_neither_what_it_has_already_nor_what_it_cannot_have_is_concealed():
    every = {each.id for each in draw_trials({}, {"gyro.g_sensitivity"}, False, None, 1)}
    assert not every & {"gyro.g_sensitivity", "gyro.thermal_bias", "outside.temperature_curve", "earth.rotation", "reference.not_still"}


def test_an_effect_of_another_s_folder_is_concealed(monkeypatch, recording):
    effect = replace(catalogue()["gyro.g2_sensitivity"], id="mine.g2")
    both = {**catalogue(), "mine.g2": effect}
    monkeypatch.setattr(injection, "catalogue", lambda: both)
    assert "mine.g2" in {each.id for each in draw_trials({}, (), True, None, 1)}
    (change,), truth = rate_changes(recording, trial("mine.g2", 0.1), np.random.default_rng(0))
    assert isinstance(recording.movements[0], Movement)
    assert list(truth) == ["dps_per_g2"]
    assert np.abs(change).max() > 0.01 * DEG


# How it is counted


def said(*names, verdict="explained", findings=()):
    claims = [{"id": name, "equivalent": [], "parameters": {}, "std": {}} for name in names]
    return {"verdict": verdict, "effects": claims, "findings": [{"id": name, "equivalent": []} for name in findings]}


def power(sizes, detection_limit=0.1):
    """sizes: multiple of detection_limit -> whether it was found."""
    return Power("a", "dps", detection_limit, tuple(Tried(m * 0.1, found, (), (), ()) for m, found in sorted(sizes.items())))


def test_detected_from_is_the_size_from_which_on_all_are_found():
    assert power({1: False, 2: True, 4: True}).detected_from == 0.2
    assert power({1: True, 2: False, 4: True}).detected_from == 0.4
    assert power({1: True, 2: True, 4: False}).detected_from is None
    assert power({1: True, 2: False, 4: True}).undetected_at == 0.2
    assert power({1: True, 2: True}).undetected_at is None


@pytest.mark.parametrize(
    ("sizes", "agrees"),
    [
        ({1: False, 2: True}, True),
        ({0.5: False, 1: True, 2: True}, True),
        ({0.5: False, 2: True}, True),
        ({0.5: False, 4: True}, None),
        ({2: True}, None),
        ({1: True, 2: True}, None),
        ({1: False, 4: True}, None),
        ({1: False}, None),
        ({2: False, 4: True}, False),
        ({2: False, 4: False}, False),
        ({1: True, 2: False, 4: True}, False),
        ({0.5: True, 1: True, 2: True}, False),
    ],
)
def test_a_promise_is_judged_only_where_the_sizes_decide_it(sizes, agrees):
    assert power(sizes).agrees is agrees
    assert power(sizes, detection_limit=None).agrees is None


def examined(*found):
    return recording_examination.OwnExamination("mine", 1, "0" * 64, "explained", ("gyro.g_sensitivity",), list(found))


def printed(result):
    console = Console(width=200, file=io.StringIO())
    console.print(power_tables(result))
    return console.file.getvalue()


def test_the_page_says_all_three_and_marks_upper_bounds():
    page = printed(examined(power({1: False, 2: True}), power({2: True}), power({4: False, 8: True})))
    assert (
        "of the 3 effects with a detection limit it holds within a factor of 2 for 1, not for 1, and for 1 the sizes do not decide it"
        in page
    )
    assert len(re.findall(r"│ ≤ 0\.2 +│ ≤ 2 +│", page)) == 1
    assert page.count("≤") == 3
    assert "gone" not in page


def test_what_should_be_found_is_counted_by_itself():
    """Twice the detection limit and more, of effects that have one."""
    page = printed(examined(power({1: False, 2: True}), power({2: False}), power({4: True, 8: True})))
    assert "of the 4 at twice their detection limit or more, 3 found" in page
    assert "at twice" not in printed(examined(power({1: True}), Power("a", STRONG, None, (Tried(1.0, True, (), (), ()),))))


def test_names_of_its_own_that_went_missing_are_written_and_printed():
    lost = Power("a", "dps", None, (Tried(1.0, True, ("a",), (), ("gyro.g_sensitivity",)), Tried(2.0, True, ("a",), (), ())))
    table = json.loads(json.dumps(recording_examination.to_json(examined(lost))))
    assert [one["lost"] for one in table["effects"][0]["tried"]] == [["gyro.g_sensitivity"], []]
    assert not strangers(table)
    assert "its own that are gone beside what was concealed: gyro.g_sensitivity in 1" in printed(examined(lost))


def test_what_the_untouched_recording_has_is_neither_right_nor_wrong():
    untouched = said("gyro.g_sensitivity", verdict="partly_explained", findings=("unknown.curve_over_time",))
    trials = [
        InjectionTrial("case001", "gyro.bias_drift", 0.1, "dps", 0.1, 0),
        InjectionTrial("case002", "outside.telegraph", 1.0, STRONG, None, 0),
    ]
    answers = {
        "case001": said("gyro.g_sensitivity", "gyro.bias_drift", "gyro.bias_step"),
        "case002": said("gyro.g_sensitivity", verdict="partly_explained", findings=("unknown.curve_over_time",)),
    }
    drift, telegraph = powers(trials, answers, untouched)
    assert (drift.tried[0].found, drift.tried[0].wrong) == (True, ("gyro.bias_step",))
    assert (telegraph.tried[0].found, telegraph.tried[0].wrong) == (False, ())
    assert not drift.tried[0].lost
    answers["case002"] = said(findings=("unknown.oscillation",))
    (seen,) = powers(trials, answers, untouched)[1].tried
    assert (seen.found, seen.lost) == (True, ("gyro.g_sensitivity",))


@pytest.mark.parametrize("name", ["gyro.bandwidth", "timing.axis_skew", "gyro.angular_acceleration", "gyro.g_sensitivity"])
def test_the_size_of_delays_is_of_what_differs_between_the_axes(name):
    """The common part is the clock's: of lags it is the least that leaves none below zero."""
    effect = catalogue()[name]
    shown = drawn_parameter(effect, 0.3, np.random.default_rng(4))
    own = [] if name == "gyro.g_sensitivity" else list(effect.gauge_convention.delays)
    apart = shown.copy()
    apart[own] -= apart[own].mean() if own else 0.0
    assert np.linalg.norm(apart) == pytest.approx(0.3)
    assert np.linalg.norm(shown - apart) == pytest.approx(np.sqrt(3) * -apart.min() if name == "gyro.bandwidth" else 0.0, abs=1e-12)
    assert name != "gyro.bandwidth" or shown.min() == 0.0


@pytest.mark.parametrize(
    ("own_ms", "copy_ms", "wrong"),
    [(8.1, 8.1, ()), (8.1, 12.0, ()), (8.1, 4.2, ()), (-8.1, -8.1, ()), (8.1, 12.2, 1), (8.1, 4.0, 1), (3.9, 3.9, 1)],
)
def test_a_delay_that_the_untouched_recording_measures_without_naming_it_is_its_own_and_the_earth_is_always(own_ms, copy_ms, wrong):
    """A sigma of 2 ms: it is there beyond 4 ms, and the same one within 4 ms."""
    delay = "timing.gyro_accel_offset"
    untouched, copy = (
        said(*names) | {"turn_gravity": {"offset_s": 1e-3 * ms, "offset_std_s": 2e-3}}
        for names, ms in (((), own_ms), (("gyro.bias_drift", delay, "earth.rotation"), copy_ms))
    )
    (drift,) = powers([InjectionTrial("case001", "gyro.bias_drift", 0.1, "dps", 0.1, 0)], {"case001": copy}, untouched)
    assert drift.tried[0].found
    assert drift.tried[0].wrong == ((delay,) if wrong else ())


def test_a_name_that_the_untouched_recording_weighs_at_one_half_is_its_own():
    """A rejected effect is reported at one half at most: there it fits, and held-out turns do not decide it."""
    trials = [InjectionTrial("case001", "gyro.bias_drift", 0.1, "dps", 0.1, 0)]
    for chance, wrong in ((0.5, ()), (0.49, ("gyro.bias_step",))):
        untouched = said() | {"considered": [{"id": "gyro.bias_step", "probability": chance}]}
        (drift,) = powers(trials, {"case001": said("gyro.bias_drift", "gyro.bias_step")}, untouched)
        assert drift.tried[0].wrong == wrong


def test_a_name_that_a_copy_merely_weighs_is_gone():
    trials = [InjectionTrial("case001", "gyro.bias_drift", 0.1, "dps", 0.1, 0)]
    copy = said("gyro.bias_drift") | {"considered": [{"id": "gyro.g_sensitivity", "probability": 0.5}]}
    (drift,) = powers(trials, {"case001": copy}, said("gyro.g_sensitivity"))
    assert drift.tried[0].lost == ("gyro.g_sensitivity",)


def test_an_effect_that_is_not_tried_here_is_not_concealed():
    names = {name for name, effect in catalogue().items() if effect.kind in ("rate", "force")}
    assert not_tried({"detection_limits": dict.fromkeys(names)}) == set()
    assert not_tried({"detection_limits": dict.fromkeys(names - {"reference.accelerometer"})}) == {"reference.accelerometer"}
    assert "earth.rotation" not in not_tried({"detection_limits": {}})


# From end to end


@pytest.mark.slow
def test_a_quick_run_names_what_it_concealed_and_the_folder_is_blind(folder, tmp_path, monkeypatch):
    wanted = ("gyro.g_sensitivity", "gyro.scale_asymmetry", "data.glitches")
    draw = recording_examination.draw_trials

    def few(*args):
        return [each for each in draw(*args) if each.id in wanted and (each.size == 1.0 or each.detection_limit == each.size / 8)]

    monkeypatch.setattr(recording_examination, "draw_trials", few)
    announced = []

    def announce(text):
        announced.append((text, {path.name for path in tmp_path.rglob("*")}))

    result = recording_examination.examine_recording(folder, tmp_path / "out", None, 5, announce=announce)
    ((text, present),) = announced
    assert result.sha256 in text
    assert SEALED in present
    assert not present & {OPENED, "answers.json", "truth.json"}
    for session in (tmp_path / "out" / SESSIONS).iterdir():
        assert {path.name for path in session.iterdir()} == {"session.toml", "log0001.csv.gz"}
    assert {each.id for each in result.powers} == set(wanted)
    for each in result.powers:
        assert each.tried[-1].found, each
        assert not any(one.wrong for one in each.tried)
    table = json.loads(json.dumps(recording_examination.to_json(result)))
    assert not strangers(table)
    assert power_tables(result).renderables
    assert len(sentences(result)) >= 3


def test_refusals_are_one_line(tmp_path, capsys, folder):
    assert calibrate.main(["challenge", "--on", str(tmp_path), "--quiet"]) == 2
    assert "session.toml: not found" in capsys.readouterr().err
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine").write_text("")
    with pytest.raises(FormatError, match="not empty"):
        recording_examination.examine_recording(folder, full, 1, 0)
    beside_truth = tmp_path / "truth"
    shutil.copytree(folder, beside_truth)
    toml = beside_truth / "session.toml"
    toml.write_text(toml.read_text().replace('"gravity"', '"truth"'))
    (beside_truth / "truth0001.csv").write_text("t_s,qw,qx,qy,qz\n" + "".join(f"{0.5 * i},1,0,0,0\n" for i in range(1, 100)))
    assert calibrate.main(["challenge", "--on", str(beside_truth), "--quiet"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "truth" in error
    assert "not supported" in error
