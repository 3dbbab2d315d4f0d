"""What a case's concealments add to the rate, as the sensor's samples would show it without noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from session.log.samples import Samples
from tinygc.challenge.cases import Case
from tinygc.challenge.conceal import MAKERS, drawn
from tinygc.challenge.discover.laws.table import LAWS
from tinygc.effects import Conditions, Movement, movement_of
from tinygc.simulation import sensor
from tinygc.simulation.options import GYRO_LPF2_HZ
from tinygc.simulation.simulate import fine_grid, true_signals, unit_of

#: all that may be hidden
ALL = {**MAKERS, **LAWS}


@dataclass(frozen=True, eq=False)
class AddedRate:
    """At the recorded samples, behind the chip's low-pass: the true movement, without noise and without what is hidden of the rate; what
    the law adds (N, 3), zero where none is hidden, and what effects of the catalogue add after it, by id; rad/s."""

    movement: Movement
    law: np.ndarray
    catalogue: dict[str, np.ndarray]


def added_rate(case: Case) -> AddedRate:
    """The same draws as in ``conceal``."""
    hidden, plan = drawn(case, ALL)
    options, unit = case.options, unit_of(case.options)
    t, factor, run_up = fine_grid(unit.odr_hz, int(np.ceil(plan.log_s * unit.odr_hz)))
    rate, force, temp = true_signals(options, unit, plan, t)

    def sampled(values: np.ndarray, hz: float = GYRO_LPF2_HZ[options.odr_hz]) -> np.ndarray:
        return sensor.low_pass(values, hz, 0.0, unit.odr_hz, factor, np.random.default_rng(0))[run_up:]

    felt = force
    for one in hidden:
        felt = felt if one.disturb is None else one.disturb(t, felt)
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
    samples = Samples(
        np.rint(1e9 * t[run_up * factor :: factor]).astype(np.int64),
        sampled(rate),
        sampled(felt, sensor.ACCEL_BANDWIDTH_ODR * unit.odr_hz),
        temp[run_up * factor :: factor],
    )
    known = Conditions(plan.log_s, options.gyro_fs_dps * DEG, options.temperature_start_c)
    return AddedRate(movement_of(samples, samples.gyro, known), law, catalogue)
