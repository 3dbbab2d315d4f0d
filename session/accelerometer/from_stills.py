"""An accelerometer's calibration from the stills of whole logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.accelerometer.lengths import LengthFit, fit_lengths
from session.accelerometer.parameters import PARAMETERS
from session.common.errors import SegmentError
from session.common.units import STANDARD_GRAVITY_MPS2
from session.detect.stills import Still, find_stills
from session.log.config import Accelerometer
from session.log.samples import Samples


def from_stills(samples: Sequence[Samples], gravity_mps2: float = STANDARD_GRAVITY_MPS2, still_s: float = 1.0) -> Accelerometer:
    """The pre-calibration that brings every still's mean specific force to ``gravity_mps2``, upper triangular, with its bias.

    samples: the logs, accelerometer as measured in m/s^2.  A few stills that are none hardly count.  Raises SegmentError where the
    stills are too few or their attitudes too alike for all nine numbers.
    """
    stills = [still for log in samples for still in find_stills(log, still_s)[0] if still.problem is None]
    found = fit_lengths(force_of(stills), gravity_mps2)
    if found.unobserved:
        raise SegmentError(f"{why_not(found)}: rest it on all six sides and some edges, or leave its calibration out")
    return found.accelerometer


def force_of(stills: Sequence[Still]) -> np.ndarray:
    """(S, 3) m/s^2: the mean specific force of each still."""
    return np.array([still.accel_mean for still in stills]).reshape(-1, 3)


def why_not(found: LengthFit) -> str:
    """What the attitudes of the stills do not fix of an accelerometer."""
    lie = f"{found.attitudes} attitude{'s' * (found.attitudes != 1)}"
    if found.attitudes < PARAMETERS:
        return f"the stills lie in {lie}, too few for an accelerometer's {PARAMETERS} numbers"
    return f"the {lie} of the stills do not fix an accelerometer's {PARAMETERS} numbers"
