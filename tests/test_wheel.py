"""The wheel: built from the project's files, installed beside nothing of them, it has all that the commands need."""

import shutil
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from processes import run

pytestmark = pytest.mark.wheel


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder with the package as ``pip`` installs it from the wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for name in ("session", "tinygc"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "calibrate.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    built = run([*pip, "wheel", "--no-deps", "--wheel-dir", folder, source], capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("tinygc-*.whl")
    done = run([*pip, "install", "--no-deps", "--target", folder / "site", wheel], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


def test_it_holds_every_file_of_the_packages(installed):
    for package in ("session", "tinygc"):
        source = {path.relative_to(ROOT) for path in (ROOT / package).rglob("*") if path.is_file() and "__pycache__" not in path.parts}
        there = {path.relative_to(installed) for path in (installed / package).rglob("*") if path.is_file()}
        assert source <= there


def test_it_calibrates_and_reports(installed, simulated, tmp_path):
    session = tmp_path / "session"
    shutil.copytree(simulated(), session)
    for words in (["fit", session, "--methods", "least_squares"], ["report", session, "--no-explain"]):
        start = f"import sys; sys.path.insert(0, {str(installed)!r}); import calibrate"
        code = f"{start}; print(calibrate.__file__); sys.exit(calibrate.main(sys.argv[1:]))"
        done = run([sys.executable, "-P", "-c", code, *words, "--quiet"], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(str(installed))
    assert (session / "report.html").stat().st_size > 10_000
