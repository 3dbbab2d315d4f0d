"""No output takes the place of what is read or recorded: every option that writes, of every command, as the parser lists them."""

import argparse
import gzip
import os
import shutil
from pathlib import Path

import processes
import pytest
from processes import refused

from session.base.errors import StorageError
from session.base.options import file_written, folder_written, log_written, path_read
from session.base.results import write_text_whole
from tinygc.cli import arguments
from tinygc.cli.commands import command_module, commands

#: a recording with one file of every name that docs/formats.md lists
RECORDED = (
    "session.toml",
    "log0001.csv",
    "log0002.csv.gz",
    "closure0001.csv",
    "rest0001.csv.gz",
    "attitudes.csv",
    "turns.csv",
    "truth0001.csv",
    "unclosed0001.csv",
    "raw.bin",
    "raw.times",
    "truth.json",
    "log0001.csv.changed1",
)
FILES, KINDS = (
    (file_written, log_written),
    (path_read, file_written, log_written, folder_written),
)
#: what a help page calls a path
METAVARS = {"FILE", "DIR", "PATH", "TOML", "CSV", "FOLDER"}
(GROUP,) = (action for action in arguments.parser()._actions if isinstance(action, argparse._SubParsersAction))
PARSERS: dict[str, argparse.ArgumentParser] = dict(GROUP.choices)


@pytest.fixture
def recording(tmp_path):
    folder = tmp_path / "D"
    folder.mkdir()
    for number, name in enumerate(RECORDED):
        (folder / name).write_bytes(b"recorded %d" % number)
    return folder


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def outputs(*kinds):
    """(command, option) of every argument that writes so."""
    return [(name, each.option_strings[-1]) for name, command in PARSERS.items() for each in command._actions if each.type in kinds]


def least(name, folder, option, path):
    """The shortest command line that has this output: whatever is read is the folder."""
    words = name.split()
    for action in PARSERS[name]._actions:
        needed = action.required or not action.option_strings
        words_alone = action.nargs == "*" and action.type not in KINDS
        if not needed or option in action.option_strings or action.nargs == 0 or words_alone:
            continue
        plain = next(iter(action.choices or ("50",)))
        value = folder if action.type is path_read else folder.parent / "new" if action.type in KINDS else plain
        words += [*action.option_strings[-1:], str(value)]
    return [*words, option, str(path)]


#: one of each kind, tried through every link
EACH_KIND = [("check", "--json"), ("apply", "--out"), ("record", "--json"), ("report", "--out")]
each_kind = pytest.mark.parametrize(("command", "option"), EACH_KIND)


@pytest.fixture
def idle(monkeypatch):
    """No command does anything: what is refused, is refused before."""

    def worked(args):
        raise AssertionError("the work began")

    for name in commands():
        monkeypatch.setattr(command_module(name), "run", worked)


def test_every_path_of_every_command_says_whether_it_is_read_or_written():
    """So that the output of a new command is held against the recordings, too."""
    silent = [
        f"{name} {action.dest}"
        for name, command in PARSERS.items()
        for action in command._actions
        if action.type is Path or (str(action.metavar).strip("…") in METAVARS and action.type not in KINDS)
        if not isinstance(action, argparse._SubParsersAction)
    ]
    assert silent == [], "give it type=path_read, file_written or folder_written (tinygc/cli/arguments.py)"
    assert {name for name, option in outputs(file_written) if option == "--json"} == set(commands()) - {
        "view"
    }  # which has no result but a page
    assert {*EACH_KIND, ("board", "--config"), ("board", "--link")} < set(outputs(*FILES))
    names = "temperature check record import noise rates history budget fit explain export simulate fleet demo"
    recording = {"noise record", "table record"}
    assert {name for name, _ in outputs(folder_written)} == {*names.split(), *recording} & set(commands())


@pytest.mark.parametrize(("command", "option"), outputs(*FILES))
def test_no_output_is_a_file_of_the_recording_that_is_read(run, idle, recording, command, option):
    before = contents(recording)
    for name in RECORDED if (command, option) in EACH_KIND else RECORDED[:2]:
        refused(run(*least(command, recording, option, recording / name)), option)
    for path in ("", "/", ".", "..", recording):
        refused(run(*least(command, recording, option, path)), option, "an empty name" if path == "" else "that is a folder")
    assert contents(recording) == before


@each_kind
def test_no_output_is_one_of_a_recording_by_another_name(run, idle, recording, tmp_path, command, option):
    """Of the recording that is read, and of one that nobody named."""
    before, there, path = contents(recording), tmp_path / "to", recording / "log0001.csv"
    other = tmp_path / "other"
    for each in (there, other):
        each.mkdir()
    (there / "symbolic").symlink_to(path)
    (there / "folder").symlink_to(path.parent)
    os.link(path, there / "hard")
    dotted = path.parent / ".." / path.parent.name / path.name
    for way in (path, there / "symbolic", there / "folder" / path.name, dotted, Path(os.path.relpath(path))):
        refused(run(*least(command, recording, option, way)), option)
        refused(run(*least(command, other, option, way)), option, "recording")
    if command != "record":  # which reads no recording; what is written is put in the link's place, not into the file
        refused(run(*least(command, recording, option, there / "hard")), option)
    if command != "apply":  # a new log beside others is a log
        refused(run(*least(command, recording, option, path.with_name(path.name.upper()))), option)
    assert contents(recording) == before


@each_kind
def test_an_output_that_is_nobodys_is_written(run, idle, recording, tmp_path, command, option):
    """The check lets through what it must: new files, old results, other files in a session folder."""
    (recording / "result.json").write_text('{"schema": "tinygc-check/2"}')
    for path in (tmp_path / "new.json", recording / "result.json", recording / "report.html"):
        with pytest.raises(AssertionError, match="the work began"):
            run(*least(command, recording, option, path))


@pytest.mark.parametrize("command", ["check", "fit", "explain", "board"])
def test_no_output_has_the_name_that_a_recording_will_have_or_of_a_model_or_result_that_is_read(run, idle, tmp_path, command):
    """``record --out D --json D/log0001.csv``: the log comes first, and the JSON after it."""
    folder = tmp_path / "D"
    for name in ("fit/model_least_squares.json", "fit/fit.json", "explain/explain.json"):
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_text('{"schema": "tinygc-fit/1"}')
        words = least(command, folder, "--json", folder / name)
        if f"{command}.json" == Path(name).name:
            with pytest.raises(AssertionError, match="the work began"):  # in the words that it writes there itself
                run(*words)
        elif command in ("check", "fit", "explain"):
            refused(run(*words), "--json", name)
        assert "tinygc" in (folder / name).read_text()
    more = ["--out", str(folder)] if command in ("fit", "explain") else []
    refused(run(*least(command, folder, "--json", folder / "log0001.csv"), *more), "--json", "recording")


@pytest.mark.skipif(not Path("/dev/fd").exists(), reason="no /dev/fd on this system")
def test_an_open_file_is_what_it_leads_to_and_standard_output_no_recording(run, idle, recording, tmp_path):
    before = contents(recording)
    for source in (recording, tmp_path):
        with (recording / "log0001.csv").open("r+b") as file:
            refused(run("check", source, "--json", f"/dev/fd/{file.fileno()}"), "--json")
    with (recording / "log0001.csv").open("ab") as file:
        done = processes.run([*processes.CALIBRATE, "check", recording], stdout=file, stderr=processes.PIPE)
    assert (done.returncode, b"standard output: is" in done.stderr) == (2, True)
    assert contents(recording) == before


def test_the_same_result_is_written_again_unasked_and_over_nothing_else(run, folder, tmp_path):
    path = tmp_path / "result"
    assert run("check", folder, "--json", path)[0] == run("check", folder, "--json", path)[0] == 0
    for text in ("my notes on TinyGC\n", 'title = "mine"\nschema = "tinygc-defaults/1"\n', "x" * 65536 + '\nschema = "tinygc-session/1"\n'):
        path.write_text(text)
        refused(run("check", folder, "--json", path), "is no result of this tool")
        assert path.read_text() == text
    refused(run("board", "--config", path), "is no result of this tool", "--force")


def test_two_outputs_are_not_one_and_a_link_is_none(run, idle, recording, tmp_path):
    one = tmp_path / "one"
    one.write_text("")
    (tmp_path / "link").symlink_to(one)
    (tmp_path / "nowhere").symlink_to(tmp_path / "nothing")
    refused(run("report", recording, "--out", one, "--json", one), "--out", "--json")
    refused(run("report", recording, "--out", one, "--json", tmp_path / "link"), "--out", "--json")
    refused(run("board", "--config", tmp_path / "new", "--json", tmp_path / "x" / ".." / "new"), "--config", "--json")
    refused(run("check", recording, "--json", tmp_path / "nowhere"), "is a link to")


# The last door


def test_nothing_is_written_whole_over_a_recording(recording):
    before = contents(recording)
    for name in RECORDED:
        with pytest.raises(StorageError, match="is a file of the recording"):
            write_text_whole(recording / name, "mine")
    assert contents(recording) == before


def test_a_simulation_replaces_only_a_simulation(run, simulated, tmp_path):
    made, real = shutil.copytree(simulated(), tmp_path / "made"), tmp_path / "real.csv.gz"
    real.write_bytes(gzip.compress(b"recorded"))
    again = ("simulate", "--out", made, "--force", "--segments", 4, "--odr-hz", 104)
    log = made / "log0001.csv.gz"
    for link in (log.symlink_to, log.hardlink_to):
        log.unlink()
        link(real)
        refused(run(*again), "log0001.csv.gz", "not replaced")
        assert gzip.decompress(real.read_bytes()) == b"recorded"
    log.unlink()
    (made / "raw.bin").write_bytes(b"recorded")
    refused(run(*again), "raw.bin", "not replaced")
    (made / "raw.bin").unlink()
    refused(run(*again[:3]), "not empty")
    (made / "session.toml").write_text((made / "session.toml").read_text().partition("\n")[2])
    refused(run(*again), "session.toml", "not replaced")
    (made / "truth.json").unlink()
    refused(run(*again), "truth.json is missing")
