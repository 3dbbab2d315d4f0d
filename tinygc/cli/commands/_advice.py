"""The coach of a recording, and the lot that it may know of."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from session.guide.messages import Advice, Progress
    from session.log.config import Config
    from tinygc.lot.lot import Lot
    from tinygc.plan.coach import Coach


def lot_of(args: argparse.Namespace) -> Lot:
    """Read before the port is opened: nobody turns a board for a lot that is none."""
    from session.common.errors import CalibrationError
    from tinygc.lot.files import read_lot
    from tinygc.lot.prior import require_usable

    if args.no_coach:
        raise CalibrationError("--lot tells the coach how many turns are enough; leave it or --no-coach out")
    lot = read_lot(args.lot)
    require_usable(lot, lot.sensor, str(args.lot))
    return lot


def of_the_model(args: argparse.Namespace, config: Config) -> Config:
    """The configuration, where the board is of the lot's model; CalibrationError where it is of another."""
    from session.common.errors import CalibrationError

    if config.sensor.model != args.lot_read.sensor:
        raise CalibrationError(f"{args.lot}: a lot of {args.lot_read.sensor}, and the board is {config.sensor.model}; leave --lot out")
    return config


def coach_of(lot: Lot | None) -> Callable[[Progress], Advice]:
    """The coach; its modules are loaded in its own thread, not before the recording starts."""
    coach: Coach | None = None

    def advise(progress: Progress) -> Advice:
        nonlocal coach
        if coach is None:
            from tinygc.plan.coach import Coach

            coach = Coach(lot=lot)
        return coach(progress)

    return advise
