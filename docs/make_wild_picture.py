"""Make the picture of found-in-the-wild.md again: python docs/make_wild_picture.py (needs ../shared/wild)

Above: gravity along the x axis of a rocket's board, as its accelerometer read it, and as the rates carry it on from each still.
Below: what BROAD's gyroscope read less what the cameras saw turn.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.public import broad, sundevil
from session.base.units import DEG
from session.detect.stills import find_stills, references
from tinygc import Session, read_session

mpl.use("Agg")
import matplotlib.pyplot as plt

WILD = Path(__file__).resolve().parents[2] / "shared" / "wild"
ROCKET_S = (66.0, 90.0)
BROAD_S = (118.0, 120.0)
#: what ``check`` says of trial 09
OFFSET_S = 0.004166
#: cameras give a rate to 1 dps over so long
WINDOW = 20
RECORDED, PREDICTED = "#1f4e79", "#d95f02"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("found-in-the-wild.png"))
    args = parser.parse_args()
    if not WILD.is_dir():
        sys.exit(f"{WILD} is not there")
    with tempfile.TemporaryDirectory() as parent:
        long = next(sundevil.write(WILD / "sundevil" / "rev2", Path(parent)))
        trials = list(broad.write(WILD / "broad", Path(parent)))
        figure, axes = plt.subplots(2, 2, figsize=(10, 5.6), sharey="row", constrained_layout=True)
        rocket(axes[0], read_session(long))
        cameras(axes[1], read_session(trials[-1]))
    figure.savefig(args.out, dpi=110)
    print(args.out)


def rocket(axes: np.ndarray, session: Session) -> None:
    """Gravity along x: recorded, and predicted by rates as the authors state them, and by twice these."""
    samples = session.logs[0].samples
    t_s = (samples.t_ns - samples.t_ns[0]) * 1e-9
    force = np.asarray(samples.accel)
    stills = [(still.start, still.stop) for still in references(find_stills(samples, session.config.protocol.still_s)[0])]
    bias = np.mean([np.asarray(samples.gyro)[a:b].mean(axis=0) for a, b in stills], axis=0)
    shown = (t_s >= ROCKET_S[0]) & (t_s <= ROCKET_S[1])
    for axis, factor, title in zip(axes, (1, 2), ("rates as the authors state them", "rates times 2"), strict=True):
        axis.plot(t_s[shown], (force[:, 0] / 9.80665)[shown], color=RECORDED, label="recorded by the accelerometer")
        for number, ((a, b), (end, _)) in enumerate(pairwise(stills)):
            gravity = force[a:b].mean(axis=0) / 9.80665
            turns = Rotation.from_rotvec(factor * (np.asarray(samples.gyro) - bias)[b:end] * np.diff(t_s)[b:end, None])
            path = [gravity]
            for step in turns:
                path.append(step.inv().apply(path[-1]))
            label = "predicted from the rates since the last still" if number == 0 else None
            axis.plot(t_s[b : end + 1], np.array(path)[:, 0], color=PREDICTED, label=label)
        axis.set(title=f"Rocket's board: {title}", xlabel="s", xlim=ROCKET_S, ylim=(-0.4, 1.5))
    axes[0].set_ylabel("gravity along x, g")
    axes[0].legend(fontsize=8, loc="upper right")


def cameras(axes: np.ndarray, session: Session) -> None:
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
    for axis, offset, title in zip(axes, (0.0, OFFSET_S), ("clocks as published", "cameras' clock 4.17 ms later"), strict=True):
        at = Slerp(seen_s + offset, attitudes)
        predicted = (at(t_s[rows]).inv() * at(t_s[rows + WINDOW])).as_rotvec() / span[:, None]
        error = (recorded - predicted) / DEG
        rms = np.sqrt(np.mean(error**2))
        axis.plot(t_s[rows] + span / 2, error, lw=0.8)
        axis.set(title=f"BROAD 09: {title}, {rms:.1f} dps rms", xlabel="s", xlim=BROAD_S)
    axes[0].set_ylabel("gyroscope less cameras, dps")
    axes[0].legend(["x", "y", "z"], fontsize=8, loc="lower left", ncols=3)


if __name__ == "__main__":
    main()
