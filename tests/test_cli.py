"""The command line: its screens as they stand in tests/screens, its streams, its exit codes, and one clear line for what is refused."""

import json
import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import processes
import pytest
from conftest import ROOT, SESSION_TOML, Table, write_session
from feature import feature
from formats_page import strangers
from processes import HEADER, QUICK, refused, spoil

from tinygc.cli.arguments import parser
from tinygc.cli.commands import commands

# Screens: of a session of four turns; that of a fit stands in docs/tutorial.md.


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    """A session of four turns."""
    return write_session(
        tmp_path_factory.mktemp("screens") / "four",
        Table().tumble(4, seed=2).samples(odr_hz=104),
        toml=SESSION_TOML.replace("208.0", "104.0"),
    )


# Streams


def command_line(*arguments, shell="", **environment):
    """The command line in a process and shell of its own; ``shell`` is what follows the command, such as a redirection."""
    words = " ".join(shlex.quote(str(word)) for word in (sys.executable, ROOT / "calibrate.py", *arguments))
    return processes.run(["bash", "-c", f"{words} {shell}"], capture_output=True, env=processes.environment(**environment))


@pytest.mark.parametrize(
    ("shell", "code", "says"),
    [
        (">&- 2>&-", 0, ""),
        ("| true; exit ${PIPESTATUS[0]}", 0, ""),
        (">/dev/full", 2, "calibrate: standard output: No space left on device\n"),
    ],
)
def test_a_reader_that_has_gone_is_no_error_and_a_full_disk_is_named(shell, code, says):
    done = command_line("sensors", shell=shell)
    assert (done.returncode, done.stderr.decode()) == (code, says)


def test_json_has_standard_output_to_itself_in_an_encoding_without_our_signs(folder):
    """What it quotes of a file is not lost; nor is a terminal's escape printed."""
    path = folder / "session.toml"
    path.write_text('"é" = 1\n' + path.read_text(encoding="utf-8"), encoding="utf-8")
    done = command_line("check", folder, "--json", "-", PYTHONIOENCODING="ascii")
    assert done.stdout.isascii()
    assert any("é" in finding["description"] for finding in json.loads(done.stdout)["findings"])


def test_what_a_file_holds_is_never_printed_raw(run, folder):
    path = folder / "session.toml"
    text = path.read_text()
    path.write_text(text + '[notes]\n"[red]" = [1]\n')
    assert "notes.[red] is a list of 1, expected text" in " ".join(run("check", folder)[1].split())
    path.write_text(text)
    spoil(folder, lambda lines: [lines[0], "\x1b[31m\x07" + HEADER.replace("gx", "g\x1b[0m"), *lines[2:]])
    refused(run("fit", folder, *QUICK), "\\x1b[31m")
    assert "\x1b" not in "".join(run("check", folder)[1:])
    spoil(folder, lambda lines: ["# serial=\x1b[31mS", HEADER, *lines[2:]])
    assert "\\x1b[31mS" in run("check", folder)[1]


# What comes out


def test_limit_is_exit_code_1_and_says_which_figure_failed_and_a_session_that_may_only_be_read_is_fitted(
    run, folder, monkeypatch, tmp_path
):
    """--out DIR takes models and figures, makes its parents, and leaves the session as it was."""
    make = Path.mkdir

    def refuse(self, *args, **settings):
        if folder in (self, *self.parents):
            raise PermissionError(13, "Permission denied", str(self))
        return make(self, *args, **settings)

    monkeypatch.setattr(Path, "mkdir", refuse)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    out = tmp_path / "results" / "first"
    code, said, err = run("fit", folder, *QUICK, "--limit", "1e-6", "--out", out, "--quiet")
    assert sorted(path.name for path in out.iterdir()) == ["fit.json", "model_least_squares.json"]
    assert (code, said, err.count("\n")) == (1, "", 1)
    for words in ("--limit 0.00000100", "held-out turns close to 0.0", "closure0001.csv.gz is off by 0.0"):
        assert words in err
    refused(run("fit", folder, *QUICK), "Permission denied", str(folder))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_what_cannot_be_written_is_found_before_the_work(run, tmp_path):
    """The session is none: nobody has looked at it, and no trial leaves a trace."""
    (tmp_path / "file").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    refused(run("fit", tmp_path, "--out", tmp_path / "file" / "sub"), "file", "--out")
    refused(run("fit", tmp_path, "--json", tmp_path / "none" / "x.json"), "x.json", "--json")
    refused(run("fit", tmp_path, "--json", tmp_path), "--json")
    refused(run("fit", tmp_path, "--out", tmp_path / "new" / "er", "--json", tmp_path / "new" / "er" / "x.json"), "session.toml")
    assert sorted(tmp_path.rglob("*")) == before


def test_of_several_folders_each_goes_by_itself_and_the_worst_code_counts(run, four, folder, tmp_path):
    place, words = tmp_path / "out", ("--methods", "least_squares", "--quiet", "--out", tmp_path / "out")
    code, out, err = run("fit", four, folder, *words, "--json", tmp_path / "fits.json")
    assert code == 2
    (line,) = err.strip().splitlines()
    assert line.startswith(f"calibrate: {four}")
    assert out.startswith("1 of 2 fitted: 1 FAILED, 1 ")
    table = json.loads((tmp_path / "fits.json").read_text())
    assert not strangers(table)
    assert [(entry["exit_code"], entry["error"] is None) for entry in table["sessions"]] == [(2, False), (0, True)]
    assert json.loads((place / folder.name / "fit.json").read_text()) == table["sessions"][1]["result"]
    assert [path.name for path in place.iterdir()] == [folder.name]
    shutil.copytree(folder, tmp_path / "other" / folder.name)
    refused(run("fit", folder, tmp_path / "other" / folder.name, *words), "would both go to", "rename one")
    refused(run("report", folder, four, "--out", tmp_path / "r.html"), "leave --out out")


def test_list_says_what_lies_there(run, four, tmp_path):
    top = tmp_path / "data"
    for name in ("a", "broken", "deeper/still/d", "lost"):
        shutil.copytree(four, top / name)
    (top / "deeper/still/d/raw.times").write_text("host_ns,bytes,event\n71,0,open 2026-03-02T10:20:30Z /dev/ttyACM0\n72,0,\n")
    with (top / "a" / "session.toml").open("a") as file:
        file.write("\n[notes]\ndate = 2026-01-31\n")
    (top / "a" / "fit").mkdir()
    (top / "a" / "fit" / "fit.json").write_text('{"schema": "tinygc-fit/2", "methods": 3}')
    (top / "broken" / "session.toml").write_text("[sensor")
    (top / "lost" / "session.toml").unlink()
    (top / "no session").mkdir()
    code, out, err = run("check", top, "--json", tmp_path / "list.json")
    assert (code, err) == (0, "")
    table = json.loads((tmp_path / "list.json").read_text())
    assert not strangers(table)
    found = {os.path.relpath(entry["folder"], top): entry for entry in table["sessions"]}
    assert list(found) == ["a", "broken", "deeper/still/d", "lost"]
    assert all(name in out for name in found)
    assert (found["deeper/still/d"]["date"], found["deeper/still/d"]["date_from"]) == ("2026-03-02T10:20:30+00:00", "port")
    assert (found["a"]["date"], found["a"]["date_from"], found["a"]["logs"]) == ("2026-01-31", "notes", 1)
    for name, problem in (("a", "methods is 3"), ("broken", "broken TOML"), ("lost", "session.toml: not found")):
        assert problem in found[name]["problem"]
    assert "no session here" in run("check", top / "no session")[1]


# What is refused, in one line


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("fly", "; see --help"),
        ("budget x --seconds 0", "; see --help"),
        ("fit x --limit 0", "; see --help"),
        ("board --rate nan", "; see --help"),
        ("chek x", "'chek' is no command; is 'check' meant?"),
        ("fit x --limmit 0.1", "fit has no option --limmit; is '--limit' meant?"),
        ("fit x --seed 1", "fit has no option --seed; see --help"),
        ("export x --to kaliber", "argument --to: 'kaliber' is no choice, expected json, kalibr,"),
        ("export x --to kaliber", "is 'kalibr' meant?"),
        ("fit x --methods least-squares", "is 'least_squares' meant?"),
        *((f"fit x --exclude={text}", "no list of segment numbers") for text in ("", "-1", "3,,4")),
        ("--completion tcsh", "; see --help"),
        ("simulate --out NEW --effect gyro.thermal_bias", "without its parameters; give ID=JSON such as 'gyro.thermal_bias={"),
        ("simulate --out NEW --odr-hz 200", "--odr-hz is 200"),
        ("simulate --out NEW --vigour inf", "vigour"),
    ],
)
def test_bad_usage_is_one_line_with_the_nearest_word(run, tmp_path, words, says):
    refused(run(*words.replace("NEW", str(tmp_path / "s")).split()), says)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(("text", "name"), [("ros2", "ros"), ("X_IO", "xio"), ("Fusion", "xio"), ("PX4", "px4"), ("C99", "c")])
def test_formats_are_understood_in_other_spellings(text, name):
    assert parser(["export"]).parse_args(["export", "x", "--to", text]).to == name
    args = parser().parse_args(["fit", "--exclude", "3", "--exclude=4, 5", "folder"])
    assert (args.folder, args.exclude) == (Path("folder"), [3, 4, 5])


# Tab completion: the scripts as the shells themselves run them

NOISE = feature("tinygc.features.noise")
#: what is typed -> some of what is offered; what is not
TYPED = [
    ("calibrate ", {name for name in commands() if " " not in name} | {"--version"}, {"--json"}),
    *([("calibrate noise ", {"record"}, {"fit"}), ("calibrate noise record --ho", {"--hours"}, {"--json"})] if NOISE else []),
    ("calibrate re", {"record", "report"}, {"fit"}),
    ("calibrate fit --acc", {"--accelerometer"}, {"--json"}),
    ("calibrate fit --quiet --bi", {"--bias"}, {"--bi"}),
    ("calibrate fit --bias ", {"auto", "ends", "stills"}, {"--json"}),
    ("calibrate fit --limit ", set(), {"log"}),
    ("calibrate check --rep", {"--repair"}, {"fit"}),
    ("calibrate --q", set(), {"--quiet"}),
]


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_completes(shell, run, tmp_path):
    code, script, err = run("--completion", shell)
    assert (code, err) == (0, "")
    options = {flag for name in ("fit", "record") for flag in re.findall(r"(?<!\w)--[a-z-]+", run(name, "--help")[1])} - {"--help"}
    assert all(flag in script for flag in options)
    if shell == "zsh" or shutil.which(shell) is None:
        return
    (tmp_path / "script").write_text(script)
    asks = [
        f"COMP_WORDS=({' '.join(map(shlex.quote, words))}); COMP_CWORD={len(words) - 1}; _calibrate_complete 2>&1;"
        'echo "${COMPREPLY[@]}" | tr " " "\\n"; echo ---'
        for words in (typed.split(" ") for typed, _, _ in TYPED)
    ]
    done = processes.run(["bash", "--norc", "-c", "\n".join([f". {tmp_path}/script", *asks])], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    pieces = [{line.split("\t")[0] for line in piece.splitlines()} - {""} for piece in done.stdout.split("---\n")[:-1]]
    for (typed, some, none), words in zip(TYPED, pieces, strict=True):
        assert some - {"--version"} <= words, typed
        assert not none & words, typed
        assert words or not some, typed
