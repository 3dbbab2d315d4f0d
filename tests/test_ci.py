"""What a hosted service and a commit hook check is what ``.ci/run`` checks; the reference of the API keeps to what is there."""

import importlib.util
import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
RUN = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
STYLE = ("ruff check .", "ruff format --check .", "mypy")


def commands() -> list[str]:
    """Lines of ``.ci/run`` that are a command of their own."""
    return [line.strip() for line in RUN.splitlines()]


def steps(job: dict) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


def test_the_hosted_service_runs_the_same_script():
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))["jobs"]
    assert steps(jobs["whole"]) == [".ci/run"]
    oldest = re.search(r"\d+\.\d+", SETTINGS["project"]["requires-python"]).group()
    assert jobs["whole"]["strategy"]["matrix"]["python"] == [oldest, "3.x"]
    assert {"windows-latest", "macos-latest"} == set(jobs["elsewhere"]["strategy"]["matrix"]["system"])
    installs = 'python -m pip install -e ".[{}]" -c constraints.txt'.format
    assert steps(jobs["slow"]) == [installs("test"), "python -m pytest -m slow"]
    assert steps(jobs["mutants"]) == [installs("test,mutation"), "python benchmarks/mutation.py --week"]
    assert steps(jobs["elsewhere"]) == [installs("test"), "python -m pytest", 'python -m pytest -m "broad and not slow"']


def test_the_hosted_service_builds_what_people_install():
    """Docker is not everywhere: the image is built there alone, from a file whose words are checked here."""
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))["jobs"]
    assert {"python -m build", "docker build -t tinygc .", "docker run --rm tinygc demo"} <= set(steps(jobs["packages"]))
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    copied = [word for line in lines if line.startswith("COPY ") and "--from" not in line for word in line.split()[1:-1]]
    assert all((ROOT / name).exists() and f"!{name}" in ignored for name in copied)
    oldest = re.search(r"\d+\.\d+", SETTINGS["project"]["requires-python"]).group()
    assert lines.index("USER calibrate") < lines.index('ENTRYPOINT ["calibrate"]')
    assert all(re.match(rf"FROM python:{oldest}-slim-\w+@sha256:[0-9a-f]{{64}}\b", line) for line in lines if line.startswith("FROM "))


def test_a_commit_is_checked_by_the_commands_of_the_script():
    repos = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    own = [hook["entry"] for repo in repos if repo["repo"] == "local" for hook in repo["hooks"]]
    assert tuple(own) == STYLE
    assert set(own) <= set(commands())


def test_what_others_wrote_is_named_by_what_it_holds():
    """An action and a hook by their commits, the image by its digest; packages from one index: of two, pip takes the higher version."""
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    used = [step["uses"] for job in yaml.safe_load(workflow)["jobs"].values() for step in job["steps"] if "uses" in step]
    assert used
    assert all(re.fullmatch(r"actions/[\w-]+@[0-9a-f]{40}", name) for name in used)
    repos = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    assert all(re.fullmatch(r"[0-9a-f]{40}", repo["rev"]) for repo in repos if repo["repo"] != "local")
    installing = [workflow, RUN, *((ROOT / name).read_text(encoding="utf-8") for name in ("Dockerfile", "README.md", "docs/platforms.md"))]
    assert not any("extra-index" in text for text in installing)


def test_the_script_tries_a_newer_python_too():
    newer = RUN[RUN.index("newest Python of this machine") :]
    assert "python calibrate.py fit data/session1" in newer
    assert "-c constraints.txt" in newer
    run = re.findall(r"tests/\S+\.py", newer)
    assert {"test_import.py", "test_html_report.py", "test_cli.py", "test_certificate.py"} <= {Path(name).name for name in run}
    assert all((ROOT / name).exists() for name in run)


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
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line}
    extras = SETTINGS["project"]["optional-dependencies"]
    wanted = {re.match(r"[\w-]+", name).group() for name in (*extras["test"], *extras["mutation"], *extras["docs"])}
    assert {name.lower() for name in wanted} <= {name.lower() for name in pinned}


@pytest.fixture(scope="module")
def api():
    spec = importlib.util.spec_from_file_location("api", ROOT / "docs" / "api.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("word", "there"),
    [
        ("tinygc.models.load", True),
        ("tinygc.models.lode", False),
        ("tinygc/models/files.py", True),
        ("tinygc/models/flies.py", False),
        ("held_out.py", True),
        ("held_up.py", False),
        ("LinearModel.vector", True),
        ("LinearModel.victor", False),
        ("linear.LinearModel", True),
        ("quadratic.LinearModel", False),
        ("session.toml", True),
        ("goodness.excess", True),
    ],
)
def test_a_reference_in_a_docstring_leads_somewhere(api, word, there):
    every = {"tinygc.models.load", "tinygc.models.linear.LinearModel", "tinygc.models.linear.LinearModel.vector"}
    assert api.is_known(every, word) is there


def test_a_public_name_without_a_docstring_is_a_problem(api, tmp_path, monkeypatch):
    documented = pytest.importorskip("pdoc.doc")
    (tmp_path / "spoilt.py").write_text(
        '"""A module."""\n\ndef said():\n    """Said in ``spoilt.Lost``."""\n\ndef unsaid():\n    pass\n\ndef _own():\n    pass\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    module = documented.Module(importlib.import_module("spoilt"))
    problems = api.problems_of(module, lambda word: word != "spoilt.Lost")
    assert problems == ["spoilt.said: ``spoilt.Lost`` is not there", "spoilt.unsaid: no docstring"]
