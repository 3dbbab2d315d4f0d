"""From a session that hides a law to the file of it: found, said, written and shown in the report."""

import json
import re
import sys
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from discovery_answers import DRIFT, LAWS, NOTHING, OTHER_LOG, found, hidden, law_of, runner_up
from formats_page import strangers
from html_pages import parsed

import calibrate
from session.base.records import json_text
from session.base.units import DEG
from session.log.folder import sha256_of
from tinygc import SimulationOptions
from tinygc.explanation.engine import explain_session
from tinygc.features.discovery import engine
from tinygc.features.discovery.form import Factor, LawForm
from tinygc.features.discovery.law_fits import pairs_of
from tinygc.features.discovery.pictures import CHANNELS, points_of
from tinygc.features.discovery.report import DiscoveryReport
from tinygc.features.discovery.report_section import SVG, searched, section
from tinygc.features.discovery.result import to_json
from tinygc.library import explanations
from tinygc.reporting.facts import document
from tinygc.simulation.write import write_session

ZONE, CUBE = LAWS["dead zone"], LawForm((Factor("rate", "cube"),))
#: the law that is hidden, what is near it, and some that have nothing to do with it
FORMS = [LAWS["cross"][0], LawForm((Factor("rate", "square"),)), CUBE, LawForm((Factor("force", "square"),))]
FORMS.append(LawForm((Factor("force"), Factor("rate"))))
ID = "discovered.force_rate_next"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A short session with nothing in it.  Read only."""
    options = SimulationOptions(segments=7, closure_s=0.0, seed=5, odr_hz=62.5)
    return write_session(options, tmp_path_factory.mktemp("told") / "session")


@pytest.fixture(scope="module")
def e(folder):
    return explain_session(folder)


# Found.


@pytest.mark.broad
def test_a_law_that_is_hidden_is_found_and_shown(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "enumerated", lambda largest: FORMS)
    first = hidden("cross", tmp_path / "first", segments=16, warm_up_c=0.0)
    e = explain_session(first)
    answer = engine.discover(e)
    (law,) = answer.laws
    assert (answer.verdict, law.effect.id) == ("found", ID)
    assert law.theta / DEG == pytest.approx(LAWS["cross"][1], abs=0.1)
    assert law.chance_p < 1e-6
    assert 0 < law.learnable_from < 1
    (pair,) = pairs_of(e, found(law, verdict="found"))
    for axis, channel in product(range(3), CHANNELS):  # what is left is noise, and what there is without the law is the law
        points = points_of(e, pair, axis, channel)
        assert np.sqrt(np.mean((points.left / points.sigma) ** 2)) < 1.8
        assert len(points.predicted) >= 5
        assert points.predicted @ points.without == pytest.approx(points.predicted @ points.predicted, rel=0.1)


# Said.


@pytest.mark.parametrize("name", LAWS)
def test_every_key_is_on_the_page_of_formats_and_survives_json(e, name):
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
    assert (said["id"], said["file"]) == (law.effect.id, None)  # until it is written


def test_what_is_told_asks_for_a_second_session(e):
    for rivals in ((), (runner_up(CUBE, worse=40.0),)):  # what is so much worse is drawn, and asks for nothing
        assert DiscoveryReport(e, found(law_of(*ZONE, runners_up=rivals))).to_json()["next"].startswith("record a second session")


# The command, with a search that answers at once.


@pytest.fixture
def asked(monkeypatch, e, folder, tmp_path):
    """``asked(answer, *words)``: exit code of ``explain --discover``."""
    monkeypatch.setattr(explanations, "explain_session", lambda *words, **settings: e)

    def ask(discovery, *words):
        search = SimpleNamespace(discover=lambda explanation, *, seed=0, progress=None: discovery)
        monkeypatch.setitem(sys.modules, "tinygc.features.discovery.engine", search)
        return calibrate.main([*map(str, ("explain", folder, "--discover", "--out", tmp_path, "--no-pictures", *words))])

    return ask


def test_what_is_written_is_not_executed_and_an_edited_or_used_file_stays(asked, tmp_path, capsys):
    effects, mine = tmp_path / "effects", tmp_path / "effects" / "discovered_dead_zone_rate.py"
    effects.mkdir()
    (effects / "discovered_before.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n", encoding="utf-8")
    assert asked(found(law_of(*ZONE)), "--json", tmp_path / "x.json") == 0
    assert not (tmp_path / "ran").exists()
    written = json.loads((tmp_path / "explain.json").read_text(encoding="utf-8"))
    assert written == json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert "EFFECT = law_effect(" in (tmp_path / written["discovery"]["laws"][0]["file"]).read_text(encoding="utf-8")
    out = capsys.readouterr().out
    assert out.startswith("FOUND: an equation was found.\n\ndiscovered.dead_zone_rate  ω_i += c_i dz(u_i, 0.1)\n")
    introduction, command = out.splitlines()[-2:]
    assert introduction.startswith("next: record a second session")
    assert command == f"  python calibrate.py explain OTHER --effects {effects}"
    (effects / "discovered_before.py").unlink(missing_ok=True)
    before = mine.read_bytes()
    assert asked(NOTHING, "--effects", effects) == 0  # named with --effects, its law is a name for this search
    assert mine.read_bytes() == before
    assert "was named with --effects, and is kept" in " ".join(capsys.readouterr().out.split())
    mine.write_text("mine = True\n", encoding="utf-8")
    asked(found(law_of(*ZONE)))
    (law,) = json.loads((tmp_path / "explain.json").read_text(encoding="utf-8"))["discovery"]["laws"]
    assert mine.read_text(encoding="utf-8") == "mine = True\n"
    assert (law["id"], law["file"]) == ("discovered.dead_zone_rate_2", "effects/discovered_dead_zone_rate_2.py")
    assert "is kept" in capsys.readouterr().out


@pytest.mark.parametrize("fault", ["effects", "truth"])
def test_what_cannot_be_searched_is_said_in_one_line_before_the_search(folder, tmp_path, fault, capsys):
    place, text = tmp_path / "session.toml", (folder / "session.toml").read_text(encoding="utf-8")
    place.write_text(text if fault == "effects" else text.replace('reference = "gravity"', 'reference = "truth"'), encoding="utf-8")
    if fault == "effects":
        (tmp_path / "effects").write_text("mine", encoding="utf-8")
    assert calibrate.main(["explain", str(tmp_path), "--discover", "--out", str(tmp_path), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    says = {"effects": f"{tmp_path / 'effects'}: that is no folder", "truth": "--discover: of no use with a truth file as the reference"}
    assert says[fault] in line


# The report's part.


class Evidence:
    def __init__(self, folder):
        (log,) = folder.glob("log*")
        self.searched = searched(folder, {log.name: sha256_of(log)})


def explained(folder, discovery, files=("effects/x.py",), following="turn it again"):
    """A folder as ``explain --discover`` leaves it, and the log of it; its table."""
    (folder / "log0001.csv").write_text("t_us\n1\n", encoding="utf-8")
    (folder / "explain").mkdir()
    logs = {"log0001.csv": sha256_of(folder / "log0001.csv")}
    table = {"schema": "tinygc-explain/2", "next": following, "logs": logs, "discovery": to_json(discovery, list(files))}
    return again(folder, json.loads(json_text(table)))


def again(folder, table):
    (folder / "explain" / "explain.json").write_text(json.dumps(table), encoding="utf-8")
    return table


def html_of(folder):
    text = document("t", "", [section(Evidence(folder))], "")
    parsed(text)
    return text


def test_the_report_has_a_laws_equation_its_evidence_its_picture_and_how_to_use_it_and_no_markup_of_a_file(tmp_path):
    clipped = runner_up(LawForm((Factor("rate", "within", 0.1),)))
    table = explained(tmp_path, found(law_of(*LAWS["matrix"], runners_up=(clipped,))))
    (tmp_path / "explain" / "discover.svg").write_bytes(SVG + b"and so on")
    text = html_of(tmp_path)
    for words in (
        "an equation was found",
        "41234 forms tried, 10987 of them distinct here",
        "closure 0.2100° -&gt; 0.0131°, noise alone 0.0117°; 99.5 % of the excess removed",
        "in these equations: clip(x, ±c) = x held within ±c",
        "alternative: ω_i += c_i clip(u_i, ±0.1)",
        "written as effects/x.py",
        f"calibrate.py explain OTHER --effects {tmp_path / 'explain' / 'effects'}",
        "<strong>next: </strong>turn it again",
        'src="data:image/svg+xml;base64,',
        "x ← x 0.1000 ± 0.0020",
    ):
        assert words in text, words
    for key in ("id", "equation", "in_words", "unit", "file"):
        table["discovery"]["laws"][0][key] = "<script>alert(1)</script>"
    again(tmp_path, table)
    (tmp_path / "explain" / "discover.svg").write_bytes(b"no picture")
    assert not re.search("<script|<img", html_of(tmp_path))
