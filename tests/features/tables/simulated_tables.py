"""What a session of a table would observe, drawn without its samples, for questions of statistics.

The truth is exact (``true_attitudes``) at the edges of equal blocks; the sensor's noise and effects are those of its means over
them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from imperfect_tables import AxisTrack, TableErrors, true_attitudes
from scipy.spatial.transform import Rotation

from session.base.units import DEG, DEG_PER_HOUR, EARTH_RATE_RPS, G
from tinygc.effects import Effect, Movement
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.observed import Observed
from tinygc.inference.noise import wander_covariance


@dataclass(frozen=True)
class Move:
    """Axes to angles, together: angles_rad (K,) of all axes, those that stay included; rate_rps: at most that fast."""

    angles_rad: tuple[float, ...]
    rate_rps: float


@dataclass(frozen=True)
class LostSteps:
    """A motor that falls behind: rad of one axis, lost evenly over ``span_s`` in the middle of the move of that number."""

    move: int
    axis: int
    lost_rad: float
    span_s: float = 0.1


def fixed_moves(table, count, rate_rps, seed=0, step_rad=30 * DEG):
    """``count`` moves of one axis each, in turn, by multiples of a step within the axis' limits (a turn either way where it has none)."""
    rng, angles, found = np.random.default_rng(seed), np.zeros(len(table.axes)), []
    for number in range(count):
        axis = number % len(table.axes)
        of = table.axes[axis]
        least, most = (-np.pi, np.pi) if of.is_endless else (of.least_rad, of.most_rad)
        goals = step_rad * np.arange(np.ceil(least / step_rad - 1e-9), np.floor(most / step_rad + 1e-9) + 1)
        goals = goals[np.abs(goals - angles[axis]) > 1.9 * step_rad]
        angles = angles.copy()
        angles[axis] = rng.choice(goals)
        found.append(Move(tuple(angles.tolist()), rate_rps * float(rng.choice([0.5, 1.0]))))
    return found


#: s of rest that a turn has on either side, as the first look cuts it
LEAD_S = 0.3


@dataclass(frozen=True, eq=False)
class Summary:
    """A session to draw.

    moves; errors of the table; lost steps; effects of the sensor with theta (P,), SI; dropped: of turns, rad that the gyroscope misses;
    repeatability: of each rest, in units of the declared accuracy; jitter_s of the word's stamps, one answer at each edge; word: what
    says another word at the edges (S, B + 1, K), and its places among the answers;
    still_s, block_s; noise of the sensor; errors of its calibration, one sigma.
    """

    table: Description
    moves: Sequence[Move]
    errors: TableErrors
    lost: Sequence[LostSteps] = ()
    effects: Sequence[tuple[Effect, np.ndarray]] = ()
    dropped: Sequence[tuple[int, float]] = ()
    repeatability: float = 0.0
    jitter_s: float = 1e-3
    word: Callable[..., tuple[np.ndarray, np.ndarray]] | None = None
    still_s: float = 2.0
    block_s: float = 0.1
    gyro_walk: float = 0.005 * DEG / np.sqrt(2)
    accel_walk_g: float = 60e-6 / np.sqrt(2)
    instability_rps: float = 3 * DEG_PER_HOUR
    scale_error: float = 0.01
    accel_error_g: float = 1e-3
    mounting_rad: float = 1 * DEG
    latitude_rad: float = 31 * DEG
    fs_rps: float = 500 * DEG


def draw(summary, seed):
    """One observed session; the same seed draws the same."""
    rng = np.random.default_rng(seed)
    table, errors, axes = summary.table, summary.errors, len(summary.table.axes)
    tracks = [AxisTrack(0.0, of.backlash) for of in errors.axes]
    t_s, spans, slips = summary.still_s, [], []
    rest_s = [summary.still_s / 2]
    for number, move in enumerate(summary.moves):
        began = t_s
        for axis, (track, goal, of) in enumerate(zip(tracks, move.angles_rad, table.axes, strict=True)):
            track.turn_to(began + LEAD_S, goal, move.rate_rps, of.acceleration_rps2)
            t_s = max(t_s, track.busy_until_s + LEAD_S)
            slips += [
                (axis, (began + t_s) / 2, slip.span_s, slip.lost_rad) for slip in summary.lost if (slip.move, slip.axis) == (number, axis)
            ]
        spans.append((began, t_s))
        rest_s.append(t_s + summary.still_s / 2)
        t_s += summary.still_s
    blocks = np.array([max(2, round((stop - start) / summary.block_s)) for start, stop in spans])
    most = int(blocks.max())
    edges = np.stack(
        [np.minimum(np.arange(most + 1) / count, 1) * (stop - start) + start for count, (start, stop) in zip(blocks, spans, strict=True)]
    )
    scatter = summary.repeatability * rng.normal(size=(len(rest_s), axes)) * [axis.sigma_rad for axis in table.axes]

    def truth(at_s, more):
        reported, sense = np.stack([track.said_and_sense(at_s) for track in tracks], axis=-1)
        for axis, middle, span, rad in slips:
            reported[:, axis] -= rad * np.clip((at_s - middle) / span + 0.5, 0, 1)
        return true_attitudes(table, errors, reported + more, sense) @ mounting

    mounting = Rotation.from_rotvec(summary.mounting_rad * rng.normal(size=3)).as_matrix()
    heading = rng.uniform(-np.pi, np.pi)
    north = np.cos(summary.latitude_rad) * np.array([np.cos(heading), -np.sin(heading), 0.0])
    earth = EARTH_RATE_RPS * (north - np.sin(summary.latitude_rad) * np.eye(3)[2])
    E_inverse = np.eye(3) + summary.scale_error * rng.normal(size=(3, 3))
    bias, accel_bias = 0.5 * DEG * rng.normal(size=3), summary.accel_error_g * rng.normal(size=3)
    accel_matrix = np.eye(3) + np.triu(summary.accel_error_g * rng.normal(size=(3, 3)))

    rest_s_, at_rest = np.array(rest_s), truth(np.array(rest_s), scatter)
    share = np.minimum(np.arange(most + 1) / blocks[:, None], 1)[..., None]
    between = scatter[:-1, None] * (1 - share) + scatter[1:, None] * share
    in_turns = truth(edges.ravel(), between.reshape(-1, axes)).reshape(*edges.shape, 3, 3)
    steps = Rotation.from_matrix((in_turns[:, :-1].transpose(0, 1, 3, 2) @ in_turns[:, 1:]).reshape(-1, 3, 3)).as_rotvec()
    block_s = np.array([(stop - start) / count for count, (start, stop) in zip(blocks, spans, strict=True)])
    rates = steps.reshape(len(blocks), most, 3) / block_s[:, None, None]
    for turn, missing in summary.dropped:
        middle = blocks[turn] // 2
        rates[turn, middle] *= 1 - missing / (np.linalg.norm(rates[turn, middle]) * block_s[turn])
    duration_s, temp_c = float(t_s), np.full(len(rest_s), 25.0)

    def movement(at_s, dt_s, rate, matrices):
        count = len(at_s)
        return Movement(at_s, dt_s, rate, -matrices[:, 2], np.full(count, 25.0), np.zeros(count), duration_s, summary.fs_rps, 25.0)

    rests = movement(rest_s_, summary.still_s, np.zeros((len(rest_s), 3)), at_rest)
    still, force = np.zeros((len(rest_s), 3)), -at_rest[:, 2]
    for effect, theta in summary.effects:
        if effect.kind == "force":
            force = force + effect.bent(rests) @ theta / G
            continue
        still = still + (effect.columns(effect.shown(rests)) @ theta if not effect.reach else 0.0)
        for turn, count in enumerate(blocks):
            middle_s = (edges[turn, :count] + edges[turn, 1 : count + 1]) / 2
            own = movement(middle_s, float(block_s[turn]), rates[turn, :count], in_turns[turn, :count])
            rates[turn, :count] = rates[turn, :count] + effect.columns(effect.shown(own)) @ theta
    still = still + at_rest.transpose(0, 2, 1) @ earth
    rates = rates + np.einsum("sbji,j->sbi", in_turns[:, :-1], earth)

    turn_s = np.array([(start + stop) / 2 for start, stop in spans])
    moments, lengths = np.concatenate([turn_s, rest_s_]), np.concatenate([blocks * block_s, np.full(len(rest_s), summary.still_s)])
    covariance = wander_covariance(moments, lengths, instability_rps=1.0)
    factor = np.linalg.cholesky(covariance + 1e-9 * covariance[0, 0] * np.eye(len(moments)))
    wander = summary.instability_rps * factor @ rng.normal(size=(len(moments), 3))
    noise = summary.gyro_walk * rng.normal(size=rates.shape) / np.sqrt(block_s)[:, None, None]
    rates = (rates - bias) @ E_inverse.T + wander[: len(turn_s), None] + noise
    still = (
        (still - bias) @ E_inverse.T + wander[len(turn_s) :] + summary.gyro_walk / np.sqrt(summary.still_s) * rng.normal(size=still.shape)
    )
    force = force @ accel_matrix.T + accel_bias + summary.accel_walk_g / np.sqrt(summary.still_s) * rng.normal(size=force.shape)
    asked = edges - errors.latency_s + summary.jitter_s * rng.normal(size=edges.shape)
    ends = (share[..., 0] == 0) | (share[..., 0] == 1)  # at rest, before the next move, a late word is the same
    asked = np.clip(asked, np.array([start for start, _ in spans])[:, None] - 0.5, np.array([stop for _, stop in spans])[:, None] + 0.5)
    asked = np.where(ends & (share[..., 0] == 1), edges + 0.5 * summary.still_s, asked)
    reported_edges = np.stack([track.reported(asked.ravel()) for track in tracks], axis=-1).reshape(*edges.shape, axes)
    reported = np.stack([track.reported(rest_s_) for track in tracks], axis=-1)
    answer_at = np.minimum(np.arange(most + 1.0), blocks[:, None])
    if summary.word is not None:
        reported_edges, answer_at = summary.word(summary, tracks, spans, edges, reported, rng)
    order = np.arange(len(blocks))
    inside = (np.arange(most) < blocks[:, None])[..., None]
    return Observed(
        table,
        rest_s_,
        np.full(len(rest_s), summary.still_s),
        force,
        still,
        temp_c,
        reported,
        order,
        order + 1,
        turn_s,
        block_s,
        blocks,
        np.where(inside, rates, 0.0),
        reported_edges,
        np.full(3, summary.gyro_walk),
        np.full(3, summary.accel_walk_g),
        summary.instability_rps,
        summary.fs_rps,
        summary.latitude_rad,
        2 * summary.accel_error_g,
        np.zeros(len(blocks), dtype=bool),
        answer_at,
    )
