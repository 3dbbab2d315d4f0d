"""What the core asks of a gyroscope alone: each function answers None of any other, and imports the rest only where it is one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.options import given_beside, record_in
from session.base.texts import command_line
from tinygc.features.turns.feature import ImportOptions
from tinygc.features.turns.names import TURNS, is_gyroscope_alone

if TYPE_CHECKING:
    from session.replay.convert import Converted
    from session.replay.options import Answers


def kind_of_folder(folder: Path) -> str | None:
    """Say what the folder is, and what takes it."""
    if not is_gyroscope_alone(folder):
        return None
    return (
        f'protocol.reference is "{TURNS}": a gyroscope alone, whose turns are known; '
        f"`{command_line('fit', folder)}` takes it (tinygc.fit_turns in Python), and `apply` its model"
    )


def import_logs(
    paths: Sequence[Path], out: Path, answers: Answers, *, columns: Sequence[str], serial: str, add: str | None, further: Sequence[Any]
) -> Converted | None:
    """Make a session folder of a gyroscope alone, by the known turns of the file that ``--turns`` names."""
    own = record_in(further, ImportOptions)
    if own.turns is None:
        return None
    from session.replay.importing import refuse_beside
    from tinygc.features.turns.importing import import_turns

    others: dict[str, object] = {"--add": add, "--even": answers.even}
    refuse_beside("--turns", {**others, **given_beside(further, own)})
    return import_turns(paths, out, answers, own.turns, columns, serial)
