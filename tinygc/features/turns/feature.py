"""A gyroscope alone, by turns of known angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from session.base.errors import FormatError
from session.base.features import Feature
from session.base.options import Record, option, record_in, refuse_with
from session.base.texts import command_line
from tinygc.features.turns import TURNS

if TYPE_CHECKING:
    from session.replay.convert import Imported
    from session.replay.options import Answers
    from tinygc.cli.results import Done


class KnownAngles:
    """The turns' own angles as the reference, of logs without specific force."""

    word: ClassVar[str] = TURNS
    accelerometer: ClassVar[bool] = False


# Options that a gyroscope alone adds to commands of the core.


@dataclass(frozen=True)
class ImportOptions(Record):
    """Options of ``import``."""

    turns: Path | None = option(None, "of a gyroscope alone: turns.csv, the known angles of its turns", rare=True)


# What the core asks: each function answers None of any other folder, and imports the rest only where it is one.


def is_gyroscope_alone(folder: Path) -> bool:
    """Whether that is the reference of a folder; what cannot be read is none."""
    from session.base.toml import read_toml

    try:
        protocol = read_toml(folder / "session.toml").get("protocol") if (folder / "session.toml").exists() else None
    except (FormatError, OSError):  # who reads the folder reports it
        return False
    return isinstance(protocol, dict) and protocol.get("reference") == TURNS


def kind_of_folder(folder: Path) -> str | None:
    """State what the folder is, and what takes it."""
    if not is_gyroscope_alone(folder):
        return None
    return (
        f'protocol.reference is "{TURNS}": a gyroscope alone, whose turns are known; '
        f"`{command_line('fit', folder)}` takes it (tinygc.fit_turns in Python), and `apply` its model"
    )


def import_logs(
    paths: Sequence[Path], out: Path, answers: Answers, *, columns: Sequence[str], serial: str, add: str | None, further: Sequence[Any]
) -> Imported | None:
    """Make a session folder of a gyroscope alone, by the known turns of the file that ``--turns`` names."""
    own = record_in(further, ImportOptions)
    if own.turns is None:
        return None
    from tinygc.features.turns.importing import import_turns

    others: dict[str, object] = {"--add": add, "--even": answers.even}
    refuse_with("--turns", others, [each for each in further if each is not own])
    return import_turns(paths, out, answers, own.turns, columns, serial)


def fit(args: Any) -> Done | None:
    """Fit scale and bias by the known turns; None of a folder whose reference is another."""
    if not is_gyroscope_alone(args.folder):
        return None
    from tinygc.cli.results import Done, inside, output, try_destinations
    from tinygc.features.turns.library import fit_turns
    from tinygc.features.turns.result import MODEL
    from tinygc.reporting.terminal import progress_bar

    args.refuse_with("a gyroscope alone, which has no closure", "out", "verbose")
    try_destinations(args.out or inside(args.folder, "fit"), args.json)
    with progress_bar(args.quiet) as progress:
        result = fit_turns(args.folder, progress=progress)
    folder = result.save(args.out)
    output(args).print(result.page)
    output(args).print(f"model: {folder / MODEL}")
    used = int(result.estimate.used.sum())
    return Done(0, result.to_json(), f"a gyroscope alone, {used} of {len(result.angles)} turns: {MODEL}")


FEATURE = Feature(
    public={"fit_turns": "library", "TurnFit": "result"},
    serves={
        "kind of folder": "feature:kind_of_folder",
        "reference": "feature:KnownAngles",
        "fit of a folder": "feature:fit",
        "options of import": "feature:ImportOptions",
        "import of logs": "feature:import_logs",
    },
)
