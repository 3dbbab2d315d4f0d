"""docs/library.md names a Python function for each command, and the notebook runs as it stands."""

import importlib
import json
import re

import pytest
from conftest import ROOT

import tinygc
from tinygc.cli.commands import commands

PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
NOTEBOOK = ROOT / "docs" / "notebook.ipynb"


def rows():
    """Command -> the name of its Python function, as the page's table has them."""
    found = re.findall(r"^- `([\w -]+)`: `([\w.]+)`(?:, `[\w\[\]]+`)?$", PAGE, re.M)
    assert len(dict(found)) == len(found), "a command has two rows"
    return dict(found)


def there(dotted):
    """What a dotted name stands for: an attribute of the longest part that is a module."""
    parts = dotted.split(".")
    for count in range(len(parts) - 1, 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for name in parts[count:]:
            thing = getattr(thing, name)
        return thing
    raise AttributeError(dotted)


@pytest.mark.parametrize("command", commands())
def test_every_command_has_its_function_on_the_page(command):
    assert command in rows(), f"docs/library.md: the table has no row for {command}"
    assert callable(there(rows()[command]))


def test_every_name_of_the_page_exists():
    """Of tinygc's own names; ``import_log`` belongs to the command ``import``."""
    names = set(re.findall(r"tinygc\.(\w+)\b(?!\.)", PAGE)) - ({"import_log"} if "import" not in commands() else set())
    missing = {name for name in names if not hasattr(tinygc, name)} - {"toml"}
    assert missing - {"effects", "simulation", "features", "cli"} == set()


def cells(kind):
    return ["".join(cell["source"]) for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


@pytest.mark.broad
def test_the_notebook_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    known: dict = {}
    for cell in cells("code"):
        exec(cell, known)
    assert capsys.readouterr().out.startswith("PASS: held-out turns close to ")
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count("notebook") > 1
    assert {path.name for path in (tmp_path / "export").iterdir()} >= {"imu_calibration.yaml", "imu.yaml", "tinygc_model.h"}
    assert (tmp_path / "fit.svg").read_text(encoding="utf-8").startswith("<svg")
    saved, made = tinygc.read_session(tmp_path / "session"), known["session"]
    assert (saved.logs[0].samples.gyro[:] == made.logs[0].samples.gyro).all()
    assert known["calibrated_dps"].shape == known["rate_dps"].shape
