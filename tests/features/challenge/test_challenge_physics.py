"""The blind examination: what is concealed is what the truth says, in a recording only what it changes is added, and each is judged."""

import shutil

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.signal import butter, sosfilt

import calibrate
from session.base.units import DEG
from session.log.written import toml_text
from tinygc import SimulationOptions
from tinygc.effects import Movement, catalogue
from tinygc.features.challenge.examination import ALIKE, ALONE, _host_of, _in_steps, _own_names, compared, conceal, drawn, injected
from tinygc.features.challenge.other_effects import MAKERS, bench
from tinygc.simulation.simulator import plan_of, simulate_session

# What is drawn and concealed.


def test_one_to_three_that_can_be_told_apart_are_drawn():
    cases = [drawn(sorted(MAKERS), np.random.default_rng(seed)) for seed in range(300)]
    assert {len(case) for case in cases} == {1, 2, 3}
    assert {name for case in cases for name in case} == set(MAKERS)
    assert all(len(group & case.keys()) <= 1 for case in cases for group in ALIKE)
    assert all(len(case) == 1 for case in cases if ALONE & case.keys())


def test_the_same_seed_conceals_the_same_and_the_configuration_does_not_tell_it():
    options = SimulationOptions(segments=2, closure_s=0.0, odr_hz=62.5)
    one, two, none, earth = (
        conceal(dict.fromkeys(names, 1.0), options, np.random.default_rng(3))
        for names in (["gyro.bias_step"], ["gyro.bias_step"], [], ["earth.rotation"])
    )
    text = toml_text(one[1])
    assert (text, one[2]) == (toml_text(two[1]), two[2])
    assert "#" not in text
    assert "bias_step" not in text
    assert_array_equal(one[0].log.gyro, two[0].log.gyro)
    assert_array_equal(one[0].log.accel, none[0].log.accel)
    assert np.abs(one[0].log.gyro - none[0].log.gyro).max() > 0
    assert (one[1].site.latitude_deg, earth[1].site.latitude_deg) == (31.03, None)


@pytest.fixture(scope="module")
def played():
    """Options and plan of a simulation, and its time, rate, force and temperature, which begins to warm up."""
    options, seen = SimulationOptions(segments=4, closure_s=0.0, warm_up_c=8.0), []
    simulate_session(options, lambda *true: seen.append(true) or true[1])
    return options, plan_of(options), seen[0]


@pytest.mark.parametrize("name", sorted({name for name in MAKERS if name.startswith("gyro.")} - {"gyro.saturation"}))
def test_two_codes_of_one_effect_agree(name, played):
    """The examiner's own code against the catalogue's, on the same movement: the parameters mean the same in both."""
    options, plan, (t, rate, force, temp) = played
    hidden = MAKERS[name](bench(np.random.default_rng(3), 1.0, options, plan))
    effect, g, dt_s = catalogue()[name], 9.80665, t[1] - t[0]
    if effect.scan:
        effect = effect.variants(np.array([hidden.truth["at_s"]]))[0]
    vibration = np.zeros(len(t))
    if hidden.disturb:
        # The truth is per g² that the accelerometer passes, by the simulation's low-pass at a quarter of the data rate.
        shaken = sosfilt(butter(2, options.odr_hz / 4, fs=1 / dt_s, output="sos"), (hidden.disturb(t, force) - force) / g, axis=0)
        vibration = np.convolve(np.mean(shaken**2, axis=1), np.ones(round(0.25 / dt_s)) * dt_s / 0.25, "same")
    movement = Movement(t, dt_s, rate, force / g, temp, vibration, plan.log_s, options.gyro_fs_dps * DEG, options.temperature_start_c)
    theta = np.ravel(hidden.truth[effect.parameter.name]) * effect.parameter.si
    mine, theirs = hidden.distort(t, rate, force, temp) - rate, effect.distort(movement, theta) - rate
    loose = {"gyro.vibration_rectification": 0.3}.get(name, 0.01)
    assert np.sqrt(np.mean((mine - theirs) ** 2)) < loose * np.sqrt(np.mean(mine**2))


# In a recording.


@pytest.fixture(scope="module")
def folder(simulated):
    return simulated(segments=8, closure_s=0.0, seed=6, odr_hz=62.5)


@pytest.fixture(scope="module")
def host(folder):
    return _host_of(folder)


@pytest.mark.parametrize("name", ["gyro.g_sensitivity", "gyro.bias_step", "gyro.thermal_bias", "gyro.scale_asymmetry"])
def test_what_is_added_is_the_effect_seen_through_the_calibration_within_one_step(name, host):
    old = host.session.logs[0].samples
    session, truth = injected(host, {name: 1.0}, np.random.default_rng(3))
    new, (movement,), effect = session.logs[0].samples, host.movements, catalogue()[name]
    effect = effect.at(truth[name]["at_s"]) if effect.scan else effect
    theta = np.ravel(truth[name][effect.parameter.name]) * effect.parameter.si
    change = (effect.distort(movement, theta) - movement.rate) @ host.back.T
    off, step = np.asarray(new.gyro) - old.gyro - change, 17.5e-3 * DEG
    assert np.abs(off).max() < 1.1 * step
    assert abs(np.mean(off)) < 0.05 * step, "rounding must not add a bias"
    assert np.abs(change).max() > step / 2
    assert_array_equal(new.t_ns, old.t_ns)
    assert_array_equal(new.accel, old.accel)


def test_less_than_a_step_is_not_lost():
    rng = np.random.default_rng(1)
    old = rng.integers(0, 50, (20000, 3)).astype(float)
    new = _in_steps(old, np.full_like(old, 0.2), rng)
    assert set(np.unique(new - old)) == {0.0, 1.0}
    assert (new - old).mean() == pytest.approx(0.2, abs=0.01)


def test_refusals_are_one_line(tmp_path, capsys, folder):
    shutil.copytree(folder, beside := tmp_path / "truth")
    toml = beside / "session.toml"
    toml.write_text(toml.read_text().replace('"gravity"', '"truth"'))
    (beside / "truth0001.csv").write_text("t_s,qw,qx,qy,qz\n" + "".join(f"{0.5 * i},1,0,0,0\n" for i in range(1, 100)))
    for place, says in ((tmp_path, "session.toml: not found"), (beside, "a recording with a truth file is not supported")):
        assert calibrate.main(["challenge", "--on", str(place), "--quiet"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert says in line


# How it is judged.

STEP = {"gyro.bias_step": {"at_s": 50.0, "dps": [0.3, 0.4, 0.0]}}


def said(*names, limits=(), equivalent=(), verdict="explained"):
    effects = [{"id": name, "equivalent": list(equivalent)} for name in names]
    sizes = {name: {"size": size, "unit": "dps"} for name, size in dict(limits).items()}
    closure = {"before": 0.5, "after": 0.1, "floor": 0.1}
    return {"verdict": verdict, "effects": effects, "detection_limits": sizes, "fit": {"holdout_closure_rms_deg": closure}}


@pytest.mark.parametrize(
    ("answer", "outcome", "wrong"),
    [
        (said("gyro.bias_step"), "right", ()),
        (said("gyro.bias_drift", equivalent=["gyro.bias_step"]), "right", ()),
        (said("gyro.bias_drift", limits={"gyro.bias_step": 0.4}), "missed", ("gyro.bias_drift",)),
        (said("unknown.curve_over_time", limits={"gyro.bias_step": 0.6}), "limit", ()),
        (said("gyro.g_sensitivity", limits={"gyro.bias_step": None}), "limit", ()),
        (said(verdict="no_mismatch"), "missed", ()),
    ],
)
def test_each_is_right_or_wrong_or_below_its_limit(answer, outcome, wrong):
    found = compared({"gyro.bias_step": 1.0}, STEP, answer, own=("gyro.g_sensitivity",))
    assert (found.hidden[0].outcome, found.wrong) == (outcome, wrong)
    assert found.hidden[0].size == pytest.approx(0.5)
    assert (found.before_deg, found.after_deg) == (0.5, 0.1)


@pytest.mark.parametrize(("offset_s", "own"), [(0.0041, {"timing.gyro_accel_offset"}), (-0.0039, set())])
def test_names_and_a_delay_of_the_untouched_recording_are_its_own(offset_s, own):
    untouched = said("gyro.g_sensitivity", equivalent=["gyro.bias_drift"])
    untouched |= {"turn_gravity": {"offset_s": offset_s, "offset_std_s": 0.002}}
    untouched |= {"findings": [{"id": "unknown.attitude", "equivalent": []}]}
    untouched |= {"considered": [{"id": "gyro.bias_step", "probability": 0.5}, {"id": "gyro.bandwidth", "probability": 0.4}]}
    assert _own_names(untouched) == {"gyro.g_sensitivity", "gyro.bias_drift", "unknown.attitude", "gyro.bias_step"} | own
