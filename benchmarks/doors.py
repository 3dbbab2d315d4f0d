"""False alarms and sigmas of every door that asks ``tinygc.inference`` something, on recordings with nothing wrong.

    python benchmarks/doors.py [--runs 200] [--seed 0] [--only NAME ...] [--noise-factor 1.3]

Each run draws its own recording, by the generators of the door's own benchmark or tests.  A test is significant if its p-value, over
all that it looks at, is below 5 %; an alarm is what the door says beyond noise: a verdict other than no mismatch, a claim, a question
answered with no, a term, a law, a dependence, a step.  A name needs evidence besides chance, so alarms are fewer than significant tests.
Stated is the share of numbers within one of their own sigmas of the truth; 68 % are expected.  --noise-factor: all noise of the sessions
of ``explain, gravity``, the bias instability too, so many times larger than drawn.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from common import PROCESSES, in_parallel, markdown, simulated
from scipy import stats

from tinygc.simulation.options import SimulationOptions

for folder in ("truth", "tables", "arrays"):
    sys.path.append(str(Path(__file__).resolve().parents[1] / "tests/features" / folder))
sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))


#: data rates and bias instabilities of the sessions of ``explain, gravity``
RATES_HZ, MOST_INSTABILITY_DPH = (62.5, 104.0, 208.0, 416.0, 833.0), 10.0
#: level of a test
LEVEL = 0.05


class Seen(NamedTuple):
    """alarm; what was said; z (K,): errors of stated numbers in their sigmas; p: of the test over all that was looked at."""

    alarm: bool
    said: str = ""
    z: tuple[float, ...] = ()
    p: float | None = None


def drawn(seed: int, noise_factor: float = 1.0) -> SimulationOptions:
    """Options of one null session; white noise 3 to 10 mdps/sqrt(Hz), whose datasheet says 5; bias instability 0 to 10 deg/h."""
    rng = np.random.default_rng([seed, 20260])
    return SimulationOptions(
        seed=seed,
        closure_s=0.0,
        segments=int(rng.integers(20, 61)),
        vigour=float(rng.uniform(0.5, 1.5)),
        odr_hz=float(rng.choice(RATES_HZ)),
        warm_up_c=float(rng.uniform(0, 8)),
        gyro_noise_dps_rthz=float(rng.uniform(0.003, 0.010)) * noise_factor,
        accel_noise_ug_rthz=60.0 * noise_factor,
        bias_instability_dph=float(rng.uniform(0, MOST_INSTABILITY_DPH)) * noise_factor,
    )


def gravity(seed: int, noise_factor: float = 1.0) -> Seen:
    """``explain`` and ``fit`` of a session on a table, each with its own noise, length, vigour, rate and warm-up."""
    import tinygc
    from session.base.results import read_json

    options = drawn(seed, noise_factor)
    with simulated(options) as folder:
        why, fit = tinygc.explain(folder), tinygc.fit(folder, methods=("least_squares",))
        names = _names(why)
        truth = read_json(folder / "truth.json")
        sigma = np.sqrt(np.diag(fit.covariance))
    vector = np.concatenate([np.ravel(truth["E"]), np.radians(truth["B_dps"])])
    z = (fit.result.linear.model.vector - vector) / sigma
    return Seen(why.verdict != "no_mismatch", names, tuple(z), why.explanation.naming.first_p)


def _names(why) -> str:
    return ", ".join(each["id"] for each in why.to_json()["effects"])


def truth_file(seed: int) -> Seen:
    """``explain`` of a session beside a truth file whose clock and frame are right."""
    from truth_sessions import Wrong, write

    import tinygc

    with tempfile.TemporaryDirectory() as folder:
        why = tinygc.explain(write(Path(folder) / "made", Wrong(turns=40), seed))
        names = _names(why)
    return Seen(bool(names), names, p=why.explanation.naming.first_p)


def table(seed: int) -> Seen:
    """The errors of a table that has none beyond its declared accuracy."""
    from table_errors import TABLES, table_of
    from table_errors import drawn as selected

    directions = list(TABLES.values())[seed % len(TABLES)]
    found = selected(table_of(directions), seed, repeatability=seed % 3 / 2)
    return Seen(bool(found.named), ", ".join(each.candidate.id for each in found.named), p=found.first_p)


def array(seed: int) -> Seen:
    """``explain`` of an array of three units with nothing of their own and nothing in common."""
    import tinygc
    from tinygc.features.arrays.feature import ArrayOptions
    from tinygc.features.arrays.simulation import simulate_array, write_array
    from tinygc.simulation.options import SimulationOptions

    with tempfile.TemporaryDirectory() as folder:
        options = SimulationOptions(segments=20, closure_s=0.0, odr_hz=104.0, seed=seed)
        where = write_array(simulate_array(options, ArrayOptions(units=3)), Path(folder) / "array")
        verdict = tinygc.array(where).explain().to_json()["verdict"]
    return Seen(verdict not in ("no_mismatch", "undecided"), verdict)


def verify(seed: int) -> Seen:
    """``verify`` of a unit that is as it was, but for what a switch-on does."""
    from verify import Job, run

    outcome = run(Job(seed % 20, 1000 + seed))
    return Seen(outcome.alarm, ", ".join(outcome.causes))


def noise(seed: int) -> Seen:
    """Noise terms of a rest of 20 minutes of white noise."""
    from noise_terms import RATE_HZ, rest

    from tinygc.features.noise.estimate import estimate_noise

    values = np.sqrt(RATE_HZ) * np.random.default_rng([7, seed]).standard_normal((round(1200 * RATE_HZ), 6))
    axes = [axis for sensor in estimate_noise([rest(values)]).figures.sensors().values() for axis in sensor.axes]
    more = [name for name, term in axes[0].terms.items() if name != "N" and term.chosen]
    white = [axis.terms["N"] for axis in axes]
    return Seen(bool(more), ", ".join(more), tuple((term.value - 1) / term.sigma for term in white if term.sigma))


def temperature(seed: int) -> Seen:
    """The zero over temperature where it does not follow it; its slope and bend where it does."""
    from temperature import errors, fitted

    fit, _ = fitted(1000 + seed, follows=False)
    z = np.array(errors(seed, lag_s=0.0))
    return Seen(fit.order > 0, "temperature" * (fit.order > 0), tuple(z[np.isfinite(z)]))


def rates(seed: int) -> Seen:
    """A true straight line on a rate table."""
    from rate_steps import SCALE
    from rate_steps import table as curve

    from tinygc.features.tables.rates.choice import choose

    choice = choose(curve("line", np.random.default_rng([9, seed])))
    line = choice.line
    scale, sigma = float(line.vector[-1]), float(np.sqrt(line.covariance[-1, -1]))
    return Seen(not choice.is_line, "" if choice.is_line else choice.fit.hypothesis.name, ((scale - SCALE) / sigma,), choice.p_value)


def history(seed: int) -> Seen:
    """A unit without shocks, over six sessions."""
    from history import Unit, estimated

    found = estimated(Unit(seed))
    share = np.asarray(found["drift"], dtype=float)
    return Seen(bool(found["false"]), "step" * bool(found["false"]), tuple(np.where(share, 0.0, 9.0)))


DOORS: dict[str, Callable[[int], Seen]] = {
    "explain, gravity": gravity,
    "explain, truth file": truth_file,
    "explain, table": table,
    "explain, array": array,
    "verify": verify,
    "noise terms": noise,
    "temperature": temperature,
    "rates": rates,
    "history": history,
}
#: times as many runs as the others: seconds each
FEWER = {"explain, array": 0.3}


def run(job: tuple[str, int, float]) -> Seen | str:
    """One run; its error where the door refuses."""
    from session.base.errors import CalibrationError

    name, seed, noise_factor = job
    try:
        return gravity(seed, noise_factor) if DOORS[name] is gravity else DOORS[name](seed)
    except CalibrationError as error:
        return str(error)


def share(count: int, of: int) -> str:
    """Share with its sigma, in per cent."""
    p = count / of
    return f"{100 * p:.1f} ± {100 * np.sqrt(max(p * (1 - p), 1 / of) / of):.1f} %"


HEAD = ["door", "runs", "p below 5 %", "uniform", "false alarms", "said", "within one sigma", "s a run"]


def main() -> None:
    """Print a row for each door."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first run")
    parser.add_argument("--only", nargs="+", choices=DOORS, default=list(DOORS), metavar="NAME", help=", ".join(DOORS))
    parser.add_argument("--noise-factor", type=float, default=1.0)
    parser.add_argument("--processes", type=int, default=PROCESSES)
    args = parser.parse_args()
    rows = []
    for name in args.only:
        began, runs = time.perf_counter(), max(1, round(FEWER.get(name, 1.0) * args.runs))
        found = in_parallel(run, [(name, args.seed + number, args.noise_factor) for number in range(runs)], name, args.processes)
        for error in {each for each in found if isinstance(each, str)}:
            print(f"refused: {error}", file=sys.stderr)
        seen = [each for each in found if not isinstance(each, str)]
        p = [each.p for each in seen if each.p is not None]
        said = Counter(each.said for each in seen if each.alarm)
        z = np.array([value for each in seen for value in each.z])
        rows.append(
            [
                name,
                len(seen),
                share(sum(each < LEVEL for each in p), len(p)) if p else "–",
                f"{stats.kstest(p, 'uniform').pvalue:.2f}" if p else "–",
                share(sum(each.alarm for each in seen), len(seen)),
                "; ".join(f"{what or 'no name'} {count}" for what, count in said.most_common(4)) or "–",
                share(int(np.sum(np.abs(z) <= 1)), len(z)) if len(z) else "–",
                f"{(time.perf_counter() - began) * args.processes / runs:.2f}",
            ]
        )
        print(" | ".join(map(str, rows[-1])), file=sys.stderr)
    print(markdown(HEAD, rows))


if __name__ == "__main__":
    main()
