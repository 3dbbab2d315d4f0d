"""An installation: what a foreign module of one of our names does."""

import os
import sys

import pytest
from conftest import ROOT
from processes import environment, run

# Foreign modules of our names


def started(*words, path):
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
