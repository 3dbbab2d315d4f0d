"""The paper's figures from our own runs, as PNG: python benchmarks/paper_figures.py [7 8 …]

5   the training loss on the EuRoC windows, by step or epoch
6   the orientation error over each EuRoC test sequence
7   a denoised rate in time: a still, the beginning of a turn, and the same with the delay taken out
8   its spectrum: at rest, before and after; and the amplitude response
11  the attitude through a closure run, by method, and what is left at its end
12  noise at rest, before and after: the distribution, and what is left when it is averaged

5 and 6 need ../shared/euroc, and 5 takes some minutes.  For the others the session is data/session1 (simulated); the denoiser has seen it,
and the closure run was never fitted.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from closure_table import TITLES, fit_model
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from paper.euroc import EUROC
from paper.figures_euroc import figure5, figure6
from scipy.signal import freqz, welch

from session.io.folder import read_session
from session.io.units import DEG
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.build import build_problem
from tinygc.closure.problem import Problem
from tinygc.closure.runs import ClosureRun, read_closure_runs
from tinygc.models.denoiser import DenoisedNet

ROOT = Path(__file__).resolve().parents[1]
BEFORE, AFTER, SHIFTED, OTHER = "#9aa5b1", "#c0392b", "#2c5fa8", "#27804a"
METHOD_COLOURS = {"raw": BEFORE, "least_squares": OTHER, "tinygc": SHIFTED, "tinygc_denoised": AFTER}


@dataclass(frozen=True, eq=False)
class Material:
    """One session with its models by method and its closure run."""

    problem: Problem
    models: dict
    run: ClosureRun

    @property
    def net(self) -> DenoisedNet:
        return self.models["tinygc_denoised"]

    @property
    def rates_dps(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) calibrated, and denoised as they come, of the first log."""
        gyro = self.problem.logs[0].samples.gyro
        return self.models["tinygc"](gyro) / DEG, self.net(gyro) / DEG


@cache
def material(folder: Path) -> Material:
    """Fitted once for all figures."""
    problem = build_problem(read_session(folder))
    return Material(problem, {name: fit_model(name, problem) for name in METHOD_COLOURS}, read_closure_runs(problem)[0])


def figure7(folder: Path) -> Figure:
    """The denoised signal in time."""
    m = material(folder)
    calibrated, denoised = m.rates_dps
    log = m.problem.logs[0]
    t_s, lag_s = log.samples.t_s, m.net.delay_s
    segment = max(m.problem.used, key=lambda one: one.turn_deg)
    axis = int(np.abs(calibrated[segment.start : segment.stop]).max(axis=0).argmax())
    turn = slice(segment.first.stop, segment.last.start)
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    still, whole, peak = figure.subplots(1, 3)
    fastest = turn.start + int(np.abs(calibrated[turn, axis]).argmax())
    spans = {still: (segment.first.start, segment.first.stop), whole: (segment.start, segment.stop), peak: (fastest - 60, fastest + 60)}
    for axes, (begin, stop) in spans.items():
        rows = slice(max(begin, 0), min(stop, len(t_s)))
        axes.plot(t_s[rows], calibrated[rows, axis], color=BEFORE, lw=0.8, label="calibrated")
        axes.plot(t_s[rows], denoised[rows, axis], color=AFTER, lw=1.2, label="denoised, as it comes")
        if axes is not still:
            axes.plot(t_s[rows] - lag_s, denoised[rows, axis], color=SHIFTED, lw=1.0, ls="--", label="… its delay taken out")
        axes.set_xlabel("s")
    still.set(title=f"at rest: {_less(m, axis):.1f} times less noise", ylabel=f"rate about {'xyz'[axis]}, dps")
    whole.set_title("a turn")
    peak.set_title(f"where it is fastest: {lag_s * 1e3:.0f} ms late")
    peak.legend(frameon=False, loc="upper center")
    return figure


def figure8(folder: Path) -> Figure:
    """The denoised signal's spectrum."""
    m = material(folder)
    log, rate_hz = m.problem.logs[0], m.net.rate_hz
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    rest, response = figure.subplots(1, 2)
    for rates, colour, words in zip(m.rates_dps, (BEFORE, AFTER), ("calibrated", "denoised"), strict=True):
        stills = [rates[s.start : s.stop] - rates[s.start : s.stop].mean(axis=0) for s in log.stills if s.problem is None]
        densities = [welch(still, rate_hz, nperseg=128, axis=0) for still in stills if len(still) >= 128]
        density = np.sqrt(np.mean([power for _, power in densities], axis=(0, 2))) * 1e3
        rest.semilogy(densities[0][0], density, color=colour, label=words)
    rest.set(title="at rest, all stills and axes", xlabel="Hz", ylabel="mdps/√Hz")
    for axis, taps in enumerate(m.net.denoiser.taps()):
        hz, gain = freqz(taps, worN=1024, fs=rate_hz)
        response.plot(hz, np.abs(gain), color=("#c0392b", "#27804a", "#2c5fa8")[axis], label="xyz"[axis])
    response.axhline(1, color="0.8", lw=0.8, zorder=0)
    response.set(title="amplitude response of the 49 taps; 1 at zero rate, exactly", xlabel="Hz", ylabel="gain", ylim=(0, None))
    for axes in (rest, response):
        axes.legend(frameon=False)
    return figure


def figure11(folder: Path) -> Figure:
    """The closure run's attitude by method."""
    m = material(folder)
    t_s = np.concatenate([[0], np.cumsum(m.run.batch.dt[0])])
    figure = Figure(figsize=(13, 7), layout="constrained")
    grid = figure.subplots(3, 2, gridspec_kw={"width_ratios": [2.2, 1]}, sharey=False)
    end = _euler_deg(m.run.batch.end)[0]
    shown = {name: _attitude_deg(m, name) for name in METHOD_COLOURS}
    for row, angle in enumerate(("roll", "pitch", "yaw")):
        for name, colour in METHOD_COLOURS.items():
            style = {"color": colour, "lw": 1.0, "label": TITLES[name], "ls": "--" if name == "tinygc_denoised" else "-"}
            grid[row, 0].plot(t_s, _broken(shown[name][:, row]), **style)
            if name != "raw":
                last = t_s > t_s[-1] - 1.5
                grid[row, 1].plot(t_s[last], (shown[name][last, row] - end[row] + 180) % 360 - 180, **style)
        grid[row, 0].set_ylabel(f"{angle}, deg")
        floor = m.run.floor_rad[row] / DEG
        grid[row, 1].axhspan(-floor, floor, color="0.92", zorder=0)
        grid[row, 1].set_ylim(-0.2, 0.2)
        grid[row, 1].set_ylabel("less the end, deg")
    grid[0, 0].set_title(f"{m.run.file}: {m.run.duration_s:.0f} s, back to where it began")
    grid[0, 1].set_title("the last 1.5 s; grey: noise floor, 1σ")
    grid[1, 0].legend(frameon=False, ncols=2)
    for axes in grid[-1]:
        axes.set_xlabel("s")
    return figure


def figure12(folder: Path) -> Figure:
    """Noise at rest before and after denoising."""
    m = material(folder)
    log = m.problem.logs[0]
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    spread, averaged = figure.subplots(1, 2)
    for rates, colour, words in zip(m.rates_dps, (BEFORE, AFTER), ("calibrated", "denoised"), strict=True):
        stills = [rates[s.start : s.stop] for s in log.stills if s.problem is None]
        noise = np.concatenate([still[48:] - still[48:].mean(axis=0) for still in stills if len(still) > 60]) * 1e3
        each = " ".join(f"{value:.0f}" for value in noise.std(axis=0))
        spread.hist(
            noise.ravel(), bins=np.linspace(-180, 180, 121), density=True, color=colour, alpha=0.75, label=f"{words}: σ {each} mdps"
        )
        _averaged(averaged, stills, m.net.rate_hz, colour, words)
    spread.set(title="distribution in the stills, x, y, z together", xlabel="mdps", yticks=[])
    averaged.set(title="what is left of it in a mean of so many samples", xlabel="s averaged", ylabel="mdps", xscale="log", yscale="log")
    for axes in (spread, averaged):
        axes.legend(frameon=False)
    return figure


def _averaged(axes: Axes, stills: list[np.ndarray], rate_hz: float, colour: str, words: str) -> None:
    lengths = np.unique(np.geomspace(1, 150, 18).astype(int))
    left = []
    for length in lengths:
        means = [still[48 : 48 + (len(still) - 48) // length * length].reshape(-1, length, 3).mean(axis=1) for still in stills]
        left.append(np.sqrt(np.mean(np.concatenate([np.diff(mean, axis=0) for mean in means if len(mean) > 1]) ** 2) / 2) * 1e3)
    axes.plot(lengths / rate_hz, left, "o-", ms=3, color=colour, label=words)


def _less(m: Material, axis: int) -> float:
    stills = [slice(s.start + 48, s.stop) for s in m.problem.logs[0].stills if s.problem is None]  # 48: the turn has left the window
    calibrated, denoised = (np.concatenate([r[rows] - r[rows].mean(axis=0) for rows in stills]) for r in m.rates_dps)
    return float(calibrated[:, axis].std() / denoised[:, axis].std())


def _attitude_deg(m: Material, name: str) -> np.ndarray:
    """(T, 3) roll, pitch, yaw through the closure run."""
    model, run = m.models[name], m.run
    rate = model.undelayed(run.samples.gyro)[run.rows] if isinstance(model, DenoisedNet) else model(run.batch.rate[0])
    return _euler_deg(closure.attitudes(run.batch, rate[None])[0])


def _broken(angle_deg: np.ndarray) -> np.ndarray:
    """No line where the angle goes round."""
    return np.where(np.abs(np.diff(angle_deg, append=angle_deg[-1])) > 90, np.nan, angle_deg)


def _euler_deg(q: np.ndarray) -> np.ndarray:
    R = rotation.matrix(q)
    angles = [np.arctan2(R[..., 2, 1], R[..., 2, 2]), -np.arcsin(np.clip(R[..., 2, 0], -1, 1)), np.arctan2(R[..., 1, 0], R[..., 0, 0])]
    return np.stack(angles, -1) / DEG


FIGURES = {5: figure5, 6: figure6, 7: figure7, 8: figure8, 11: figure11, 12: figure12}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("numbers", type=int, nargs="*", choices=[*FIGURES, []], help=f"which: {', '.join(map(str, FIGURES))} (all)")
    parser.add_argument("--session", type=Path, default=ROOT / "data" / "session1", help="session with a closure run (%(default)s)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "paper", metavar="DIR", help="folder of the pictures (%(default)s)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for number in args.numbers or FIGURES:
        if number in (5, 6) and not EUROC.is_dir():
            print(f"figure {number}: left out, {EUROC} is not there", file=sys.stderr)
            continue
        path = args.out / f"figure{number}.png"
        FIGURES[number](args.session).savefig(path, dpi=90)
        print(path)


if __name__ == "__main__":
    main()
