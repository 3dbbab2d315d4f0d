"""``calibrate.py report``: one file that needs nothing else, says what fit says, and lets nothing through from a file's text."""

import json
import re
import shutil

import pytest
from html_pages import QUICK, WHOLE, parsed, report_of

import calibrate
from session.io.config import BoardGiven
from session.io.texts import degrees, fixed
from session.io.units import DEG
from tinygc.reporting.html import markup
from tinygc.reporting.html.sections.provenance import board_text


@pytest.fixture(scope="module")
def text(simulated, tmp_path_factory):
    return report_of(simulated(), tmp_path_factory.mktemp("report") / "report.html", *WHOLE).read_text(encoding="utf-8")


def test_it_is_one_well_formed_file_without_a_script(text):
    parser = parsed(text)
    assert {"script", "img", "iframe", "object", "form"}.isdisjoint(parser.tags)
    assert "default-src 'none'" in text
    assert len(text) < 1_500_000
    assert not re.search(r"\b(nan|inf|None)\b", " ".join(parser.words))
    read_aloud = [" ".join(part.split()) for part in re.split(r"<[^>]*>", re.sub(r"(?s)<(style|svg|pre|code).*?</\1>", "|", text))]
    assert [found[0] for part in read_aloud for found in re.finditer(r"\b([a-z]\w+(?:[ ,]+\w+){0,4}) \1\b", part)] == []


def test_it_has_every_part(text):
    for part in (
        "answer",
        "session",
        "methods",
        "closure",
        "runs",
        "parameters",
        "correlations",
        "noise",
        "explain",
        "apply",
        "provenance",
    ):
        assert f'id="{part}"' in text
    assert "Calibration report" in text
    assert "no certificate" in text
    assert "Estimated non-white noise of this recording" in text
    assert "noise.bias_wander" in text
    assert "not observable here" in text  # of 2 s stills no bias instability can be had


@pytest.mark.broad
def test_the_first_sheet_of_paper_stands_alone(simulated, tmp_path):
    """What, when, by whom, in which conditions, E and B; and each sheet says whose it is, though a serial number may hold anything."""
    folder = shutil.copytree(simulated(), tmp_path / "s")
    config = (folder / "session.toml").read_text()
    evil = re.sub(r'serial = ".*"', lambda _: r'serial = "</style>\"}x{"', config)
    (folder / "session.toml").write_text(evil + '\n[notes]\noperator = "Mara"\ndate = "2026-03-04"\n')
    text = report_of(folder, tmp_path / "r.html", *QUICK).read_text(encoding="utf-8")
    parsed(text)
    assert text.count("</style>") == text.count("<style>")
    front = text[text.index('<div class="front">') : text.index('<section id="session"')]
    for words in ("2026-03-04", "Mara", "latitude", "TinyGC", "scale factor error", "misalignment", "bias"):
        assert words in front, words
    assert front.count("±") >= 12
    sheets = re.search(r"@page\{@top-left\{content:\"(.*?)\"\}@top-right\{content:\"(.*?)\"\}", text)
    left, right = (re.sub(r"\\([0-9a-f]+) ", lambda found: chr(int(found[1], 16)), words) for words in sheets.groups())
    assert '</style>"}x{' in left
    assert right == "recorded 2026-03-04"


def test_a_pdf_without_a_browser_is_refused_before_the_work(simulated, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("tinygc.reporting.html.paper.NAMES", ("no-such-browser",))
    assert calibrate.main(["report", str(simulated()), "--out", str(tmp_path / "r.html"), "--pdf", *QUICK]) == 2
    assert capfd.readouterr().err.startswith("calibrate: --pdf needs Chromium, and none is found")
    assert list(tmp_path.iterdir()) == []


def test_its_figures_are_those_of_fit(simulated, tmp_path):
    out, table, fitted = tmp_path / "r.html", tmp_path / "r.json", tmp_path / "f.json"
    report_of(simulated(), out, *QUICK, "--json", str(table))
    calibrate.main(["fit", str(simulated()), "--methods", "raw,least_squares", "--out", str(tmp_path), "--json", str(fitted), "--quiet"])
    report, fit = json.loads(table.read_text()), json.loads(fitted.read_text())
    assert report["closure"]["holdout_tilt_rms_deg"] == pytest.approx(fit["methods"]["least_squares"]["holdout"]["tilt_rms_deg"], rel=1e-12)
    assert report["closure"]["runs"][0]["rmse_deg"] == pytest.approx(fit["closure_runs"][0]["least_squares"]["rmse_deg"])
    page = out.read_text(encoding="utf-8")
    assert degrees(report["closure"]["holdout_tilt_rms_deg"] * DEG) in page
    for entry in (entry for entry in report["parameters"] if entry["value"] is not None):
        largest = max(other["expanded_uncertainty"] or 0 for other in report["parameters"] if other["parameter"] == entry["parameter"])
        value, expanded = (fixed(entry[which], markup.decimals_for(largest)) for which in ("value", "expanded_uncertainty"))
        further = "" if entry["by_one_effect"] is None else f" ({fixed(entry['by_one_effect'], markup.decimals_for(largest))})"
        assert f"{value} <small>± {expanded}{further}</small>" in page
    for digest in report["inputs"].values():
        assert digest in page


def test_text_from_files_stays_text(simulated, tmp_path):
    evil = "</style><script>alert(1)</script><img src=x onerror=alert(1)>\"'&"
    folder = tmp_path / "<b>s&amp;"
    shutil.copytree(simulated(), folder)
    config = folder / "session.toml"
    text = re.sub(r"^(model|serial) = .*$", lambda found: f"{found[1]} = {json.dumps(evil)}", config.read_text(), flags=re.M)
    config.write_text(text.replace("[accelerometer]", "gyro_mdps_per_lsb = 17.5\naccel_mg_per_lsb = 0.122\n[accelerometer]"))
    (folder / "closure0001.csv.gz").rename(folder / "closure<i>1.csv.gz")
    page = report_of(folder, tmp_path / "r.html", *QUICK).read_text(encoding="utf-8")
    parser = parsed(page)
    assert {"script", "img", "i>1.csv.gz"}.isdisjoint(parser.tags)
    assert evil in "".join(parser.words)
    assert "closure<i>1.csv.gz" in "".join(parser.words)


def test_what_the_board_said_of_itself_is_kept():
    sensor = BoardGiven("sensor", "1.0.0", 0x6B, -7, "8c88", 417.0)
    said = board_text(sensor)
    assert said == "firmware 1.0.0; WHO_AM_I 0x6B, which siblings of the sensor share; INTERNAL_FREQ_FINE −7; CTRL1_XL to CTRL10_C 8c88"
    assert "it had no sensor" in board_text(BoardGiven("stand-in", "1.0.0"))
    assert board_text(BoardGiven()) == "said nothing of itself"


def test_bad_destinations_are_refused_before_the_work(simulated, tmp_path, capfd):
    assert calibrate.main(["report", str(simulated()), "--out", str(tmp_path), *QUICK]) == 2
    assert "give --out a file" in capfd.readouterr().err
    (tmp_path / "file").write_text("")
    assert calibrate.main(["report", str(simulated()), "--out", str(tmp_path / "file" / "r.html"), *QUICK]) == 2
    assert "--out another file" in capfd.readouterr().err
    assert calibrate.main(["report", str(tmp_path / "none"), *QUICK]) == 2
    assert "not found" in capfd.readouterr().err
