"""Write the tables of options into docs/commands.md and docs/library.md: python docs/make_options.py.

They are made of the records of options (session/base/options.py), between two comments of each page; tests/test_options.py holds the pages
to them.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from session.base import features  # noqa: E402
from session.base.options import declared, flag, help_of, metavar, typed_as  # noqa: E402
from session.replay.options import Answers  # noqa: E402
from tinygc.cli.commands import command_module, commands  # noqa: E402
from tinygc.cli.options import Command, Force, Judged, Pictures, Stream, UsesEffects  # noqa: E402
from tinygc.cli.recording import Recording, Turning  # noqa: E402
from tinygc.estimation.options import FitOptions, Seed  # noqa: E402
from tinygc.simulation.options import SimulationOptions  # noqa: E402

#: records that several commands have -> what the page calls them
SHARED: dict[type, str] = {
    Command: "every command",
    UsesEffects: "commands that use the catalogue of effects",
    Stream: "commands that read a port",
    Force: "commands that write files by name",
    Seed: "commands that draw",
    Pictures: "commands that draw their result",
    Judged: "`fit` and `report`",
    FitOptions: "`fit`, `report` and `budget`",
    Recording: "every `record`",
    Turning: "`record` and `table record`",
    Answers: "`import`",
}
#: what stands before and behind the tables of a page
BEGIN, END = "<!-- made by docs/make_options.py -->\n", "<!-- end -->"


def rows(kind: Any) -> Iterator[str]:
    """A row for each option of a record that stands in no table of its shared ones."""
    shared = {each.name for base in SHARED if base is not kind and issubclass(kind, base) for each, _ in declared(base)}
    for each, rule in declared(kind):
        if rule.cli and (each.name not in shared or each.name in inspect.get_annotations(kind)):
            value = metavar(each, rule)
            name = value or each.name.upper() if rule.positional else f"{flag(kind, each.name)} {value}".strip()
            yield _row(f"`{name}`", help_of(each, rule))


def _row(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def commands_text() -> str:
    """All commands, with the options that each has alone, then those that several have."""
    lines = []
    for name, summary in commands().items():
        module: Any = command_module(name)
        kinds = [module.Options, *features.each(f"options of {name}")]
        shared = [called for base, called in SHARED.items() if issubclass(module.Options, base) and base is not Command]
        own = [row for kind in kinds for row in rows(kind)]
        lines += [f"### {name}", "", f"{summary[0].upper()}{summary[1:]}."]
        lines += [f"Also those of {', of '.join(shared)}.", ""] if shared else [""]
        lines += ["| option | what it does |", "| --- | --- |", *own, ""] if own else []
    for kind, called in SHARED.items():
        lines += [f"### Of {called}", "", "| option | what it does |", "| --- | --- |", *rows(kind), ""]
    return "\n".join(lines)


def library_text() -> str:
    """The keywords of each record."""
    lines = []
    records = {FitOptions: "`fit`, `report`, `budget`", SimulationOptions: "`simulate`", Answers: "what a log may not state"}
    for kind, called in records.items():
        lines += [f"### {kind.__name__}: {called}", "", "| keyword | type | default | meaning |", "| --- | --- | --- | --- |"]
        for each, rule in declared(kind):
            unit = f"{rule.unit}; " if rule.unit else ""
            lines.append(_row(f"`{each.name}`", *typed_as(each, rule), f"{unit}{rule.help}"))
        lines.append("")
    return "\n".join(lines)


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
