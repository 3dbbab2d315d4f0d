"""An array of two or three units over a few turns, made directly from arrays: prepared units whose numbers are all known."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from conftest import DEG, wxyz
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from session.detect.accelerometer import IDENTITY, corrected
from session.log.config import Accelerometer
from tinygc.closure.earth import EarthRate
from tinygc.closure.least_squares import StillRates
from tinygc.closure.residual import Batch
from tinygc.closure.stills import StillSet
from tinygc.features.arrays.clocks import UnitPlace
from tinygc.features.arrays.system import ArrayState
from tinygc.features.arrays.units import ArrayUnit, SameStills
from tinygc.models.linear import LinearModel

G = 9.8
#: s of a still, of a turn, and samples of a turn
STILL_S, TURN_S, SAMPLES = 2.0, 1.6, 24
STEP_S = TURN_S / (SAMPLES - 1)
#: s of the last step of each turn, which makes the errors of its end
LAST_S = 0.02
#: rad/s/sqrt(Hz) and m/s^2/sqrt(Hz), each axis its own
WALK, FORCE_WALK = np.array([1e-4, 2e-4, 3e-4]), np.array([1e-3, 2e-3, 2e-3])


class SmallArray(NamedTuple):
    """units; same stills; what is true; earth of the only group; start: somewhat off the truth, as other fits would leave it."""

    units: list[ArrayUnit]
    same: SameStills
    truth: ArrayState
    earth: EarthRate
    start: ArrayState


def small_array(
    units=2,
    stills=4,
    seed=0,
    turn_rad=0.0,
    force_mps2=0.0,
    common_rad=0.0,
    level_mps2=0.0,
    drift_rps=0.0,
    earth=None,
    joint="fit",
    turns=None,
):
    """Every unit turns from still to still, except where turns lists others.

    turn_rad (units,): sigma of an error of each unit's own of each end; force_mps2 (units,) of each still's mean force; common_rad and
    level_mps2 of what all units share; drift_rps: of each unit's bias from still to still.  White noise is stated and not made.
    """
    rng = np.random.default_rng(seed)
    turn_rad, force_mps2 = np.broadcast_to(turn_rad, units), np.broadcast_to(force_mps2, units)
    turns = turns or [[(q, q + 1) for q in range(stills - 1)]] * units
    q_tb = Rotation.concatenate([Rotation.random(random_state=seed + 7)])
    t = np.linspace(0, 1, SAMPLES)[:, None]
    waves = [2.5 * rng.normal(size=3) * np.sin(np.pi * t) + 1.2 * rng.normal(size=3) * np.sin(2 * np.pi * t) for _ in range(stills - 1)]
    for wave in waves:
        q_tb = Rotation.concatenate([q_tb, q_tb[-1] * _along(wave)[-1]])
    turned = [_along(wave) for wave in waves]
    mountings = [np.eye(3), *(Rotation.random(random_state=seed + 20 + i).as_matrix() for i in range(1, units))]
    models = [LinearModel(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.5 * DEG * rng.normal(size=3)) for _ in range(units)]
    accelerometers = IDENTITY + np.concatenate([0.002 * rng.normal(size=(units, 6)), 0.02 * rng.normal(size=(units, 3))], axis=1)
    earth = earth or EarthRate(7e-5 * np.array([0.5, 0.3, -0.8]), None, np.inf, "given")
    common = common_rad * rng.normal(size=(stills - 1, 2))
    level = level_mps2 * rng.normal(size=(stills, 2))
    times = np.array([[q * (STILL_S + TURN_S), q * (STILL_S + TURN_S) + STILL_S] for q in range(stills)]) + 100.0
    found, mine = [], []
    for i in range(units):
        M, E, B = mountings[i], models[i].E, models[i].B
        R = q_tb.as_matrix()
        force_t = np.concatenate([-level, np.full((stills, 1), -G)], axis=1)  # what the table's axes see
        force_b = np.einsum("qji,qj->qi", R, force_t) @ M + force_mps2[i] * rng.normal(size=(stills, 3))
        force = np.array([_uncorrected(accelerometers[i], f) for f in force_b])
        own = [
            SimpleNamespace(problem=None, accel_mean=f, duration_s=STILL_S + 0.5 * q, start_s=float(times[q, 0] - 100.0))
            for q, f in enumerate(force)
        ]
        rates, segments = [], []
        middle_s = times.mean(axis=1) - 100.0
        drifted = make_interp_spline(middle_s, drift_rps * np.random.default_rng(seed + 50 + i).normal(size=(stills, 3)), k=1)
        for a, b in turns[i]:
            error = np.append(common[a:b].sum(axis=0), 0) + turn_rad[i] * rng.normal(size=3)
            pieces = [(waves[k], q_tb[k] * turned[k]) for k in range(a, b)]
            pieces.append((np.tile(q_tb[b].inv().apply(error) / LAST_S, (2, 1)), q_tb[[b, b]]))
            begin = float(times[a, 1] - 100.0)
            at_s = begin + np.minimum(np.arange(SAMPLES * (b - a) + 2), SAMPLES * (b - a) - 1) * STEP_S
            true = np.concatenate([rate + at.inv().apply(earth.rate_t) for rate, at in pieces])
            rates.append((true @ M - B) @ np.linalg.inv(E).T + drifted(at_s))
            segments.append(
                SimpleNamespace(
                    log=0, accepted=True, start_s=begin, duration_s=(b - a) * TURN_S, first=own[a], last=own[b], stills=(own[a], own[b])
                )
            )
        batch = _batch(rates, wxyz(q_tb[[a for a, _ in turns[i]]] * Rotation.from_matrix(M)))
        samples = SimpleNamespace(t_ns=np.array([100_000_000_000, 100_010_000_000]))
        noise = SimpleNamespace(angle_random_walk=WALK * (1 + i), velocity_random_walk=FORCE_WALK * (1 + i))
        q_bu = q_tb * Rotation.from_matrix(M)
        still_rate = np.array([(q.inv().apply(earth.rate_t) - B) @ np.linalg.inv(E).T for q in q_bu]) + drifted(middle_s)
        sigma = (1 + i) * WALK / np.sqrt([[still.duration_s] for still in own])
        near = LinearModel(E + 0.002 * rng.normal(size=(3, 3)), B + 0.02 * DEG * rng.normal(size=3))
        site = SimpleNamespace(expected_gravity_mps2=G, gravity_sigma_mps2=1e-4, latitude_deg=48.0)
        session = SimpleNamespace(config=SimpleNamespace(site=site, accelerometer=Accelerometer(np.eye(3), np.zeros(3), "stills")), logs=())
        log = StillSet(samples, own, noise, wxyz(q_bu), np.zeros(stills, dtype=int))
        problem = SimpleNamespace(
            batch=batch, first=near, logs=[log], stills=own, used=segments, references=[(0, still) for still in own],
            session=session, earths={0: earth}, began_s=np.array([0.0, 99.0]),
            still_rates=StillRates(still_rate, q_bu.inv().apply(earth.rate_t), sigma, wxyz(q_bu), middle_s),
            joint=None if joint is None else SimpleNamespace(mode=joint), instability=SimpleNamespace(rps=(1 + i) * 1e-5),
        )  # fmt: skip
        place = UnitPlace(i, mounting=M if i == 0 else Rotation.from_rotvec(0.003 * rng.normal(size=3)).as_matrix() @ M)
        prepared = SimpleNamespace(problem=problem, as_given=lambda problem=problem: SimpleNamespace(problem=problem))
        found.append(ArrayUnit(i, session, place, prepared))
        mine.append(own)
    rows, firsts, lasts = zip(*((np.arange(len(own)), *np.array(own).T) for own in turns), strict=True)
    zero = np.zeros(stills, dtype=int)
    same = SameStills(0, times, zero, zero, tuple(map(tuple, mine)), rows, firsts, lasts)
    truth = ArrayState(tuple(models), accelerometers, np.array(mountings), wxyz(q_tb), G)
    placed = np.array([unit.place.mounting for unit in found])
    start = ArrayState(tuple(unit.problem.first for unit in found), np.tile(IDENTITY, (units, 1)), placed, wxyz(q_tb), G)
    return SmallArray(found, same, truth, earth, start)


def _along(rate):
    """Rotations (T,) from the first sample on, of mean rates and their coning term."""
    found = [Rotation.identity()]
    for before, after in pairwise(rate):
        found.append(found[-1] * Rotation.from_rotvec((before + after) / 2 * STEP_S + STEP_S**2 / 6 * np.cross(before, after)))
    return Rotation.concatenate(found)


def _uncorrected(x, force):
    """The reading that the nine numbers turn into a force."""
    columns = corrected(np.concatenate([x[:6], np.zeros(3)]), np.eye(3)).T
    return np.linalg.solve(columns, force) + x[6:]


def _batch(rates, start):
    """Turns padded to one length, of pieces with no time between them; the ends are the array's, which the system puts in."""
    most = max(map(len, rates))
    rate = np.stack([np.pad(each, ((0, most - len(each)), (0, 0)), mode="edge") for each in rates])
    dt = np.zeros((len(rates), most - 1))
    for own, each in zip(dt, rates, strict=True):
        own[: len(each) - 3] = STEP_S
        own[SAMPLES - 1 : len(each) - 2 : SAMPLES] = 0.0
        own[len(each) - 2] = LAST_S
    return Batch(rate, dt, np.zeros_like(rate), start, start, True)
