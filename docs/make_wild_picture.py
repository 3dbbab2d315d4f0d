"""Make the picture of docs/real-recordings.md again: python docs/make_wild_picture.py (needs ../shared/wild)

Above: gravity along the x axis of a rocket's board, as its accelerometer read it, and as the rates carry it on from each still.
Below: what BROAD's gyroscope read less what the cameras saw turn.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.public import broad, sundevil
from session.base.units import DEG
from session.detect.stills import find_stills, references
from tinygc import Session, read_session
from tinygc.reporting.drawing import Axis, Panel, Picture, to_one_scale

WILD = Path(__file__).resolve().parents[2] / "shared" / "wild"
ROCKET_S = (66.0, 90.0)
BROAD_S = (118.0, 120.0)
#: what ``check`` says of trial 09
OFFSET_S = 0.004166
#: cameras give a rate to 1 dps over so long
WINDOW = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("found-in-the-wild.svg"))
    args = parser.parse_args()
    if not WILD.is_dir():
        sys.exit(f"{WILD} is not there")
    with tempfile.TemporaryDirectory() as parent:
        long = next(sundevil.write(WILD / "sundevil" / "rev2", Path(parent)))
        trials = list(broad.write(WILD / "broad", Path(parent)))
        Picture([*rocket(read_session(long)), *cameras(read_session(trials[-1]))]).save(args.out)
    print(args.out)


def rocket(session: Session) -> list[Panel]:
    """Gravity along x: recorded, and predicted by rates as the authors state them, and by twice these."""
    samples = session.logs[0].samples
    t_s = (samples.t_ns - samples.t_ns[0]) * 1e-9
    force = np.asarray(samples.accel)
    stills = [(still.start, still.stop) for still in references(find_stills(samples, session.config.protocol.still_s)[0])]
    bias = np.mean([np.asarray(samples.gyro)[a:b].mean(axis=0) for a, b in stills], axis=0)
    shown, panels = (t_s >= ROCKET_S[0]) & (t_s <= ROCKET_S[1]), []
    for factor, title in ((1, "rates as the authors state them"), (2, "rates times 2")):
        axes = Axis("time (s)", *ROCKET_S), Axis("gravity along x (g)", -0.4, 1.5)
        panel = Panel(*axes, f"Rocket's board: {title}")
        panel.line(t_s[shown], (force[:, 0] / 9.80665)[shown], "before", name="recorded by the accelerometer")
        for (a, b), (end, _) in pairwise(stills):
            gravity = force[a:b].mean(axis=0) / 9.80665
            turns = Rotation.from_rotvec(factor * (np.asarray(samples.gyro) - bias)[b:end] * np.diff(t_s)[b:end, None])
            path = [gravity]
            for step in turns:
                path.append(step.inv().apply(path[-1]))
            panel.line(t_s[b : end + 1], np.array(path)[:, 0], "after", name="predicted from the rates since the last still")
        panels.append(panel)
    return panels


def cameras(session: Session) -> list[Panel]:
    """What the gyroscope turned over a short window, as a rate, less the cameras', before and after their clock is shifted."""
    samples, (truth,) = session.logs[0].samples, session.reference.truths
    t_s, gyro = samples.t_ns * 1e-9, np.asarray(samples.gyro)
    near = (truth.t_ns * 1e-9 > BROAD_S[0] - 1) & (truth.t_ns * 1e-9 < BROAD_S[1] + 1)
    seen_s, attitudes = truth.t_ns[near] * 1e-9, Rotation.from_quat(truth.q_nb[near][:, [1, 2, 3, 0]])
    rows = np.flatnonzero((t_s >= BROAD_S[0]) & (t_s <= BROAD_S[1]))
    first, steps = rows[0], np.arange(rows[0], rows[-1] + WINDOW)
    path = [Rotation.identity()]
    for turn in Rotation.from_rotvec((gyro[steps] + gyro[steps + 1]) / 2 * (t_s[steps + 1] - t_s[steps])[:, None]):
        path.append(path[-1] * turn)
    turned = Rotation.concatenate(path)
    span = t_s[rows + WINDOW] - t_s[rows]
    recorded = (turned[rows - first].inv() * turned[rows - first + WINDOW]).as_rotvec() / span[:, None]
    panels = []
    for offset, title in ((0.0, "clocks as published"), (OFFSET_S, "cameras' clock 4.17 ms later")):
        at = Slerp(seen_s + offset, attitudes)
        predicted = (at(t_s[rows]).inv() * at(t_s[rows + WINDOW])).as_rotvec() / span[:, None]
        error = (recorded - predicted) / DEG
        rms = np.sqrt(np.mean(error**2))
        y = Axis("gyroscope less cameras (dps)")
        panels.append(Panel(Axis("time (s)", *BROAD_S), y, f"BROAD 09: {title}, {rms:.1f} dps rms").zero())
        for name, values in zip("xyz", error.T, strict=True):
            panels[-1].line(t_s[rows] + span / 2, values, name, "thin", name=name)
    to_one_scale(*panels)
    return panels


if __name__ == "__main__":
    main()
