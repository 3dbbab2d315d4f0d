"""A few turns made directly from arrays, and their closure worked out by scipy: no code of the project's own."""

from dataclasses import replace

import numpy as np
from conftest import DEG, wxyz
from scipy.spatial.transform import Rotation

from tinygc.closure.residual import Batch, KnownTurns
from tinygc.models.linear import LinearModel

#: of a typical unit: 1 % of scale, 5 mrad of misalignment, 1 dps
TYPICAL = np.array([0.01, 0.005, -0.004, -0.006, -0.012, 0.003, 0.005, -0.002, 0.008, 1.0 * DEG, -0.7 * DEG, 0.4 * DEG])
PERFECT = LinearModel(np.eye(3), np.zeros(3))
TRUE = LinearModel.from_vector(PERFECT.vector + TYPICAL)


def small_turns(
    count=8,
    model=TRUE,
    yaw_known=False,
    noise_rad=0.0,
    samples=40,
    seed=0,
):
    """A chain of smooth turns of 1.6 s under an Earth a thousand times as fast as ours, which close under ``model`` but for a noise of
    their ends; the last sample of the first turn is padding."""
    rng = np.random.default_rng(seed)
    part = np.linspace(0, 1, samples)[:, None]
    waves = np.sin(2 * np.pi * (rng.uniform(0.3, 1, (count, 1, 3)) * part + rng.uniform(0, 1, (count, 1, 3))))
    rate = rng.normal(size=(count, 1, 3)) + 1.5 * waves
    dt = rng.uniform(0.9, 1.1, (count, samples - 1)) * 1.6 / samples
    dt[0, -1] = 0.0
    earth = 0.07 * (rng.normal(size=(count, 1, 3)) + waves)
    q = [Rotation.random(random_state=seed)]
    batch = Batch(rate, dt, earth, np.zeros((count, 4)), np.zeros((count, 4)), yaw_known)
    for turn in turns_by_scipy(batch, model):
        q.append(q[-1] * turn)
    q = wxyz(Rotation.concatenate(q))
    batch = replace(batch, start=q[:-1], end=q[1:])
    return turned_ends(batch, noise_rad * rng.normal(size=(count, 3)))


def turned_ends(batch, by):
    """A batch with the references of its ends rotated by vectors (S, 3) rad about the table's axes; a known angle takes the third."""
    if batch.turns is not None:
        turns = replace(batch.turns, angle_rad=batch.turns.angle_rad + by[:, 2])
        batch, by = replace(batch, turns=turns), by * [1, 1, 0]
    return replace(batch, end=wxyz(Rotation.from_rotvec(by) * Rotation.from_quat(batch.end, scalar_first=True)))


def with_known_angles(batch, model=TRUE):
    """The net angle of every turn but the second stated, about an axis a little off."""
    vectors = turns_by_scipy(batch, model).as_rotvec()
    angle = np.linalg.norm(vectors, axis=1)
    axis = vectors / angle[:, None] + [0.02, -0.01, 0.03]
    angle[1] = np.nan
    return replace(batch, turns=KnownTurns(angle, np.where(np.isfinite(angle), 1e-4, np.nan), axis / np.linalg.norm(axis, axis=1)[:, None]))


def turns_by_scipy(batch, model):
    """What the body turns by in each segment (docs/model.md): mean rate, and the coning term dt^2 / 6 w_k x w_k+1."""
    rate = batch.rate @ model.E.T + model.B - batch.earth
    before, after, dt = rate[:, :-1], rate[:, 1:], batch.dt[..., None]
    mean = (before + after) / 2 * dt
    q = Rotation.from_rotvec((mean + dt**2 / 6 * np.cross(before, after)).reshape(-1, 3)).as_quat()
    steps = q.reshape(*mean.shape[:2], 4)
    while steps.shape[1] > 1:
        if steps.shape[1] % 2:
            steps = np.concatenate([steps, np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(batch), 1, 4))], axis=1)
        first, second = (Rotation.from_quat(steps[:, begin::2].reshape(-1, 4)) for begin in (0, 1))
        steps = (first * second).as_quat().reshape(len(batch), -1, 4)
    return Rotation.from_quat(steps[:, 0])


def angles_by_scipy(batch, vector):
    """Error angles (S, d) rad: the tilt is the shortest rotation between the two verticals, a yaw that is known is one more component.

    A length of 4 sin(angle / 4) stands for the angle.
    """
    start, end = (Rotation.from_quat(q, scalar_first=True) for q in (batch.start, batch.end))
    turns = turns_by_scipy(batch, LinearModel.from_vector(vector))
    error = start * turns * end.inv()
    if batch.yaw_known:
        return _chord(error.as_rotvec())
    down = error.apply([0.0, 0.0, 1.0])
    across = np.cross([0.0, 0.0, 1.0], down)
    sine = np.linalg.norm(across, axis=1, keepdims=True)
    tilt = _chord(across * np.where(sine > 1e-12, np.arctan2(sine, down[:, 2:]) / np.maximum(sine, 1e-12), 1.0))[:, :2]
    if batch.turns is None:
        return tilt
    vectors = turns.as_rotvec()
    along = np.einsum("si,si->s", vectors, batch.turns.axis)
    miss = np.sign(along) * np.linalg.norm(vectors, axis=1) - batch.turns.angle_rad
    return np.column_stack([tilt, 4 * np.sin(np.nan_to_num(miss) / 4)])


def _chord(vectors):
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors * np.where(size > 1e-12, 4 * np.sin(size / 4) / np.maximum(size, 1e-12), 1.0)


def numeric_jacobian(function, at, step=1e-5):
    """Derivative (…, P) of function(vector (P,)), by central differences."""
    return np.stack([(function(at + s) - function(at - s)) / (2 * step) for s in np.eye(len(at)) * step], axis=-1)
