"""What is said of a discovery: its JSON, its page, the next movement, its files; with laws that stand in hand-made answers."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from discovery_answers import DECIDED, DRIFT, LAWS, NOTHING, OTHER_LOG, found, hidden, law_of, runner_up
from formats_page import strangers
from rich.text import Text

import calibrate
from session.io.results import json_text
from session.io.units import DEG
from tinygc import CalibrationError, closure, explain
from tinygc.annexes.discovery import engine
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.law_fits import best_trial, pairs_of
from tinygc.annexes.discovery.report import DiscoveryReport
from tinygc.annexes.discovery.result import discovery_page
from tinygc.annexes.discovery.words import terms_of
from tinygc.closure.residual import Batch
from tinygc.explanation.engine import explain_session
from tinygc.library import explanations
from tinygc.planning.proposals import requested_by_explain
from tinygc.planning.turns import trials
from tinygc.reporting.terminal import as_text

pytestmark = pytest.mark.broad

ZONE, CUBE = LAWS["dead zone"], LawForm((Factor("rate", "cube"),))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A session with a dead zone that no catalogue has.  Read only."""
    return hidden("dead zone", tmp_path_factory.mktemp("told") / "hidden")


@pytest.fixture(scope="module")
def e(folder):
    return explain_session(folder)


def lines_of(table: dict) -> list[str]:
    return as_text(discovery_page(table)).splitlines()


def told_law(**changed):
    return law_of(*ZONE, **changed)


@pytest.mark.parametrize("name", LAWS)
def test_every_key_is_on_the_page_and_survives_json(e, name):
    law = law_of(*LAWS[name], same=(CUBE,), held_out=(OTHER_LOG, OTHER_LOG))
    table = DiscoveryReport(e, found(law, beside=(DRIFT,))).to_json()
    assert not strangers(table)
    assert json.loads(json_text(table))["discovery"] == table["discovery"]
    (said,) = table["discovery"]["laws"]
    (values,), (stds,) = said["parameters"].values(), said["std"].values()
    assert np.ravel(values) == pytest.approx(np.ravel(LAWS[name][1]))
    assert np.ravel(stds) == pytest.approx(0.02 * np.abs(np.ravel(LAWS[name][1])))
    assert said["unit"].startswith("dps")
    assert {each["value"] for each in said["constants"].values()} == set(law.form.constants)
    assert said["id"] == law.effect.id
    assert said["file"] is None  # until it is written


def test_what_has_no_laws_has_the_limits(e):
    table = DiscoveryReport(e, NOTHING).to_json()
    assert not strangers(table)
    assert table["discovery"]["laws"] == []
    assert table["discovery"]["learnable"] == {"rate": {"size_dps": pytest.approx(0.011)}, "force": {"size_dps": pytest.approx(0.0042)}} | {
        "vibration": {"size_dps": None}
    }


def test_the_page_of_a_law_says_what_a_bench_needs(e):
    law = told_law(runners_up=(runner_up(CUBE),), same=(LawForm((Factor("rate", "root"),)),), held_out=(DECIDED, OTHER_LOG))
    lines = lines_of(DiscoveryReport(e, found(law, verdict="ambiguous", beside=(DRIFT,))).to_json())
    text = "\n".join(lines)
    assert lines[0].startswith("Beyond the catalogue: equations were found, and this recording cannot decide between them")
    assert "(41234 forms tried, 10987 of them distinct here)" in lines[0]
    assert "discovered.dead_zone_rate  ω_i += c_i dz(u_i, 0.1)" in text
    assert "0.900 ± 0.018   -0.700 ± 0.014   0.500 ± 0.010" in text
    assert "width: 0.1000 ± 0.0030 of full scale" in text
    assert "closure 0.2100° before, 0.0131° after, floor 0.0117°; 99.5 % of the excess removed" in text
    assert "log0002.csv, left out whole (12 segments)" in text
    assert "equivalent in this recording: ω_i += c_i √|u_i|" in text
    assert "alternative: ω_i += c_i u_i³ (worse by 4.2, correlation 0.962)" in text
    assert "beside it: gyro.bias_drift  dps_over_log: 1.20 ± 0.10   0.40 ± 0.10   0.00 ± 0.10" in text
    assert "from 0.21 of its size on" in text
    assert "a search finds as much with p = 0.0005" in text
    assert "a search finds as much with p < 0.0001" in "\n".join(lines_of(DiscoveryReport(e, found(told_law(chance_p=0.0))).to_json()))


def test_the_page_of_nothing_says_how_much_that_is_worth(e):
    lines = lines_of(DiscoveryReport(e, NOTHING).to_json())
    assert lines[0] == "Beyond the catalogue: no equation of this grammar   (41234 forms tried, 10987 of them distinct here)"
    text = " ".join(lines)
    assert "promises 812 in −2 log evidence" in text
    assert "chance does in 34 % of such searches" in text
    assert "the specific force from 0.0042, the rate from 0.011; not detectable here: the vibration's energy" in text


def test_there_is_one_next_step_and_the_search_says_it(e):
    told = DiscoveryReport(e, found(told_law(runners_up=(runner_up(CUBE),)), verdict="ambiguous"))
    page = [part.plain for part in told.page().renderables[0].renderables if isinstance(part, Text)]
    assert not [line for line in page if line.startswith("next: ")]
    assert sum(line.startswith("next: ") for line in lines_of(told.to_json())) == 1
    assert told.to_json()["next"].startswith("to tell ω_i += c_i dz(u_i, 0.1) from ω_i += c_i u_i³: from a still with ")
    for rivals in ((), (runner_up(CUBE, worse=40.0),)):  # what is so much worse is drawn, and asks for nothing
        assert DiscoveryReport(e, found(told_law(runners_up=rivals))).to_json()["next"].startswith("record a second session")


def test_of_two_laws_each_has_its_own_numbers(e):
    """Two orders of the same effects are one hypothesis."""
    laws = told_law(), law_of(*LAWS["matrix"])
    first, second = pairs_of(e, found(*laws))
    assert first.own.theta == pytest.approx(np.array(ZONE[1]) * DEG, abs=0.2 * DEG)
    assert second.own.theta.shape == (9,)
    assert {pair.own.adds.closure.shape[-1] for pair in (first, second)} == {3, 9}


def test_the_movement_that_is_asked_for_closes_as_differently_as_it_says(e):
    """Not to first order: the turn is integrated with what each of the two corrects, the zero then fitted to its stills."""
    (pair,) = pairs_of(e, found(told_law(runners_up=(runner_up(CUBE),))))
    trial, sigmas = best_trial(pair.own, pair.other)
    m = trial.movement
    start = np.array([[1.0, 0, 0, 0]])
    batch = Batch(m.rate[None], np.full((1, len(m.rate) - 1), m.dt_s), np.zeros_like(m.rate)[None], start, start, yaw_known=False)
    ends = []
    for by in (pair.own, pair.other):
        corrected = by.fit.state.model(m.rate)
        corrected = by.effect.correct(corrected, m.with_rate(corrected), by.theta)
        corrected -= corrected[np.r_[trial.stills[0], trial.stills[1]]].mean(axis=0)
        ends.append(closure.end_attitude(batch, corrected[None])[0])
    angle = 2 * np.arccos(min(abs(float(ends[0] @ ends[1])), 1.0))
    sigma = float(np.median(pair.own.whiten.sigma[pair.own.whiten.parts["closure"]]))
    assert angle / sigma > 0.7 * sigmas
    assert sigmas > 5


def test_movements_that_are_tried_stay_within_the_scale_and_end_at_rest(e):
    tried = trials(e.twin.movements[0])
    assert len(tried) > 100
    for trial in tried:
        assert np.abs(trial.movement.rate).max() <= trial.movement.fs_rps
        assert all(np.abs(trial.movement.rate[rows]).max() < 1e-9 for rows in trial.stills)
        assert np.linalg.norm(trial.movement.force_g, axis=1) == pytest.approx(1.0)


@pytest.fixture
def asked(monkeypatch, e):
    """``explain --discover`` with a search that answers at once."""

    def answers(discovery):
        search = SimpleNamespace(discover=lambda explanation, *, seed=0, progress=None: discovery)
        monkeypatch.setitem(sys.modules, "tinygc.annexes.discovery.engine", search)
        monkeypatch.setattr(explanations, "explain_session", lambda *words, **settings: e)

    return answers


def test_the_command_writes_what_it_says_and_plan_takes_it_up(asked, folder, tmp_path, capsys):
    asked(found(told_law(runners_up=(runner_up(CUBE),)), verdict="ambiguous"))
    out = tmp_path / "explain"
    assert (
        calibrate.main(["explain", str(folder), "--discover", "--out", str(out), "--no-pictures", "--json", str(tmp_path / "x.json")]) == 0
    )
    written = json.loads((out / "explain.json").read_text(encoding="utf-8"))
    assert written == json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    (law,) = written["discovery"]["laws"]
    assert "EFFECT = Effect(" in (out / law["file"]).read_text(encoding="utf-8")
    assert f"use it in another session:\n  python calibrate.py explain OTHER --effects {out / 'effects'}" in capsys.readouterr().out
    for log in folder.glob("log*"):
        (tmp_path / log.name).write_bytes(log.read_bytes())
    assert requested_by_explain(tmp_path) == written["next"]


def test_a_file_that_somebody_edited_stays_and_the_json_names_the_new_one(asked, folder, tmp_path, capsys):
    asked(found(told_law()))
    words = ["explain", str(folder), "--discover", "--out", str(tmp_path), "--no-pictures"]
    calibrate.main(words)
    mine = tmp_path / "effects" / "discovered_dead_zone_rate.py"
    mine.write_text("mine = True\n", encoding="utf-8")
    capsys.readouterr()
    calibrate.main(words)
    (law,) = json.loads((tmp_path / "explain.json").read_text(encoding="utf-8"))["discovery"]["laws"]
    assert mine.read_text(encoding="utf-8") == "mine = True\n"
    assert law["file"] == "effects/discovered_dead_zone_rate_2.py"
    assert law["id"] == "discovered.dead_zone_rate_2"
    assert "is kept" in capsys.readouterr().out


def test_a_file_that_is_in_use_is_neither_replaced_nor_taken_away(asked, folder, tmp_path, capsys):
    """Named with --effects, its law is a name for this search, which therefore finds another or none."""
    asked(found(told_law()))
    words = ["explain", str(folder), "--discover", "--out", str(tmp_path), "--no-pictures"]
    calibrate.main(words)
    (used,) = (tmp_path / "effects").glob("*.py")
    before = used.read_bytes()
    for answer, files in ((NOTHING, 1), (found(told_law()), 2)):
        asked(answer)
        capsys.readouterr()
        assert calibrate.main([*words, "--effects", str(tmp_path / "effects")]) == 0
        assert used.read_bytes() == before
        assert "was named with --effects, and is kept" in " ".join(capsys.readouterr().out.split())
        assert len(list((tmp_path / "effects").glob("*.py"))) == files


def test_a_law_has_no_name_that_a_loaded_effect_has(monkeypatch):
    monkeypatch.setattr(engine, "catalogue", lambda: {"discovered.dead_zone_rate": None})
    assert engine._free_id(ZONE[0], []) == "discovered.dead_zone_rate_2"
    assert engine._free_id(ZONE[0], ["discovered.dead_zone_rate_2"]) == "discovered.dead_zone_rate_3"
    assert engine._free_id(CUBE, []) == "discovered.cube_rate"


def test_nothing_of_a_session_folder_is_executed(asked, folder, tmp_path):
    asked(found(told_law()))
    effects, ran = tmp_path / "explain" / "effects", tmp_path / "ran"
    effects.mkdir(parents=True)
    (effects / "discovered_before.py").write_text(f"open({str(ran)!r}, 'w').close()\n", encoding="utf-8")
    calibrate.main(["explain", str(folder), "--discover", "--out", str(tmp_path / "explain"), "--no-pictures", "--quiet"])
    assert (effects / "discovered_dead_zone_rate.py").exists()
    assert not ran.exists()


def test_a_session_beside_a_truth_file_is_refused_in_one_line(folder, tmp_path):
    text = (folder / "session.toml").read_text(encoding="utf-8")
    place = tmp_path / "session.toml"
    place.write_text(text.replace('reference = "gravity"', 'reference = "truth"'), encoding="utf-8")
    assert 'reference = "truth"' in place.read_text(encoding="utf-8")
    with pytest.raises(CalibrationError, match="--discover searches turns between stills"):
        explain(tmp_path, discover=True)


def test_an_array_is_refused_in_one_line(folder, tmp_path, capsys):
    (tmp_path / "session.toml").write_bytes((folder / "session.toml").read_bytes())
    (log,) = folder.glob("log*")
    for unit in (1, 2):
        (tmp_path / log.name.replace("log0001", f"log0001.unit{unit}")).write_bytes(log.read_bytes())
    assert calibrate.main(["explain", str(tmp_path), "--discover"]) == 2
    assert "--discover: of no use with" in (said := capsys.readouterr().err)
    assert "give one unit a folder of its own" in said
    assert said.count("\n") == 1


def test_each_number_of_a_matrix_says_which_axis_it_adds_to_and_which_it_follows(e):
    lines = lines_of(DiscoveryReport(e, found(law_of(*LAWS["matrix"]))).to_json())
    rows = [line.split(": ")[-1].strip() for line in lines if " ← " in line]
    assert [row.split(" ± ")[0] for row in rows] == ["x ← x 0.1000", "y ← x 0.0500", "z ← x -0.03000"]
    assert all("   y " in row and "   z " in row for row in rows)


@pytest.mark.parametrize(
    ("form", "some"),
    [
        (LawForm((Factor("force", "wave", 0.5), Factor("rate")), "cross"), {0: "x ← y cos", 3: "x ← z sin", 4: "y ← z cos"}),
        (LawForm((Factor("rate"), Factor("force")), "leant"), {1: "x ← y", 8: "z ← z"}),
        (LawForm((Factor("world"),)), {0: "x ← x 1", 5: "y ← y 3"}),
        (LawForm((Factor("temperature", "wave", 5.0),)), {0: "x ← cos", 1: "x ← sin"}),
        (LawForm((Factor("rate"),)), {0: "x", 2: "z"}),
    ],
)
def test_terms_stand_in_the_order_of_the_numbers(form, some):
    terms = terms_of(form)
    assert len(terms) == form.size == len(set(terms))
    assert {number: terms[number] for number in some} == some


def test_a_file_in_the_place_of_the_effects_folder_is_said_before_the_search(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(explanations, "explain_session", lambda *words, **settings: pytest.fail("the search had begun"))
    (tmp_path / "effects").write_text("mine", encoding="utf-8")
    assert calibrate.main(["explain", str(folder), "--discover", "--out", str(tmp_path)]) == 2
    assert f"{tmp_path / 'effects'}: that is no folder" in (said := capsys.readouterr().err)
    assert said.count("\n") == 1
    assert (tmp_path / "effects").read_text(encoding="utf-8") == "mine"
