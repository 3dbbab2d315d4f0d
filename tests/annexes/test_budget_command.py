"""``budget`` from the command line: what it prints, the files, the JSON, exit codes, and what it refuses."""

import json
from types import SimpleNamespace

import pytest
from commandline import refused
from formats_page import strangers

import tinygc
from tinygc.annexes.budget import command
from tinygc.annexes.budget.library import FILE, PAGE
from tinygc.models.files import load_with_table


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    simulated = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=3)
    return simulated.save(tmp_path_factory.mktemp("budget") / "s")


def test_the_overview_and_the_files(folder, tmp_path, run):
    code, out, _ = run("budget", folder, "--out", tmp_path / "out")
    assert code == 0
    for words in ("scale factor error x", "bias z", "attitude total", "drift of the bias", "the first 60 s", "written:"):
        assert words in out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {FILE, PAGE}
    html = (tmp_path / "out" / PAGE).read_text()
    assert html.count('class="solid') > 50
    assert "not in the sum: one effect that the model lacks" in html


def test_the_json_is_as_its_page_says_and_sums_to_the_models_covariance(folder, tmp_path, run):
    code, out, _ = run("budget", folder, "--json", "-")
    assert code == 0
    table = json.loads(out)
    assert not strangers(table)
    assert run("fit", folder, "--methods", "least_squares", "--out", tmp_path, "--quiet")[0] in (0, 1)
    covariance = load_with_table(tmp_path / "model_least_squares.json")[1]["covariance"]
    sources = json.loads((tmp_path / "fit.json").read_text())["sources"]
    for i, each in enumerate(table["budgets"][:12]):
        found = each["sources"][0]["variance_si"]
        for row in each["sources"][1:]:
            found += row["variance_si"]
        assert found == each["variance_si"] == covariance[i][i]
        assert [row["variance_si"] for row in each["sources"]] == [source["variance"][i] for source in sources]
    assert table["monte_carlo"] is None


@pytest.mark.broad
def test_draws_are_in_the_json_as_its_page_says(folder, run):
    code, out, _ = run("budget", folder, "--monte-carlo", "30", "--of", "attitude_x", "--motion", "rest", "--json", "-")
    table = json.loads(out)
    assert not strangers(table)
    assert code == 5
    assert table["monte_carlo"]["answer"] == "undecided"
    assert [each["name"] for each in table["monte_carlo"]["quantities"]] == ["attitude x"]


def test_one_table_is_asked_for_by_its_name(folder, run):
    code, out, _ = run("budget", folder, "--of", "bias_x", "--of", "E_xy", "--motion", "rest")
    assert code == 0
    assert "bias x, dps = " in out
    assert "E_xy = " in out
    assert "scale factor error" not in out
    assert out.count("effective degrees of freedom") == 2


@pytest.mark.parametrize("answer", ["agrees", "differs", "undecided"])
def test_what_the_draws_say_is_the_exit_code(answer, folder, run, monkeypatch):
    found = SimpleNamespace(page="", drawn=SimpleNamespace(answer=answer), to_json=dict)
    monkeypatch.setattr("tinygc.annexes.budget.library.budget_of_folder", lambda *given: found)
    assert run("budget", folder)[0] == {"agrees": 0, "differs": 1, "undecided": 5}[answer] == command.EXIT[answer]


def test_what_is_wrong_is_refused_in_one_line(folder, tmp_path, run):
    refused(run("budget", folder, "--of", "colour", "--quiet"), "colour", "bias_x")
    refused(run("budget", folder, "--motion", tmp_path / "none.csv", "--quiet"), "none.csv")
    refused(run("budget", tmp_path / "none"), "none")
    refused(run("budget", folder, "--seconds", "-1"))
    refused(run("budget", folder, "--warmer", "nan"))
    refused(run("budget", folder, "--of", ""))
    refused(run("budget", folder, "--monte-carlo", "0"))
    refused(run("budget", folder, "--bias-per-log", "--monte-carlo", "5", "--quiet"), "--monte-carlo")


def test_in_python(folder):
    fit = tinygc.fit(folder, methods=("least_squares",))
    found = tinygc.budget(fit, motion="rest", seconds=10.0, of=("bias_x",))
    assert [each.name for each in found.asked] == ["bias x"]
    assert found.motion == "10 s at rest"
    assert repr(found) == f"<UncertaintyBudget of s: {len(fit.result.sources)} sources>"
    with pytest.raises(tinygc.CalibrationError, match="no such quantity"):
        tinygc.budget(fit, of=("colour",))
    with pytest.raises(tinygc.CalibrationError, match="no option 'speed'"):
        tinygc.budget(fit, speed=1)
