"""Tab completion: the scripts as the shells themselves run them; what they offer is what the parser takes."""

from __future__ import annotations

import shlex
import shutil

import processes
import pytest

from tinygc.cli.arguments import parser
from tinygc.cli.commands import COMMANDS
from tinygc.cli.completion import SHELLS, script

#: what is typed -> some of what is offered; what is not
TYPED = [
    ("calibrate ", set(COMMANDS) | {"--version"}, {"--json"}),
    ("calibrate re", {"record", "report"}, {"fit"}),
    ("calibrate fit --acc", {"--accelerometer"}, {"--json"}),
    ("calibrate fit --quiet --bi", {"--bias", "--bias-dps", "--bias-per-log"}, {"--bi"}),
    ("calibrate fit --bias ", {"auto", "ends", "stills", "gravity"}, {"--json"}),
    ("calibrate fit --folds ", set(), {"log"}),
    ("calibrate completion ", set(SHELLS), {"fit"}),
    ("calibrate --q", set(), {"--quiet"}),
]


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not there")
def test_bash_completes(tmp_path):
    (tmp_path / "script").write_text(script("bash", parser()))
    words = [typed.split(" ") for typed, _, _ in TYPED]  # the last is what is being typed, and may be empty
    asks = [
        f'COMP_WORDS=({" ".join(map(shlex.quote, each))}); COMP_CWORD={len(each) - 1}; _calibrate_complete 2>&1; echo "${{COMPREPLY[@]}}"'
        for each in words
    ]
    done = processes.run(["bash", "--norc", "-c", "\n".join([f". {tmp_path}/script", *asks])], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    _hold([set(line.split()) for line in done.stdout.splitlines()])


def _hold(offered: list[set[str]]) -> None:
    assert len(offered) == len(TYPED)
    for (typed, some, none), words in zip(TYPED, offered, strict=True):
        if typed != "calibrate " or "--version" in words:  # fish offers options once a dash is typed
            assert some <= words, typed
        assert not none & words, typed
        if not some:
            assert not words, typed


def test_the_command_prints_it_and_imports_nothing_heavy(run):
    code, out, err = run("completion", "bash")
    assert (code, err) == (0, "")
    assert out == script("bash", parser())
    assert run("completion", "tcsh")[0] == 2
