"""No output takes the place of what is read or recorded: every option that writes, of every command, as the parser lists them."""

import argparse
import os
from functools import cache
from pathlib import Path

import processes
import pytest
from commandline import refused
from conftest import broad
from processes import PIPE
from recorded_files import RECORDED, contents, make_recording

from tinygc.cli.arguments import Paths, file_written, folder_written, log_written, parser, path_read
from tinygc.cli.commands import command_module, present_commands

recording = pytest.fixture(make_recording, name="recording")
KINDS = (path_read, file_written, log_written, folder_written)
#: what a help page calls a path
METAVARS = {"FILE", "DIR", "PATH", "TOML", "CSV", "FOLDER"}


@cache
def command_parsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of each command."""
    (commands,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    return dict(commands.choices)


def outputs(*kinds) -> list[tuple[str, str]]:
    """(command, option) of every argument that writes so."""
    return [
        (name, action.option_strings[-1])
        for name, command in command_parsers().items()
        for action in command._actions
        if action.type in kinds
    ]


def least(command: argparse.ArgumentParser, folder: Path, option: str, path: Path) -> list[str]:
    """The shortest command line that has this output: whatever is read is the folder."""
    words = []
    for action in command._actions:
        needed = action.required or not action.option_strings
        words_alone = action.nargs == "*" and action.type not in KINDS
        if not needed or option in action.option_strings or action.nargs in ("?", 0) or words_alone:
            continue
        value = (
            str(folder) if action.type is path_read else str(folder.parent / "new") if action.type in KINDS else next(iter(action.choices))
        )
        words += [*action.option_strings[-1:], value]
    return [*words, option, str(path)]


#: those that are tried through every link: one with each command, the others with one command of each kind
EVERY_WAY = ("session.toml", "log0001.csv", "raw.bin")
OF_EACH_KIND = ("check", "apply", "record", "report")
OF_SOME = [(pytest.param if each[0] in OF_EACH_KIND else broad)(*each) for each in outputs(file_written, log_written)]


@pytest.fixture
def idle(monkeypatch):
    """No command does anything: what is refused, is refused before."""

    def worked(args):
        raise AssertionError("the work began")

    for name in present_commands():
        monkeypatch.setattr(command_module(name), "run", worked)


def ways_to(path: Path, there: Path, every: bool) -> dict[str, Path]:
    """The same file by other names, made in ``there``; or by its own alone."""
    if not every:
        return {"its name": path}
    there.mkdir()
    (there / "symbolic").symlink_to(path)
    (there / "folder").symlink_to(path.parent)
    ways = {
        "its name": path,
        "a symbolic link": there / "symbolic",
        "a linked folder": there / "folder" / path.name,
        "..": path.parent / ".." / path.parent.name / path.name,
        "another case": path.with_name(path.name.upper()),
        "from here": Path(os.path.relpath(path)),
    }
    os.link(path, there / "hard")
    return ways | {"a hard link": there / "hard"}


def test_every_path_of_every_command_says_whether_it_is_read_or_written():
    """So that the output of a new command is held against the recordings, too."""
    silent = [
        f"{name} {action.dest}"
        for name, command in command_parsers().items()
        for action in command._actions
        if action.type is Path or (str(action.metavar).strip("…") in METAVARS and action.type not in KINDS)
        if not isinstance(action, argparse._SubParsersAction)
    ]
    assert silent == [], "give it type=path_read, file_written or folder_written (tinygc/cli/arguments.py)"
    assert {name for name, option in outputs(file_written) if option == "--json"} == set(present_commands())
    assert set(outputs(file_written, log_written)) > {("report", "--out"), ("apply", "--out"), ("board", "--config"), ("board", "--link")}
    names = "check record import accelerometer noise rates history budget fit explain export simulate fleet demo"
    assert {name for name, _ in outputs(folder_written)} == set(names.split()) & set(present_commands())
    for command in command_parsers().values():
        assert isinstance(command.get_default("paths"), Paths)


@pytest.mark.parametrize(("command", "option"), outputs(file_written, log_written))
def test_no_output_is_a_file_of_the_recording_that_is_read(run, idle, recording, tmp_path, command, option):
    before = contents(recording)
    for name in RECORDED:
        for way, path in ways_to(
            recording / name, tmp_path / f"to {name}", name in EVERY_WAY[: 3 if command in OF_EACH_KIND else 1]
        ).items():
            words = least(command_parsers()[command], recording, option, path)
            if (
                command in ("ports", "sensors", "demo", "simulate", "challenge", "record", "board", "table", "list", "completion")
                and way == "a hard link"
            ):
                continue  # they read no recording; what is written is put in the link's place, not into the file
            if command == "apply" and option == "--out" and way == "another case" and not path.exists():
                continue  # a new log beside others is a log
            refused(run(command, *words), option)
            assert contents(recording) == before, (name, way)


@pytest.mark.parametrize(("command", "option"), outputs(file_written))
def test_no_output_has_the_name_that_a_recording_will_have(run, idle, tmp_path, command, option):
    """``record --out D --json D/log0001.csv``: the log comes first, and the JSON after it."""
    folder = tmp_path / "D"
    folder.mkdir()
    for _, out in outputs(folder_written):
        words = least(command_parsers()[command], folder, option, folder / "log0001.csv")
        if (command, out) in outputs(folder_written):
            words += [out, str(folder)]
        elif not any(action.type is path_read and not action.option_strings for action in command_parsers()[command]._actions):
            continue  # it has no folder
        if command in ("board", "list"):
            words = [str(folder), *words]
        refused(run(command, *words), option, "recording")


@pytest.mark.parametrize(("command", "option"), OF_SOME)
def test_an_output_that_is_nobodys_is_written(run, idle, recording, tmp_path, command, option):
    """The check lets through what it must: new files, old results, other files in a session folder."""
    (recording / "result.json").write_text('{"schema": "tinygc-check/2"}')
    (tmp_path / "log0001.csv").write_text("in no session")
    for path, force in (
        *((tmp_path / "new.json", ()), (recording / "result.json", ()), (recording / "report.html", ())),
        (tmp_path / "log0001.csv", ("--force",)),
    ):
        words = [*least(command_parsers()[command], recording, option, path), *force]
        if force and (command, option) in outputs(file_written):
            refused(run(command, *words[:-1]), option, "is no result of this tool", "--force")
        with pytest.raises(AssertionError, match="the work began"):
            run(command, *words)


@pytest.mark.parametrize("command", ["check", "report", "export", "compare", "plan", "fit", "explain"])
def test_no_output_is_a_model_or_a_result_that_is_read(run, idle, recording, tmp_path, command):
    for name in ("fit/model_least_squares.json", "fit/fitted.json", "fit/fit.json", "explain/explain.json"):
        (recording / name).parent.mkdir(exist_ok=True)
        (recording / name).write_text('{"schema": "tinygc-fit/1"}')
        words = least(command_parsers()[command], recording, "--json", recording / name)
        if f"{command}.json" == Path(name).name:
            with pytest.raises(AssertionError, match="the work began"):  # in the words that it writes there itself
                run(command, *words)
        else:
            refused(run(command, *words), "--json", name)
            assert "tinygc" in (recording / name).read_text()


@pytest.mark.skipif(not Path("/dev/fd").exists(), reason="no /dev/fd on this system")
def test_an_open_file_is_what_it_leads_to(run, idle, recording, tmp_path):
    for source in (recording, tmp_path):
        with (recording / "log0001.csv").open("r+b") as file:
            refused(run("check", source, "--json", f"/dev/fd/{file.fileno()}"), "--json")
            refused(run("check", source, "--json", f"/proc/self/fd/{file.fileno()}"), "--json")


WRITTEN_AGAIN = {
    "check": ("check", "SESSION", "--json"),
    "report": ("report", "SESSION", "--out"),
    "certificate": ("report", "SESSION", "--certificate"),
    "fleet": ("fleet", "PARENT", "--csv"),
}


@pytest.mark.parametrize("name", ["check", *map(broad, list(WRITTEN_AGAIN)[1:])])
def test_the_same_result_is_written_again_unasked_and_over_nothing_else(run, folder, tmp_path, name):
    place = {"SESSION": folder, "PARENT": folder.parent}
    if name != "check":
        assert run("fit", folder, "--methods", "least_squares", "--quiet")[0] == 0
    words, path = [place.get(word, word) for word in WRITTEN_AGAIN[name]], tmp_path / "result"
    more = ["--out", tmp_path / "fleet"] if name == "fleet" else []
    usual = run(*words, path, *more)[0]
    assert path.stat().st_size > 100
    assert usual != 2
    again = run(*words, path, *more)
    assert again[0] == usual, again
    path.write_text("my notes on TinyGC\n")
    refused(run(*words, path, *more), "is no result of this tool", "--force")
    assert path.read_text() == "my notes on TinyGC\n"
    assert run(*words, path, *more, "--force")[0] == usual
    assert path.read_text() != "my notes on TinyGC\n"


@pytest.mark.parametrize("text", ['title = "mine"\nschema = "tinygc-defaults/1"\n', "x" * 65536 + '\nschema = "tinygc-session/1"\n'])
def test_a_text_that_quotes_a_schema_is_no_result(run, idle, recording, tmp_path, text):
    (tmp_path / "notes").write_text(text)
    refused(run("check", recording, "--json", tmp_path / "notes"), "is no result of this tool", "--force")


def test_a_link_is_refused_before_the_work(run, idle, recording, tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    refused(run("check", recording, "--json", tmp_path / "link"), "is a link to")


def test_standard_output_may_not_be_a_recording(recording):
    before = contents(recording)
    for stream in ("stdout", "stderr"):
        with (recording / "log0001.csv").open("ab") as file:
            done = processes.run([*processes.CALIBRATE, "check", recording], **{"stdout": PIPE, "stderr": PIPE, stream: file})
        assert done.returncode == 2
        if stream == "stdout":
            assert b"standard output: is" in done.stderr
            assert contents(recording) == before


def test_two_outputs_are_not_one(run, idle, recording, tmp_path):
    one = tmp_path / "one"
    one.write_text("")
    (tmp_path / "link").symlink_to(one)
    refused(run("report", recording, "--out", one, "--json", one), "--out", "--json")
    refused(run("report", recording, "--out", one, "--json", tmp_path / "link"), "--out", "--json")
    refused(run("board", "--config", tmp_path / "new", "--json", tmp_path / "x" / ".." / "new"), "--config", "--json")


def test_an_output_without_a_name_is_refused(run, recording):
    for command, option in outputs(file_written, log_written, folder_written):
        refused(run(command, *least(command_parsers()[command], recording, option, "")), option, "an empty name")
    for command, option in outputs(file_written, log_written):
        for folder in ("/", ".", "..", recording):
            refused(run(command, *least(command_parsers()[command], recording, option, folder)), option, "that is a folder")


def test_inputs_of_apply_stay(run, idle, tmp_path):
    """Its model and log lie in no session folder here."""
    for name in ("model.json", "walk.csv"):
        (tmp_path / name).write_text("read")
    os.link(tmp_path / "walk.csv", tmp_path / "hard.csv")
    for out in ("model.json", "walk.csv", "hard.csv"):
        for option, other in (("-o", "--json"), ("--json", "-o")):
            words = ["apply", tmp_path / "model.json", tmp_path / "walk.csv", other, tmp_path / "new", option, tmp_path / out, "--force"]
            refused(run(*words), "that this command reads")
    (tmp_path / "session.toml").write_text("schema")
    refused(run("apply", tmp_path / "model.json", tmp_path / "walk.csv", "-o", tmp_path / "session.toml", "--force"), "session.toml")


def test_no_folder_output_puts_a_file_over_a_recordings(run, recording, folder, tmp_path, monkeypatch):
    """An exporter's, or anybody's, file with such a name; a fit, whose names are others, may go into any folder."""
    assert run("fit", folder, "--methods", "least_squares", "--quiet", "--out", recording)[0] == 0
    assert run("fit", folder, "--methods", "least_squares", "--quiet")[0] == 0
    assert {name: data for name, data in contents(recording).items() if name in RECORDED} == {
        name: b"recorded %d" % number for number, name in enumerate(RECORDED)
    }
    before = contents(recording)

    class Exporter:
        @staticmethod
        def export(model, context):
            return {"Session.toml" if (recording / "SESSION.TOML").exists() else "session.toml": "mine"}

    monkeypatch.setattr("tinygc.deploy.exports.exporter", lambda name: Exporter)
    refused(run("export", folder, "--to", "json", "--out", recording), "session.toml", "recording")
    assert contents(recording) == before
