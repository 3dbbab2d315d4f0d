"""The denoiser's trade-off: noise at rest, delay and closure, by loss, beside Butterworth and Savitzky-Golay filters of its delay.

Simulated sessions of an ASM330LHH at 208 Hz: a fit to all segments, a denoiser trained on the same, and then judged on another log of the
same sensor that neither has seen (half of the segments), and on the closure run.

- noise at rest: by how much the standard deviation in the unseen stills falls
- delay: of a slow movement, in ms
- in motion: rms error against the true rate of that moment, delay allowed for, in dps (without the truth: denoising/risk.py)
- closure: tilt of the unseen segments against the calibration alone (1.00); RMSE of the closure run in degrees

A Butterworth filter of second order has its cut-off where its delay at rate zero is the same; a Savitzky-Golay filter (cubic, causal)
has the longest window of that delay that its 49 samples allow, fitted at the sample that is that late.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from closure_table import rms
from common import in_parallel, markdown, simulated
from paper.as_in_paper import trained_denoiser
from scipy.signal import butter, lfilter, lfilter_zi, savgol_coeffs

from session.base.units import DEG
from session.log.folder import Session, read_session
from tinygc.closure import residual
from tinygc.closure.build import build_problem
from tinygc.closure.runs import ClosureRun, read_closure_runs
from tinygc.estimation.choice import run_figures
from tinygc.methods import denoiser
from tinygc.methods.denoiser import DELAY, Material, of_problem, train_denoiser
from tinygc.methods.network import train_second_order
from tinygc.models.denoiser import REACH, DenoisedNet
from tinygc.simulation.options import SimulationOptions

TAPS = REACH + 1


@dataclass(frozen=True)
class Filter:
    """A rival: numerator and denominator, and its whole delay in samples."""

    b: np.ndarray
    a: np.ndarray
    delay: int

    def undelayed(self, rate: np.ndarray) -> np.ndarray:
        """Rates (N, 3) filtered from a standing start, each answer at the sample that it belongs to."""
        state = lfilter_zi(self.b, self.a)[:, None] * rate[:1] if len(self.a) > 1 else self._fir_state(rate)
        late = lfilter(self.b, self.a, rate, axis=0, zi=state)[0]
        return np.concatenate([late[self.delay :], np.repeat(late[-1:], self.delay, axis=0)])

    def _fir_state(self, rate):
        return np.cumsum(self.b[::-1])[:-1][::-1][:, None] * rate[:1]


def butterworth(delay: int) -> Filter:
    """Second order; its delay at rate zero is found by bisection on the cut-off."""
    low, high = 1e-3, 0.49
    for _ in range(60):
        middle = (low + high) / 2
        b, a = butter(2, 2 * middle)
        k = np.arange(3)
        lag = b @ k / b.sum() - a @ k / a.sum()
        low, high = (middle, high) if lag > delay else (low, middle)
    return Filter(b, a, delay)


def savitzky_golay(delay: int) -> Filter:
    """Cubic over 49 samples, evaluated ``delay`` samples before the newest."""
    return Filter(savgol_coeffs(TAPS, 3, pos=TAPS - 1 - delay, use="conv"), np.ones(1), delay)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=8, help="simulated sessions (%(default)s)")
    parser.add_argument("--seed", type=int, default=5000, help="of the first session (%(default)s)")
    args = parser.parse_args()
    results = in_parallel(one_session, range(args.seed, args.seed + args.sessions), "session")
    header = ["", "noise at rest", "delay", "in motion", "closure", "closure run, °"]
    print(markdown(header, _rows(results)))


def one_session(seed: int) -> dict:
    """Figures by the filter's name."""
    with simulated(SimulationOptions(seed=seed, closure_s=55.0)) as folder:
        return _figures(read_session(folder))


def _figures(session: Session) -> dict:
    problem = build_problem(session)
    run = read_closure_runs(problem)[0]
    whole = of_problem(problem)
    half = np.arange(len(problem.batch)) % 2 == 0
    seen = replace(whole.pick(half), stills=whole.stills[::2])
    unseen = replace(whole.pick(~half), stills=whole.stills[1::2])
    net = train_second_order(seen.batch, seen.sigma).net
    calibrated = _closures(unseen, run, net, net)[0]
    filters = {
        "calibrated alone": Filter(np.ones(1), np.ones(1), 0),
        "endpoint (the paper's loss)": train_denoiser(seen, net, "endpoint"),
        "endpoint, as in the paper": trained_denoiser(seen, net),
        f"**neighbours, {DELAY} samples** (default)": train_denoiser(seen, net),
        "Butterworth of the same delay": butterworth(DELAY),
        f"Savitzky–Golay (cubic, {TAPS} samples)": savitzky_golay(DELAY),
    }
    return {name: _judge(unseen, run, net, model, calibrated) for name, model in filters.items()}


def _judge(unseen: Material, run: ClosureRun, net, model, calibrated) -> dict:
    answer = _whole(net, model)
    before = np.concatenate([net(x)[REACH:-REACH] - net(x).mean(axis=0) for x in unseen.stills])
    after = np.concatenate([answer(x)[REACH:-REACH] - net(x).mean(axis=0) for x in unseen.stills])
    delay = model.denoiser.delay_samples.mean() if isinstance(model, DenoisedNet) else model.delay
    segments, closure_run = _closures(unseen, run, net, answer)
    return {
        "noise": float(np.sqrt(np.mean(before**2) / np.mean(after**2))),
        "delay_ms": float(delay / unseen.rate_hz * 1e3),
        "motion": _in_motion(unseen, net, answer, before),
        "segments": segments / calibrated,
        "run": closure_run,
    }


def _in_motion(unseen: Material, net, answer, before: np.ndarray) -> float:
    """dps: the answer against the noisy rate of its own sample, less what noise they share (found with a second dose of it)."""
    noise = denoiser.autocovariance_at_rest([net(x) for x in unseen.stills], TAPS)[:, 0]
    rng, total = np.random.default_rng(0), []
    for x, count in zip(unseen.context, unseen.counts, strict=True):
        x = net(x[: 2 * REACH + count])
        dose = before[(rng.integers(len(before)) + np.arange(len(x))) % len(before)]
        shared = dose * (answer(x + dose, False) - answer(x, False))
        total.append(np.mean(((answer(x, False) - x) ** 2 + 2 * shared)[REACH:-REACH], axis=0))
    return float(np.sqrt(max(np.mean(np.mean(total, axis=0) - noise), 0))) / DEG


def _whole(net, model):
    """Measured (or, with False, calibrated) rates (N, 3) to denoised ones, undelayed."""
    if not isinstance(model, DenoisedNet):
        return lambda rate, calibrate=True: model.undelayed(net(rate) if calibrate else rate)
    bare = replace(model, calibration=lambda rate: rate)
    return lambda rate, calibrate=True: (model if calibrate else bare).undelayed(rate)


def _closures(unseen: Material, run: ClosureRun, net, answer) -> tuple[float, float]:
    length = unseen.batch.rate.shape[1]
    rate = np.stack([answer(x)[REACH : REACH + length] for x in unseen.context])
    angles = residual.error_angles(residual.segment_residuals(unseen.batch, rate))
    return rms(angles) / DEG, run_figures(run.errors_at(answer(run.samples.gyro)[run.rows]))["rmse_deg"]


def _rows(results: list[dict]):
    for name in results[0]:
        noise, delay, motion, segments, run = (
            np.median([result[name][key] for result in results]) for key in ("noise", "delay_ms", "motion", "segments", "run")
        )
        yield [name, f"1/{noise:.2f}", f"{delay:.0f} ms", f"{motion:.3f}", f"{segments:.3f}", f"{run:.4f}"]


if __name__ == "__main__":
    main()
