"""Explaining from end to end: what is concealed in a small session is named with its size, and checked on other sessions of the unit."""

import json
import re
import shutil
from dataclasses import replace
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest
from formats_page import strangers

from session.base.errors import DataError
from session.base.units import DEG, G
from session.log.siblings import recordings_at, sibling_sessions
from tinygc import SimulationOptions, explain, read_session, report
from tinygc.closure.floor import BiasInstability
from tinygc.effects import catalogue
from tinygc.estimation.options import FitOptions
from tinygc.explanation.checked import check_on
from tinygc.explanation.engine import explain_session
from tinygc.explanation.physics import physics_methods
from tinygc.explanation.result import to_json, what_next, worst_segments
from tinygc.fitting.fit import fit_session
from tinygc.library.explanations import Why
from tinygc.reporting.checked_text import checked_page
from tinygc.reporting.explanation_text import explanation_facts, explanation_screen, headline, in_unit, next_commands, next_line, plain_name
from tinygc.reporting.html.sections.explanation import section
from tinygc.reporting.terminal import Group, as_text
from tinygc.simulation.write import write_session
from tinygc.verdict.model_tests import ModelTest

PER_G = np.array([[0.05, -0.03, 0.02], [0.04, 0.06, -0.05], [-0.07, 0.02, 0.03]])  # dps/g


@pytest.fixture(scope="module", name="unit")
def of_one_unit(tmp_path_factory):
    """Folder of three sessions of one serial number: two of a g-sensitive unit, and a sound one."""
    place = tmp_path_factory.mktemp("unit")

    def sensitive(t_s, rate, force, temp_c):
        return rate + force / G @ (PER_G * DEG).T

    for name, distort, seed in (("first", sensitive, 5), ("second", sensitive, 8), ("sound", None, 9)):
        made = write_session(SimulationOptions(segments=11, closure_s=0.0, seed=seed, odr_hz=62.5), place / name, distort=distort)
        path = made / "session.toml"
        path.write_text(re.sub('serial = ".*"', 'serial = "SIM-1"', path.read_text()))
    return place


@pytest.fixture(scope="module", name="explained")
def explained_sessions(unit):
    return {path.name: explain_session(path) for path in unit.iterdir()}


def test_where_the_earths_rotation_is_found_or_suspected_the_latitude_is_requested():
    def following(verdict, found, text):
        claims = [
            SimpleNamespace(
                effect=SimpleNamespace(id=found, kind="earth"),
                equivalent=[],
                description="it turns: give your latitude",
                against_stated=None,
            )
        ]
        session, decision = SimpleNamespace(folder="s", in_memory=False), SimpleNamespace(tests=[ModelTest("effect", 0.0, 0.05, text)])
        proof = SimpleNamespace(fit=SimpleNamespace(state=SimpleNamespace(claims=[])))
        e = SimpleNamespace(
            verdict=verdict, claimed=claims if found else [], findings=[], session=session, decision=decision, proof=proof, own_p={}
        )
        return next_line(e, what_next(e)), next_commands(e)

    latitude = "next: give your latitude", ["python calibrate.py fit s --latitude DEG"]
    assert following("explained", "earth.rotation", "") == latitude
    assert following("unexplained", "", "the Earth's rotation shows; give your latitude") == latitude
    assert following("explained", "gyro.other", "")[1] == []


def test_nothing_concealed_is_no_mismatch_and_lives_nowhere(explained):
    result = to_json(explained["sound"])
    held = result["fit"]["holdout_closure_rms_deg"]
    assert (result["verdict"], result["effects"], result["next"], result["fit"]["excess_removed"]) == ("no_mismatch", [], None, None)
    assert result["mismatch"]["p_value"] > 0.05
    assert held["before"] == held["after"] < 1.6 * held["floor"]
    nowhere = {"phases": [], "axes": [], "segments": [], "segment_seconds": [], "seconds": None, "conditions": None}
    assert result["mismatch"]["where"] == nowhere


def test_a_strong_effect_is_named_with_its_size_and_undone(explained):
    """Its columns are 0.095, 0.070 and 0.062 dps per g long: what it shows most is gravity along x."""
    result = to_json(explained["first"])
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    assert strangers(result) == []
    (effect,) = result["effects"]
    assert (result["verdict"], effect["id"], effect["equivalent"], result["next"]) == ("explained", "gyro.g_sensitivity", [], None)
    pulls = (np.array(effect["parameters"]["matrix_dps_per_g"]) - PER_G) / effect["std"]["matrix_dps_per_g"]
    assert np.abs(pulls).max() < 4
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["before"] > 5 * held["floor"]
    assert held["after"] < 1.6 * held["floor"]
    assert result["fit"]["excess_removed"] > 0.98
    assert result["mismatch"]["p_value"] < 1e-6
    where = result["mismatch"]["where"]
    assert (set(where["phases"]), where["axes"]) == ({"still", "turn"}, ["x", "y", "z"])
    assert (where["conditions"]["variable"], where["conditions"]["axis"], where["conditions"]["units"]) == ("attitude", "x", "g")
    assert len(where["segment_seconds"]) == len(where["segments"]) > 0


@pytest.mark.parametrize(("of_unit", "role"), [(False, "the prior of `noise.bias_wander`"), (True, "by the stills alone")])
def test_what_the_recording_itself_gives_is_no_prior_of_it(explained, of_unit, role):
    problem = replace(explained["first"].problem)
    problem.__dict__["instability"] = BiasInstability(1e-5, "given", of_unit=of_unit)
    assert f"bias instability, {role}: " in as_text(Group(*explanation_facts(replace(explained["first"], problem=problem))))


def test_terminal_report_and_json_show_one_table_of_residuals(explained):
    """And a healthy accelerometer looks healthy before and after: whitened together with the closure, a name would seem to mend it."""
    e, heading = explained["first"], "Recorded less predicted"
    lines = as_text(Group(*explanation_facts(e))).splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith(heading))
    shown = [re.split(r"\s{2,}", line.strip()) for line in lines[at + 2 : at + 7]]
    html = section(SimpleNamespace(by_reference=None, explanation=e)).html
    body = html[html.index("<tbody>", html.index("channel</th>")) :]
    rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", body[: body.index("</tbody>")])]
    assert shown == [[unescape(cell) for cell in row if cell] for row in rows]
    channels = to_json(e)["channels"]
    for row, (name, channel) in zip(shown, channels.items(), strict=False):
        assert row[2:] == [f"{channel['rms_sigmas'][when]:.2f}" for when in ("before", "after")], name
    before, after = (channels["length"]["rms_sigmas"][when] for when in ("before", "after"))
    assert before == pytest.approx(after, abs=0.02)
    assert 0.3 < before < 1.5


def test_the_first_screen_begins_with_the_answer_in_plain_words_and_has_no_exponent(explained):
    """A number that is small has a small unit, and ids stay in the JSON."""
    answers = {"sound": "OK: nothing beyond the model shows (p = ", "first": "FOUND: the gyro's zero-rate offset moves 0.0"}
    for name, answer in answers.items():
        e = explained[name]
        lines = as_text(Group(*explanation_screen(e), next_line(e, None), *next_commands(e))).splitlines()
        assert lines[0].startswith(answer)
        assert lines[1].startswith("Held-out closure 0.")
        assert max(map(len, lines[:-1])) <= 80
        assert len(lines) <= 24
        assert not re.search(r"\de[-+]?\d|10⁻|gyro\.", "\n".join(lines[:-1]))
    assert (lines[-2], lines[-1].endswith("first --physics auto")) == ("next: keep gravity's direction in the model", True)
    for size, unit, shown in (
        (0.00028, "1/°C", "280 ppm/°C"),
        (8.1e-05, "s", "81 µs"),
        (0.0041, "dps/g", "4.1 mdps/g"),
        (2.0, "mg", "2 mg"),
    ):
        factor, small = in_unit(size, unit)
        assert f"{size * factor:.3g} {small}" == shown
    assert plain_name("gyro.thermal_scale") == "gyro scale with temperature"


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda effect: effect.id)
def test_what_an_effect_does_fits_the_first_line(effect):
    effect = effect if effect.scan is None else effect.scan.make(115.0)
    statement, _, do = effect.describe(0.5 * np.full(effect.parameter.size, effect.parameter.plausible)).partition(": ")
    assert len(f"FOUND, undecided: {statement}.") <= 80
    assert do


def test_the_worst_segments_are_of_those_that_the_proof_has():
    """Segment 1 is left out of the fit and explained all the same; each has a floor of its own."""
    used = [SimpleNamespace(number=number) for number in (0, 1, 2, 4)]
    floor = SimpleNamespace(own=np.array([[[size**2]] for size in (1.0, 9.0, 2.0, 3.0)]))
    proof = SimpleNamespace(before_numbers=[0, 2, 4], before=np.array([[2.0], [12.0], [12.0]]))
    assert worst_segments(SimpleNamespace(problem=SimpleNamespace(used=used, floor=floor), proof=proof)) == [2, 4]


def test_the_picture_is_an_svg(explained, tmp_path):
    folder = Why(explained["first"]).save(tmp_path / "first")
    assert (folder / "explain.svg").read_text(encoding="utf-8").startswith("<svg xmlns=")


def test_a_scatter_that_no_effect_explains_stands_in_the_headline(explained):
    e = replace(explained["sound"], within={"slope": np.ones((3, 3)), "scatter": np.full((3, 3), 13.0)})
    scatters = "within the stills the rate scatters 13 sigma beyond its noise."
    assert [str(line) for line in headline(e)] == [f"OK, but {scatters}"]
    first, left = map(str, headline(replace(explained["first"], within=e.within)))
    assert (first.startswith("FOUND, not all: the gyro's"), left) == (True, f"Not explained: {scatters}")


def test_the_json_of_a_report_with_a_named_effect_is_as_its_page_says(unit):
    table = report(unit / "first", methods=("least_squares",)).to_json()
    assert (table["calibration"], table["closure"]["degrees_of_freedom"], strangers(table)) == ("physics", None, [])


def test_a_wrong_full_scale_is_said_and_not_explained(unit, run, tmp_path):
    folder = shutil.copytree(unit / "sound", tmp_path / "wrong")
    path = folder / "session.toml"
    path.write_text(path.read_text().replace("gyro_fs_dps = 500", "gyro_fs_dps = 250"))
    code, out, err = run("explain", folder, "--quiet")
    assert (code, out) == (2, "")
    assert re.fullmatch(r"calibrate: .*250.*500.*\n|calibrate: .*500.*250.*\n", err)
    assert not (folder / "explain").exists()


@pytest.mark.broad
def test_fit_and_explain_have_one_closure_of_one_model_and_one_verdict(unit, explained):
    """Also where a fit with physics is explained: what is to be explained is what the linear model misses."""
    session, why = read_session(unit / "first"), explained["first"]
    fit = fit_session(session, FitOptions(methods=("least_squares",), physics=("auto",)), physics=physics_methods)
    physics, again = fit.methods["physics"], explain_session(session, fit=fit)
    assert fit.use.method == "physics"
    np.testing.assert_allclose(physics.held_out, why.proof.after, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(why.proof.before, fit.linear.held_out, rtol=1e-9, atol=1e-12)
    assert physics.model.linear is fit.physics.fit.state.model
    assert [test.name for test in fit.verdict().tests] == ["gravity"]  # those of the linear model do not hold for the one with physics
    assert again.decision.tests == why.decision.tests
    assert (again.verdict, again.p_value) == (why.verdict, why.p_value)


def test_physics_of_another_name_is_refused(unit, run):
    for words in ("gyro.nonsense", "", "auto,gyro.g_sensitivity"):
        code, _, err = run("fit", unit / "nowhere", f"--physics={words}")
        assert (code, err.count("\n")) == (2, 1)
        assert "is no effect; give auto, or of accelerometer.cross_coupling, " in err


# Checked on another session.


def test_the_sessions_of_a_unit_are_found_by_its_serial_number(unit):
    assert [path.name for path in sibling_sessions(unit / "first")] == ["second", "sound"]
    assert [path.name for path in recordings_at(unit, unit / "first", "SIM-1")] == ["second", "sound"]
    assert recordings_at(unit / "sound", unit / "first", "SIM-1") == [unit / "sound"]
    for place, serial, says in (
        ("first", "SIM-1", "is the recording itself"),
        ("nowhere", "SIM-1", "not found"),
        ("", "SIM-2", "sessions of the unit 'SIM-2' other than first"),
    ):
        with pytest.raises(DataError, match=says):
            recordings_at(unit / place, unit / "first", serial)


def test_a_sensors_effect_is_confirmed_where_it_is_and_contradicted_where_it_is_not(explained):
    checked = [check_on(explained["first"], explained[name]) for name in ("second", "sound")]
    (found,), (absent,) = (each.effects for each in checked)
    assert (found.outcome, found.other_size, absent.outcome) == ("confirmed", False, "contradicted")
    assert found.size[0] == pytest.approx(1, abs=3 * found.size[1])
    assert absent.size[0] == pytest.approx(0, abs=3 * absent.size[1])
    own = to_json(explained["second"])["fit"]["holdout_closure_rms_deg"]
    before, after = np.degrees(found.closure_rad)
    assert before == pytest.approx(own["before"], rel=1e-6)  # the figure that fit states of that session
    assert after == pytest.approx(own["after"], rel=0.25)  # as well as with its own numbers
    assert absent.closure_rad[1] > 5 * absent.closure_rad[0]
    text = as_text(Group(*checked_page(checked)))
    assert text.startswith("Other recordings, gyro g-sensitivity: contradicted in 1, confirmed in 1 of 2.\n")
    assert max(map(len, text.splitlines())) <= 80
    assert [line.split()[:4] for line in text.splitlines()[2:]] == [
        ["second", "gyro", "g-sensitivity", "confirmed"],
        ["sound", "gyro", "g-sensitivity", "contradicted"],
    ]


def test_another_units_own_effect_is_not_checked_and_a_copy_confirms_nothing(explained):
    session = explained["second"].session
    config = replace(session.config, sensor=replace(session.config.sensor, serial="SIM-2"))
    checked = check_on(explained["first"], replace(explained["second"], session=replace(session, config=config)))
    (found,) = checked.effects
    assert (checked.same_unit, found.outcome) == (False, "of one unit")
    assert found.there.theta == pytest.approx(found.named.theta, abs=0.02 * DEG)
    with pytest.raises(DataError, match="holds a log of first itself"):
        check_on(explained["first"], explained["first"])


@pytest.mark.broad
def test_a_recording_that_cannot_be_explained_does_not_cost_the_first_result(unit, tmp_path):
    short = write_session(SimulationOptions(segments=4, closure_s=0.0, seed=9, odr_hz=62.5), tmp_path / "short")
    why = explain(unit / "first", check_on=[short, unit / "second"])
    failed, confirmed = why.to_json()["checked"]
    assert "expected at least" in failed["error"]
    (entry,) = confirmed["effects"]
    assert (entry["outcome"], entry["standing"], entry["there"]["parameters"].keys()) == ("confirmed", "for", {"matrix_dps_per_g"})
