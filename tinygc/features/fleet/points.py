"""What the core asks of a lot: the prior of one unit's fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from session.base.errors import CalibrationError
from tinygc.features.fleet.options import LotOptions

if TYPE_CHECKING:
    from tinygc.estimation.options import FitOptions
    from tinygc.features.fleet.fit import LotFile


def prior(options: FitOptions, sensor: str) -> LotFile | None:
    """Return the lot as prior of a unit with this sensor, where the options name one.

    Raises CalibrationError for options that cannot use a prior, and the errors of ``lot_for``.
    """
    assert isinstance(options, LotOptions)
    if options.lot is None:
        return None
    for idle, name in ((options.physics is not None, "--physics"), (options.bias_per_log, "bias_per_log")):
        if idle:
            raise CalibrationError(f"{name} fits without a lot's prior; leave it or --lot out")
    from tinygc.features.fleet.fit import lot_for

    return lot_for(options.lot, sensor)
