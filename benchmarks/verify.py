"""``verify`` on simulated years of one unit: false alarms, causes that are found, and what they cost.

A unit is calibrated once by 30 turns.  A year later a session of a few turns is recorded: with a zero that moved as between switch-ons, an
accelerometer whose calibration is off by what is assumed of a given one, and one fault of the list, at four sizes, or none.  The false
alarm is counted by ``alarm``, a cause is right where its name is the fault's, and the cost is compared with that of the true sensor on the
same motion.  An answer is wrong where it lets a model be used that truly misses more than the limit in that motion: as it is, or with B
anew.

    python benchmarks/verify.py --null 200
    python benchmarks/verify.py --faults 3
    python benchmarks/verify.py --mimu FOLDER       # sessions of ``python -m benchmarks.public mimu``, which are fitted there first
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from common import in_parallel, markdown
from scipy.signal import lfilter

import tinygc
from session.base import rotation
from session.base.results import read_json
from session.base.units import DEG, MG
from session.log.folder import Session, read_session
from tinygc.closure.motion import LIMIT_DEG
from tinygc.closure.residual import closure_angles
from tinygc.estimation.between_sessions import course
from tinygc.estimation.spread import ACCELEROMETER, COUNT, GYROSCOPE, USUAL, ZERO, Spread
from tinygc.features.unit.options import VerifyOptions
from tinygc.features.unit.verification.cost import minute_of
from tinygc.features.unit.verification.questions import PLAUSIBLE, ask, expected_parts, todays_noise
from tinygc.features.unit.verification.rows import LENGTH, Rows, rows_of
from tinygc.features.unit.verification.verdict import Verified, verify_session
from tinygc.fitting.unit_state import UnitState, fitted_state, read_state, spread_of, spread_over
from tinygc.inference.decide import BIAS, HOLDS
from tinygc.library.simulations import Simulated
from tinygc.models.linear import LinearModel
from tinygc.simulation.options import SimulatedUnit, SimulationOptions
from tinygc.simulation.simulator import simulate_session, unit_of

#: turns of the calibration and of today; how far the accelerometer's calibration is off, and moves, m/s^2 at zero g
THEN, TODAY = 30, 12
ACCEL_MPS2 = 0.1 * MG
#: fault -> its four sizes and their unit
FAULTS: dict[str, tuple[tuple[float, ...], str]] = {
    "bias": ((0.5, 1.0, 2.0, 4.0), "dps"),
    "temperature": ((0.02, 0.04, 0.08, 0.16), "dps/K, 20 K warmer"),
    "warm-up": ((0.1, 0.3, 1.0, 2.0), "dps"),
    "step": ((0.03, 0.1, 0.3, 1.0), "dps"),
    "common scale": ((0.3, 1.0, 3.0, 10.0), "%"),
    "scale": ((0.3, 0.6, 1.0, 2.0), "% of one axis"),
    "rotation": ((3.0, 6.0, 15.0, 50.0), "mrad"),
    "shock": ((3.0, 6.0, 10.0, 20.0), "mrad, and 50 times as many mdps"),
    "filter": ((20.0, 10.0, 5.0, 2.0), "Hz, one pole"),
    "accelerometer's bias": ((2.0, 5.0, 10.0, 30.0), "mg"),
    "accelerometer's scale": ((0.3, 0.6, 1.0, 2.0), "% of one axis"),
}
WARMER_K = 20.0
#: rad: a cost below this, a tenth of a degree, is not compared
LEAST_RAD = 0.1 * DEG


@dataclass(frozen=True)
class Job:
    """unit and session: seeds; fault, None without one, and its size; turns of today."""

    unit: int
    session: int
    fault: str | None = None
    size: float = 0.0
    turns: int = TODAY


@dataclass(frozen=True)
class Outcome:
    """job; whether an alarm; answer; names of the causes, and of those not told apart from the first; how far the
    stated cost is off and the true one, rad, as it is and with B anew; p by question."""

    job: Job
    alarm: bool
    answer: str
    causes: tuple[str, ...]
    instead: tuple[str, ...]
    off: float
    truth: float
    off_anew: float
    truth_anew: float
    p: tuple[float, ...]

    @property
    def is_wrong(self) -> bool:
        """Whether its answer lets a model be used that misses more than the limit."""
        missed = {HOLDS: self.truth, BIAS: self.truth_anew}.get(self.answer, 0.0)
        return missed > LIMIT_DEG * DEG


@cache
def calibrated(unit: int) -> tuple[UnitState, SimulatedUnit]:
    """The calibration of a unit, and the unit as it was then."""
    options = SimulationOptions(segments=THEN, closure_s=0.0, odr_hz=104.0, seed=10_000 + unit, unit_seed=unit)
    rng = np.random.default_rng([1, unit])
    then = replace(unit_of(options), accel_shift=rng.normal(0, ACCEL_MPS2, 3))
    fit = tinygc.fit(Simulated({}, simulate_session(options, unit=then)).session, methods=("least_squares",))
    with tempfile.TemporaryDirectory() as folder:
        fit.save(folder)
        return read_state(Path(folder) / "model_least_squares.json"), then


def today_of(job: Job, then: SimulatedUnit) -> tuple[Session, Callable[[np.ndarray], np.ndarray], SimulatedUnit, np.ndarray]:
    """The session; the zero's drift (N, 3) rad/s over seconds (N,); the unit today; temperature's part of B (3,)."""
    rng = np.random.default_rng([2, job.unit, job.session])
    zero = then.B + rng.normal(0, np.sqrt(2) * USUAL.sigma[ZERO])
    unit = replace(then, B=zero, accel_shift=then.accel_shift + rng.normal(0, ACCEL_MPS2, 3))
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    size, options = (
        job.size,
        SimulationOptions(segments=job.turns, closure_s=0.0, odr_hz=104.0, seed=20_000 + job.session, unit_seed=job.unit),
    )

    def drift(t_s: np.ndarray) -> np.ndarray:
        return np.zeros((len(t_s), 3))

    if job.fault == "bias":
        unit = replace(unit, B=unit.B + size * DEG * direction)
    elif job.fault == "temperature":
        options = replace(options, temperature_start_c=options.temperature_start_c + WARMER_K)
        unit = replace(unit, B=unit.B + size * DEG * WARMER_K * direction)
    elif job.fault == "warm-up":
        tau = rng.uniform(10, 40)

        def drift(t_s: np.ndarray) -> np.ndarray:
            return size * DEG * direction * np.exp(-np.maximum(t_s, 0) / tau)[:, None]

    elif job.fault == "step":
        at = rng.uniform(0.3, 0.7) * job.turns * 5

        def drift(t_s: np.ndarray) -> np.ndarray:
            return size * DEG * direction * (t_s >= at)[:, None]

    elif job.fault == "common scale":
        factor = 1 + size / 100 * rng.choice([-1.0, 1.0])
        unit = replace(unit, E=unit.E * factor, B=unit.B)
    elif job.fault == "scale":
        unit = replace(unit, E=unit.E @ np.diag(1 + size / 100 * axis))
    elif job.fault == "rotation":
        turn = rotation.matrix(rotation.exp(size * 1e-3 * direction))
        unit = replace(unit, E=turn @ unit.E, B=turn @ unit.B)
    elif job.fault == "shock":
        x, y, z = size * 1e-3 * rng.standard_normal(3)
        shear = np.eye(3) + np.array([[0, x, z], [x, 0, y], [z, y, 0]]) / 2
        unit = replace(unit, E=shear @ unit.E, B=unit.B + size * 0.05 * DEG * direction)
    elif job.fault == "accelerometer's bias":
        unit = replace(unit, accel_shift=unit.accel_shift + size * MG * direction)
    elif job.fault == "accelerometer's scale":
        unit = replace(unit, accel_matrix=np.diag(1 + size / 100 * axis) @ unit.accel_matrix)
    share = np.exp(-2 * np.pi * size / options.odr_hz)

    def distort(t_s: np.ndarray, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray) -> np.ndarray:
        if job.fault == "filter":
            return np.asarray(lfilter([1 - share], [1, -share], rate, axis=0, zi=share * rate[:1])[0])
        return rate + drift(t_s)

    distorts = job.fault in ("warm-up", "step", "filter")
    made = Simulated({}, simulate_session(options, distort if distorts else None, unit=unit)).session
    return made, drift, unit, direction


def run(job: Job) -> Outcome:
    """One verification against the truth."""
    old, then = calibrated(job.unit)
    session, drift, unit, _ = today_of(job, then)
    temp = 25.0 if job.fault == "temperature" else None
    found = verify_session(replace(old, table=old.table | {"temperature_c": temp}), session, VerifyOptions())
    truth, off, truth_anew, off_anew = cost_in_truth(found, unit, drift)
    diagnosis = found.diagnosis
    causes = () if diagnosis is None else diagnosis.best.names
    instead = diagnosis.rivals.get(causes[0], ()) if causes and diagnosis is not None else ()
    p = tuple(q.p_value if q.tested else 1.0 for q in found.questions)
    return Outcome(job, found.alarm, found.answer, causes, instead, off, truth, off_anew, truth_anew, p)


def cost_in_truth(found: Verified, unit: SimulatedUnit, drift: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float, float, float]:
    """What the old calibration truly costs in the same minute, rad, and how far the stated error lies from the true one; the same with B
    taken anew."""
    motion, old = minute_of(found.rows), found.old.linear
    first = 0.0 if found.rows.twin is None else found.rows.twin.segments[0].start_s
    mean = drift(first + np.linspace(0, motion.duration_s, 200)).mean(axis=0)
    true = LinearModel(unit.E, unit.B - mean)
    errors = [motion.largest_error(each, true)[1] for each in (old, old.with_bias_moved(found.bias_change))]
    stated = found.cost.as_it_is, found.cost.with_new_bias
    sizes = [float(np.linalg.norm(error)) for error in errors]
    off = [float(np.linalg.norm(said - error)) for said, error in zip(stated, errors, strict=True)]
    return sizes[0], off[0], sizes[1], off[1]


def nulls(count: int, turns: int) -> list[str]:
    """Sessions without a fault."""
    found = list(in_parallel(run, [Job(k % 40, 1000 + k, turns=turns) for k in range(count)], "null"))
    p = np.array([outcome.p for outcome in found])
    rows = [[f"{turns} turns", str(count), f"{sum(o.alarm for o in found)}", f"{100 * sum(o.alarm for o in found) / count:.1f} %"]]
    rows[0] += [f"{np.mean(p[:, k] < 0.0127):.3f} / {np.mean(p[:, k] < 0.5):.2f}" for k in range(p.shape[1])]
    head = ["today", "sessions", "false alarms", "share", "E: p < 0.0127 / p < 0.5", "B", "gravity", "noise"]
    return [markdown(head, rows), f"answers: {dict(Counter(o.answer for o in found))}; wrong: {sum(o.is_wrong for o in found)}"]


def faults(count: int, turns: int, only: str | None) -> list[str]:
    """Sessions with each fault at each size."""
    names = [only] if only else list(FAULTS)
    jobs = [
        Job(k, 2000 + 100 * n + 10 * s + k, name, size, turns)
        for n, name in enumerate(FAULTS)
        for s, size in enumerate(FAULTS[name][0])
        for k in range(count)
        if name in names
    ]
    found = list(in_parallel(run, jobs, "faults"))
    rows = []
    for name in names:
        for size in FAULTS[name][0]:
            own = [o for o in found if o.job.fault == name and o.job.size == size]
            alarms = [o for o in own if o.alarm]
            right = sum(o.causes[:1] == (name,) or name in o.causes for o in alarms)
            among = sum(name in o.causes or name in o.instead for o in alarms)
            others = Counter("+".join(o.causes) for o in alarms if name not in o.causes)
            near = sum(o.off <= 0.3 * o.truth for o in own)
            anew = [o for o in own if o.truth_anew > LEAST_RAD]
            near_anew = sum(o.off_anew <= 0.3 * o.truth_anew for o in anew)
            mean, mean_anew = (np.degrees(np.mean([getattr(o, name) for o in own])) for name in ("truth", "truth_anew"))
            rows.append(
                [
                    name,
                    f"{size:g} {FAULTS[name][1]}",
                    f"{len(alarms)} of {len(own)}",
                    str(right),
                    str(among),
                    f"{mean:.2f}°",
                    f"{near} of {len(own)}",
                    f"{mean_anew:.2f}°",
                    f"{near_anew} of {len(anew)}",
                    ", ".join(f"{k} {v}" for k, v in Counter(o.answer for o in own).items()),
                    str(sum(o.is_wrong for o in own)),
                    ", ".join(f"{k or 'none'} {v}" for k, v in others.items()),
                ]
            )
    head = [
        "fault",
        "size",
        "alarms",
        "right cause",
        "right, or not told apart",
        "true cost",
        "within 30 %",
        "with B anew",
        "within 30 %",
        "answers",
        "wrong answers",
        "instead",
    ]
    return [markdown(head, rows)]


# Real units: eight MPU-9150, up to six sessions each, every pair of sessions of a unit.


@dataclass(frozen=True)
class Pair:
    """Folders of two sessions of one unit, those of all other units, and the other ones of this unit."""

    then: Path
    today: Path
    others: tuple[Path, ...]
    history: tuple[Path, ...]


def unit_and_session(folder: Path) -> tuple[str, str]:
    """``e1u3`` is experiment 1 of unit 3."""
    session, unit = folder.name[1:].split("u")
    return unit, session


def spread_of_others(folders: tuple[Path, ...]) -> Spread:
    """Spread between sessions of one unit, over all units but the one that is verified."""
    by_unit: dict[str, list[Path]] = {}
    for folder in folders:
        by_unit.setdefault(unit_and_session(folder)[0], []).append(folder)
    sums, freedom = np.zeros(COUNT), 0
    for own in by_unit.values():
        sessions, values, stated = [fitted_state(folder) for folder in own], np.zeros((len(own), COUNT)), np.zeros((len(own), COUNT))
        for j, each in enumerate(sessions):
            fit = each.triad
            values[j, GYROSCOPE], stated[j, GYROSCOPE] = each.vector, np.diag(each.covariance)
            values[j, ACCELEROMETER] = fit.values
            stated[j, ACCELEROMETER] = np.diag(fit.jacobian @ np.asarray(fit.covariance) @ fit.jacobian.T)
        models = [course(values[:, q], stated[:, q], np.arange(len(own), dtype=float)).model for q in range(COUNT)]
        sums, freedom = sums + np.array([model.freedom * model.counted**2 for model in models]), freedom + models[0].freedom
    return Spread.of(slice(None), np.sqrt(sums / freedom), "sessions of the other units", freedom)


def run_pair(pair: Pair) -> tuple[str, str, dict[str, tuple[float, ...]], tuple[float, ...]]:
    """p of each question with the usual spread, that of the other units, and that of the unit's own other sessions; tilt, degrees, that
    today's turns miss with the old E and, held out, with today's own fit; rms of gravity's length in today's stills, mg, with the old
    accelerometer and, held out, with today's own."""
    old, session = read_state(pair.then), read_session(pair.today)
    rows = rows_of(session, old)
    noise = todays_noise(rows)
    found = {}
    for name, spread in (
        ("usual", spread_of(session.config, old.table)),
        ("other units", spread_of_others(pair.others)),
        ("own history", spread_of(session.config, old.table, between=spread_over(pair.history, session, old.accelerometer))),
    ):
        asked = ask(rows, expected_parts(old, rows, spread), noise, old)
        found[name] = tuple(question.p_value if question.tested else 1.0 for question in asked)
    own = fitted_state(pair.today)
    twin = rows.twin
    assert twin is not None
    model = LinearModel(old.linear.E, old.linear.B + (own.vector - old.linear.vector)[9:])  # E is compared: B is today's
    tilt = float(np.degrees(np.sqrt(np.mean(np.sum(closure_angles(twin.batch, model)[:, :2] ** 2, axis=1)))))
    held_out = read_json(pair.today / "fit" / "fit.json")["methods"]["least_squares"]["holdout"]["tilt_rms_deg"]
    return pair.then.name, pair.today.name, found, (tilt, float(held_out), *lengths_mg(rows))


def lengths_mg(rows: Rows) -> tuple[float, float]:
    """Rms of gravity's length about its mean, with the old accelerometer, and with one fitted to every second still and used on the
    others."""
    part = rows.kinds[LENGTH]
    r, A = rows.r[part], rows.parameters[part, ACCELEROMETER] * PLAUSIBLE[ACCELEROMETER]
    A = np.column_stack([A, np.full(len(r), 0.02)])
    left = np.empty_like(r)
    for fold in (0, 1):
        own = np.arange(len(r)) % 2 == fold
        fitted = np.linalg.solve(A[~own].T @ A[~own] + (0.1 * MG) ** 2 * np.eye(A.shape[1]), A[~own].T @ r[~own])
        left[own] = r[own] - A[own] @ fitted
    return float(np.std(r) / MG), float(np.std(left) / MG)


def real(folder: Path, most: int) -> list[str]:
    """All pairs of sessions of one unit, or ``most`` of them."""
    folders = sorted(each.parent.parent for each in folder.glob("e*u*/fit/model_least_squares.json"))
    pairs = []
    for then in folders:
        others = tuple(each for each in folders if unit_and_session(each)[0] != unit_and_session(then)[0])
        mine = [each for each in folders if unit_and_session(each)[0] == unit_and_session(then)[0] and each != then]
        pairs += [Pair(then, today, others, tuple(each for each in mine if each != today)) for today in mine]
    chosen = np.random.default_rng(0).permutation(len(pairs))[: most or len(pairs)]
    found = in_parallel(run_pair, [pairs[k] for k in sorted(chosen)], "pairs")
    rows, level = [], 1 - 0.95 ** (1 / 4)
    for name in ("usual", "other units", "own history"):
        p = np.array([each[2][name] for each in found])
        any_ = float(np.mean((p < level).any(axis=1)))
        rows.append(
            [name, str(len(p)), f"{100 * any_:.1f} %", *(f"{np.mean(p[:, k] < level):.3f} / {np.median(p[:, k]):.2f}" for k in range(4))]
        )
    tilt = np.array([each[3] for each in found])
    moved = np.array([each[2]["usual"][2] for each in found]) < level
    e_moved = np.array([each[2]["usual"][0] for each in found]) < level
    said = [f"tilt of today's turns, E of then and B of today / all of today, held out: median {np.median(tilt[:, 0] / tilt[:, 1]):.2f}"]
    for what, which in (("where E is said to hold", ~e_moved), ("where it is not", e_moved)):
        if which.any():
            said.append(f"{what}: {np.median(tilt[which, 0] / tilt[which, 1]):.2f} ({which.sum()} pairs)")
    ratio = tilt[:, 2] / tilt[:, 3]
    said.append(f"gravity's length, old accelerometer / own, held out: {np.median(ratio[moved]):.2f} where it is said to have changed")
    return [markdown(["spread", "pairs", "any no", "E: share of no / median p", "B", "gravity", "noise"], rows), *said]


def main() -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--null", type=int, default=0, metavar="N", help="sessions without a fault")
    parser.add_argument("--faults", type=int, default=0, metavar="N", help="sessions of each fault and size")
    parser.add_argument("--only", choices=tuple(FAULTS), help="one fault alone")
    parser.add_argument("--mimu", type=Path, metavar="DIR", help="folder of fitted sessions e1u0, e1u1, … of the public set")
    parser.add_argument("--pairs", type=int, default=0, metavar="N", help="of these, drawn at random (all)")
    parser.add_argument("--turns", type=int, default=TODAY, help="of today")
    args = parser.parse_args()
    if args.mimu is not None:
        print("\n".join(real(args.mimu, args.pairs)), flush=True)
    for lines in ([nulls(args.null, args.turns)] if args.null else []) + (
        [faults(args.faults, args.turns, args.only)] if args.faults else []
    ):
        print("\n".join(lines), flush=True)


if __name__ == "__main__":
    main()
