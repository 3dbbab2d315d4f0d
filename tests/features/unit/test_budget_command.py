"""``budget`` from the command line and in Python: what it prints, the files, the JSON, exit codes, and what it refuses."""

import functools
import json

import pytest
from formats_page import strangers
from processes import refused

import tinygc


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    simulated = tinygc.simulate(segments=8, closure_s=0.0, odr_hz=62.5, seed=3)
    return simulated.save(tmp_path_factory.mktemp("budget") / "s")


@pytest.fixture(scope="module")
def fit(folder):
    return tinygc.fit(folder, methods=("least_squares",))


def test_the_overview_the_files_and_the_json_which_sums_to_the_models_covariance(folder, fit, tmp_path, run):
    code, out, _ = run("budget", folder, "--out", tmp_path / "out", "--motion", "rest")
    assert code == 0
    for words in ("scale factor error x", "bias z", "attitude total", "60 s at rest", "written:"):
        assert words in out
    table, html = json.loads((tmp_path / "out" / "budget.json").read_text()), (tmp_path / "out" / "budget.html").read_text()
    assert not strangers(table)
    assert html.count('class="solid') > 50
    assert "not in U: one effect missing from the model" in html
    for i, each in enumerate(table["budgets"][:12]):
        parts = [row["variance_si"] for row in each["sources"]]
        assert parts == [source.covariance[i, i] for source in fit.result.sources]
        assert functools.reduce(float.__add__, parts) == each["variance_si"] == fit.result.covariance[i, i]


@pytest.mark.parametrize(("words", "says"), [("--seconds -1", "--seconds"), ("--warmer nan", "--warmer")])
def test_what_is_wrong_is_refused_in_one_line(folder, words, says, run):
    refused(run("budget", folder, *words.split(), "--quiet"), says)


def test_in_python(fit):
    found = tinygc.budget(fit, motion="rest", seconds=10.0, of=("bias_x", "accelerometer_bias_x"))
    assert [each.name for each in found.chosen] == ["bias x", "accelerometer bias x"]
    assert found.to_json()["motion"] == "10 s at rest, at another switch-on"
    later = tinygc.budget(fit, motion="rest", seconds=10.0, elapsed_s=10.0)
    assert later.to_json()["motion"] == "10 s at rest, for this switch-on only"
    assert later.attitude[0].u < 0.1 * found.attitude[0].u
    wrongs = (({"speed": 1}, "no option 'speed'"), ({"of": ("colour",)}, "no such quantity"), ({"motion": "none.csv"}, r"none\.csv"))
    for wrong, says in wrongs:
        with pytest.raises(tinygc.CalibrationError, match=says):
            tinygc.budget(fit, **wrong)
