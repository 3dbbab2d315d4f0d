"""An installation: what ``demo`` writes, what works without PyTorch, and what a foreign module of one of our names does."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from conftest import ROOT
from processes import CompletedProcess, environment, run

#: a finder before all others, which knows of no torch, as where it was never installed
WITHOUT_TORCH = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
"""
#: each works alone on the folder that the first one makes
COMMANDS = (
    "simulate --out s --segments 12 --closure 12 --odr-hz 104 --seed 1",
    "check s",
    "fit s --methods raw,least_squares --folds 2",
    "explain s --no-pictures",
    "report s --no-explain --methods least_squares --folds 2",
    "apply s/fit/model_least_squares.json s/log0001.csv.gz -o out.csv",
    "export s --to c --out exported",
    "import s/log0001.csv.gz --out again",
)


def commands(start: str, words: list[str], folder: Path) -> CompletedProcess:
    """Commands in one process; each is followed by its exit code and whether torch is there, on a line of standard output."""
    code = f"""{start}
import tinygc, calibrate
for line in {words!r}:
    code = calibrate.main([*line.split(), "--quiet"])
    print("did", line.split()[0], code, "torch" in sys.modules)
"""
    return run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)


# PyTorch


@pytest.mark.broad
def test_no_command_loads_torch_but_a_training_as_in_the_paper(tmp_path):
    done = commands(WITHOUT_TORCH, [*COMMANDS, "demo", "fit s --folds 2 --out nets"], tmp_path)
    assert done.stderr == ""
    lines = [line for line in done.stdout.splitlines() if line.startswith("did ")]
    names = [line.split()[0] for line in (*COMMANDS, "demo", "fit")]
    assert lines == [f"did {name} 0 False" for name in names]


def test_a_net_that_needs_torch_says_so_in_one_line(simulated, tmp_path, run, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    code, _, err = run("fit", simulated(), "--as-in-paper", "--folds", 2, "--out", tmp_path, "--quiet")
    needs = "training as in the paper needs PyTorch: python -m pip install 'tinygc[torch]', or leave out --as-in-paper"
    assert (code, err) == (2, f"calibrate: {needs}\n")


# Foreign modules of our names


def started(*words: str, path: Sequence[Path]) -> CompletedProcess:
    """Python with folders of its own on the path: ``-P`` keeps the working folder, which is the checkout, off it."""
    return run([sys.executable, "-P", *words], env=environment(PYTHONPATH=os.pathsep.join(map(str, path))), capture_output=True, text=True)


@pytest.mark.parametrize(("name", "what"), [("session.py", "import tinygc"), ("session/__init__.py", "import calibrate")])
def test_a_foreign_session_before_ours_is_refused_in_one_line(name, what, tmp_path):
    foreign = tmp_path / name
    foreign.parent.mkdir(exist_ok=True)
    foreign.write_text("VERSION = '9'\n")
    done = started("-c", what, path=[tmp_path, ROOT])
    assert done.returncode != 0
    line = done.stderr.splitlines()[-1]
    assert f"{foreign} is imported as 'session' in place of TinyGC's own, {ROOT / 'session'}; rename it" in line
    if what == "import calibrate":  # as the installed command does
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
