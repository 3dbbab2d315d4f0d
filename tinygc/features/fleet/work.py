"""What a fleet does with each session, and by whom.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass

from session.base.options import Record, option
from tinygc.estimation.options import ACCELEROMETERS, Earth, Seed

#: in order; fit and explain include the work of check, so omitting check omits only its findings
STEPS = ("check", "fit", "explain")


@dataclass(frozen=True)
class Run(Seed, Earth):
    """What is done with each session, how, and by whom."""

    steps: tuple[str, ...] = option(STEPS, "do these steps alone", some=STEPS, metavar=",".join(STEPS), flags=("--only",), rare=True)
    accelerometer: str = option("auto", "as of fit", choices=ACCELEROMETERS, rare=True)
    jobs: int | None = option(None, "processes (one for each core)", least=1, most=1024, rare=True)
    retry: bool = option(False, "compute again what has failed before", rare=True)
    limit_deg: float | None = option(
        None, "exit 1 if a session fails by this limit, as in fit --limit", unit="deg", above=0, flags=("--limit",)
    )


@dataclass(frozen=True)
class LotOf(Record):
    """Which lot of a table."""

    model: str | None = option(None, "of several models of sensors: the lot of this one", metavar="TEXT", read=str, rare=True)
