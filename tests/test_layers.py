"""Who imports whom: the bench side starts at once, without the estimators."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in (ROOT / "session").rglob("*.py") if path.stem != "__init__"
)


def test_recording_never_loads_the_estimators():
    code = f"import sys, session, {', '.join(MODULES)}; print(sorted({{'torch', 'tinygc'}} & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True, cwd=ROOT).strip() == "[]"


@pytest.mark.parametrize("name", MODULES)
def test_no_module_of_the_bench_side_names_the_estimators(name):
    """Not even inside a function."""
    text = (ROOT / (name.replace(".", "/") + ".py")).read_text()
    lines = [line.strip() for line in text.splitlines()]
    assert not [line for line in lines if line.startswith(("import torch", "from torch", "import tinygc", "from tinygc"))]
