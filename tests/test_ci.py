"""What a hosted service and a commit hook check is what ``.ci/run`` checks; the reference of the API keeps to what is there."""

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
RUN = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def commands():
    """Lines of ``.ci/run`` that are a command of their own."""
    return [line.strip() for line in RUN.splitlines()]


def steps(job):
    return [step["run"] for step in job["steps"] if "run" in step]


def test_the_hosted_service_runs_the_same_script():
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))["jobs"]
    assert steps(jobs["whole"]) == [".ci/run"]
    oldest = re.search(r"\d+\.\d+", SETTINGS["project"]["requires-python"]).group()
    assert jobs["whole"]["strategy"]["matrix"]["python"] == [oldest, "3.x"]
    last = {name: steps(jobs[name])[-1] for name in ("slow", "mutants")}
    assert last == {"slow": "python -m pytest -m slow", "mutants": "python benchmarks/mutation.py --week"}


def test_the_script_checks_types_the_reference_and_all_tests():
    assert "python docs/api.py" in commands()
    assert "tests" in commands()  # the quick suite
    markers = {line.split(":")[0] for line in SETTINGS["tool"]["pytest"]["ini_options"]["markers"]}
    (others,) = [line for line in commands() if line.startswith("tests -m")]
    assert set(re.findall(r"\w+", others)) - {"tests", "m", "or", "and", "not"} == markers
    assert all(f"not {marker}" in SETTINGS["tool"]["pytest"]["ini_options"]["addopts"] for marker in markers)
    assert SETTINGS["tool"]["mypy"]["files"] == ["tinygc", "session", "calibrate.py"]
    assert SETTINGS["tool"]["mypy"]["disallow_untyped_defs"] is True
    assert "ignore_errors" not in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert all((ROOT / package / "py.typed").exists() for package in ("tinygc", "session"))


def test_what_checks_has_a_pinned_version():
    pinned = set(re.findall(r"^([\w-]+)==", (ROOT / "constraints.txt").read_text(encoding="utf-8").lower(), re.M))
    extras = SETTINGS["project"]["optional-dependencies"]
    wanted = {re.match(r"[\w-]+", name).group().lower() for extra in ("test", "mutation", "docs") for name in extras[extra]}
    assert wanted - pinned == set()


def test_what_others_wrote_is_named_by_what_it_holds():
    """An action and a hook by their commits, the image by its digest; packages from one index: of two, pip takes the higher version."""
    workflow, hooks, image = (
        (ROOT / name).read_text(encoding="utf-8") for name in (".github/workflows/ci.yml", ".pre-commit-config.yaml", "Dockerfile")
    )
    used = re.findall(r"uses: *(\S+)", workflow) + re.findall(r"rev: *(\S+)", hooks) + re.findall(r"^FROM (\S+)", image, re.M)
    assert len(used) > 5
    assert all(re.fullmatch(r"(actions/[\w-]+@)?[0-9a-f]{40}|python:[\d.]+-slim-\w+@sha256:[0-9a-f]{64}", name) for name in used)
    pages = [(ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/platforms.md")]
    assert not any("extra-index" in text for text in (workflow, RUN, image, *pages))
