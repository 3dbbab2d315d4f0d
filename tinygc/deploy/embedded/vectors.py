"""What a device's self-test is fed, and what it must answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.deploy.embedded.program import Program
from tinygc.deploy.embedded.register_input import Registers

#: more than the denoiser's window, so that its rings have gone round
COUNT = 64
#: of the answer, plus 1 rad/s: far below the sensor's noise, far above what another order of operations does
TOLERANCE = 2e-6
#: to either side of where the temperature register is 0
SPAN_C = 16.0
_SEED = 195


@dataclass(frozen=True, eq=False)
class Vectors:
    """registers (COUNT, 7) int16, rates (COUNT, 3) float32 rad/s that the program makes of them, one after the other."""

    registers: np.ndarray
    rates: np.ndarray


def vectors(program: Program, registers: Registers) -> Vectors:
    """Turns over all of the range, gravity in all directions, 16 degC to either side of where its register is 0."""
    rng = np.random.default_rng(_SEED)
    numbers = rng.integers(-28000, 28000, size=(COUNT, 7)).astype(np.int16)
    direction = rng.normal(size=(COUNT, 3))
    one_g = 8192 * 4 / registers.accel_fs_g
    numbers[:, 3:6] = np.rint(direction / np.linalg.norm(direction, axis=1, keepdims=True) * one_g)
    span = round(SPAN_C * registers.thermometer.lsb_per_c)
    numbers[:, 6] = rng.integers(-span, span, size=COUNT)
    return Vectors(numbers, program.run(registers.inputs(numbers)))
