"""Is the budget right?  Each share with its source switched off: pairs of simulated sessions that differ in one source alone.

A pair has the same motion and the same other errors, so the difference of the two estimates is what the source did.  Its mean square over
the seeds, over the variance that the budgets state for that source, is one where the budget is right.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from common import first_still_heading_deg, in_parallel, markdown, with_heading

from session.io.folder import Session
from session.io.units import DEG, MG, G
from tinygc import simulate
from tinygc.closure.floor import ACCEL_NOISE, GYRO_NOISE
from tinygc.closure.uncertainty import BIAS_DRIFT, EARTH
from tinygc.estimation.assembly import CLOCK, ROUNDING
from tinygc.estimation.fit import fit_session
from tinygc.estimation.options import FitOptions
from tinygc.estimation.results import FitResult
from tinygc.estimation.stated_noise import CALIBRATION, COMPONENTS
from tinygc.models.linear import BIAS, MATRIX, LinearModel
from tinygc.noise.components import STILL_RATE
from tinygc.simulation.options import SimulationOptions

#: simulated sessions of a pair, unless it says otherwise; a fine register, so that rounding is none of the other sources
USUAL = {"segments": 24, "closure_s": 0.0, "odr_hz": 104.0, "gyro_fs_dps": 125.0, "accel_fs_g": 2.0}
#: of the errors that pairs put into a session: dps of each still, dps of a register's step, relative of a clock, mg of a calibration
STILL_DPS, STEP_DPS, CLOCK_SIGMA, GIVEN_MG = 0.003, 0.1, 0.02, 0.1
#: share of white noise that stays where it is switched off: none at all would leave the register without dither
STAYS = 0.1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40, help="pairs of each source (%(default)s)")
    parser.add_argument("--only", default="", help="only sources whose name has this")
    args = parser.parse_args()
    shares(args)


@dataclass(frozen=True)
class Pair:
    """source; sessions: a seed -> with it, and without; weight: share of the source's variance that the difference has; options of the
    fit."""

    source: str
    sessions: Callable[[int], tuple[Session, Session]]
    options: FitOptions
    weight: float = 1.0


def fit_options(**more: object) -> FitOptions:
    return FitOptions(methods=("least_squares",), **({"accelerometer": "given", "bias": "ends"} | more))


def _simulated(seed: int, **more: object) -> Session:
    return simulate(SimulationOptions(**USUAL | {"seed": seed} | more)).session


def _by_option(name: str, on: float, off: float) -> Callable[[int], tuple[Session, Session]]:
    return lambda seed: (_simulated(seed, **{name: on}), _simulated(seed, **{name: off}))


def _heading(seed: int) -> tuple[Session, Session]:
    session = _simulated(seed)
    return session, with_heading(session, first_still_heading_deg(SimulationOptions(**USUAL | {"seed": seed})))


def _with_samples(session: Session, **changes: np.ndarray) -> Session:
    log = session.logs[0]
    return replace(session, logs=(replace(log, samples=replace(log.samples, **changes)),))


def _clock(seed: int) -> tuple[Session, Session]:
    session = _simulated(seed)
    counted = _with_samples(session, t_ns=np.round(np.arange(len(session.logs[0].samples.t_ns)) * 1e9 / USUAL["odr_hz"]).astype(np.int64))
    counted = replace(counted, logs=(replace(counted.logs[0], comments={"stamps": "counted"}),))
    return replace(counted, config=replace(counted.config, sensor=replace(counted.config.sensor, odr_sigma=CLOCK_SIGMA))), session


def _calibration(seed: int) -> tuple[Session, Session]:
    session, rng = _simulated(seed), np.random.default_rng([seed, 1])
    exact = session.config.accelerometer
    matrix = (np.eye(3) + rng.normal(size=(3, 3)) * GIVEN_MG * MG / G) @ exact.matrix
    wrong = replace(exact, matrix=matrix, bias_mps2=exact.bias_mps2 + rng.normal(size=3) * GIVEN_MG * MG)
    return replace(session, config=replace(session.config, accelerometer=wrong)), session


def _creep(seed: int) -> tuple[Session, Session]:
    """A body that creeps while it lies still, at another rate in each: q exp(phi), so omega - phi x omega + dphi / dt, f - phi x f."""
    made, rng = simulate(SimulationOptions(**USUAL | {"seed": seed})), np.random.default_rng([seed, 2])
    session, (E, B) = made.session, (np.array(made.truth["E"]), np.array(made.truth["B_dps"]) * DEG)
    samples, accelerometer = session.logs[0].samples, session.config.accelerometer
    creep = np.zeros_like(samples.gyro)
    for still in fit_session(session, fit_options()).problem.stills:
        creep[still.start : still.stop] = rng.normal(size=3) * STILL_DPS * DEG
    phi = np.cumsum(creep, axis=0) * samples.period_s
    rate, force = np.asarray(samples.gyro) @ E.T + B, (np.asarray(samples.accel) - accelerometer.bias_mps2) @ accelerometer.matrix.T
    gyro = np.linalg.solve(E, (rate - np.cross(phi, rate) + creep - B).T).T
    accel = np.linalg.solve(accelerometer.matrix, (force - np.cross(phi, force)).T).T + accelerometer.bias_mps2
    return _with_samples(session, gyro=gyro, accel=accel), session


def _rounding(seed: int) -> tuple[Session, Session]:
    """Steps of three sigmas of the noise, the coarsest that a fit takes, of a sensor whose usual noise nobody says."""
    session, step = _simulated(seed), STEP_DPS * DEG
    samples, config = session.logs[0].samples, session.config
    rates = np.asarray(samples.gyro)
    more = {"gyro_fs_dps": 125, "accel_fs_g": 2, "accelerometer": config.accelerometer, "site": config.site}
    coarse, fine = (
        Session.from_arrays(samples.t_ns * 1e-9, each, samples.accel, **more) for each in (np.round(rates / step) * step, rates)
    )
    return coarse, fine


PAIRS = (
    Pair(GYRO_NOISE, _by_option("gyro_noise_dps_rthz", 0.005, 0.005 * STAYS), fit_options(), (1 - STAYS) ** 2),
    Pair(ACCEL_NOISE, _by_option("accel_noise_ug_rthz", 300.0, 300.0 * STAYS), fit_options(), (1 - STAYS) ** 2),
    Pair(BIAS_DRIFT, _by_option("bias_instability_dph", 3.0, 0.0), fit_options()),
    Pair(BIAS_DRIFT, _by_option("bias_instability_dph", 3.0, 0.0), fit_options(bias="stills")),
    Pair(COMPONENTS[STILL_RATE], _creep, fit_options(bias="stills")),
    Pair(EARTH, _heading, fit_options()),
    Pair(CALIBRATION, _calibration, fit_options()),
    Pair(CLOCK, _clock, fit_options()),
    Pair(ROUNDING, _rounding, fit_options(bias="stills")),
)


@dataclass(frozen=True)
class Job:
    pair: int
    seed: int


def shares(args: argparse.Namespace) -> None:
    chosen = [n for n, pair in enumerate(PAIRS) if args.only in pair.source]
    jobs = [Job(n, seed) for n in chosen for seed in range(1, args.seeds + 1)]
    results = in_parallel(one_pair, jobs, "pair")
    rows = []
    for n in chosen:
        own = [result for job, result in zip(jobs, results, strict=True) if job.pair == n and result is not None]
        moved, stated, whole = (np.array([each[i] for each in own]) for i in range(3))
        pair = PAIRS[n]
        cells = [pair.source, pair.options.bias, str(len(own))]
        for part in (MATRIX, BIAS):
            ratio, share = moved[:, part] ** 2 / pair.weight, stated[:, part] / whole[:, part]
            if not stated[:, part].any():
                cells += ["0", "–"]
                continue
            # Seeds are independent, parameters of one seed are not: the spread between seeds is of the mean over the parameters.
            each = (ratio / stated[:, part].mean(axis=0)).mean(axis=1)
            cells += [f"{100 * share.mean():.1f}", f"{each.mean():.2f} ± {each.std(ddof=1) / np.sqrt(len(own)):.2f}"]
        rows.append(cells)
    head = ["source", "bias", "pairs", "E: share, %", "done / stated", "B: share, %", "done / stated"]
    print(markdown(head, rows))


def one_pair(job: Job) -> tuple[np.ndarray, ...] | None:
    """What the source moved (12,), its variance and the whole one as stated; None where the two find other turns."""
    pair = PAIRS[job.pair]
    with_it, without = (fit_session(session, pair.options) for session in pair.sessions(job.seed))
    if [s.number for s in with_it.problem.used] != [s.number for s in without.problem.used]:
        return None
    stated = sum((source.covariance for source in with_it.sources if source.name == pair.source), np.zeros((12, 12)))
    moved = _vector(with_it) - _vector(without)
    return moved, np.diag(stated), np.diag(with_it.covariance)


def _vector(result: FitResult) -> np.ndarray:
    assert isinstance(result.linear.model, LinearModel)
    return result.linear.model.vector


if __name__ == "__main__":
    main()
