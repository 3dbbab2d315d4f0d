"""``rates`` from the command line and in Python: what it prints, the files, the JSON, and what it refuses."""

import json

import numpy as np
import pytest
from formats_page import strangers

import tinygc
from tinygc.annexes.rates.library import FILE, PAGE, PICTURE


@pytest.fixture(scope="module")
def clipped(tmp_path_factory):
    rng = np.random.default_rng(1)
    rate = np.array([*np.linspace(-100, 100, 11), *np.linspace(80, -100, 10)])
    output = np.clip(0.02 * rate, -1.5, 1.5) + 1e-4 * rng.normal(size=21)
    path = tmp_path_factory.mktemp("rates") / "table.csv"
    path.write_text("rate_dps,mean_v\n" + "\n".join(f"{r:g},{v:.6f}" for r, v in zip(rate, output, strict=True)) + "\n")
    return path


def test_the_screen_and_the_files(clipped, tmp_path, run):
    code, out, _ = run("rates", clipped, "--out", tmp_path / "out", "--no-pictures")
    assert code == 0
    for words in (
        "a straight line, clipped below and above",
        "scale factor",
        "less than",
        "hysteresis",
        "a straight line would say",
        "written:",
    ):
        assert words in out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {FILE, PAGE}
    html = (tmp_path / "out" / PAGE).read_text()
    assert "dead band" in html
    assert "<svg" in html


@pytest.mark.broad
def test_the_picture(clipped, tmp_path, run):
    pytest.importorskip("matplotlib")
    code, out, _ = run("rates", clipped, "--out", tmp_path)
    assert code == 0
    assert (tmp_path / PICTURE).read_bytes().startswith(b"\x89PNG")
    assert PICTURE in out


def test_the_json_is_as_its_page_says(clipped, run):
    code, out, _ = run("rates", clipped, "--json", "-")
    assert code == 0
    table = json.loads(out)
    assert table["schema"] == "tinygc-rates/1"
    assert not strangers(table)
    (sensor,) = table["sensors"]
    assert sensor["law"] == "line"
    names = [each["name"] for each in sensor["parameters"]]
    assert names == ["V0", "K", "V−", "V+"]
    assert sum(point["limited"] for point in sensor["points"]) == 7
    assert {term["key"] for term in sensor["terms"]} >= {"scale", "offset", "nonlinearity", "asymmetry", "hysteresis", "dead_band"}


def test_a_sweep_as_json(tmp_path, run):
    path = tmp_path / "sweep.csv"
    rows = [f"{f},{1 / np.hypot(1, f / 20):.9f},{-np.degrees(np.arctan(f / 20)):.9f}" for f in (1, 2, 5, 10, 20, 40)]
    path.write_text("frequency_hz,gain,phase_deg\n" + "\n".join(rows) + "\n")
    code, out, _ = run("rates", path, "--json", "-")
    assert code == 0
    table = json.loads(out)
    assert not strangers(table)
    assert table["sweeps"][0]["model"] == "first"
    assert table["sweeps"][0]["bandwidth_hz"] == pytest.approx(20, rel=1e-4)


def test_names_from_a_csv_are_text_wherever_they_go(tmp_path, run):
    path = tmp_path / "table.csv"
    rng = np.random.default_rng(3)
    cells = [f'"<b>[bold]s","<i>{curve}",{rate},{0.02 * rate + 1e-3 * rng.normal()}' for curve in "ab" for rate in range(-40, 50, 10)]
    path.write_text("sensor,condition,rate_dps,mean_v\n" + "\n".join(cells) + "\n")
    code, out, _ = run("rates", path, "--out", tmp_path / "out", "--no-pictures")
    assert code == 0
    assert "<b>[bold]s: 18 points on 2 curves" in out
    html = (tmp_path / "out" / PAGE).read_text()
    assert "&lt;b&gt;[bold]s" in html
    assert "<b>" not in html
    assert "&amp;lt;" not in html


def test_arrays_in_python(tmp_path):
    rate = np.linspace(-100, 100, 11)
    found = tinygc.estimate_rates((rate, 0.02 * rate + 1e-4 * np.cos(40 * rate)), unit="V")
    assert found.choices[0].is_line
    assert "arrays" in found.summary()
    assert found.to_json()["sensors"][0]["unit"] == "V"
    assert (found.save(tmp_path / "r", pictures=False) / FILE).exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["absent.csv"], "absent.csv"),
        (["table.csv", "--output-column", "volts"], "no column 'volts'"),
        (["."], "table.toml: not found; a recording of rates"),
    ],
)
def test_what_is_refused_in_one_line(clipped, run, monkeypatch, words, said):
    monkeypatch.chdir(clipped.parent)
    code, _, err = run("rates", *words)
    assert code == 2
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_what_python_refuses():
    with pytest.raises(tinygc.CalibrationError, match="expected a path or a tuple"):
        tinygc.estimate_rates([1, 2, 3])
    with pytest.raises(tinygc.CalibrationError, match=r"shapes \(3,\) and \(2,\)"):
        tinygc.estimate_rates(([1, 2, 3], [1, 2]))
    with pytest.raises(tinygc.CalibrationError, match="sigma is of arrays"):
        tinygc.estimate_rates("t.csv", sigma=[1])
