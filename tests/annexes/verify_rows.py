"""Rows of a few measurements made from arrays, whose statistics can be worked out by linear algebra."""

import numpy as np

from tinygc.annexes.verification.expected import Part
from tinygc.annexes.verification.old import ACCELEROMETER, COUNT, GYROSCOPE
from tinygc.annexes.verification.questions import PLAUSIBLE
from tinygc.annexes.verification.rows import CLOSURE, LENGTH, STILL, Rows
from tinygc.models.linear import BIAS, MATRIX

SIZES = {CLOSURE: 24, STILL: 18, LENGTH: 12}


def made_rows(seed=0, change=None, noise=1.0, components=(), with_turns=True) -> Rows:
    """r = noise - A change: closures by E and B and the accelerometer, rates at rest by E and B, lengths by the accelerometer.

    change (21,): in plausible sizes.
    """
    rng = np.random.default_rng(seed)
    n = sum(SIZES.values())
    edges = np.cumsum([0, *SIZES.values()])
    kinds = {name: slice(*edges[i : i + 2]) for i, name in enumerate(SIZES)}
    A = np.zeros((n, COUNT))
    A[kinds[CLOSURE]] = rng.normal(size=(SIZES[CLOSURE], COUNT))
    still = np.zeros((SIZES[STILL], 12))
    for axis in range(3):
        still[axis::3, BIAS.start + axis] = 1.0
        still[axis::3, MATRIX.start + 3 * axis : MATRIX.start + 3 * axis + 3] = 1e-4
    A[kinds[STILL], GYROSCOPE] = still * 5
    A[kinds[LENGTH], ACCELEROMETER] = rng.normal(size=(SIZES[LENGTH], 9))
    A *= 20 / PLAUSIBLE
    sigma = np.full(n, 0.5)
    r = noise * sigma * rng.normal(size=n)
    if change is not None:
        r = r - A @ (np.asarray(change) * PLAUSIBLE)
    return Rows(
        r=r,
        parameters=A,
        known=np.zeros((n, 0)),
        spans_s=np.ones(n),
        white=np.diag(sigma**2),
        components=tuple(components),
        kinds=kinds,
        blank=np.zeros(n, dtype=bool),
        duration_s=60.0,
        temp_c=25.0,
        stills=SIZES[STILL] // 3,
        turns=SIZES[CLOSURE] // 2 if with_turns else 0,
        noise_freedom=1e6,
        rest_rps=np.zeros(3),
        session=None,
        steps_s=np.zeros(0),
        in_time=lambda profile: np.zeros((n, 3)),
    )


def part(rows: Rows, which, sigma, freedom=np.inf, name="switch-on") -> Part:
    """An expected change of some of the parameters."""
    into = np.zeros((COUNT, len(sigma)))
    into[which] = np.diag(sigma)
    return Part(name, rows.parameters @ into, into, freedom)
