"""``rates`` from the command line and in Python: what it prints, the files, the JSON, and what it refuses."""

import json

import numpy as np
import pytest
from formats_page import strangers

import tinygc
from tinygc.features.tables.rates.library import FILE, PAGE


@pytest.fixture(scope="module")
def clipped(tmp_path_factory):
    rng = np.random.default_rng(1)
    rate = np.array([*np.linspace(-100, 100, 11), *np.linspace(80, -100, 10)])
    output = 0.02 * rate + 1e-4 * rng.normal(size=21)
    path = tmp_path_factory.mktemp("rates") / "table.csv"
    path.write_text("rate_dps,mean_v\n" + "\n".join(f"{r:g},{v:.6f}" for r, v in zip(rate, output, strict=True)) + "\n")
    return path


def test_the_screen_the_files_and_the_json(clipped, tmp_path, run):
    code, out, _ = run("rates", clipped, "--out", tmp_path / "out", "--no-pictures", "--json", tmp_path / "rates.json")
    assert code == 0
    for words in (
        "a straight line",
        "scale factor",
        "less than",
        "hysteresis",
        "written:",
    ):
        assert words in out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {FILE, PAGE}
    html = (tmp_path / "out" / PAGE).read_text()
    assert "dead band" in html
    assert "<svg" in html
    table = json.loads((tmp_path / "rates.json").read_text())
    assert table["schema"] == "tinygc-rates/1"
    assert not strangers(table)
    (sensor,) = table["sensors"]
    assert sensor["law"] == "line"
    names = [each["name"] for each in sensor["parameters"]]
    assert names == ["V0", "K"]
    assert {term["key"] for term in sensor["terms"]} >= {"scale", "offset", "nonlinearity", "asymmetry", "hysteresis", "dead_band"}


def test_arrays_in_python(tmp_path):
    rate = np.linspace(-100, 100, 11)
    found = tinygc.estimate_rates((rate, 0.02 * rate + 1e-4 * np.cos(40 * rate)), unit="V")
    assert found.choices[0].is_line
    assert "arrays" in found.summary()
    assert found.to_json()["sensors"][0]["unit"] == "V"
    assert (found.save(tmp_path / "r", pictures=False) / FILE).exists()


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["absent.csv"], "absent.csv"),
        (["table.csv", "--output-column", "volts"], "no column 'volts'"),
        (["."], "it is a folder, expected a file"),
    ],
)
def test_what_is_refused_in_one_line(clipped, run, monkeypatch, words, reported):
    monkeypatch.chdir(clipped.parent)
    code, _, err = run("rates", *words)
    assert code == 2
    assert reported in err
    assert len(err.strip().splitlines()) == 1


def test_what_python_refuses():
    with pytest.raises(tinygc.CalibrationError, match="expected a path or a tuple"):
        tinygc.estimate_rates([1, 2, 3])
    with pytest.raises(tinygc.CalibrationError, match=r"shapes \(3,\) and \(2,\)"):
        tinygc.estimate_rates(([1, 2, 3], [1, 2]))
    with pytest.raises(tinygc.CalibrationError, match="sigma is of arrays"):
        tinygc.estimate_rates("t.csv", sigma=[1])
