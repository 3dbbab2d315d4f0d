"""Conceal effects in sessions, have ``explain`` name them blind, and count what it names.

``rate_effects`` and ``other_effects`` conceal, and know nothing of the catalogue; ``explain`` gets the session alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from session.base import results
from session.base.errors import CalibrationError, DataError
from session.base.progress import Progress, no_report
from session.base.records import Size
from session.base.texts import significant
from session.base.units import G
from session.log.config import Config, Site
from session.log.folder import Session, read_session
from tinygc.closure.prepared import prepare
from tinygc.effects import Movement, catalogue, movement_of
from tinygc.explanation.decision import REPORTED
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json as answer_of
from tinygc.features.challenge.other_effects import MAKERS, bench
from tinygc.features.challenge.rate_effects import RATE_EFFECTS, Concealment, Scene
from tinygc.noise.thinned import conditions
from tinygc.reporting.explanation_text import in_unit, plain_name
from tinygc.reporting.facts import Part, Table, screen
from tinygc.reporting.terminal import Group
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import Simulation, plan_of, simulate_session
from tinygc.simulation.write import config_of, write_files

# What is drawn: one to three effects that a recording can separate, and the strength of each.

MOST = 3
STRENGTHS = (1.0, 0.5, 0.2, 0.05)
#: never two of these at once: all contain a common delay of the axes; or, in a log of minutes, one curve over time is nearly the other
ALIKE = (
    {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew", "timing.gyro_accel_offset"},
    {"gyro.bias_drift", "gyro.thermal_bias", "gyro.bias_step"},
    {"data.glitches", "timing.dropped_samples"},
)
#: hidden alone
ALONE = {"gyro.saturation", "reference.not_still", "earth.rotation"}
#: options without which a session does not show an effect
NEEDS = {
    "gyro.thermal_bias": {"warm_up_c": 10.0},
    "gyro.thermal_scale": {"warm_up_c": 10.0},
    "earth.rotation": {"latitude_deg": 60.0, "segments": 80},
}


def drawn(pool: Sequence[str], rng: np.random.Generator) -> dict[str, float]:
    """Id -> strength of one to three effects of the pool."""
    most = int(rng.integers(1, MOST + 1))
    ids: list[str] = []
    for name in map(str, rng.permutation(pool)):
        apart = not ALONE & {name, *ids} and not any(name in group and group & set(ids) for group in ALIKE)
        if not ids or (len(ids) < most and apart):
            ids.append(name)
    return {name: float(rng.choice(STRENGTHS)) for name in ids}


# Conceal in a simulated session.


def simulated(strengths: Mapping[str, float], rng: np.random.Generator, folder: Path) -> tuple[Session, dict[str, dict]]:
    """A simulated session that hides these effects, and the truth."""
    chosen: dict[str, Any] = {"segments": int(rng.integers(30, 51)), "warm_up_c": 1.5, "seed": int(rng.integers(2**31))}
    for name in strengths:
        chosen |= NEEDS.get(name, {})
    simulation, config, truth = conceal(strengths, SimulationOptions(closure_s=0.0, **chosen), rng)
    write_files(simulation, folder, config)
    return read_session(folder), truth


def conceal(
    strengths: Mapping[str, float], options: SimulationOptions, rng: np.random.Generator
) -> tuple[Simulation, Config, dict[str, dict]]:
    """A simulation with these effects, its session.toml, and the truth: id -> parameters."""
    plan = plan_of(options)
    hidden = [MAKERS[name](bench(rng, strength, options, plan)) for name, strength in strengths.items()]
    for one in hidden:
        plan = one.movement(plan) if one.movement else plan

    def disturb(t: np.ndarray, force: np.ndarray) -> np.ndarray:
        for one in hidden:
            force = one.disturb(t, force) if one.disturb else force
        return force

    simulation = simulate_session(options, partial(distorted, hidden), plan=plan, disturb=disturb)
    truth = {one.id: dict(one.truth) for one in hidden}
    for one in hidden:
        if one.spoil:
            log, more = one.spoil(simulation.log)
            simulation, truth[one.id] = replace(simulation, log=log), truth[one.id] | more
    config = config_of(options, simulation.unit)
    if any(one.without_latitude for one in hidden):
        config = replace(config, site=Site(gravity_mps2=config.site.gravity_mps2))
    return simulation, config, truth


def distorted(hidden: Iterable[Concealment], t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
    """The rate with what is hidden, one after the other."""
    for one in hidden:
        rate = one.distort(t, rate, force, temp) if one.distort else rate
    return rate


# Conceal in a recording: the true rate is taken as measured, E m + B, and only what the effects change is added to m.

#: share of the differences between neighbouring values of a log that are one step; rare values differ by several
STEP_SHARE = 0.1


class Host(NamedTuple):
    """A recording: session; movement of each log by its linear fit; back: E^-1 (3, 3) of that fit; place: full scale in dps, first
    temperature in degC and length in s, for a ``Scene``."""

    session: Session
    movements: tuple[Movement, ...]
    back: np.ndarray
    place: tuple[float, float, float]


def _host_of(folder: Path) -> Host:
    """The recording in a folder.  Raises what ``read_session`` and ``prepare`` raise, and DataError where it has a further reference."""
    session = read_session(folder)
    if session.reference is not None:
        raise DataError(f"{folder}: a recording with a {session.reference.title} is not supported; give one with gravity or dials")
    problem = prepare(session).problem
    known, first, began = conditions(problem), problem.first, problem.began_s
    moved = tuple(movement_of(log.samples, first(log.samples.gyro), known, float(s)) for log, s in zip(problem.logs, began, strict=False))
    bridged = zip(session.logs, problem.session.logs, strict=True)
    start_c = 25.0 if session.logs[0].samples.temp_c is None else float(moved[0].first_temp_c)
    whole = replace(session, logs=tuple(replace(log, samples=old.samples) for log, old in bridged))
    return Host(whole, moved, np.linalg.inv(first.E), (session.config.sensor.gyro_fs_dps, start_c, float(began[-1])))


def injected(host: Host, strengths: Mapping[str, float], rng: np.random.Generator) -> tuple[Session, dict[str, dict]]:
    """The recording with these effects in its readings, and the truth."""
    hidden = [RATE_EFFECTS[name](Scene(rng, strength, *host.place)) for name, strength in strengths.items()]
    logs = []
    for log, moved in zip(host.session.logs, host.movements, strict=True):
        gyro = np.asarray(log.samples.gyro)
        change = (distorted(hidden, moved.t_s, moved.rate, moved.force_g * G, moved.temp_c) - moved.rate) @ host.back.T
        logs.append(replace(log, samples=replace(log.samples, gyro=_in_steps(gyro, change, rng))))
    return replace(host.session, logs=tuple(logs)), {one.id: dict(one.truth) for one in hidden}


def _in_steps(old: np.ndarray, change: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Readings with a change, in whole steps from the old ones: a fraction of a step is rounded up with a probability equal to it, since
    the old reading's place between two steps is unknown."""
    gaps = np.concatenate([np.diff(np.unique(axis)) for axis in old.T])
    step = float(np.quantile(gaps, STEP_SHARE)) if len(gaps) else 1e-9
    return old + step * np.floor(change / step + rng.uniform(size=change.shape))


# The answer for one session, against the truth.

RIGHT, MISSED, LIMIT = "right", "missed", "limit"
COUNTED = ("hidden", RIGHT, MISSED, LIMIT, "wrong")
#: prefix of shapes without a name in ``explain``: no names, so never wrong ones
NAMELESS = "unknown."
#: in a recording never wrong: the Earth turns; and the delay of its clocks, where it measures one beyond two sigmas without naming it
EARTH, DELAY, DELAY_SIGMAS = "earth.rotation", "timing.gyro_accel_offset", 2.0


@dataclass(frozen=True)
class Hidden:
    """One concealed effect: id, strength, parameters as in docs/formats/effects.md; size and detection_limit in the parameter's unit, None
    without; outcome: right (named, or among the equivalents of a name), limit (not named, and smaller than ``explain`` states that this
    session shows), or missed."""

    id: str
    strength: float
    parameters: Annotated[dict, results.Keys()]
    size: Size | None
    detection_limit: Size | None
    unit: str
    outcome: Annotated[str, results.Text((RIGHT, LIMIT, MISSED))]


@dataclass(frozen=True)
class Answer:
    """One session: verdict of ``explain``; what it hid; wrong names; held-out closure before and after, deg rms, None where refused."""

    verdict: str
    hidden: tuple[Hidden, ...]
    wrong: tuple[str, ...]
    before_deg: Size | None
    after_deg: Size | None


@dataclass(frozen=True)
class Examination:
    """recording: its name, None for simulated sessions; own: names that it gets untouched, neither right nor wrong; the answers."""

    schema = "tinygc-challenge/3"
    written = ("seed", "recording", "own", "sessions", "totals")
    seed: int
    recording: str | None
    own: tuple[str, ...]
    sessions: tuple[Answer, ...]

    @property
    def totals(self) -> Annotated[dict[str, int], results.Keys(dict.fromkeys(COUNTED, results.Number(0, whole=True)))]:
        """Counts over all sessions."""
        hidden = [one.outcome for each in self.sessions for one in each.hidden]
        counts = {outcome: hidden.count(outcome) for outcome in (RIGHT, MISSED, LIMIT)}
        return {"hidden": len(hidden), **counts, "wrong": sum(len(each.wrong) for each in self.sessions)}


def size_of(name: str, truth: Mapping[str, Any]) -> float | None:
    """Size of an effect's parameter in its unit, as detection limits are: of delays what differs between the axes, which alone closure
    shows; None for what occurs at moments or has no such parameter."""
    effect = catalogue()[name]
    value = truth.get(effect.parameter.name)
    if value is None or effect.occurs is not None:
        return None
    numbers, delays = np.ravel(value).astype(float), list(getattr(effect.gauge_convention, "delays", ()))
    if delays:
        numbers[delays] -= numbers[delays].mean()
    return float(np.linalg.norm(numbers))


def compared(strengths: Mapping[str, float], truth: Mapping[str, dict], answer: dict, own: Iterable[str] = ()) -> Answer:
    """Compare the truth with ``answer`` (``tinygc-explain/2``); own: names that are neither right nor wrong."""
    names = {claim["id"]: {claim["id"], *claim["equivalent"]} for claim in answer["effects"]}
    found, hidden = set().union(*names.values()), []
    for name, parameters in truth.items():
        size, limits = size_of(name, parameters), answer["detection_limits"].get(name)
        limit = None if limits is None else limits["size"]
        small = size is not None and limits is not None and (limit is None or size < limit)
        outcome = RIGHT if name in found else LIMIT if small else MISSED
        hidden.append(Hidden(name, strengths[name], parameters, size, limit, catalogue()[name].parameter.unit, outcome))
    wrong = tuple(name for name, ids in names.items() if not ids & truth.keys() and name not in own and not name.startswith(NAMELESS))
    closure = answer["fit"]["holdout_closure_rms_deg"] if "fit" in answer else {"before": None, "after": None}
    return Answer(answer["verdict"], tuple(hidden), wrong, closure["before"], closure["after"])


def explained(session: Session) -> dict:
    """The answer of ``explain`` for a session; a refusal is an answer, too."""
    try:
        return answer_of(explain_session(session))
    except CalibrationError:
        return {"verdict": "refused", "effects": [], "detection_limits": {}}


def _own_names(untouched: dict) -> set[str]:
    """Names of an untouched recording, with their equivalents, and those that it weighs as high as a name."""
    own = {name for claim in (*untouched["effects"], *untouched["findings"]) for name in (claim["id"], *claim["equivalent"])}
    own |= {one["id"] for one in untouched["considered"] if one["probability"] >= REPORTED}
    gravity = untouched["turn_gravity"]
    return own | ({DELAY} if abs(gravity["offset_s"]) > DELAY_SIGMAS * gravity["offset_std_s"] else set())


def examine(count: int, seed: int, on: Path | None = None, *, progress: Progress = no_report) -> Examination:
    """Conceal effects in ``count`` simulated sessions, or in copies of the recording ``on``, and explain each blind."""
    rng, host, own, pool = np.random.default_rng(seed), None, set(), sorted(MAKERS)
    if on is not None:
        host = _host_of(on)
        untouched = answer_of(explain_session(host.session))
        own, limits = _own_names(untouched), untouched["detection_limits"]
        pool = [name for name in sorted(RATE_EFFECTS) if name in limits and limits[name]["size"] and name not in own]
        if not pool:
            raise DataError(f"{on}: of {len(RATE_EFFECTS)} effects it has each already, or shows none of any plausible size")
    answers = []
    for number in range(count):
        progress("concealing and explaining", number, count)
        strengths = drawn(pool, rng)
        with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
            session, truth = simulated(strengths, rng, Path(folder) / "session") if host is None else injected(host, strengths, rng)
            answers.append(compared(strengths, truth, explained(session), own | {EARTH} if host else ()))
    return Examination(seed, None if host is None else host.session.name, tuple(sorted(own)), tuple(answers))


# What is printed and written.


def page(result: Examination) -> Group:
    """The screen: how many were found, then each that was not; the JSON has all."""
    t, where = result.totals, "simulation" if result.recording is None else f"copies of {result.recording}"
    parts: list[Part] = [f"{t[RIGHT]} of {t['hidden']} effects found in {where}, {t['wrong']} wrong names."]
    parts.append(f"Sessions: {len(result.sessions)}. Not found: {t[LIMIT]} below the detection limit, {t[MISSED]} missed.")
    closed = [(each.before_deg, each.after_deg) for each in result.sessions if each.before_deg is not None and each.after_deg is not None]
    if closed:
        before, after = np.median(closed, axis=0)
        parts.append(f"Held-out closure, median {before:.3f}° -> {after:.3f}°.")
    parts += [f"In the recording itself, and not counted: {', '.join(map(plain_name, result.own))}."] if result.own else []
    rows: list[list[Any]] = []
    for number, each in enumerate(result.sessions, 1):
        others = [one for one in each.hidden if one.outcome != RIGHT]
        rows += [[number, plain_name(one.id), _sized(one, one.size), _sized(one, one.detection_limit), one.outcome] for one in others]
        rows += [[number, plain_name(name), "", "", "wrong"] for name in each.wrong]
    return screen([*parts, *([Table("", ("case", "not found", "size", "would show from", "answer"), rows, left=(1, 4))] if rows else [])])


def _sized(one: Hidden, size: float | None) -> str:
    if size is None:
        return "–"
    factor, unit = in_unit(size, one.unit)
    return f"{significant(size * factor, 2)} {unit}"
