"""The examination of the search for laws: what is drawn, what its truth adds, how answers are scored, and that nothing leaks."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from formats_page import CODE, section, strangers
from rich.console import Console

import calibrate
from session.io.units import DEG
from tinygc import SimulationOptions
from tinygc.annexes.challenge import law_examination
from tinygc.annexes.challenge.cases import STRENGTHS, Case, conceal
from tinygc.annexes.challenge.examination import OPENED, SEALED, SESSIONS, Examination
from tinygc.annexes.challenge.law_examination import ALIKE, ALL, added_rate, correlation, draw_discover_cases, law_tables, score_law, totals
from tinygc.annexes.challenge.laws import BY_HAND, LAWS
from tinygc.annexes.challenge.rate_effects import RATE_EFFECTS
from tinygc.effects import catalogue

pytestmark = pytest.mark.broad

OPTIONS = SimulationOptions(
    segments=6, closure_s=0.0, warm_up_c=10.0, seed=3, gyro_noise_dps_rthz=0.0, accel_noise_ug_rthz=0.0, bias_instability_dph=0.0
)
PRODUCT, SQUARES = "np.roll(m.rate, -1, 1) * np.roll(m.rate, 1, 1)", "np.roll(m.rate, -1, 1) ** 2 + np.roll(m.rate, 1, 1) ** 2"
FILE = '''"""A law as a search would write it."""

from tinygc.effects import Effect, Parameter, diagonal
import numpy as np

EFFECT = Effect(
    id="{id}",
    equation="w += c x",
    parameter=Parameter("at_fs_percent", (3,), "%", 0.01),
    observable_in=("turn",),
    columns=lambda m: diagonal(({x}) / m.fs_rps),
    describe=lambda theta: "a law",
    discriminating_motion="turn",
)
'''


def case(*ids, strengths=None, options=OPTIONS):
    return Case("case001", ids, strengths or (1.0,) * len(ids), options, 4)


@pytest.fixture(scope="module")
def product():
    """A case that hides the product of two rates, its truth, and what it adds."""
    return truth_of(case("law.rate_product"))


def truth_of(one):
    truth = {"effects": conceal(one, ALL)[2], "strength": one.strength, "strengths": dict(zip(one.ids, one.strengths, strict=True))}
    return truth, added_rate(one)


def write_law(folder, x=PRODUCT, number=1):
    (folder / "effects").mkdir(parents=True, exist_ok=True)
    name = f"effects/discovered_{number:02d}.py"
    (folder / name).write_text(FILE.format(id=f"discovered.law_{number}", x=x))
    return name


def law_said(file, at_fs, number=1):
    proof = {"before_deg": 0.3, "after_deg": 0.02, "floor_deg": 0.012, "removed": 0.99, "p_value": 1e-6, "segments": 12, "recording": None}
    return {
        "id": f"discovered.law_{number}",
        "equation": "w += c x",
        "parameters": {"at_fs_percent": (100 * np.array(at_fs)).tolist()},
        "std": {},
        "constants": {},
        "held_out": [proof],
        "chance_p": 0.001,
        "file": file,
        "runners_up": [],
    }


def said(*laws, verdict=None, effects=()):
    verdict = verdict or ("found" if laws else "none")
    return {"verdict": "explained", "effects": list(effects), "seconds": 9.0, "discovery": {"verdict": verdict, "laws": list(laws)}}


def scored(truth, true, answer, folder):
    return score_law("case001", truth, answer, true, folder)


# What is drawn


def test_laws_and_strengths_take_turns():
    cases = draw_discover_cases(200, 1)
    hidden = [each for each in cases if each.ids and each.ids[0] in LAWS]
    assert {name for each in hidden for name in each.ids if name in LAWS} == set(LAWS)
    assert sum(not each.ids for each in cases) == 50
    assert sum(bool(each.ids) and each.ids[0] in RATE_EFFECTS for each in cases) == 20
    beside = [each for each in cases if len(each.ids) == 2]
    assert len(beside) == 20
    assert all(each.ids[0] in BY_HAND and each.ids[1] in set(RATE_EFFECTS) - set(ALIKE.get(each.ids[0], ())) for each in beside)
    strengths = [each.strengths[0] for each in hidden]
    assert all(abs(strengths.count(each) / len(strengths) - 1 / 4) < 0.05 for each in STRENGTHS)
    assert {each.options.odr_hz for each in cases} == {104.0, 208.0, 416.0}
    assert all(38 <= each.options.segments < 49 or "earth.rotation" in each.ids for each in cases)
    assert all(each.options.warm_up_c == 10 for each in cases if {"law.package_strain", "law.random"} & set(each.ids))
    assert draw_discover_cases(40, 5) == draw_discover_cases(40, 5) != draw_discover_cases(40, 6)
    assert draw_discover_cases(7, 5) == draw_discover_cases(40, 5)[:7]


# Truth


def test_what_a_law_adds_is_what_the_registers_show():
    one = case("law.rate_product")
    with_law, clean = (conceal(each, ALL)[0] for each in (one, case()))
    step = OPTIONS.register_units.gyro_rps
    shown = (with_law.log.gyro.astype(float) - clean.log.gyro) * step @ clean.unit.E.T
    true = added_rate(one)
    assert len(true.law) == len(shown)
    assert np.abs(shown - true.law).max() < 1.2 * step
    assert np.abs(true.law).max() > 10 * step
    assert np.abs(true.movement.rate - (clean.log.gyro * step @ clean.unit.E.T + clean.unit.B)).max() < 1.2 * step


# Scores


def test_the_law_itself_is_found(product, tmp_path):
    truth, true = product
    at_fs = truth["effects"]["law.rate_product"]["at_fs"]
    score = scored(truth, true, said(law_said(write_law(tmp_path), at_fs)), tmp_path)
    assert (score.outcome, score.kind, score.strength) == ("found", "law", 1.0)
    assert score.correlation > 0.9999
    assert (score.removed, score.p_value, score.chance_p, score.seconds) == (0.99, 1e-6, 0.001, 9.0)
    assert "discovered.law_1" not in catalogue()


def test_another_law_is_wrong_and_so_is_the_right_one_upside_down(product, tmp_path):
    truth, true = product
    at_fs = np.array(truth["effects"]["law.rate_product"]["at_fs"])
    upside_down = scored(truth, true, said(law_said(write_law(tmp_path), -at_fs)), tmp_path)
    assert upside_down.outcome == "wrong"
    assert upside_down.correlation < -0.999
    other = scored(truth, true, said(law_said(write_law(tmp_path, SQUARES), at_fs)), tmp_path)
    assert other.outcome == "wrong"
    assert abs(other.correlation) < 0.9
    assert totals([upside_down, other])["far"] == 2


def test_two_laws_count_together_and_ambiguous_ones_alone(product, tmp_path):
    truth, true = product
    at_fs = np.array(truth["effects"]["law.rate_product"]["at_fs"])
    halves = [law_said(write_law(tmp_path, number=i), at_fs / 2, number=i) for i in (1, 2)]
    assert scored(truth, true, said(*halves), tmp_path).outcome == "found"
    pair = [halves[0], law_said(write_law(tmp_path, SQUARES, number=2), at_fs, number=2)]
    undecided = scored(truth, true, said(*pair, verdict="ambiguous"), tmp_path)
    assert (undecided.outcome, undecided.listed_same) == ("ambiguous", True)
    assert totals([undecided])["ambiguous_with_equal"] == 1


def test_a_file_that_is_missing_or_holds_other_parameters_is_wrong(product, tmp_path):
    truth, true = product
    (tmp_path / "effects").mkdir()
    missing = scored(truth, true, said(law_said("effects/discovered_01.py", [0.1] * 3)), tmp_path)
    assert missing.outcome == "wrong"
    assert "no effect" in missing.why
    law = law_said(write_law(tmp_path), [0.1] * 3)
    other = scored(truth, true, said(law | {"parameters": {"another": [1.0]}}), tmp_path)
    assert "at_fs_percent" in other.why


def test_names_of_the_catalogue_that_are_numerically_equal(tmp_path):
    truth, true = truth_of(case("law.soft_limit"))
    fs = OPTIONS.gyro_fs_dps * DEG
    cubic = -(fs**2) / (3 * np.square(truth["effects"]["law.soft_limit"]["rps"]))
    name = {"id": "gyro.scale_nonlinearity", "parameters": {"cubic_at_fs": cubic.tolist()}}
    equal = scored(truth, true, said(effects=[name]), tmp_path)
    assert (equal.outcome, equal.misnamed) == ("catalogue_equal", False)
    other = scored(truth, true, said(effects=[{"id": "gyro.bias_drift", "parameters": {"dps_over_log": [0.1, 0.1, 0.1]}}]), tmp_path)
    assert (other.outcome, other.misnamed) == ("missed", True)
    assert scored(truth, true, said(effects=[{"id": "unknown.curve_over_time", "parameters": {}}]), tmp_path).correlation is None
    refused = scored(truth, true, {"verdict": "refused", "why": "no stills", "effects": []}, tmp_path)
    assert (refused.outcome, refused.why) == ("missed", "no stills")


def test_what_a_concealed_effect_of_the_catalogue_can_take_up_is_nobody_s(tmp_path):
    """A law beside one of the catalogue: an answer that holds some of the other, too, is right."""
    truth, true = truth_of(case("law.rate_product", "gyro.g_sensitivity"))
    noise = true.movement.force_g @ np.array([[0.1, 0, 0.2], [0, 0.1, 0], [0.3, 0, 0]]) * DEG
    assert correlation(true, truth["effects"], true.law + noise) > 0.9999
    alone, none_beside = truth_of(case("law.rate_product"))
    assert correlation(none_beside, alone["effects"], none_beside.law + noise) < 0.99
    assert correlation(true, truth["effects"], noise) == pytest.approx(0, abs=0.2)


def test_where_no_law_is_hidden(tmp_path):
    law = law_said(write_law(tmp_path), [0.1] * 3)
    null, alone = truth_of(case()), truth_of(case("gyro.bias_step"))
    scores = [scored(*each, answer, tmp_path) for each in (null, alone) for answer in (said(), said(law), said(law, verdict="ambiguous"))]
    assert [each.outcome for each in scores] == ["silent", "invented", "ambiguous"] * 2
    assert [each.kind for each in scores] == ["nothing"] * 3 + ["catalogue"] * 3
    counts = totals(scores)
    assert counts["nothing"] == counts["catalogue"] == {"silent": 1, "ambiguous": 1, "invented": 1, "sessions": 3}


def test_a_law_at_its_strength_not_its_neighbour_s(tmp_path):
    truth, true = truth_of(case("law.rate_product", "gyro.bias_step", strengths=(1.0, 0.5)))
    assert scored(truth, true, said(), tmp_path).strength == 1.0


def test_vibration_as_the_accelerometer_passes_it_is_vibration_enough():
    """A law of the vibration is asked for what the log shows of it, not for what the chip's low-pass hides."""
    one = case("law.vibration_scale")
    truth, true = truth_of(one)
    moved = true.movement
    assert (
        correlation(true, truth["effects"], truth["effects"]["law.vibration_scale"]["per_g2"] * moved.rate * moved.vibration_g2[:, None])
        > 0.999
    )


# From end to end


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A tiny examination of a searcher that says the same of every session, and what it saw."""
    folder, seen = tmp_path_factory.mktemp("discover") / "out", []

    def answer(copy):
        seen.append((copy, {path.name for path in copy.rglob("*")}, (folder / OPENED).exists()))
        return said(law_said(write_law(copy / "explain"), [0.1, 0.1, 0.1]))

    announced = []
    result = law_examination.examine_laws(folder, 4, 11, segments=4, answer=answer, announce=announced.append)
    return folder, result, seen, announced


def test_the_searcher_sees_a_copy_and_no_truth(small):
    folder, result, seen, announced = small
    assert result.sha256 in announced[0]
    assert all(names == {"session.toml", "log0001.csv.gz"} and not opened for _, names, opened in seen)
    assert len({copy for copy, *_ in seen}) == 4
    for copy, *_ in seen:
        assert {path.name for path in (folder / SESSIONS / copy.name).iterdir()} == {"session.toml", "log0001.csv.gz"}
        assert "law." not in (copy / "session.toml").read_text()
    assert b"law." not in (folder / SEALED).read_bytes()
    assert (folder / law_examination.EXAMINED_LAWS / "case001" / "discovered_01.py").exists()


def test_the_table_and_the_json_are_whole(small):
    folder, result, *_ = small
    table = json.loads(json.dumps(law_examination.to_json(result)))
    assert table["schema"] == "tinygc-discover-challenge/2"
    assert not strangers(table)
    assert {path.name for path in folder.iterdir()} <= set(CODE.findall(section("`tinygc-discover-challenge/2`")))
    assert law_tables(result).renderables
    assert sum(table["totals"]["with_law"][outcome] for outcome in ("wrong", "found")) == table["totals"]["with_law"]["sessions"]
    assert all(each.equations == ("w += c x",) for each in result.scores)


def test_found_laws_are_in_the_tables(product, tmp_path):
    truth, true = product
    found = scored(truth, true, said(law_said(write_law(tmp_path), truth["effects"]["law.rate_product"]["at_fs"])), tmp_path)
    scores = [found, replace(found, strength=0.5, outcome="missed"), replace(found, law=None, hidden=(), outcome="invented")]
    result = Examination(1, "0", scores, {}, {})
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(law_tables(result))
    told = console.export_text()
    assert "rate_product" in told
    assert "99.0 %" in told
    assert "1 hide nothing: 1 with an invented law" in told


def test_the_search_is_not_examined_on_a_recording(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        calibrate.main(["challenge", "--discover", "--on", str(tmp_path)])
    assert ended.value.code == 2
    assert "--on" in capsys.readouterr().err
