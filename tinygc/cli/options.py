"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from session.base.options import Record, declared, file_written, given, option, refuse_with
from tinygc.cli.arguments import stream_header
from tinygc.estimation.options import Limit

LONGEST_S = 1e9  #: up to 30 years, which a program can wait for and a counter can hold
EFFECTS_HELP = "folder with further effects, a Python file each, which is run; may be given several times"


R = TypeVar("R")

# Options that several commands have.


@dataclass(frozen=True)
class Command(Record):
    """Options of every command; of_features: the records of options that features add to it; defaults: of its JSON, what was
    taken of the user's own; of_several: whether this is one of several folders."""

    json: Path | None = option(None, "write the result as JSON (- for standard output)", read=file_written)
    quiet: bool = option(False, "print nothing but errors, and the verdict of a command that has one", rare=True)
    of_features: tuple[Any, ...] = ()
    defaults: dict[str, Any] | None = None
    of_several: bool = False

    def of_feature(self, kind: type[R]) -> R:
        """Return the record of a kind among those of the features."""
        return next(each for each in self.of_features if isinstance(each, kind))

    def refuse_with(self, what: str, *used: str, otherwise: str = "") -> None:
        """Raise CalibrationError where options are given that do nothing with ``what``, which uses those fields alone; the user's
        defaults are of other commands as well.  otherwise: what to do instead."""
        by_default = [each.name for each, rule in declared(self) if rule.default_key and self.defaults]
        idle = given(self, ("json", "quiet", "effects", *used, *by_default))
        refuse_with(what, dict.fromkeys(idle, True), self.of_features, otherwise)

    @property
    def further(self) -> dict[str, Any]:
        """The options of features, as keywords of the function that the command calls."""
        return {name: value for each in self.of_features for name, value in vars(each).items()}


@dataclass(frozen=True)
class Stream(Record):
    """Options of a command that reads a port."""

    baud: int = option(921600, "of a port that has one", least=1, rare=True)
    header: str | None = option(
        None, "of a text stream that does not send it, as t_us,gx_dps", metavar="LINE", read=stream_header, rare=True
    )


@dataclass(frozen=True)
class UsesEffects(Record):
    """Options of a command that uses the catalogue of effects."""

    effects: tuple[Path, ...] = option((), EFFECTS_HELP, repeated=True, rare=True)


@dataclass(frozen=True)
class Force(Record):
    """Options of a command that writes where an option names."""

    force: bool = option(False, "write over what is there: another's file, a log, an earlier simulation", rare=True)


@dataclass(frozen=True)
class Pictures(Record):
    """Options of a command that draws its result."""

    pictures: bool = option(True, "draw the pictures", off="write no picture", rare=True)


@dataclass(frozen=True)
class VerdictOptions(Limit):
    """Options of a command whose exit code is its verdict on a calibration."""

    strict: bool = option(False, "exit 1 for all but PASS without doubts", rare=True)
