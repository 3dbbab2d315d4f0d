"""Features can be removed: without their folders, and without PyTorch, the core's commands run, and nothing in the core names them."""

import inspect
import json
import os
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import processes
import pytest
from conftest import SESSION_TOML

import tinygc
from session.base import features
from session.base.options import declared, flag
from session.log.config import read_config
from tinygc.cli.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
FEATURES = {package.rpartition(".")[2]: feature for package, feature in features.known().items()}
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
)
SHORT = tuple(MAIN_JOB[each] for each in (0, 1, 2, 5, 7))
#: imports every module of the core without PyTorch, then runs commands, all in one process; prints their exit codes as JSON
RUN = f"""
import importlib, json, sys
from pathlib import Path
sys.path.insert(0, {str(ROOT / "tests")!r})
import processes
sys.meta_path.insert(0, processes.WithoutTorch())
for path in sorted(p for room in ("session", "tinygc") for p in Path(room).rglob("*.py")):
    if "features" not in path.parts and path.stem != "__main__":
        importlib.import_module(".".join(path.with_suffix("").parts).removesuffix(".__init__"))
import calibrate
codes = []
for words in json.loads(sys.argv[1]):
    print("#", *words, file=sys.stderr, flush=True)
    try:
        codes.append(calibrate.main(words))
    except SystemExit as stopped:  # argparse
        codes.append(stopped.code)
    except Exception as error:
        codes.append(repr(error))
print(json.dumps(codes))
"""


def without(names, folder):
    """The product, as links, in which these features are removed."""
    for path in (ROOT / "session", ROOT / "calibrate.py", ROOT / "data"):
        (folder / path.name).symlink_to(path)
    for room in ("tinygc", "tinygc/features"):
        (folder / room).mkdir()
        for path in (ROOT / room).iterdir():
            if path.name not in ("features", "__pycache__") and (room == "tinygc" or path.name not in names):
                (folder / room / path.name).symlink_to(path)
    return folder


def run(folder, *commands):
    """Exit codes; what was printed; of each command the lines on standard error."""
    words = json.dumps([command.split() for command in commands])
    environment = processes.environment(PYTHONPATH=str(folder), TINYGC_DEFAULTS="")
    done = processes.run([sys.executable, "-B", "-c", RUN, words], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    printed, _, codes = done.stdout.rstrip().rpartition("\n")
    return json.loads(codes), printed, [part.splitlines()[1:] for part in done.stderr.split("# ")[1:]]


def gone(names, folder):
    """Commands that these features served -> what the line says that anything unknown gets."""
    found = {}
    for name in names:
        found |= {command: f"{command.split()[0]!r} is no command" for command in FEATURES[name].commands if " " not in command}
        for command, point in (*((command, f"options of {command}") for command in COMMANDS), ("fit", "options of a fit")):
            served = FEATURES[name].serves.get(point, ())
            for value in (served,) if isinstance(served, str) else served:
                kind = pkgutil.resolve_name(f"tinygc.features.{name}.{value}")
                words = next(flag(kind, each.name) for each, _ in declared(kind))
                found[f"{command} {words}"] = f"{command} has no option {words}"
        for kind in FEATURES[name].kinds:
            (folder / f"{kind}.json").write_text(json.dumps({"schema": "tinygc-model/1", "kind": kind}))
            found[f"apply {kind}.json data/session1/log0001.csv.gz -o t.csv"] = f'kind is "{kind}", expected one of'
        if "reference" in FEATURES[name].serves:
            word = pkgutil.resolve_name(f"tinygc.features.{name}.{FEATURES[name].serves['reference']}").word
            (folder / word).mkdir()
            (folder / word / "log0001.csv.gz").symlink_to(ROOT / "data/session1/log0001.csv.gz")
            (folder / word / "session.toml").write_text(f'{SESSION_TOML}[protocol]\nreference = "{word}"\n')
            found[f"check {word} --json -"] = f'protocol.reference is "{word}", expected one of'
    return found


def hold(names, folder, job):
    without(names, folder)
    expected = gone(names, folder)
    codes, printed, lines = run(folder, *job, *expected)
    assert codes == [0] * len(job) + [2] * len(expected), (printed, lines)
    for command, said, errors in zip(expected, expected.values(), lines[len(job) :], strict=True):
        assert [said in error for error in errors] == [True], (command, errors)


def test_without_any_feature_the_core_imports_and_works_and_what_is_gone_is_unknown(tmp_path):
    hold(tuple(FEATURES), tmp_path, SHORT)


@pytest.mark.broad
def test_without_any_feature_the_main_job_runs(tmp_path):
    hold(tuple(FEATURES), tmp_path, MAIN_JOB)
    assert (tmp_path / "s/report.html").is_file()


@pytest.mark.broad
@pytest.mark.parametrize("half", [0, 1])
def test_without_half_of_the_features_the_others_run(half, tmp_path):
    """No feature imports another (tests/test_layers.py); this is of what they ask for by name."""
    hold(tuple(FEATURES)[half::2], tmp_path, SHORT)


@pytest.mark.broad
def test_the_feature_of_the_page_works_as_it_stands(tmp_path):
    without((), tmp_path)
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("## Add a feature", 1)[1].split("\n## ", 1)[0]
    for text, name in re.findall(r"```python\n(# (\S+?\.py).*?)```", page, re.S):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    codes, printed, _ = run(tmp_path, "rests data/session1", "report data/session1 --no-explain --out report.html --methods least_squares")
    assert codes == [0, 0]
    assert re.search(r"^[0-9.]+ s at rest$", printed, re.M)
    assert 'id="rests-title"' in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_what_a_feature_declares_is_there():
    for package, feature in features.known().items():
        for point in feature.serves:
            words = re.compile(re.sub("[A-Z]{2,}", r"[\\w-]+", "|".join(features.POINTS)))
            assert words.fullmatch(point), f"{package}: {point} is no point"
            assert all(each is not None for each in features.each(point))
        for table in ("commands", "kinds", "exports"):
            assert all(features.named(table, name) is not None for name in getattr(feature, table))
        assert all(hasattr(tinygc, name) for name in feature.public)
        assert not set(feature.commands) & set(COMMANDS)


def test_an_installed_feature_adds_its_options_to_the_command_and_to_python(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/__init__.py").write_text("")
    (tmp_path / "mine/feature.py").write_text(
        "from dataclasses import dataclass\nfrom session.base.features import Feature\nfrom session.base.options import Record, option\n"
        "@dataclass(frozen=True)\nclass More(Record):\n    mine: int = option(0, 'of mine', least=0)\n"
        "FEATURE = Feature(serves={'options of a fit': 'feature:More', 'options of apply': 'feature:More'})\n"
    )
    (tmp_path / "mine-1.dist-info").mkdir()
    (tmp_path / "mine-1.dist-info/METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1\n")
    (tmp_path / "mine-1.dist-info/entry_points.txt").write_text("[tinygc.features]\nmine = mine.feature:FEATURE\n")
    code = (
        "import calibrate, tinygc; print(tinygc.FitOptions(mine=2).mine)\n"
        "for words in (['fit', '--help'], ['apply', '--help']):\n    try: calibrate.main(words)\n    except SystemExit: pass"
    )
    environment = processes.environment(PYTHONPATH=os.pathsep.join(map(str, (ROOT, tmp_path))), TINYGC_DEFAULTS="")
    done = processes.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout.count("of mine")) == (0, 2), done.stderr
    assert done.stdout.startswith("2\n")
    text = (tmp_path / "mine/feature.py").read_text()
    for broken, says in (
        ("import no_such\n" + text, "mine.feature:FEATURE: cannot be loaded: ModuleNotFoundError: No module named 'no_such'"),
        (text.replace("'feature:More'", "'nowhere:More'"), "mine.nowhere:More: cannot be loaded: ModuleNotFoundError: No module named"),
        ("FEATURE = 3", "mine.feature:FEATURE: is no Feature"),
    ):
        (tmp_path / "mine/feature.py").write_text(broken)
        words = [sys.executable, ROOT / "calibrate.py", "fit", "s"]
        done = processes.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
        (line,) = done.stderr.splitlines()
        assert (done.returncode, f"calibrate: installed feature {says}" in line) == (2, True), done.stderr
        assert line.endswith("; correct or uninstall its package")


def test_what_a_feature_records_is_refused_without_it(tmp_path, monkeypatch):
    (tmp_path / "log0001.unit3.csv").write_text("")
    monkeypatch.setattr(features, "known", dict)
    with pytest.raises(tinygc.CalibrationError, match=r"log0001\.unit3\.csv is one unit's log of several"):
        tinygc.read_session(tmp_path)


def test_a_further_reference_is_no_reference_without_its_feature_and_has_all_that_is_asked_of_it(tmp_path, monkeypatch):
    served = [kind for kind in features.each("reference") if kind.accelerometer]
    for kind in served:
        assert {name for name in features.REFERENCE if not hasattr(kind, name)} <= inspect.get_annotations(kind).keys()
    sensor = "[sensor]\nodr_hz = 104\ngyro_fs_dps = 500\naccel_fs_g = 4\n"
    monkeypatch.setattr(features, "known", dict)
    for word in (kind.word for kind in served):
        (tmp_path / "session.toml").write_text(f'schema = "tinygc-session/1"\n{sensor}[protocol]\nreference = "{word}"\n')
        with pytest.raises(tinygc.CalibrationError, match=rf'protocol.reference is "{word}", expected one of gravity, table'):
            read_config(tmp_path / "session.toml")
        with pytest.raises(TypeError, match=word):
            tinygc.Session.from_arrays(**{word: ()})


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no checkout")
def test_nothing_outside_of_its_folder_names_a_feature():
    """Its folder, its commands, and its functions; what the house says of them all, and benchmarks and pages, may."""
    commands = "|".join(name for each in FEATURES.values() for name in each.commands)
    functions = "|".join(name for each in FEATURES.values() for name in each.public)
    named = [rf"features[./]({'|'.join(FEATURES)})\b"] if FEATURES else []
    named += [rf"calibrate(\.py)? ({commands})\b", rf"command_line\(\"({commands})\""] if commands else []
    named += [rf"tinygc\.({functions})\("] if functions else []
    if not named:
        pytest.skip("no feature is there")
    places = ("session", "tinygc", "calibrate.py", ":!tinygc/features", ":!session/log/config.py")
    found = subprocess.run(["git", "grep", "-nE", "|".join(named), "--", *places], cwd=ROOT, capture_output=True, text=True, check=False)
    assert found.stdout == ""


@pytest.mark.broad
def test_no_feature_works_where_nobody_asks():
    """A fit and an explanation of one sensor on a table import nothing of a feature but what it declares and answers by."""
    code = (
        "import sys, tinygc; s = tinygc.simulate(segments=10, closure_s=0.0, odr_hz=104.0).session; "
        "tinygc.fit(s, methods=('least_squares',)); tinygc.explain(s).summary(); "
        "print({name.split('.')[3] for name in sys.modules if '.features.' in name and name.count('.') > 2})"
    )
    done = processes.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, env=processes.environment())
    assert done.returncode == 0, done.stderr
    assert eval(done.stdout) <= {"feature", "options", "points", "names"}
