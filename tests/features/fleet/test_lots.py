"""A lot's report and file: what people see is what was put in; what is no lot is refused in one line; the commands on a fleet's table."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from fleets import simulated_lot, written_fleet
from formats_page import strangers
from processes import unread

import calibrate
from session.base.errors import FormatError
from session.base.records import table_of, write_whole
from tinygc.features.fleet.report import lot_facts, lot_of, read_lot
from tinygc.reporting.facts import screen
from tinygc.reporting.terminal import as_text


@pytest.fixture(scope="module")
def report():
    results = simulated_lot(60, 1, [2, 4], drift=1.5)
    far = np.zeros(21)
    far[10] = 0.3
    odd = (dataclasses.replace(r, values=r.values + far, serial="serial <b>") if r.serial == "serial 00007" else r for r in results)
    return lot_of(odd, "ASM330LHH")


def printed(report):
    return " ".join(as_text(screen(lot_facts(report))).split())


def test_the_terminal_the_page_and_the_file_have_all_of_it(report, tmp_path):
    text = printed(report)
    for word in ("60 units of ASM330LHH, 180 sessions", "drift found", "gyro bias y, mdps", "serial <b>", "repeats"):
        assert word in text, word
    html = report.html()
    for words in (">The lot</h2>", "serial &lt;b&gt;"):
        assert words in html
    assert not re.search(r"\bnan\b", html, re.IGNORECASE)
    write_whole(tmp_path / "lot.json", table_of(report))
    assert not strangers(json.loads((tmp_path / "lot.json").read_text(encoding="utf-8")))
    few = lot_of(simulated_lot(2, 0, without_accelerometer=1.0))
    for word, there in (("repeatability is not known", True), ("two units have no drift", True), ("accel", False), ("nan", False)):
        assert (word in printed(few)) == there


# The file.


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Of twelve units without accelerometers, and no repeated session: much is null."""
    path = tmp_path_factory.mktemp("lot") / "lot.json"
    report = lot_of(simulated_lot(12, 0, without_accelerometer=1.0), "ASM330LHH")
    write_whole(path, table_of(report))
    return report, path


def test_what_is_written_reads_back_the_same(file):
    lot, path = file
    again = read_lot(path)
    for name in ("mean", "mean_sigma", "spread", "repeatability"):
        assert np.array_equal(getattr(again, name), getattr(lot, name), equal_nan=True), name
    assert (again.sensor, again.units, again.sessions) == ("ASM330LHH", 12, 12)
    assert np.isnan(again.repeatability).all()
    assert np.isnan(again.mean[12:]).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"sessions": 3}, "sessions is 3, expected at least one for each unit of 12"),
        ({"mean": [1.0]}, "mean has 1 entries, expected 21"),
        ({"spread": [-1.0] * 21}, "spread[0] is -1.0, expected a number of at least 0"),
    ],
)
def test_what_is_no_lot_is_refused_in_one_line(file, change, says, tmp_path):
    table, path = json.loads(file[1].read_text(encoding="utf-8")), tmp_path / "lot.json"
    path.write_text(json.dumps(table | change), encoding="utf-8")
    with pytest.raises(FormatError, match=re.escape(says)) as refused:
        read_lot(path)
    assert "\n" not in str(refused.value)
    assert "lot.json: " in str(refused.value)


# The commands.


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    return written_fleet(tmp_path_factory.mktemp("lot") / "fleet", "MPU-9150")


def test_fleet_says_of_one_model_what_its_units_are_together(fleet, tmp_path, capsys):
    alone = written_fleet(tmp_path / "alone", "ASM330LHH")
    for folder in (alone, fleet):
        assert calibrate.main(["fleet", "--out", str(folder), "--quiet"]) == 0
    assert read_lot(alone / "lot.json").units == 20
    assert ">The lot</h2>" in (alone / "fleet.html").read_text(encoding="utf-8")
    assert not (fleet / "lot.json").exists()
    (fleet / "lot.json").write_text("{}")
    assert calibrate.main(["fleet", "--out", str(fleet), "--quiet"]) == 0
    (fleet / "lot.json").unlink()
    (line,) = capsys.readouterr().err.splitlines()
    assert "lot.json: not renewed (several models, or too few units); --lot writes it" in line


def test_the_command(fleet, tmp_path, capsys):
    copy = shutil.copytree(fleet, tmp_path / "fleet")
    out, html, told = copy / "lot.json", copy / "lot.html", tmp_path / "x.json"
    words = ["fleet", "--out", copy, "--lot", "--model", "ASM330LHH", "--json", told]
    assert calibrate.main([*map(str, words)]) == 0
    assert "19 units of ASM330LHH, 29 sessions" in capsys.readouterr().out
    assert json.loads(told.read_text(encoding="utf-8")) == json.loads(out.read_text(encoding="utf-8"))
    assert ">The lot</h2>" in html.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "sensors of 2 models (ASM330LHH, MPU-9150)"),
        (["--model", "LSM9DS1"], "no fitted session of a LSM9DS1"),
        (["--model", "MPU-9150"], "two units or more, got 1"),
    ],
)
def test_a_table_without_a_lot_is_refused_in_one_line(fleet, words, says, capsys):
    assert calibrate.main(["fleet", "--out", str(fleet), "--lot", *words]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_the_verdict_stands_though_nobody_reads(tmp_path, monkeypatch):
    written_fleet(tmp_path / "lot", "ASM330LHH", drift=5.0)
    assert unread(monkeypatch, "fleet", "--out", str(tmp_path / "lot"), "--lot", "--strict") == 1
