"""The blind examination: what is hidden is what the truth says, nobody can read it before the end, and the same seed asks the same."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from session.io.errors import DataError, FormatError
from session.io.units import DEG
from tinygc import SimulationOptions
from tinygc.annexes.challenge import examination
from tinygc.annexes.challenge.cases import ALIKE, INSTABILITY_SOURCES, LEAST_HZ, MAKERS, NEEDS, STRENGTHS, Case, conceal, draw_cases
from tinygc.annexes.challenge.examination import SESSIONS, challenge_tables, markdown, seal, totals
from tinygc.annexes.challenge.other_effects import OUTSIDERS
from tinygc.annexes.challenge.rate_effects import Scene
from tinygc.annexes.challenge.score import calibration_error, parameter_errors, reliability, score
from tinygc.effects import Movement, catalogue
from tinygc.simulation.options import draw_unit
from tinygc.simulation.simulator import plan_of, simulate_session, true_signals

CASES, SEGMENTS, SEED = 2, 8, 8


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A tiny examination, and where it was held."""
    folder = tmp_path_factory.mktemp("challenge") / "out"
    announced = []
    result = examination.examine(folder, CASES, SEED, segments=SEGMENTS, announce=lambda text: announced.append((text, _files(folder))))
    return folder, result, announced


def _files(folder):
    return {path.name for path in folder.rglob("*") if path.is_file()}


@pytest.mark.broad
def test_every_session_is_explained_and_scored(small):
    _, result, _ = small
    assert [each.name for each in result.scores] == [f"case{i + 1:03d}" for i in range(CASES)]
    assert all(said["verdict"] for said in result.said.values())
    table = examination.to_json(result)
    assert json.loads(json.dumps(table))["schema"] == "tinygc-challenge/2"
    assert table["totals"]["sessions"] == CASES
    assert markdown(result).count("\n") > 5
    assert challenge_tables(result).renderables


def test_the_seal_cannot_be_read_and_not_be_changed(tmp_path):
    truth = {"case001": {"effects": {"gyro.bias_step": {"at_s": 3.0}}}}
    closed = seal(truth, tmp_path / "sealed")
    assert b"gyro" not in closed.path.read_bytes()
    assert closed.open() == truth
    data = bytearray(closed.path.read_bytes())
    data[20] ^= 1
    closed.path.write_bytes(data)
    with pytest.raises(DataError, match="SHA-256"):
        closed.open()


@pytest.mark.slow
def test_same_seed_same_questions_and_same_answers(small, tmp_path):
    folder, result, _ = small
    assert draw_cases(40, 5) == draw_cases(40, 5)
    assert draw_cases(40, 5) != draw_cases(40, 6)
    for case in draw_cases(CASES, SEED, SEGMENTS)[:1]:
        simulation, config, truth = conceal(case)
        examination.write_files(simulation, tmp_path / case.name, config)
        for name in ("session.toml", "log0001.csv.gz"):
            assert (tmp_path / case.name / name).read_bytes() == (folder / SESSIONS / case.name / name).read_bytes()
        assert json.loads(json.dumps(truth)) == result.truth[case.name]["effects"]
        again = examination.explained(tmp_path / case.name)
        assert score(case.name, result.truth[case.name], again) == next(each for each in result.scores if each.name == case.name)


def test_a_full_folder_is_not_touched(tmp_path):
    (tmp_path / "mine").write_text("")
    with pytest.raises(FormatError, match="not empty"):
        examination.examine(tmp_path, 1, 0)


# What is drawn


def kind_of(case):
    outside = sum(name in OUTSIDERS for name in case.ids)
    return "beside" if outside and len(case.ids) > 1 else "outside" if outside else len(case.ids)


def test_shares_of_what_is_hidden():
    cases = draw_cases(200, 1)
    kinds = [kind_of(case) for case in cases]
    assert [kinds.count(kind) for kind in (0, 1, 2, 3, 4, "outside", "beside")] == [40, 70, 20, 20, 14, 16, 20]
    assert {name for case in cases for name in case.ids} == set(MAKERS)
    alone = [case.strength for case in cases if kind_of(case) in (1, 2, "outside") and case.ids != ("earth.rotation",)]
    assert all(abs(alone.count(each) / len(alone) - 1 / 4) < 0.05 for each in STRENGTHS)
    assert all(abs(sum(case.instability_source == source for case in cases) / 200 - 1 / 3) < 0.01 for source in INSTABILITY_SOURCES)
    assert {case.options.odr_hz for case in cases} == {62.5, 104, 208, 416, 833}
    assert 0 <= min(case.options.bias_instability_dph for case in cases) < 1
    assert 9 < max(case.options.bias_instability_dph for case in cases) <= 10
    assert [len(draw_cases(count, 0)) for count in (1, 2, 3, 7, 40)] == [1, 2, 3, 7, 40]


def test_several_at_once_can_be_told_apart():
    several = [case for case in draw_cases(400, 2) if kind_of(case) in (3, 4, "beside")]
    for case in several:
        assert max(case.strengths) == 1.0
        assert min(case.strengths) >= 0.2
        assert len(set(case.ids)) == len(case.ids) == len(case.strengths)
        assert all(len(group & set(case.ids)) <= 1 for group in ALIKE)
        assert kind_of(case) != "beside" or 2 <= len(case.ids) <= 3
    assert all(case.options.odr_hz >= LEAST_HZ.get(name, 0) for case in draw_cases(400, 2) for name in case.ids)


@pytest.mark.parametrize("source", INSTABILITY_SOURCES)
def test_what_is_told_of_the_bias_instability(source):
    options = SimulationOptions(segments=3, closure_s=0.0, bias_instability_dph=7.25)
    _, config, _ = conceal(Case("case", (), (), options, 4, source))
    assert ('model = "ASM330LHH"' in config) == (source == "model")
    assert ("gyro_bias_instability_dph = 7.25" in config) == (source == "stated")
    assert ("instability" in config) == (source == "stated")


def test_the_effects_that_are_asked_for_are_in_the_catalogue_and_no_outsider_is():
    """An effect that is added to the catalogue need not have a maker here."""
    assert set(MAKERS) - set(OUTSIDERS) <= set(catalogue())
    assert not set(OUTSIDERS) & set(catalogue())
    assert len(set(MAKERS) - set(OUTSIDERS)) >= 19
    assert len(OUTSIDERS) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(MAKERS))
def test_what_is_hidden_is_in_the_recording_and_fades_with_its_strength(name):
    options = SimulationOptions(closure_s=0.0, **({"segments": 8} | {k: v for k, v in NEEDS.get(name, {}).items() if k != "segments"}))
    clean = simulate_session(options).log
    sizes = []
    for strength in (1.0, 0.2):
        simulation, config, truth = conceal(Case("case", (name,), (strength,), options, 4))
        assert set(truth) == {name}
        json.dumps(truth)
        log = simulation.log
        same = min(len(log.gyro), len(clean.gyro))
        sizes.append(sum(np.abs(a[:same].astype(float) - b[:same]).sum() for a, b in ((log.gyro, clean.gyro), (log.accel, clean.accel))))
    if name == "earth.rotation":
        assert "latitude" not in config
    else:
        assert "latitude" in config
        assert sizes[0] > sizes[1] > 0


@pytest.mark.parametrize("name", sorted(set(catalogue()) & {name for name in MAKERS if name.startswith("gyro.")} - {"gyro.saturation"}))
def test_two_codes_of_one_effect_agree(name):
    """The examiner's own code against the catalogue's, on the same movement: the parameters mean the same in both."""
    options = SimulationOptions(segments=8, closure_s=0.0, warm_up_c=8.0)
    plan = plan_of(options)
    hidden = MAKERS[name](Scene(np.random.default_rng(3), 1.0, options, plan))
    t = np.arange(0, plan.log_s, 1 / 1664)
    rate, force, temp = true_signals(options, draw_unit(options, np.random.default_rng(0)), plan, t)
    effect, g = catalogue()[name], 9.80665
    if effect.scan:
        effect = effect.variants(np.array([hidden.truth["at_s"]]))[0]
    vibration = np.zeros(len(t))
    if hidden.disturb:
        # The truth is per g² that the accelerometer passes, by the simulation's low-pass at a quarter of the data rate.
        shaken = sosfilt(butter(2, options.odr_hz / 4, fs=1664, output="sos"), (hidden.disturb(t, force) - force) / g, axis=0)
        vibration = np.convolve(np.mean(shaken**2, axis=1), np.ones(416) / 416, "same")
    movement = Movement(
        t, t[1] - t[0], rate, force / g, temp, vibration, plan.log_s, options.gyro_fs_dps * DEG, options.temperature_start_c
    )
    theta = np.ravel(hidden.truth[effect.parameter.name]) * effect.parameter.si
    mine, theirs = hidden.distort(t, rate, force, temp) - rate, effect.distort(movement, theta) - rate
    loose = {"gyro.vibration_rectification": 0.3}.get(name, 0.01)
    assert np.sqrt(np.mean((mine - theirs) ** 2)) < loose * np.sqrt(np.mean(mine**2))


# How it is scored

STEP = {"gyro.bias_step": {"at_s": 50.0, "dps": [0.1, 0.2, 0.3]}}


def said(*effects, verdict="explained"):
    return {"verdict": verdict, "effects": list(effects), "fit": {"excess_removed": 0.9}}


def claim(name, parameters=None, std=None, equivalent=()):
    return {"id": name, "parameters": parameters or {}, "std": std or {}, "equivalent": list(equivalent)}


def test_scores():
    truth = {"effects": STEP, "strength": 0.5}
    exact = score("a", truth, said(claim("gyro.bias_step", {"dps": [0.1, 0.2, 0.3]}, {"dps": [0.01] * 3})))
    assert exact.exact
    assert exact.covered
    assert exact.sigmas == (0, 0, 0)
    stand_in = score("a", truth, said(claim("gyro.bias_drift", equivalent=["gyro.bias_step"]), verdict="ambiguous"))
    assert (stand_in.exact, stand_in.covered, stand_in.wrong, stand_in.missed) == (False, True, (), ())
    wrong = score("a", truth, said(claim("gyro.bias_drift")))
    assert (wrong.covered, wrong.wrong, wrong.missed) == (False, ("gyro.bias_drift",), ("gyro.bias_step",))
    missed = score("a", truth, said(verdict="unexplained"))
    assert (missed.wrong, missed.missed, missed.removed) == ((), ("gyro.bias_step",), None)
    null = score("a", {"effects": {}, "strength": None}, said(claim("gyro.bias_step")))
    nameless = {"effects": {"outside.telegraph": {}}, "strength": 1.0}
    outside = score("a", nameless, said(claim("gyro.bias_step")))
    undecided = score("a", nameless, said(claim("gyro.bias_step", equivalent=["unknown.curve_over_time"]), verdict="ambiguous"))
    counts = totals([exact, stand_in, wrong, missed, null, replace(null, verdict="no_mismatch", claimed=()), outside, undecided])
    asked = ("hidden", "named_exactly", "named_with_equivalents", "wrongly_named", "missed", "false_alarms")
    assert [counts[name] for name in asked] == [4, 1, 2, 1, 2, 1]
    assert [counts[f"outsiders{name}"] for name in ("", "_wrongly_named", "_undecided")] == [2, 1, 1]


def test_beside_an_outsider_the_catalogue_s_names_are_asked_for_and_shapes_without_a_name_are_never_wrong():
    truth = {"effects": STEP | {"outside.telegraph": {}}, "strength": 0.5}
    right = score("a", truth, said(claim("gyro.bias_step"), claim("unknown.curve_over_time")))
    assert (right.kind, right.exact, right.covered) == ("beside", True, True)
    wrong = score("a", truth, said(claim("gyro.bias_step"), claim("gyro.bias_drift")))
    assert (wrong.exact, wrong.covered, wrong.wrong) == (False, False, ("gyro.bias_drift",))
    missed = score("a", truth, said(claim("unknown.curve_over_time")))
    assert (missed.covered, missed.wrong, missed.missed) == (False, (), ("gyro.bias_step",))
    (counts,) = totals([right, wrong, missed])["kinds"]
    assert [counts[name] for name in ("kind", "named_with_equivalents", "wrongly_named", "missed")] == ["beside", 1, 1, 1]


def test_stated_probabilities_are_held_against_how_often_they_were_right():
    truth = {"effects": STEP, "strength": 0.5}
    sure = said(claim("gyro.bias_step") | {"probability": 0.8}) | {"considered": [{"id": "gyro.bias_drift", "probability": 0.2}]}
    unsure = said(claim("gyro.bias_drift") | {"probability": 0.8}, claim("unknown.shape") | {"probability": 0.9})
    silent = said(claim("gyro.bias_drift"))
    scores = [score("a", truth, each) for each in (sure, sure, sure, unsure, silent)]
    stated = [one for each in scores for one in each.statements]
    assert len(stated) == 7
    (bin,) = (each for each in reliability(stated) if each.low == 0.7)
    assert (bin.number, bin.share_right, bin.mean_stated) == (4, 0.75, pytest.approx(0.8))
    assert calibration_error(stated) == pytest.approx((4 * 0.05 + 3 * 0.2) / 7)
    assert totals(scores)["ece_claimed"] == pytest.approx(0.05)
    assert totals(scores[-1:])["ece"] is None
    certain = [score("a", truth, said(claim("gyro.bias_step") | {"probability": 1.0}))]
    assert totals(certain)["reliability"][-1]["number"] == 1


def test_alarms_by_data_rate_and_bias_instability():
    truth = {"effects": {}, "strength": None, "odr_hz": 62.5, "bias_instability_dph": 10.0, "instability_source": "model"}
    rows = totals([score("a", truth, said(claim("gyro.bias_step"))), score("a", truth, said(verdict="no_mismatch"))])["groups"]
    assert [row["group"] for row in rows] == ["5 to 10 deg/h", "62.5 Hz", "model"]
    assert all((row["sessions"], row["nulls"], row["false_alarms"]) == (2, 2, 1) for row in rows)


def test_parameter_errors_are_in_the_reported_sigmas():
    effect = claim("gyro.bias_drift", {"dps_over_log": [1.0, 2.0, 3.4]}, {"dps_over_log": [0.1, 0.1, 0.1]})
    sigmas, right = parameter_errors(effect, {"dps_over_log": [1.0, 2.2, 3.0]})
    assert sigmas == pytest.approx([0, 2, 4])
    assert right == [True, True, False]


def test_moments_count_once():
    truth = {"at": [100, 200, 300, 400, 500], "samples": 4}
    assert parameter_errors(claim("x", {"at": [101, 199, 300, 403]}), truth) == ([], [True])
    assert parameter_errors(claim("x", {"at": [101, 199, 300]}), truth) == ([], [False])
    assert parameter_errors(claim("x", {"at": list(range(0, 1000, 7))}), truth) == ([], [False])
