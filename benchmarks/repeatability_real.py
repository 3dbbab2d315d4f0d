"""Do stated sigmas of E hold over repeats of real recordings?  Eight MPU-9150 on one board, turned by hand in four experiments.

Each unit's E scatters about the mean of its four; the sigmas that ``fit`` states say by how much it should.  Right ones have 68 % of the
deviations within one sigma of a deviation.  The accelerometer's triad is the body frame, and each experiment estimates it anew with the
gyroscope, so E is also shown as sqrt(E'E), in which a turn of that frame drops out.  Then the same of simulated sessions against their
truth, where the bias wanders by what nobody told the fit.

    python benchmarks/repeatability_real.py                      # ../shared/mimu
    python benchmarks/repeatability_real.py DIR/e1u0 DIR/e2u0 …  # folders that lie ready, eNuK
"""

from __future__ import annotations

import argparse
import contextlib
import re
import tempfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from common import in_parallel, markdown, simulated
from public import mimu
from scipy.linalg import sqrtm

from session.io.errors import CalibrationError
from tinygc.estimation.fit import fit_session
from tinygc.estimation.options import FitOptions
from tinygc.models.linear import MATRIX
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session

SHARED = Path(__file__).resolve().parent.parent.parent / "shared" / "mimu"
BIASES = ("ends", "stills", "auto")
UPPER = np.triu_indices(3)


@dataclass(frozen=True)
class Job:
    folder: Path
    bias: str


@dataclass(frozen=True)
class Simulated:
    seed: int
    instability_dph: float
    bias: str


@dataclass(frozen=True)
class Found:
    """E (3, 3), covariance (9, 9) of it row by row, used: where the bias came from, tilt: held out, rms deg of ends and stills."""

    unit: str
    E: np.ndarray
    covariance: np.ndarray
    used: str
    tilt: tuple[float, float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, help="session folders eNuK (all of ../shared/mimu)")
    parser.add_argument("--simulated", type=int, default=24, help="simulated sessions for each row; 0: none (%(default)s)")
    parser.add_argument("--seed", type=int, default=6000, help="of the first simulated session (%(default)s)")
    args = parser.parse_args()
    with contextlib.ExitStack() as stack:
        folders = args.folders
        if not folders and SHARED.exists():
            parent = stack.enter_context(tempfile.TemporaryDirectory(prefix="tinygc-"))
            folders = made(Path(parent))
        if folders:
            real(folders)
    if args.simulated:
        simulations(args.simulated, args.seed)


def made(parent: Path) -> list[Path]:
    """Session folders of the authors' own files, the accelerometer as it was measured."""
    return [*mimu.write(SHARED, parent)]


def real(folders: list[Path]) -> None:
    """The table of the recordings."""
    jobs = [Job(folder, bias) for bias in BIASES for folder in folders]
    found = in_parallel(fitted, jobs, "recording")
    rows = []
    for bias, start in zip(BIASES, range(0, len(jobs), len(folders)), strict=True):
        by_unit = defaultdict(list)
        for one in found[start : start + len(folders)]:
            if one is not None:
                by_unit[one.unit].append(one)
        units = [group for group in by_unit.values() if len(group) > 1]
        for words, of in (("E", as_it_is), ("sqrt(E'E)", symmetric)):
            rows.append([f"{bias}, {words}", *_figures([_deviations(group, of) for group in units])])
        if bias == "auto":
            everything = [one for group in units for one in group]
            used = sum(one.used == "stills" for one in everything)
            ends, stills = np.sqrt(np.mean(np.array([one.tilt for one in everything]) ** 2, axis=0))
            held = f"held out, rms over all: ends {ends:.3f}°, stills {stills:.3f}°; auto took the stills in {used} of {len(everything)}"
    print(f"{len(folders)} recordings of {len(units)} units: deviations from the unit's own mean.\n")
    print(markdown(["bias", "within 1σ", "within 2σ", "rms / σ", "rms, mrad", "stated σ, mrad"], rows))
    print(f"\n{held}.\n")


def _figures(by_group: list[tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """Of deviations (n, P) and their sigmas (n, P), group by group; ± by the groups' spread."""
    z = [np.abs(deviation / sigma) for deviation, sigma in by_group]
    inside = np.array([[np.mean(group < bar) for bar in (1, 2)] for group in z])
    spread = inside.std(axis=0, ddof=1) / np.sqrt(len(inside)) if len(inside) > 1 else np.zeros(2)
    deviation, sigma = (np.concatenate([pair[i].ravel() for pair in by_group]) for i in range(2))
    shares = [f"{100 * share:.0f} ± {100 * more:.0f} %" for share, more in zip(inside.mean(axis=0), spread, strict=True)]
    rms = np.sqrt(np.mean(np.concatenate([group.ravel() for group in z]) ** 2))
    return [*shares, f"{rms:.2f}", f"{1e3 * np.sqrt(np.mean(deviation**2)):.2f}", f"{1e3 * np.sqrt(np.mean(sigma**2)):.2f}"]


def _deviations(group: list[Found], of: Callable) -> tuple[np.ndarray, np.ndarray]:
    """(n, P) from the mean of n, and the sigma of such a deviation: of four alike, sqrt(1 - 1/4) of each one's."""
    pairs = [of(one) for one in group]
    values, variance = np.array([value for value, _ in pairs]), np.array([np.diag(covariance) for _, covariance in pairs])
    n = len(values)
    return values - values.mean(axis=0), np.sqrt(variance * (1 - 2 / n) + variance.sum(axis=0) / n**2)


def as_it_is(one: Found) -> tuple[np.ndarray, np.ndarray]:
    """E's nine."""
    return one.E.ravel(), one.covariance


def symmetric(one: Found) -> tuple[np.ndarray, np.ndarray]:
    """The six of sqrt(E'E), which no turn of the frame changes."""
    step = 1e-6
    here = _root(one.E)
    jacobian = np.array([(_root(one.E + step * unit.reshape(3, 3)) - here) / step for unit in np.eye(9)]).T
    return here, jacobian @ one.covariance @ jacobian.T


def _root(E: np.ndarray) -> np.ndarray:
    return np.real(sqrtm(E.T @ E))[UPPER]


def fitted(job: Job) -> Found | None:
    """One recording, as ``fit`` fits it; None where the tool refuses it."""
    unit = re.sub(r"^e\d+", "", job.folder.name)
    try:
        result = fit_session(job.folder, FitOptions(methods=("least_squares",), bias=job.bias))
    except CalibrationError as error:
        print(f"{job.folder.name}: {error}")
        return None
    said = result.bias_from.to_json()
    tilt = (said["ends_holdout_tilt_rms_deg"], said["stills_holdout_tilt_rms_deg"])
    return Found(unit, result.linear.model.E, result.covariance[MATRIX, MATRIX], result.bias_from.used, tilt)


def simulations(count: int, seed: int) -> None:
    """The same of simulated sessions, against the truth."""
    kinds = [(instability, bias) for instability in (0.0, 3.0, 10.0) for bias in BIASES]
    jobs = [Simulated(seed + i, instability, bias) for instability, bias in kinds for i in range(count)]
    found = in_parallel(simulated_error, jobs, "session")
    rows = []
    for number, (instability, bias) in enumerate(kinds):
        own = found[number * count : (number + 1) * count]
        pairs = [(error[None], sigma[None]) for error, sigma, _ in own]
        used = np.mean([stills for _, _, stills in own])
        rows.append([f"{instability:g}", bias, *_figures(pairs), f"{used:.0%}"])
    print(f"Simulated sessions, {count} a row; the fit takes 3 °/h for typical and estimates.\n")
    columns = ["within 1σ", "within 2σ", "rms / σ", "rms, mrad", "stated σ, mrad", "by the stills"]
    print(markdown(["bias instability, °/h", "bias", *columns], rows))


def simulated_error(job: Simulated) -> tuple[np.ndarray, np.ndarray, bool]:
    """E's errors (9,), their sigmas, and whether the stills gave the bias.  The simulated accelerometer is exact: its part is left out."""
    options = SimulationOptions(seed=job.seed, closure_s=0.0, bias_instability_dph=job.instability_dph)
    truth = simulate_session(SimulationOptions(seed=job.seed, segments=1, closure_s=0.0)).unit
    with simulated(options) as folder:
        result = fit_session(folder, FitOptions(methods=("least_squares",), bias=job.bias))
    covariance = (result.covariance - result.accelerometer_covariance)[MATRIX, MATRIX]
    return (result.linear.model.E - truth.E).ravel(), np.sqrt(np.diag(covariance)), result.bias_from.used == "stills"


if __name__ == "__main__":
    main()
