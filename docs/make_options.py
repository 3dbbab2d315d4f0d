"""Write the options into docs/commands.md, and into docs/library.md with what the library's functions take and give.

``python docs/make_options.py`` makes them of the records of options (session/base/options.py) and of docstrings, between two comments of
each page; tests/test_options.py compares the pages with them.
"""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import tinygc  # noqa: E402
from session.base import features  # noqa: E402
from session.base.options import declared, flag, help_of, metavar, typed_as  # noqa: E402
from session.replay.options import Answers  # noqa: E402
from tinygc.cli.commands import command_module, commands  # noqa: E402
from tinygc.cli.options import Command, Force, Pictures, Stream, UsesEffects, VerdictOptions  # noqa: E402
from tinygc.cli.recording import Recording, Turning  # noqa: E402
from tinygc.estimation.options import FitOptions, Seed  # noqa: E402
from tinygc.simulation.options import SimulationOptions  # noqa: E402

#: records that several commands have -> their heading on the page
SHARED: dict[type, str] = {
    Command: "All commands",
    UsesEffects: "Effects",
    Stream: "Port",
    Force: "Files",
    Seed: "Draws",
    Pictures: "Pictures",
    VerdictOptions: "Limits",
    FitOptions: "Fit options",
    Recording: "Recordings",
    Turning: "Guided turns",
    Answers: "Logs",
}
#: command -> its function, where that is not its namesake in tinygc
FUNCTIONS = {
    "demo": "tinygc.simulate",
    "import": "tinygc.import_log",
    "board": "tinygc.simulation.virtual_board.VirtualBoard",
    "record": "session.bench.guided_session.GuidedRecording",
    "view": "tinygc.reporting.view.page.whole_page",
    "noise": "tinygc.estimate_noise",
    "noise record": "session.bench.rest_guide.RestGuide",
    "table": "tinygc.features.tables.machines.makes.open_table",
    "table record": "tinygc.features.tables.recording.TurnedRecording",
    "rates": "tinygc.estimate_rates",
    "temperature": "tinygc.fit_temperature",
    "challenge": "tinygc.features.challenge.examination.examine",
}
#: of an option on the page, where a clause ends before
MOST_WORDS = 6
#: of an argument whose name states what it is
MOST_OF_PLACES = 4
#: what stands before and behind the tables of a page
BEGIN, END = "<!-- made by docs/make_options.py -->\n", "<!-- end -->"


def rows(*kinds: Any) -> Iterator[str]:
    """A row for each usual option of these records that stands in no list of its shared ones, and one that names the others."""
    rare = []
    for kind in kinds:
        shared = {each.name for base in SHARED if base is not kind and issubclass(kind, base) for each, _ in declared(base)}
        for each, rule in declared(kind):
            if rule.cli and (each.name not in shared or each.name in inspect.get_annotations(kind)):
                value = metavar(each, rule)
                name = value or each.name.upper() if rule.positional else f"{flag(kind, each.name)} {value}".strip()
                if rule.positional and len(help_of(each, rule).split()) < MOST_OF_PLACES:
                    continue
                if rule.rare:
                    rare.append(f"`{name.split()[0]}`")
                else:
                    yield f"- `{name}`: {brief(help_of(each, rule))}"
    if rare:
        yield f"- more: {', '.join(rare)}"


def brief(text: str) -> str:
    """The first clause of a help text; ``--help`` has all of it.  A list of more than three is kept, and what follows a few words."""
    if text.count("; ") > 3:
        return text
    clause = re.split(r"; | \((?!\d)", text, maxsplit=1)[0]
    before, colon, _ = clause.partition(": ")
    clause = before if colon and len(before.split()) > 4 else clause
    while ":" not in clause and "one of" not in clause and len(clause.split()) > MOST_WORDS and len(clause.rpartition(", ")[0].split()) > 3:
        clause = clause.rpartition(", ")[0]
    return clause


def commands_text() -> str:
    """All commands, with the options that each has alone, then those that several have."""
    lines = []
    for name, summary in commands().items():
        module: Any = command_module(name)
        kinds = [module.Options, *features.each(f"options of {name}")]
        shared = [called for base, called in SHARED.items() if issubclass(module.Options, base) and base is not Command]
        own = [*rows(*kinds)]
        links = ", ".join(f"[{each}](#{each.lower().replace(' ', '-')})" for each in shared)
        also = f" Also: {links}." if shared else ""
        lines += [f"### {name}", "", f"{summary[0].upper()}{summary[1:]}.{also}", "", *own, *[""] * bool(own)]
    for kind, called in SHARED.items():
        lines += [f"### {called}", "", *rows(kind), ""]
    return "\n".join(lines)


def library_text() -> str:
    """The function of each command, the other functions, and the keywords that are no option."""
    functions = {name: FUNCTIONS.get(name, f"tinygc.{name}") for name in commands()}
    lines = ["### Functions", "", "The function of each command, and what it returns where that has a name of its own:", ""]
    lines += [f"- `{name}`: `{dotted}`{returned(there(dotted))}" for name, dotted in functions.items()]
    others = [name for name in dir(tinygc) if inspect.isfunction(getattr(tinygc, name)) and f"tinygc.{name}" not in functions.values()]
    lines += ["", "Others:", ""]
    lines += [f"- `tinygc.{name}`: {first_sentence(getattr(tinygc, name))}" for name in others]
    lines.append("")
    for kind in (FitOptions, SimulationOptions):
        lines += [f"### {kind.__name__}", ""]
        for each, rule in declared(kind):
            if not rule.cli:
                unit = f"{rule.unit}; " if rule.unit else ""
                lines.append(f"- `{each.name}` ({typed_as(each, rule)[1] or 'None'}): {unit}{brief(rule.help)}")
        lines.append("")
    return "\n".join(lines)


def there(dotted: str) -> Any:
    """What a dotted name stands for."""
    parts = dotted.split(".")
    if len(parts) == 2:
        return getattr(tinygc, parts[1])
    return getattr(importlib.import_module(".".join(parts[:-1])), parts[-1])


def returned(thing: Any) -> str:
    """Behind a comma, the name of what a function returns, where it is declared."""
    name = str(getattr(thing, "__annotations__", {}).get("return", "")).rpartition(".")[2]
    return f", `{name}`" if name not in ("", "Any", "None") else ""


def first_sentence(thing: Any) -> str:
    """Of its docstring, without the double backticks of code."""
    text = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    return re.split(r"(?<=[.;])\s|: | \(", text, maxsplit=1)[0].rstrip(".;").replace("``", "`")


def made(page: str, text: str) -> str:
    """A page with the text between its comments."""
    return re.sub(f"{re.escape(BEGIN)}.*?{re.escape(END)}", lambda found: f"{BEGIN}\n{text}\n{END}", page, flags=re.S)


PAGES = {"commands.md": commands_text, "library.md": library_text}


def main() -> int:
    """Write both pages."""
    for name, text in PAGES.items():
        path = ROOT / "docs" / name
        path.write_text(made(path.read_text(encoding="utf-8"), text()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
