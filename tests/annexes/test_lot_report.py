"""A lot's report: what people see is what was put in, in the terminal, on the page and in the file; the command reads a fleet's table."""

import dataclasses
import json

import numpy as np
import pytest
from formats_page import strangers
from rich.console import Console
from simulated_lots import simulated_lot, written_fleet

import calibrate
from tinygc.annexes.lots.page import page
from tinygc.annexes.lots.report import lot_of, read_lot, save
from tinygc.annexes.lots.text import lot_page


@pytest.fixture(scope="module")
def report():
    results = simulated_lot(60, 1, [2, 4], drift=1.5)
    far = np.zeros(21)
    far[10] = 0.3
    odd = (dataclasses.replace(r, values=r.values + far, serial="serial <b>") if r.serial == "serial 00007" else r for r in results)
    return lot_of(odd, "ASM330LHH")


def printed(report):
    console = Console(width=200, force_terminal=False)
    with console.capture() as capture:
        console.print(lot_page(report))
    return capture.get()


def test_the_report_says_what_was_put_in(report):
    by_key = {each.error.key: each for each in report.quantities}
    bias = by_key["gyro_bias_x_mdps"]
    assert bias.spread == pytest.approx(600, rel=0.35)
    # 1.5 spreads over 60 units, per 1000; the sensor's bias is minus the correction's.
    assert bias.drift_per_1000 == pytest.approx(-1.5 * 600 * 1000 / 59, abs=4 * bias.drift_sigma)
    assert report.estimate.drifts
    (odd,) = report.outliers
    assert odd.serial == "serial <b>"
    assert odd.reasons[0].what == "gyro_bias_y_mdps"


def test_the_terminal_names_all_of_it(report):
    text = printed(report)
    for word in ("ASM330LHH: 60 units, 180 sessions", "it drifts", "gyro bias y, mdps", "serial <b>", "repeats within"):
        assert word in text, word


def test_the_page_is_whole_and_escaped(report):
    text = page(report)
    for heading in ("The lot", "What does not belong"):
        assert f">{heading}</h2>" in text
    assert "serial &lt;b&gt;" in text
    assert "u202f" not in text
    assert "nan" not in text.lower().replace("nano", "").replace("finan", "")


def test_the_file_is_on_the_page_of_formats_and_is_a_prior(report, tmp_path):
    save(report, tmp_path / "lot.json")
    kept = json.loads((tmp_path / "lot.json").read_text(encoding="utf-8"))
    assert not strangers(kept)
    assert read_lot(tmp_path / "lot.json").mean == pytest.approx(report.lot.mean)


def test_a_lot_of_two_units_says_what_it_cannot():
    report = lot_of(simulated_lot(2, 0, without_accelerometer=1.0))
    text = printed(report)
    assert "repeatability is unknown" in text
    assert "two units have no drift" in text
    assert "accel" not in text
    assert "nan" not in text


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    return written_fleet(tmp_path_factory.mktemp("lot") / "fleet", "MPU-9150")


@pytest.mark.broad
def test_fleet_says_of_one_model_what_its_units_are_together(fleet, tmp_path, capsys):
    alone = written_fleet(tmp_path / "alone", "ASM330LHH")
    for folder in (alone, fleet):
        assert calibrate.main(["fleet", "--out", str(folder), "--quiet"]) == 0
    assert read_lot(alone / "lot.json").units == 20
    assert ">What does not belong</h2>" in (alone / "fleet.html").read_text(encoding="utf-8")
    assert not (fleet / "lot.json").exists()
    assert capsys.readouterr().err == ""
    (fleet / "lot.json").write_text("{}")
    assert calibrate.main(["fleet", "--out", str(fleet), "--quiet"]) == 0
    (fleet / "lot.json").unlink()
    assert "left as it was, and not of this table" in capsys.readouterr().err


@pytest.mark.broad
def test_the_command(fleet, tmp_path, capsys):
    words = [
        "--model",
        "ASM330LHH",
        "--out",
        str(tmp_path / "lot.json"),
        "--html",
        str(tmp_path / "lot.html"),
        "--json",
        str(tmp_path / "x.json"),
    ]
    assert calibrate.main(["lot", str(fleet), *words]) == 0
    assert "ASM330LHH: 19 units, 29 sessions" in capsys.readouterr().out
    assert read_lot(tmp_path / "lot.json").units == 19
    table = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert table == json.loads((tmp_path / "lot.json").read_text(encoding="utf-8"))
    assert not strangers(table)
    assert "What does not belong" in (tmp_path / "lot.html").read_text(encoding="utf-8")
    assert calibrate.main(["lot", str(fleet / "fleet.sqlite"), "--model", "ASM330LHH", "--quiet"]) == 0
    assert "19 units" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "sensors of 2 models (ASM330LHH, MPU-9150)"),
        (["--model", "LSM9DS1"], "no fitted session of a LSM9DS1"),
        (["--model", "MPU-9150"], "two units or more, got 1"),
    ],
)
def test_what_is_no_lot_is_said_in_one_line(fleet, words, says, capsys):
    assert calibrate.main(["lot", str(fleet), *words]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
