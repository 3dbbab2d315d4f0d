"""What is estimated of an array, and where each of its numbers stands among all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.accelerometer.parameters import PARAMETERS as OF_ACCELEROMETER
from tinygc.attitude import rotation
from tinygc.models import linear
from tinygc.models.linear import LinearModel

#: where a unit's numbers stand among its own: the gyroscope's twelve, the accelerometer's nine, its mounting's three
GYROSCOPE = slice(0, linear.PARAMETERS)
ACCELEROMETER = slice(GYROSCOPE.stop, GYROSCOPE.stop + OF_ACCELEROMETER)
MOUNTING = slice(ACCELEROMETER.stop, ACCELEROMETER.stop + 3)
PER_UNIT = MOUNTING.stop


@dataclass(frozen=True)
class Layout:
    """units N, stills Q.  Behind the units' numbers: gravity's length; of each still its attitude (3) and the level acceleration that all
    units feel (2); of each interval between two stills the tilt (2) by which all units miss alike."""

    units: int
    stills: int

    def unit(self, number: int, part: slice = slice(0, PER_UNIT)) -> slice:
        """Of the unit that is the number-th used."""
        return slice(number * PER_UNIT + part.start, number * PER_UNIT + part.stop)

    @property
    def gravity(self) -> int:
        """Its length."""
        return self.units * PER_UNIT

    @property
    def attitudes(self) -> slice:
        """(3 Q) rad about the table's axes."""
        return slice(self.gravity + 1, self.gravity + 1 + 3 * self.stills)

    @property
    def level(self) -> slice:
        """(2 Q) m/s^2 along the table's x and y."""
        return slice(self.attitudes.stop, self.attitudes.stop + 2 * self.stills)

    @property
    def common(self) -> slice:
        """(2 (Q - 1)) rad about the table's x and y."""
        return slice(self.level.stop, self.level.stop + 2 * (self.stills - 1))

    @property
    def count(self) -> int:
        """Of all."""
        return self.common.stop


@dataclass(frozen=True, eq=False)
class State:
    """models, accelerometers (N, 9) against the ones that the forces are under, mountings (N, 3, 3) from unit to array; q_tb (Q, 4) of the
    array's body in each still; gravity_mps2.  What is random, and has no place of its own, is not in it."""

    models: tuple[LinearModel, ...]
    accelerometers: np.ndarray
    mountings: np.ndarray
    q_tb: np.ndarray
    gravity_mps2: float

    def moved(self, change: np.ndarray, layout: Layout) -> State:
        """By a change (count,) of all numbers."""
        units = change[: layout.gravity].reshape(layout.units, PER_UNIT)
        turned = rotation.exp(change[layout.attitudes].reshape(-1, 3))
        return replace(
            self,
            models=tuple(LinearModel.from_vector(m.vector + c[GYROSCOPE]) for m, c in zip(self.models, units, strict=True)),
            accelerometers=self.accelerometers + units[:, ACCELEROMETER],
            mountings=rotation.matrix(rotation.exp(units[:, MOUNTING])) @ self.mountings,
            q_tb=rotation.multiply(turned, self.q_tb),
            gravity_mps2=self.gravity_mps2 + float(change[layout.gravity]),
        )
