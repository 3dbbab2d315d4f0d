"""``calibrate.py report``: one file that needs nothing else, says what fit says, and lets nothing through from a file's text."""

import json
import re
import shutil
from base64 import b64decode
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest
from html_pages import QUICK, parsed, report_of
from models_in_use import MODELS, SAMPLES

import calibrate
from session.base.texts import measured
from session.base.units import DEG
from tinygc import models
from tinygc.reporting.facts import html, typeset
from tinygc.reporting.html.sections import denoising
from tinygc.reporting.terminal import Text

PARTS = "answer session methods closure runs parameters correlations noise explain apply provenance"


@pytest.fixture(scope="module")
def made(simulated, tmp_path_factory):
    """The page and its JSON."""
    folder = tmp_path_factory.mktemp("report")
    out = report_of(simulated(), folder / "report.html", "--methods", "raw,least_squares", "--quiet", "--json", str(folder / "r.json"))
    return out.read_text(encoding="utf-8"), json.loads((folder / "r.json").read_text())


def test_it_is_one_well_formed_file_without_a_script_that_has_every_part(made):
    text, _ = made
    parser = parsed(text)
    assert {"script", "img", "iframe", "object", "form"}.isdisjoint(parser.tags)
    assert "default-src 'none'" in text
    assert len(text) < 1_500_000
    assert not re.search(r"\b(nan|inf|None)\b", " ".join(parser.words))
    read_aloud = [" ".join(part.split()) for part in re.split(r"<[^>]*>", re.sub(r"(?s)<(style|svg|pre|code).*?</\1>", "|", text))]
    assert [found[0] for part in read_aloud for found in re.finditer(r"\b([a-z]\w+(?:[ ,]+\w+){0,4}) \1\b", part)] == []
    assert set(PARTS.split()) <= set(parser.ids)
    for words in ("no certificate", "noise.bias_wander", "not observed"):  # of 2 s stills no bias instability can be had
        assert words in text


def test_its_figures_are_those_of_its_json_and_its_code_calibrates_as_the_model_does(made):
    """Those of the JSON are those of the fit (tests/test_library.py)."""
    page, report = made
    for entry in (entry for entry in report["parameters"] if entry["value"] is not None):
        sigma = np.sqrt((entry["expanded_uncertainty"] / entry["coverage_factor"]) ** 2 - ((entry["by_one_effect"] or 0) / 2) ** 2)
        assert typeset(measured(entry["value"], float(sigma)), True) in page
    for digest in report["inputs"].values():
        assert digest in page
    program = next(unescape(found) for found in re.findall(r"<code>(.*?)</code>", page, re.S) if found.startswith("import numpy"))
    names = {"registers": np.array([[100.0, -2000.0, 300.0]])}
    exec(program, names)
    model = models.from_dict(json.loads(b64decode(re.search(r"data:application/json;base64,([^\"]+)", page).group(1))))
    assert names["omega"][0] == pytest.approx(model(names["registers"][0] * 17.5e-3 * DEG), rel=1e-9)


def test_a_page_has_in_bold_what_a_terminal_has():
    """The name of an effect, not its equation; a warning has its own look, and the rows of a matrix stand below each other."""
    claim = Text.assemble(("gyro.x  ", "bold cyan"), "w < 1", "   p = 0.1")
    rows = "  dps: 1   2", "     : 3   4"
    said = html([claim, Text("all", "bold red"), Text("look", "yellow"), "-3 dps", Text.assemble(("", "bold"), "none"), *rows])
    expected = [
        "<strong>gyro.x  </strong>w &lt; 1   p = 0.1",
        "<strong>all</strong>",
        "−3 dps",
        "none",
        "\u00a0\u00a0dps: 1   2",
        "\u00a0" * 5 + ": 3   4",
    ]
    assert said.replace('<p class="warning">look</p>', "") == "".join(f"<p>{each}</p>" for each in expected)


def test_text_from_files_stays_text_and_the_first_sheet_of_paper_stands_alone(simulated, tmp_path):
    """What, when, by whom, in which conditions, E and B; and each sheet says whose it is, though a serial number may hold anything."""
    evil = "</style><script>alert(1)</script><img src=x onerror=alert(1)>\"'&}x{"
    folder = shutil.copytree(simulated(), tmp_path / "<b>s&amp;")
    config = folder / "session.toml"
    text = re.sub(r"^(model|serial) = .*$", lambda found: f"{found[1]} = {json.dumps(evil)}", config.read_text(), flags=re.M)
    text = text.replace("[sensor]\n", "[sensor]\ngyro_mdps_per_lsb = 17.5\naccel_mg_per_lsb = 0.122\n")
    config.write_text(text + '\n[notes]\noperator = "Mara"\ndate = "2026-03-04"\n')
    (folder / "closure0001.csv.gz").rename(folder / "closure<i>1.csv.gz")
    page = report_of(folder, tmp_path / "r.html", *QUICK).read_text(encoding="utf-8")
    parser = parsed(page)
    assert {"script", "img", "i>1.csv.gz"}.isdisjoint(parser.tags)
    assert evil in "".join(parser.words)
    assert "closure<i>1.csv.gz" in "".join(parser.words)
    assert page.count("</style>") == page.count("<style>")
    front = page[page.index('<div class="front">') : page.index('<section id="session"')]
    for words in ("2026-03-04", "Mara", "latitude", "TinyGC", "scale factor error", "misalignment", "bias"):
        assert words in front, words
    assert front.count("±") >= 12
    sheets = re.search(r"@page\{@top-left\{content:\"(.*?)\"\}@top-right\{content:\"(.*?)\"\}", page)
    left, right = (re.sub(r"\\([0-9a-f]+) ", lambda found: chr(int(found[1], 16)), words) for words in sheets.groups())
    assert evil[:20] in left
    assert right == "recorded 2026-03-04"


@pytest.mark.parametrize(
    ("out", "more", "says"),
    [
        ("", (), "give --out a file"),
        ("file/r.html", (), "file/r.html: File exists; give --out another file"),
        ("r.html", ("--pdf",), "--pdf needs Chromium, and none is found"),
        ("none", (), "no such folder"),
    ],
)
def test_what_cannot_be_made_is_refused_before_the_work(simulated, tmp_path, capfd, monkeypatch, out, more, says):
    monkeypatch.setenv("PATH", "")
    (tmp_path / "file").write_text("")
    folder = tmp_path / "none" if out == "none" else simulated()
    assert calibrate.main(["report", str(folder), "--out", str(tmp_path / out), *more, *QUICK]) == 2
    assert says in capfd.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_denoiser_without_a_still_of_two_samples_has_no_section():
    fit = SimpleNamespace(methods={"tinygc_denoised": SimpleNamespace(model=MODELS["denoised"])})
    log = SimpleNamespace(samples=SAMPLES, stills=())
    assert denoising.section(SimpleNamespace(fit=fit, problem=SimpleNamespace(logs=[log]))) is None
