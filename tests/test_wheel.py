"""Wheel and sdist: built from the project's files, installed beside nothing of them, they have all that the commands and the tests need."""

import os
import shutil
import sys
import sysconfig
import tarfile
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import ROOT
from processes import environment, run

pytestmark = pytest.mark.wheel

#: what lies in a checkout and is not of it
NOT_OURS = shutil.ignore_patterns(
    ".git", "__pycache__", "*.egg-info", "build", "dist", ".venv", ".*_cache", ".hypothesis", "fit", "downloads"
)
#: what building adds to an sdist
ADDED = {"PKG-INFO", "setup.cfg"}
#: in which no file of the checkout is imported
CLEAN = environment(PYTHONPATH="", PYTHONNOUSERSITE="1")


@dataclass(frozen=True)
class Built:
    """sdist: of a copy of the checkout; wheel: made from the sdist, as ``python -m build`` does."""

    sdist: Path
    wheel: Path


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    pytest.importorskip("build", reason="python -m pip install build")
    folder = tmp_path_factory.mktemp("built")
    source = folder / "source"
    shutil.copytree(ROOT, source, ignore=NOT_OURS)
    done = run([sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, source], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    (sdist,), (wheel,) = (folder.glob(name) for name in ("*.tar.gz", "*.whl"))
    return Built(sdist, wheel)


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """The commands' folder of an environment that holds the wheel; what the wheel depends on is seen through a path."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "--python", scripts / "python"]
    done = run([*pip, "install", "--no-deps", "--no-index", built.wheel], env=CLEAN, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    site = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    assert (site / "calibrate.py").exists()
    paths = dict.fromkeys(sysconfig.get_path(name) for name in ("purelib", "platlib"))
    (site / "dependencies.pth").write_text("".join(f"{path}\n" for path in paths), encoding="utf-8")
    return scripts


def test_the_wheel_holds_every_file_of_the_packages_and_no_other(built):
    source = {
        path.relative_to(ROOT).as_posix()
        for package in ("session", "tinygc")
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    with zipfile.ZipFile(built.wheel) as packed:
        names = {name for name in packed.namelist() if ".dist-info/" not in name}
    assert names == source | {"calibrate.py"}


def test_the_sdist_holds_every_file_that_git_keeps_and_no_other(built):
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("no git checkout")
    listed = run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True)
    kept = {name for name in listed.stdout.splitlines() if (ROOT / name).exists()}
    with tarfile.open(built.sdist) as packed:
        names = {member.name.split("/", 1)[1] for member in packed if member.isfile()}
    assert {name for name in names if ".egg-info/" not in name} - ADDED == kept


def test_a_fresh_installation_calibrates_in_one_command(installed, tmp_path):
    """The screen is that of the README, from files of the wheel alone; then the commands that it names."""
    where = "import calibrate, session, tinygc; print(calibrate.__file__, session.__file__, tinygc.__file__, sep='\\n')"
    done = run([installed / "python", "-c", where], cwd=tmp_path, env=CLEAN, capture_output=True, text=True, check=True)
    assert all(Path(line).is_relative_to(installed.parent) for line in done.stdout.splitlines())
    done = run([installed / "calibrate", "demo"], cwd=tmp_path, env=CLEAN, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (shown,) = (block for block in readme.split("```\n") if "\nPASS" in block)
    printed = [line.rstrip() for line in done.stdout.splitlines()]
    assert {line for line in shown.splitlines()[1:] if line != "…"} <= set(printed)
    assert "next: calibrate report tinygc-demo" in printed
    done = run([installed / "calibrate", "report", "tinygc-demo", "--no-explain", "--quiet"], cwd=tmp_path, env=CLEAN, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "tinygc-demo" / "report.html").stat().st_size > 10_000
