"""Make the picture of the recording screen again: python docs/make_screen.py

A simulated session, with a hand left on the table after a turn, is played to the guide and its coach.  Drawn is the live view, as
``calibrate.py record`` shows it, at two moments: while the hand trembles, and when the coach has asked for a turn.
"""

from __future__ import annotations

import io
from collections import deque
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.text import Text

from session.base.units import DEG
from session.bench.guide import Guide
from session.bench.messages import Kind, Stage
from session.bench.screen import REMEMBERED, view
from session.log.config import Protocol, Sensor
from session.log.registers import DEFAULT, RegisterUnits, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.log.samples import Samples
from tinygc.planning.coach import Coach
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session

HAND_DPS = 0.3


def main() -> None:
    simulation = simulate_session(SimulationOptions(odr_hz=416.0, closure_s=0.0, seed=3))
    log = simulation.log
    gyro = log.gyro * gyro_rps_per_lsb(500)
    accel = simulation.unit.accel_matrix @ (log.accel * accel_mps2_per_lsb(4) - simulation.unit.accel_bias)[..., None]
    samples = Samples(log.t_us * 1000, gyro, accel[..., 0], RegisterUnits(DEFAULT, None, None).temperature_c(log.temp.astype(float)))
    turn_s = next(stop for start, stop in simulation.plan.turns if stop > 60)
    trembles = (samples.t_s > turn_s) & (samples.t_s < turn_s + 1.2)
    gyro[trembles] += HAND_DPS * DEG * np.random.default_rng(0).standard_normal((int(trembles.sum()), 3))
    guide, coach, changes = Guide(Protocol(), stop_at_target=True), Coach(), deque(maxlen=REMEMBERED)
    guide.coached = True
    guide.begin(Sensor("ASM330LHH", "", 416.0, 500, 4))
    guide.health.info_odr_hz = simulation.unit.odr_hz
    console = Console(record=True, width=80, file=io.StringIO(), force_terminal=True, highlight=False)
    moments = [turn_s + 1.1, turn_s + 6.0]
    for first in range(0, len(samples), 42):
        for change in guide.feed(samples.between(first, first + 42)):
            if change.kind is not Kind.STAGE:
                changes.append(change)
            if change.accepted:
                guide.advise(coach(guide.taken.progress))
        if moments and samples.t_s[first] > moments[0] and (len(moments) == 2 or (guide.stage is Stage.TURN and not guide.turning)):
            moments.pop(0)
            console.print(view(guide, "data/session2 · /dev/ttyACM0", changes))
            console.print(Text(""))
    console.save_svg(str(Path(__file__).parent / "record.svg"), title="calibrate.py record")


if __name__ == "__main__":
    main()
