"""Movements that a hand can be asked for, sample by sample, so that laws can be asked what each would make of them.

A single turn from a side, as ``proposals`` and ``turns`` know it, slowly and quickly, with a still before and after it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch
from tinygc.effects import Movement
from tinygc.plan.lying import SIDES, up_words
from tinygc.plan.turns import PEAK, QUARTERS, TurnPart, parts_from

STILL_S, RATE_HZ = 1.0, 25.0
#: of one turn: briskly, as usual, slowly
TURNS_S = (1.5, 3.0, 8.0)
#: of full scale, that no turn's peak comes near
MOST_OF_SCALE = 0.8


@dataclass(frozen=True, eq=False)
class Trial:
    """words for the operator; movement, still at both ends; sensitivity (N, 2, 3) s of its closure; stills: rows at rest, before, after."""

    words: str
    movement: Movement
    sensitivity: np.ndarray
    stills: tuple[slice, slice]


def trials(like: Movement) -> list[Trial]:
    """Turns by quarters from each side; like: a log of the sensor, whose full scale, temperature and vibration hold."""
    found = []
    for seconds in TURNS_S:
        moves = [
            (up, part)
            for up, degrees in product(SIDES, QUARTERS)
            for part in parts_from(up, degrees, seconds)
            if PEAK * part.angle_rad / seconds <= MOST_OF_SCALE * like.fs_rps
        ]
        if moves:
            found += _together(moves, seconds, like)
    return found


def _together(moves: list[tuple[np.ndarray, TurnPart]], seconds: float, like: Movement) -> list[Trial]:
    """Of one duration."""
    t = np.arange(0, seconds + 2 * STILL_S, 1 / RATE_HZ)
    speed = PEAK / seconds * np.sin(np.pi * np.clip((t - STILL_S) / seconds, 0, 1)) ** 2
    rate = speed[:, None] * np.array([part.axis * part.angle_rad for _, part in moves])[:, None]
    start = rotation.from_gravity(np.array([up for up, _ in moves]))
    dt = np.full((len(moves), len(t) - 1), 1 / RATE_HZ)
    batch = Batch(rate, dt, np.zeros_like(rate), start, start, yaw_known=False)
    turn = rotation.matrix(closure.attitudes(batch, rate))
    up_t = np.einsum("sij,sj->si", rotation.matrix(start), np.array([up for up, _ in moves]))
    force = np.einsum("stji,sj->sti", turn, up_t)
    sensitivity = closure.sensitivity(batch, rate)[:, :, :2]
    count = round(STILL_S * RATE_HZ)
    stills = slice(count), slice(len(t) - count, len(t))
    return [
        Trial(
            f"from a still with {up_words(up)} up, turn {part.words} ({part.seconds:g} s)",
            _movement(t, rate[number], force[number], like),
            sensitivity[number],
            stills,
        )
        for number, (up, part) in enumerate(moves)
    ]


def _movement(t: np.ndarray, rate: np.ndarray, force: np.ndarray, like: Movement) -> Movement:
    """At the log's middle temperature and vibration; at its beginning in time."""
    return Movement(
        t_s=like.t_s[0] + t,
        dt_s=1 / RATE_HZ,
        rate=rate,
        force_g=force,
        temp_c=np.full(len(t), np.median(like.temp_c)),
        vibration_g2=np.full(len(t), np.median(like.vibration_g2)),
        duration_s=like.duration_s,
        fs_rps=like.fs_rps,
        first_temp_c=like.first_temp_c,
    )
