"""A drift of the accelerometer's zero within each recording of mimu, and what it does to nonorthogonality from day to day.

    python benchmarks/accelerometer_drift.py [../shared/mimu ../shared/wild/mimu]

Each unit of each experiment is prepared as ``fit`` does, with the drift and without.  Residuals are those of gravity's length in the stills
between the turns; the last still, after 100 s of shaking, is left out.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import combinations
from pathlib import Path

import numpy as np
from common import markdown
from public import mimu

from session.detect.accelerometer import SHEARS
from session.io.units import MG
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem
from tinygc.estimation.accelerometer import accelerometer_fit

SPAN_S = 500.0
MRAD = 1e-3


def state_of(problem: Problem) -> tuple[np.ndarray, np.ndarray, float]:
    """Nonorthogonality (3,) and its sigma, mrad; rms of the lengths' residuals, mg."""
    fit = accelerometer_fit(problem.session.config.accelerometer, problem.joint, None, problem.session.config.site.expected_gravity_mps2)
    return fit.values[SHEARS] / MRAD, fit.sigmas[SHEARS] / MRAD, float(np.sqrt(np.mean(problem.joint.after[:-1] ** 2))) / MG


def pulls(states: dict, which: int, units: list[int], days: list[int]) -> np.ndarray:
    """Differences of nonorthogonality between two days of a unit, in their sigmas."""
    found = []
    for unit in units:
        for one, other in combinations([states[day, unit][which] for day in days], 2):
            found.append((one[0] - other[0]) / np.hypot(one[1], other[1]))
    return np.abs(np.concatenate(found))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folders", nargs="*", type=Path, default=[Path("../shared/mimu"), Path("../shared/wild/mimu")])
    folders = arguments.parse_args().folders
    states, rows, found = {}, [], {}
    with tempfile.TemporaryDirectory() as made:
        for source in folders:
            for folder in mimu.write(source, Path(made)):
                day, unit = (int(part) for part in folder.name[1:].split("u"))
                prepared = prepare(folder)
                joint = prepared.problem.joint
                states[day, unit] = state_of(prepared.given or prepared.problem), state_of(prepared.problem)
                if joint.drift is not None:
                    scale = SPAN_S / joint.drift.duration_s / MG
                    found[day, unit] = joint.drift.mps2 * scale, joint.drift.sigma_mps2 * scale, joint.drift.significant
    days, units = (sorted({key[i] for key in states}) for i in (0, 1))
    for day in days:
        own = [found[day, unit] for unit in units if (day, unit) in found]
        strongest = [drift[np.argmax(np.abs(drift) / sigma)] for drift, sigma, _ in own]
        rms = [np.mean([states[day, unit][which][2] for unit in units]) for which in (0, 1)]
        rows.append(
            [
                f"e{day}",
                f"{sum(s for *_, s in own)} of {len(own)}",
                f"{min(strongest):.1f} to {max(strongest):.1f}",
                *(f"{r:.3f}" for r in rms),
            ]
        )
    print(markdown(["experiment", "p below 0.01", f"mg in {SPAN_S:.0f} s, strongest axis", "length rms without, mg", "with, mg"], rows))
    for which, name in ((0, "without"), (1, "with")):
        spread = np.array([[states[day, unit][which][0] for day in days] for unit in units]).std(axis=1, ddof=1)
        apart = pulls(states, which, units, days)
        size, sigmas = np.sqrt(np.mean(spread**2)), np.sqrt(np.mean(apart**2))
        print(f"{name} the drift: nonorthogonality from day to day {size:.2f} mrad rms, {sigmas:.2f} of its sigmas,")
        print(f"{np.mean(apart < 1):.0%} of the differences within one sigma, {apart.max():.1f} at most")


if __name__ == "__main__":
    main()
