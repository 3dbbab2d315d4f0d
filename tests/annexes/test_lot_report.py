"""A lot's report: what people see is what was put in, in the terminal, on the page and in the file; the command reads a fleet's table."""

import dataclasses
import html
import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from formats_page import strangers
from rich.console import Console
from simulated_lots import simulated_lot

import calibrate
from tinygc.annexes.lots.lot import NAMES, PooledEffect
from tinygc.annexes.lots.page import page
from tinygc.annexes.lots.report import lot_of, read_lot, save, to_json
from tinygc.annexes.lots.text import lot_page

LIMITS = {"gyro_bias_y_mdps": (-1500.0, 1500.0), "accel_bias_z_mg": (-np.inf, 30.0)}
PEOPLE = (("Mara", 0.4), ("Ben <b>", -0.4))


@pytest.fixture(scope="module")
def report():
    results = simulated_lot(60, 1, [2, 4], drift=1.5, people=PEOPLE)
    far = np.zeros(21)
    far[10] = 0.3
    return lot_of(
        [dataclasses.replace(r, values=r.values + far) if r.serial == "serial 00007" else r for r in results], "ASM330LHH", LIMITS
    )


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
    assert report.hierarchy.drifts
    (odd,) = report.outliers
    assert odd.serial == "serial 00007"
    assert odd.reasons[0].what == "gyro_bias_y_mdps"
    gauge = report.gauges["accel_scale_factor_error_x_ppm"]
    assert report.appraisers == "operator"
    assert gauge.av == pytest.approx(2000 * 0.8 / np.sqrt(2), rel=0.15)  # two people 0.8 spreads apart
    assert gauge.method == "likelihood"
    assert report.capabilities["gyro_bias_y_mdps"].units == 60
    assert report.charts["gyro_bias_y_mdps"].alarms.tolist() == [7]


def test_the_terminal_names_all_of_it(report):
    text = printed(report)
    for word in ("ASM330LHH: 60 units, 180 sessions", "it drifts", "gyro bias y, mdps", "%GRR", "Ppk", "serial 00007", "repeats / stated"):
        assert word in text, word


def test_the_page_is_whole_and_escaped(report):
    text = page(report)
    assert "Ben <b>" not in text
    for heading in ("The lot", "What does not belong", "Control charts", "Measurement system", "Capability"):
        assert f">{heading}</h2>" in text
    assert "serial 00007" in text
    drawings = re.findall(r"<svg.*?</svg>", text)
    assert len(drawings) >= 8
    for drawing in drawings:
        ElementTree.fromstring(html.unescape(drawing.replace("&lt;", "").replace("&amp;", "")))
    assert "u202f" not in text
    assert "nan" not in text.lower().replace("nano", "").replace("finan", "")


def test_the_file_is_on_the_page_of_formats_and_is_a_prior(report, tmp_path):
    table = to_json(report)
    assert table["capabilities"]["accel_bias_z_mg"]["lower"] == -np.inf
    save(report, tmp_path / "lot.json")
    kept = json.loads((tmp_path / "lot.json").read_text(encoding="utf-8"))
    assert kept["capabilities"]["accel_bias_z_mg"]["lower"] is None
    assert not strangers(kept)
    assert read_lot(tmp_path / "lot.json").mean == pytest.approx(report.lot.mean)


def test_a_lot_of_two_units_says_what_it_cannot():
    report = lot_of(simulated_lot(2, 0, without_accelerometer=1.0))
    assert not report.charts
    text = printed(report)
    assert "repeatability is unknown" in text
    assert "two units have no drift" in text
    assert "accel" not in text
    assert "nan" not in text


def test_noise_far_below_the_spread_is_still_a_number():
    text = printed(lot_of(simulated_lot(30, 4, noise=1e-4)))
    rows = [line.split() for line in text.splitlines() if line.strip().startswith(("gyro", "accel"))]
    assert len(rows) == 21
    assert all(any(digit in row[-4] for digit in "123456789") for row in rows)


def test_a_doubtful_unit_is_not_said_to_belong(report):
    found = dataclasses.replace(report.hierarchy, belongs=np.r_[0.4, np.ones(59)])
    doubtful = dataclasses.replace(report, outliers=(), hierarchy=found)
    assert "none is odd beyond chance, 1 may not belong" in printed(doubtful)
    assert "all belong" in printed(dataclasses.replace(doubtful, hierarchy=dataclasses.replace(found, belongs=np.ones(60))))
    assert "Every unit" not in page(doubtful)


def test_a_tail_that_nobody_could_count_is_no_number(report):
    capable = {key: dataclasses.replace(each, ppm_tails=3e-80, false_accept_ppm=0.0) for key, each in report.capabilities.items()}
    far = dataclasses.replace(report, capabilities=capable)
    assert "e-80" not in printed(far) + page(far)
    assert "< 0.001" in printed(far)
    assert "&lt; 0.001" in page(far)


def test_an_effect_of_the_lot_is_on_the_page(report):
    effects = {"gyro.<b>": PooledEffect(0.5, {"x": 1e-4}, {"x": 0.0}, 1e-4, 40, ("gyro.bias_step",))}
    text = page(dataclasses.replace(report, lot=dataclasses.replace(report.lot, effects=effects)))
    assert ">Effects of the lot</h2>" in text
    assert "gyro.&lt;b&gt;, in 50% of 40 units that tell" in text
    assert "Effects of the lot" not in page(report)


def test_an_appraiser_and_nobody_are_no_two():
    someone = lot_of(simulated_lot(20, 6, 2, people=(("Mara", 0.0), ("", 0.0))))
    assert someone.appraisers == ""
    assert np.isnan(someone.gauges["gyro_bias_x_mdps"].av)
    assert lot_of(simulated_lot(20, 6, 2, people=PEOPLE)).appraisers == "operator"


def written_fleet(folder, first_model):
    """A fleet's table of simulated results, the first of which may be of another model."""
    from tinygc.annexes.lots.fleet_row import DONE, SIGMAS, empty, packed
    from tinygc.annexes.lots.fleet_session import Outcome
    from tinygc.annexes.lots.fleet_table import open_table

    folder.mkdir()
    with open_table(folder) as table:
        for number, result in enumerate(simulated_lot(20, 5, [1, 2])):
            row = empty() | {"status": DONE, "model": "ASM330LHH" if number else first_model, "serial": result.serial}
            row |= {"covariance": packed(result.covariance), "held_out_deg": 0.02, "floor_deg": 0.02}
            row |= dict(zip(NAMES, map(float, result.values), strict=True)) | dict(zip(SIGMAS, map(float, result.sigmas), strict=True))
            table.put_folder(folder / result.session, result.key)
            table.put(Outcome(result.key, row), row, [])
    return folder


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    return written_fleet(tmp_path_factory.mktemp("lot") / "fleet", "MPU-9150")


@pytest.mark.broad
def test_fleet_says_of_one_model_what_its_units_are_together(fleet, tmp_path, capsys):
    alone = written_fleet(tmp_path / "alone", "ASM330LHH")
    for folder in (alone, fleet):
        assert calibrate.main(["fleet", "--out", str(folder), "--quiet"]) == 0
    assert read_lot(alone / "lot.json").units == 20
    assert ">Control charts</h2>" in (alone / "fleet.html").read_text(encoding="utf-8")
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
    assert "Measurement system" in (tmp_path / "lot.html").read_text(encoding="utf-8")
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
