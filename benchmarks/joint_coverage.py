"""Are the sigmas of a whole IMU true?  Accelerometer and gyroscope together, from simulated sessions without ``[accelerometer]``.

Each unit's accelerometer is off by 30 mg, 1 % and 5 mrad (one sigma each).  Nine numbers of it and twelve of the gyroscope, in the body
frame that its triad defines, are held against the truth.  Right sigmas give 68 % and 95 %, and a chi-square of 21.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from common import in_parallel, markdown
from scipy import stats

from session.detect import accelerometer
from session.io.config import Accelerometer
from session.io.units import DEG, MG
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prepared import prepare
from tinygc.estimation.stated_noise import stated_goodness, stated_joint_covariance, stated_noise
from tinygc.library.sessions import simulate
from tinygc.models.linear import NAMES, LinearModel, bias_only
from tinygc.simulation.options import SimulatedUnit, SimulationOptions

RAW = {"accel_bias_mg": 30.0, "accel_scale_error": 0.01, "accel_misalignment": 0.005}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=100, help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=5000, help="of the first session (%(default)s)")
    parser.add_argument("--segments", type=int, default=40, help="per session (%(default)s)")
    args = parser.parse_args()
    results = in_parallel(one_session, [(args.seed + i, args.segments) for i in range(args.sessions)], "session")
    z = np.array([result["z"] for result in results])
    print(f"{len(z)} simulated sessions of {args.segments} segments, no [accelerometer]: share of errors within their stated sigmas.\n")
    names = [*accelerometer.NAMES, *NAMES]
    rows = [_row(name, z[:, i]) for i, name in enumerate(names)]
    print(markdown(["parameter", "within 1σ", "within 2σ", "error rms / σ", "mean error / σ"], [*rows, _row("all", z.ravel())]))
    for words, of in (("all 21", slice(None)), ("the accelerometer's 9", slice(0, 9)), ("the gyroscope's 12", slice(9, 21))):
        together = np.array([result["chi_square"][words] for result in results])
        count = z[:, of].shape[1]
        print(
            f"{words}: chi-square with {count} degrees of freedom, mean {together.mean():.1f}, Kolmogorov-Smirnov "
            f"p = {stats.kstest(together, stats.chi2(count).cdf).pvalue:.2g}."
        )
    sigma = np.median([result["sigma"] for result in results], axis=0)
    print(
        f"Median stated sigma: scale {np.median(sigma[accelerometer.SCALES]) * 1e6:.0f} ppm, nonorthogonality "
        f"{np.median(sigma[accelerometer.SHEARS]) * 1e6:.0f} µrad, bias {np.median(sigma[accelerometer.BIASES]) / MG:.3f} mg; "
        f"E {np.median(sigma[9:18]) * 1e6:.0f} ppm (or µrad), B {np.median(sigma[18:]) / DEG * 1e3:.2f} mdps."
    )


def one_session(job: tuple[int, int]) -> dict:
    """Errors in sigmas (21,), and chi-squares."""
    seed, segments = job
    made = simulate(SimulationOptions(seed=seed, segments=segments, closure_s=0.0, **RAW))
    session = bare(made.session)
    problem = prepare(session).problem
    joint = problem.joint
    fit = fit_least_squares(problem.batch, problem.floor.sigma, bias_only(problem.still_rates.rate[0]))
    model = fit.model
    noise = stated_noise(problem)
    _, widened = stated_goodness(problem, model, noise)
    covariance = widened * stated_joint_covariance(problem, model, noise, still_rates=False)
    error = np.concatenate(
        [errors_of(joint.x, joint.accelerometer, made.simulation.unit), model.vector - in_triad(made.simulation.unit).vector]
    )
    sigma = np.sqrt(np.diag(covariance))
    parts = {"all 21": slice(0, 21), "the accelerometer's 9": slice(0, 9), "the gyroscope's 12": slice(9, 21)}
    chi_square = {name: float(error[of] @ np.linalg.solve(covariance[of, of], error[of])) for name, of in parts.items()}
    return {"z": error / sigma, "sigma": sigma, "chi_square": chi_square}


def bare(session):
    """A session as of somebody who has calibrated nothing."""

    return replace(session, config=replace(session.config, accelerometer=Accelerometer(source="none")))


def triad(unit: SimulatedUnit) -> tuple[np.ndarray, np.ndarray]:
    """Q, U: f = Q U (m - b), Q (3, 3) the turn from the triad's frame to the simulator's body, U upper triangular."""
    q, u = np.linalg.qr(unit.accel_matrix)
    sign = np.sign(np.diag(u))
    return q * sign, u * sign[:, None]


def in_triad(unit: SimulatedUnit) -> LinearModel:
    """The gyroscope's truth in the frame of the accelerometer's triad."""
    q, _ = triad(unit)
    return LinearModel(q.T @ unit.E, q.T @ unit.B)


def errors_of(x: np.ndarray, found: Accelerometer, unit: SimulatedUnit) -> np.ndarray:
    """(9,) of a correction x that led to ``found``."""
    before = np.linalg.inv(accelerometer.matrix_of(x)) @ found.matrix
    start = found.bias_mps2 - np.linalg.solve(before, x[accelerometer.BIAS])
    matrix = triad(unit)[1] @ np.linalg.inv(before)
    return x - np.concatenate([matrix[accelerometer.UPPER], before @ (unit.accel_bias - start)])


def _row(name: str, z: np.ndarray) -> list[str]:
    inside = [f"{np.mean(np.abs(z) < bar):.1%}" for bar in (1, 2)]
    return [name, *inside, f"{np.sqrt(np.mean(z**2)):.2f}", f"{z.mean():+.2f}"]


if __name__ == "__main__":
    main()
