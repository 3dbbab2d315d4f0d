"""What a case's concealments add to the rate, as the sensor's samples would show it without noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.challenge.cases import Case
from tinygc.challenge.conceal import MAKERS, drawn
from tinygc.challenge.discover.laws.table import LAWS
from tinygc.simulation import sensor
from tinygc.simulation.options import GYRO_LPF2_HZ
from tinygc.simulation.simulate import fine_grid, true_signals, unit_of

#: all that may be hidden
ALL = {**MAKERS, **LAWS}


@dataclass(frozen=True, eq=False)
class AddedRate:
    """At the recorded samples: the true rate (N, 3), what the laws add (N, 3), zero where none is hidden, and what effects of the
    catalogue add after it, by id; rad/s, behind the chip's low-pass."""

    rate: np.ndarray
    law: np.ndarray
    catalogue: dict[str, np.ndarray]


def added_rate(case: Case) -> AddedRate:
    """The same draws as in ``conceal``."""
    hidden, plan = drawn(case, ALL)
    options, unit = case.options, unit_of(case.options)
    t, factor, run_up = fine_grid(unit.odr_hz, int(np.ceil(plan.log_s * unit.odr_hz)))
    rate, force, temp = true_signals(options, unit, plan, t)

    def sampled(values: np.ndarray) -> np.ndarray:
        bandwidth, no_noise = GYRO_LPF2_HZ[options.odr_hz], np.random.default_rng(0)
        return sensor.low_pass(values, bandwidth, 0.0, unit.odr_hz, factor, no_noise)[run_up:]

    law, catalogue, now = np.zeros((len(t) // factor - run_up, 3)), {}, rate
    for one in hidden:
        if one.distort is None:
            continue
        after = one.distort(t, now, force, temp)
        if one.id in LAWS:
            law = law + sampled(after - now)
        else:
            catalogue[one.id] = sampled(after - now)
        now = after
    return AddedRate(sampled(rate), law, catalogue)
