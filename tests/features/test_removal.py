"""Features can be removed: without their folders, and without PyTorch, the core's commands run; what is gone is named in one line."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import processes
import pytest
from fleets import written_fleet
from watched import model_file

ROOT = Path(__file__).resolve().parents[2]
#: feature -> its folders
FOLDERS: dict[str, list[Path]] = {}
for found in sorted(ROOT.glob("tinygc/features/*/__init__.py")):
    FOLDERS.setdefault(found.parent.name, []).append(found.parent.relative_to(ROOT))
#: feature -> commands that need it
GONE = {
    "arrays": ("simulate --units 3 --out array", "fit body"),
    "fleet": ("fleet data", "lot data", "fit data/session1 --lot lot.json"),
    "temperature": ("temperature data/session1", "apply thermal.json data/session1/log0001.csv.gz -o t.csv"),
    "noise": ("noise data/session1",),
    "discovery": ("explain data/session1 --discover",),
    "challenge": ("challenge --cases 1",),
    "tables": ("table list", "rates table.csv"),
    "turns": ("fit phone",),
    "unit": (
        *("budget data/session1", "report data/session1 --certificate", "report data/session1 --dcc dcc.xml"),
        *("verify model.json data/session1", "watch model.json data/session1/log0001.csv.gz", "history data/session1"),
    ),
}
MAIN_JOB = (
    "simulate --segments 10 --closure 0 --odr-hz 104 --out s",
    "check s",
    "fit s --methods raw,least_squares",
    "explain s --no-pictures",
    "report s --methods raw,least_squares",
    "apply s/fit/model_least_squares.json s/log0001.csv.gz -o calibrated.csv",
    "export s --to px4",
    "export s --to c",
    "import s/log0001.csv.gz --out again",
    "demo",
    "fit s --out nets",
)
#: runs commands in one process without PyTorch, and prints the exit codes as JSON on the last line of standard output
RUN = f"""
import json, sys
sys.path.insert(0, {str(ROOT / "tests")!r})
import processes
sys.meta_path.insert(0, processes.WithoutTorch())
import calibrate
codes = []
for words in json.loads(sys.argv[1]):
    print("#", *words, file=sys.stderr, flush=True)
    try:
        codes.append(calibrate.main(words))
    except Exception as error:
        codes.append(repr(error))
print(json.dumps(codes))
"""
IMPORT = """
import importlib, sys
from pathlib import Path
for path in sorted(p for room in ("session", "tinygc") for p in Path(room).rglob("*.py")):
    if "features" not in path.parts and path.stem != "__main__":
        importlib.import_module(".".join(path.with_suffix("").parts).removesuffix(".__init__"))
"""


def without(features: tuple[str, ...], folder: Path) -> Path:
    """A copy of the product and of a recording in which these features are removed."""
    for room in ("session", "tinygc"):
        shutil.copytree(ROOT / room, folder / room)
    shutil.copy2(ROOT / "calibrate.py", folder)
    shutil.copytree(ROOT / "data/session1", folder / "data/session1", ignore=shutil.ignore_patterns("fit", "explain", "report.html"))
    for feature in features:
        for gone in FOLDERS[feature]:
            shutil.rmtree(folder / gone)
    body = folder / "body"
    body.mkdir()
    (body / "session.toml").write_text((folder / "data/session1/session.toml").read_text() + "\n[[array.unit]]\nnumber = 0\n")
    (folder / "rests").mkdir()
    shutil.copy(folder / "data/session1/session.toml", folder / "rests")
    shutil.copy(folder / "data/session1/log0001.csv.gz", folder / "rests/rest0001.csv.gz")
    phone = (folder / "data/session1/session.toml").read_text().replace('"gravity"', '"turns"')
    (folder / "phone").mkdir()
    (folder / "phone/session.toml").write_text(phone)
    for name, table in (
        ("array.json", {"schema": "tinygc-array-model/1"}),
        ("thermal.json", {"schema": "tinygc-model/1", "kind": "thermal"}),
        ("lot.json", {"schema": "tinygc-lot/3"}),
        ("noise.json", {"schema": "tinygc-noise/1"}),
    ):
        (folder / name).write_text(json.dumps(table))
    model_file(folder / "model.json")
    written_fleet(folder / "fleet", "ASM330LHH")
    (folder / "table.csv").write_text("rate_dps,x,y,z\n0,1,2,3\n")
    return folder


def python(folder: Path, code: str, *words: str) -> processes.CompletedProcess:
    return processes.run([sys.executable, "-c", code, *words], cwd=folder, env=within(folder), capture_output=True, text=True)


def within(folder: Path) -> dict[str, str]:
    return processes.environment(PYTHONPATH=str(folder), TINYGC_DEFAULTS="")


def run(folder: Path, *commands: str) -> tuple[list[int], str, list[list[str]]]:
    """Exit codes; what was printed; of each command the lines on standard error."""
    done = python(folder, RUN, json.dumps([command.split() for command in commands]))
    assert done.returncode == 0, done.stderr
    printed, _, codes = done.stdout.rstrip().rpartition("\n")
    return json.loads(codes), printed, [part.splitlines()[1:] for part in done.stderr.split("# ")[1:]]


def hold_gone(folder: Path, features: tuple[str, ...]) -> None:
    commands = [command for feature in features for command in GONE[feature]]
    if not commands:
        return
    codes, _, lines = run(folder, *commands)
    for command, code, errors in zip(commands, codes, lines, strict=True):
        assert code == 2, command
        assert len(errors) == 1, (command, errors)


def test_every_feature_is_removed_here():
    assert set(GONE) == set(FOLDERS)


@pytest.mark.broad
def test_without_any_feature_each_says_so_and_the_main_job_runs_without_pytorch_too(tmp_path):
    folder = without(tuple(FOLDERS), tmp_path)
    hold_gone(folder, tuple(FOLDERS))
    assert python(folder, IMPORT).stderr == ""  # every module of the core
    whole = processes.run([sys.executable, "calibrate.py", "--help"], cwd=folder, capture_output=True, text=True, env=within(folder)).stdout
    assert "\n    check" in whole
    assert not any(f"\n    {name} " in whole for name in ("fleet", "lot", "challenge", "noise", "verify", "watch", "history"))
    codes, printed, _ = run(folder, *MAIN_JOB)
    assert codes == [0] * len(MAIN_JOB), printed
    assert (folder / "s/report.html").is_file()


@pytest.mark.broad
def test_no_feature_is_loaded_where_nobody_asks():
    """A fit and an explanation of one sensor on a table import no feature, though all are there."""
    code = (
        "import sys, tinygc; s = tinygc.simulate(segments=10, closure_s=0.0, odr_hz=104.0).session; "
        "tinygc.fit(s, methods=('least_squares',)); tinygc.explain(s).summary(); "
        "print(sorted(name for name in sys.modules if '.features.' in name))"
    )
    done = python(ROOT, code)
    assert (done.returncode, done.stdout) == (0, "[]\n"), done.stderr
