"""What a lot's prior is worth: sigmas with and without it, whether they are true, and units that do not belong.

Whole simulated sessions (no linear design in place of one): units drawn from a lot, turned by hand, fitted by `fit --lot`'s own code.
Lots are of two spreads: a tenth of a percent, and 50 ppm with 20 mdps.  The lot is estimated from the true numbers of as many units as
`--units` says, so that its own errors are in the coverage.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

from session.base.units import DEG
from session.detect.segments import FEWEST_SEGMENTS
from session.log.folder import read_session
from tinygc.closure.prepared import prepare
from tinygc.estimation.bias import choose
from tinygc.estimation.options import FitOptions
from tinygc.estimation.stated_noise import stated_covariance, stated_goodness, stated_noise
from tinygc.features.fleet.fit import LotFile
from tinygc.features.fleet.lot import NAMES as LOT_NAMES
from tinygc.features.fleet.lot import Lot
from tinygc.models.linear import PARAMETERS
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session, unit_of
from tinygc.simulation.write import write_simulation

#: scale (fraction), misalignment (rad), bias (dps): one sigma between units
LOTS = {
    "0.1 %, 0.5 mrad, 0.1 dps": (0.001, 0.0005, 0.1),
    "50 ppm, 50 µrad, 20 mdps": (5e-5, 5e-5, 0.02),
}
#: number of a unit that does not belong, and by how many sigmas of the lot it is off
FOREIGN = {"scale of y by 6": (4, 6.0), "scale of y by 15": (4, 15.0), "bias of z by 10": (11, 10.0)}
GROUPS = {"scale": [0, 4, 8], "misalignment": [1, 2, 3, 5, 6, 7], "bias": [9, 10, 11]}


@dataclass(frozen=True)
class Job:
    seed: int
    segments: int
    spread: tuple[float, float, float]
    units: int
    foreign: tuple[int, float] | None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=300, help="units that belong, of each lot and number of turns (%(default)s)")
    parser.add_argument("--foreign", type=int, default=60, help="units that do not, of each kind (%(default)s)")
    parser.add_argument("--turns", type=int, nargs="+", default=[4, 8, 20], help="(4 8 20)")
    parser.add_argument("--units", type=int, default=200, help="that the lot is estimated from (%(default)s)")
    parser.add_argument("--lots", type=int, nargs="+", default=[0, 1], help="which of the two (0 1)")
    args = parser.parse_args()
    for name, spread in (list(LOTS.items())[i] for i in args.lots):
        print(f"\nLot of {name} (one sigma between units), estimated from {args.units} units; {args.sessions} units that belong\n")
        rows = []
        for turns in args.turns:
            found = in_parallel(one_unit, [Job(7000 + i, turns, spread, args.units, None) for i in range(args.sessions)], f"unit of {name}")
            rows += _rows(turns, found)
        print(markdown(["turns", "numbers", "σ without", "σ with", "1σ without", "1σ with", "2σ with", "used, open, not"], rows))
        rows = []
        for turns, (what, kind) in product(args.turns, FOREIGN.items() if args.foreign else ()):
            found = in_parallel(one_unit, [Job(9000 + i, turns, spread, args.units, kind) for i in range(args.foreign)], "foreign unit")
            wrong = np.abs([f["z"][kind[0]] for f in found]) < 2
            rows.append([turns, what, _shares(found, "no", "partly", "yes"), f"{wrong.mean():.0%}"])
        print(f"\n{args.foreign} units that do not belong, of each kind\n")
        print(markdown(["turns", "off by sigmas of the lot", "said not to belong, open, taken for one", "2σ of the wrong number"], rows))


def _shares(found: list[dict], *words: str) -> str:
    return ", ".join(f"{np.mean([f['used'] == word for f in found]):.1%}" for word in words)


def _rows(turns: int, found: list[dict]) -> list[list]:
    z, sigma = (np.array([f[name] for f in found]) for name in ("z", "sigma"))
    free_z, free_sigma = (np.array([f[name] for f in found if "free_z" in f]) for name in ("free_z", "free_sigma"))
    rows = []
    for name, which in GROUPS.items():
        unit, size = ("mdps", DEG / 1e3) if name == "bias" else ("ppm", 1e-6)
        shown = lambda s: f"{np.median(s[:, which]) / size:.3g} {unit}"  # noqa: B023, E731
        within = lambda z, k: f"{np.mean(np.abs(z[:, which]) < k):.1%}"  # noqa: B023, E731
        without = (shown(free_sigma), within(free_z, 1)) if len(free_z) else ("–", "–")
        used = _shares(found, "yes", "partly", "no")
        rows.append([turns, name, without[0], shown(sigma), without[1], within(z, 1), within(z, 2), used])
    return rows


def drawn(spread: tuple[float, float, float], rng: np.random.Generator) -> np.ndarray:
    """(12,) of a unit of the lot."""
    return lot_mean() + sigmas(spread) * rng.standard_normal(PARAMETERS)


def lot_mean() -> np.ndarray:
    """(12,)"""
    return np.concatenate([np.eye(3).ravel(), np.zeros(3)])


def sigmas(spread: tuple[float, float, float]) -> np.ndarray:
    """(12,) one sigma between units."""
    scale, misalignment, bias = spread
    return np.array([scale if i == j else misalignment for i in range(3) for j in range(3)] + [bias * DEG] * 3)


def lot_of_units(spread: tuple[float, float, float], units: int) -> Lot:
    """From the true numbers of so many units."""
    rng = np.random.default_rng(123)
    rows = np.array([drawn(spread, rng) for _ in range(units)])
    sigma = rows.std(axis=0, ddof=1)
    numbers = (rows.mean(axis=0), sigma / np.sqrt(units), sigma, np.zeros(PARAMETERS))
    mean, mean_sigma, spread, repeatability = (np.pad(part, (0, len(LOT_NAMES) - PARAMETERS), constant_values=np.nan) for part in numbers)
    return Lot(
        sensor="simulated",
        units=units,
        sessions=units,
        names=LOT_NAMES,
        mean=mean,
        mean_sigma=mean_sigma,
        spread=spread,
        repeatability=repeatability,
    )


def one_unit(job: Job) -> dict:
    """A unit's session, fitted with the lot and, where there are turns enough, without."""
    rng = np.random.default_rng(job.seed)
    options = SimulationOptions(segments=job.segments, closure_s=0.0, seed=job.seed, odr_hz=104.0, accel_calibration_error_mg=0.1)
    vector = drawn(job.spread, rng)
    if job.foreign is not None:
        which, by = job.foreign
        vector[which] = lot_mean()[which] + by * sigmas(job.spread)[which] * rng.choice([-1, 1])
    unit = replace(unit_of(options), E=vector[:9].reshape(3, 3), B=vector[9:])
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        session = read_session(write_simulation(simulate_session(options, unit=unit), Path(parent) / "one"))
        lot = lot_of_units(job.spread, job.units)
        problem = prepare(session, prior=LotFile(lot, "", "").prior).problem
        fit_options = FitOptions(methods=("least_squares",))
        noise = stated_noise(problem)
        assert noise is not None
        _, level, fit, use = LotFile(lot, "lot.json", "").fit(problem, fit_options, noise)
        covariance = _noise(level, fit, noise) + use.more
        sigma = np.sqrt(np.diag(covariance))
        found = {"used": use.used, "sigma": sigma, "z": (fit.model.vector - vector) / sigma}
        if job.foreign is None and len(problem.batch) >= FEWEST_SEGMENTS:
            _, level, fit = choose(problem, fit_options)
            found["free_sigma"] = np.sqrt(np.diag(_noise(level, fit, noise)))
            found["free_z"] = (fit.model.vector - vector) / found["free_sigma"]
    return found


def _noise(level, fit, noise) -> np.ndarray:
    return stated_goodness(level, fit.model, noise)[1] * stated_covariance(level, fit.model, noise)[0]


if __name__ == "__main__":
    main()
