"""Faults of a truth file: what ``explain`` names where it fails, jumps, is smoothed or late, alone and beside an effect of the sensor.

Simulated sessions (``truth_alignment.simulated``) and windows of EuRoC, whose truth is spoilt here: by none of the detector's code.
``python benchmarks/truth_faults.py`` prints a table with a row for each fault; ../shared/euroc is left out where it is not there.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from common import markdown
from public.euroc import write_sequences
from scipy.spatial.transform import Rotation, Slerp
from truth_alignment import EUROC, simulated

from session.io.folder import Session, read_session
from session.io.logfile import Truth
from session.io.units import DEG, NS_PER_S, G
from tinygc.explanation.truth_engine import explain_truth

WINDOWS = (("V1_02", 10.0), ("V1_03", 20.0), ("V2_02", 30.0))  #: sequence, and where its window begins, s
WINDOW_S = 50.0
#: turns of 2 s, noise of a moment in degrees, s between moments
SIMULATED = (25, 0.02, 0.02)
#: of a truth's errors, whichever of them is there: none of them says anything about the sensor
OF_THE_TRUTH = ("reference.", "timing.truth_offset")
#: shapes without a name say nothing but that something is left
NAMELESS = "unknown."

Attitudes = tuple[np.ndarray, Rotation]
Fault = Callable[[np.random.Generator, np.ndarray, Rotation], Attitudes]


def _lost(start_s: float, stop_s: float, how: str) -> Fault:
    """A camera system loses the body between two times, s from the first moment; a start before it counts from the last."""

    def spoil(rng: np.random.Generator, t_s: np.ndarray, q: Rotation) -> Attitudes:
        begin = start_s if start_s >= 0 else t_s[-1] + start_s
        inside = np.flatnonzero((t_s >= begin) & (t_s <= stop_s))
        before, after = max(inside[0] - 1, 0), min(inside[-1] + 1, len(t_s) - 1)
        quaternions = q.as_quat()
        if how == "frozen":
            quaternions[inside] = quaternions[before if before not in inside else after]
        elif how == "bridged":
            quaternions[inside] = Slerp(t_s[[before, after]], q[[before, after]])(t_s[inside]).as_quat()
        else:  # it follows other markers: a wandering rate of some 100 dps that is renewed every 0.1 to 0.4 s
            steps = np.diff(t_s, prepend=t_s[0])[inside]
            changes = np.cumsum(rng.random(len(inside)) < steps / rng.uniform(0.1, 0.4))
            rates = rng.normal(size=(changes[-1] + 1, 3)) * rng.uniform(60, 150) * DEG
            turned, seen = Rotation.identity(), []
            for step, rate in zip(steps, rates[changes], strict=True):
                turned = turned * Rotation.from_rotvec(rate * step)
                seen.append(turned)
            quaternions[inside] = (q[inside] * Rotation.concatenate(seen)).as_quat()
        return t_s, Rotation.from_quat(quaternions)

    return spoil


def _jumps(rng: np.random.Generator, t_s: np.ndarray, q: Rotation) -> Attitudes:
    """Three stretches of 30 ms, each wrong by one rotation of 2 to 6 degrees; they begin where segments of 2 s do."""
    turned = np.zeros((len(t_s), 3))
    for number in rng.choice(np.arange(2, int((t_s[-1] - t_s[0]) / 2) - 2), 3, replace=False):
        near = np.abs(t_s - (t_s[0] + 2.0 * number)) < 0.015
        axis = rng.normal(size=3)
        turned[near] = axis / np.linalg.norm(axis) * rng.uniform(2, 6) * DEG
    return t_s, q * Rotation.from_rotvec(turned)


def _smoothed(width_s: float) -> Fault:
    """A moving mean of the attitude, with as much before as after."""

    def spoil(rng: np.random.Generator, t_s: np.ndarray, q: Rotation) -> Attitudes:
        del rng
        steps, at = np.linspace(-width_s / 2, width_s / 2, 21), Slerp(t_s, q)
        seen = [at(np.clip(t_s + step, t_s[0], t_s[-1])).as_quat() for step in steps]
        seen = [values * np.sign(np.sum(values * seen[10], axis=1, keepdims=True)) for values in seen]
        inside = (t_s > t_s[0] + width_s) & (t_s < t_s[-1] - width_s)
        return t_s[inside], Rotation.from_quat(np.mean(seen, axis=0)[inside])

    return spoil


def _late(seconds: float) -> Fault:
    def spoil(rng: np.random.Generator, t_s: np.ndarray, q: Rotation) -> Attitudes:
        del rng
        return (t_s + seconds)[:-50], q[:-50]

    return spoil


def _shaky(jitter_s: float) -> Fault:
    """Each moment errs in proportion to the rate, in any direction."""

    def spoil(rng: np.random.Generator, t_s: np.ndarray, q: Rotation) -> Attitudes:
        rate = np.linalg.norm((q[:-1].inv() * q[1:]).as_rotvec(), axis=1) / np.diff(t_s)
        rate = np.convolve(np.append(rate, rate[-1]), np.ones(5) / 5, mode="same")
        return t_s, q * Rotation.from_rotvec(rng.normal(size=(len(t_s), 3)) * rate[:, None] * jitter_s)

    return spoil


#: name -> the fault, and the ids that name it; none is asked for of noise
FAULTS: dict[str, tuple[Fault, tuple[str, ...]]] = {
    "none": (lambda rng, t_s, q: (t_s, q), ()),
    "lost at the end, 1.3 s": (_lost(-1.3, np.inf, "astray"), ("reference.truth_outage",)),
    "lost at the beginning, 1.5 s": (_lost(0.0, 1.5, "astray"), ("reference.truth_outage",)),
    "lost in the middle, 3 s": (_lost(21.0, 24.0, "astray"), ("reference.truth_outage",)),
    "frozen at the end, 2.5 s": (_lost(-2.5, np.inf, "frozen"), ("reference.truth_outage",)),
    "frozen in the middle, 2.5 s": (_lost(15.0, 17.5, "frozen"), ("reference.truth_outage",)),
    "bridged in the middle, 3 s": (_lost(30.0, 33.0, "bridged"), ("reference.truth_outage",)),
    "three moments jump": (_jumps, ("reference.truth_jump", "reference.truth_outage")),
    "smoothed, 100 ms": (_smoothed(0.1), ("reference.truth_smoothing",)),
    "late, 12 ms": (_late(0.012), ("timing.truth_offset",)),
    "noise of 4 ms times the rate": (_shaky(0.004), ()),
}


def _g_sensitivity(session: Session) -> np.ndarray:
    return session.logs[0].samples.accel[:, [1, 2, 0]] / G * DEG


def _asymmetry(session: Session) -> np.ndarray:
    return np.abs(session.logs[0].samples.gyro) * [0.015, -0.01, 0.02]


def _step(session: Session) -> np.ndarray:
    t_s = session.logs[0].samples.t_s
    return (t_s > 0.6 * t_s[-1])[:, None] * np.multiply((0.6, -0.4, 0.8), DEG)


EFFECTS: dict[str, Callable[[Session], np.ndarray]] = {
    "gyro.g_sensitivity": _g_sensitivity,
    "gyro.scale_asymmetry": _asymmetry,
    "gyro.bias_step": _step,
}


#: in flight the thrust holds the specific force along one axis, and its sensitivity is a constant bias
FLOWN = ("gyro.scale_asymmetry", "gyro.bias_step")


@dataclass(frozen=True)
class Trial:
    """One explanation: source and fault; effect added, if any; ids that are named, ids that are said to be as good, and ids of the sensor
    that are named without the fault as well."""

    source: str
    fault: str
    effect: str | None
    named: frozenset[str]
    as_good: frozenset[str]
    own: frozenset[str] = frozenset()

    @property
    def false(self) -> frozenset[str]:
        """Effects of the sensor that are named for the fault."""
        return frozenset(i for i in self.named if not i.startswith((*OF_THE_TRUTH, NAMELESS)) and i != self.effect) - self.own

    @property
    def found(self) -> bool:
        """Whether the added effect is named, or said to be as good as what is."""
        return self.effect in self.named | self.as_good

    @property
    def fault_named(self) -> bool:
        """Whether the fault of the truth is named."""
        return bool(self.named & set(FAULTS[self.fault][1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="simulated sessions for each fault and effect (%(default)s)")
    parser.add_argument("--fault", action="append", choices=tuple(FAULTS), help="only these faults")
    parser.add_argument("--verbose", action="store_true", help="print each trial")
    args = parser.parse_args()
    faults = args.fault or list(FAULTS)
    sources = {f"simulated {seed}": _simulated(seed) for seed in range(args.seeds)}
    if EUROC.is_dir():
        sources |= {name: _window(name, begin_s) for name, begin_s in WINDOWS}
    trials: list[Trial] = []
    for fault in faults:
        for number, (name, session) in enumerate(sources.items()):
            # Each source with the fault alone, and with one of the effects in turn.
            effects = list(EFFECTS) if name.startswith("simulated") else FLOWN
            for effect in (None, effects[(number + faults.index(fault)) % len(effects)]):
                bad = spoilt(_with(session, effect), fault, seed=100 * list(FAULTS).index(fault) + number)
                trial = explained(name, fault, effect, bad)
                if trial.false:  # is it in the recording itself, at the moments that the fault leaves?
                    trial = replace(trial, own=explained(name, fault, effect, _unspoilt(_with(session, effect), bad)).false)
                trials.append(trial)
                if args.verbose:
                    print(name, fault, effect, sorted(trial.named), f"own: {sorted(trial.own)}" if trial.own else "", flush=True)
    print(markdown(("fault of the truth", "trials", "it is named", "false names of the sensor", "effect beside it found"), _rows(trials)))
    print(f"\n{len(trials)} trials; {sum(bool(t.false) for t in trials)} with a false name of the sensor: {_falses(trials) or 'none'}")
    print("named without the fault as well, at the moments that it leaves: " + (_falses(trials, own=True) or "none"))


def _rows(trials: list[Trial]) -> list[tuple[str, ...]]:
    rows = []
    for fault in dict.fromkeys(trial.fault for trial in trials):
        own = [trial for trial in trials if trial.fault == fault]
        beside = [trial for trial in own if trial.effect]
        named = f"{sum(t.fault_named for t in own)}" if FAULTS[fault][1] else "–"
        rows.append((fault, str(len(own)), named, str(sum(bool(t.false) for t in own)), f"{sum(t.found for t in beside)} of {len(beside)}"))
    return rows


def _falses(trials: list[Trial], own: bool = False) -> str:
    found = [(trial, trial.own if own else trial.false) for trial in trials]
    return "; ".join(f"{t.source}, {t.fault}, {t.effect or 'alone'}: {', '.join(sorted(ids))}" for t, ids in found if ids)


def _unspoilt(session: Session, bad: Session) -> Session:
    """The session without the moments that a fault has changed, or as it is where it has changed more than a fifth."""
    (truth,), (other,) = session.truths or (), bad.truths or ()
    if len(truth) != len(other):
        return session
    kept = np.abs(np.sum(truth.q_nb * other.q_nb, axis=1)) > 1 - 1e-12
    return session if kept.mean() < 0.8 else replace(session, truths=(Truth(truth.path, truth.t_ns[kept], truth.q_nb[kept]),))


def explained(source: str, fault: str, effect: str | None, session: Session) -> Trial:
    """The trial of a session that holds the fault and the effect."""
    e = explain_truth(session)
    as_good = frozenset(name for claim in e.claimed for name in claim.equivalent)
    return Trial(source, fault, effect, frozenset(claim.effect.id for claim in e.claimed), as_good)


def spoilt(session: Session, fault: str, seed: int) -> Session:
    """The session with this fault in its truth."""
    (truth,) = session.truths or ()
    t_s = (truth.t_ns - truth.t_ns[0]) / NS_PER_S
    at_s, q = FAULTS[fault][0](np.random.default_rng(seed), t_s, Rotation.from_quat(truth.q_nb, scalar_first=True))
    t_ns = truth.t_ns[0] + np.rint(at_s * NS_PER_S).astype(np.int64)
    return replace(session, truths=(Truth(truth.path, t_ns, q.as_quat(scalar_first=True)),))


def _with(session: Session, effect: str | None) -> Session:
    if effect is None:
        return session
    (log,) = session.logs
    return replace(session, logs=(replace(log, samples=replace(log.samples, gyro=log.samples.gyro + EFFECTS[effect](session))),))


def _simulated(seed: int) -> Session:
    session = simulated(seed, *SIMULATED, 0.0, (0.0, 0.0, 0.0))
    # Segments that begin at all phases of a turn: at one phase, a rate and its change are in one proportion.
    return replace(session, config=replace(session.config, protocol=replace(session.config.protocol, segment_s=1.7)))


def _window(name: str, begin_s: float) -> Session:
    with tempfile.TemporaryDirectory() as folder:
        session = read_session(write_sequences(EUROC, [name], Path(folder) / name, segment_s=2.0))
    (log,), (truth,) = session.logs, session.truths or ()
    first, last = np.searchsorted(log.samples.t_s, (begin_s, begin_s + WINDOW_S))
    samples = log.samples.between(int(first), int(last))
    inside = (truth.t_ns > samples.t_ns[0]) & (truth.t_ns < samples.t_ns[-1])
    return replace(
        session, logs=(replace(log, samples=samples),), truths=(Truth(truth.path, truth.t_ns[inside], truth.q_nb[inside]),), alignment=None
    )


if __name__ == "__main__":
    main()
