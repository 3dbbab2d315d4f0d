"""Rotations as unit quaternions (..., 4), scalar first, and their integration from rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Unit quaternions as pairs of complex numbers: w + x i + y j + z k = a + b j with a = w + x i and b = y + z i.
#
# As j c = c* j, (a + b j)(c + d j) = (a c - b d*) + (a d + b c*) j (Cayley and Dickson).  Four complex products of arrays take less than
# half the time of the sixteen real ones: each reads and writes its arrays once.

#: a and b (...), complex
Pairs = tuple[np.ndarray, np.ndarray]

#: coefficients of powers of h^2, h half the angle: cos h and sin h / 2 h; below ``SERIES_BELOW`` the next term is below 1e-18
COSINE = (-1 / 3628800, 1 / 40320, -1 / 720, 1 / 24, -1 / 2, 1.0)
HALF_SINC = (-1 / 79833600, 1 / 725760, -1 / 10080, 1 / 240, -1 / 12, 1 / 2)
SERIES_BELOW = 1e-2


def of(q: np.ndarray) -> Pairs:
    """Convert quaternions (..., 4) to pairs."""
    a, b = np.empty(q.shape[:-1], dtype=complex), np.empty(q.shape[:-1], dtype=complex)
    a.real, a.imag, b.real, b.imag = (q[..., i] for i in range(4))
    return a, b


def quaternions(pairs: Pairs) -> np.ndarray:
    """Convert pairs to quaternions (..., 4), each component contiguous in memory."""
    a, b = pairs
    q = np.empty((4, *a.shape))
    q[0], q[1], q[2], q[3] = a.real, a.imag, b.real, b.imag
    return np.moveaxis(q, 0, -1)


def exp_small(vector: np.ndarray, into: Pairs) -> bool:
    """Convert rotation vectors (..., 3) of at most 0.2 rad to pairs; return False, without a change, if one is longer."""
    x, y, z = (vector[..., i] for i in range(3))
    h2, term = x * x, y * y
    h2 += term
    np.multiply(z, z, out=term)
    h2 += term
    h2 *= 0.25
    if not h2.max(initial=0.0) < SERIES_BELOW:
        return False
    a, b = into
    a.real = _polynomial(COSINE, h2, term)
    half_sinc = _polynomial(HALF_SINC, h2, term)
    np.multiply(half_sinc, x, out=a.imag)
    np.multiply(half_sinc, y, out=b.real)
    np.multiply(half_sinc, z, out=b.imag)
    return True


def _polynomial(coefficients: tuple[float, ...], of: np.ndarray, into: np.ndarray) -> np.ndarray:
    """Evaluate a polynomial by Horner's scheme, highest power first."""
    np.multiply(of, coefficients[0], out=into)
    for coefficient in coefficients[1:-1]:
        into += coefficient
        into *= of
    into += coefficients[-1]
    return into


def multiply_pairs(p: Pairs, q: Pairs) -> Pairs:
    """Hamilton product of p and q of the same shape: first q, then p."""
    (a, b), (c, d) = p, q
    first, term = a * c, np.conjugate(d)
    term *= b
    first -= term
    second = a * d
    np.conjugate(c, out=term)
    term *= b
    second += term
    return first, second


def compose_pairs(steps: Pairs) -> Pairs:
    """``rotation.compose`` of steps (..., T): (...)."""
    tail: Pairs | None = None
    while steps[0].shape[-1] > 1:
        even = steps[0].shape[-1] // 2 * 2
        if even < steps[0].shape[-1]:
            last = _at(steps, even)
            tail = last if tail is None else multiply_pairs(last, tail)
        steps = multiply_pairs(_every_second(steps, 0, even), _every_second(steps, 1, even))
    first = _at(steps, 0)
    return first if tail is None else multiply_pairs(first, tail)


def accumulate_pairs(steps: Pairs) -> Pairs:
    """``rotation.accumulate`` of steps (..., T), in place: all partial products (..., T)."""
    count = steps[0].shape[-1]
    if count < 2:
        return steps
    even = count // 2 * 2
    odd = accumulate_pairs(multiply_pairs(_every_second(steps, 0, even), _every_second(steps, 1, even)))
    between = (count - 1) // 2
    later = multiply_pairs((odd[0][..., :between], odd[1][..., :between]), _every_second(steps, 2, count))
    for whole, at_odd, at_even in zip(steps, odd, later, strict=True):
        whole[..., 1::2], whole[..., 2::2] = at_odd, at_even
    return steps


def matrices_into(found: np.ndarray, pairs: Pairs, weight: np.ndarray) -> None:
    """Write the rotation matrices of pairs (..., T), each times its weight (..., T), into found (..., 3, 3, T)."""
    a, b = pairs
    doubled = b + b
    across, along = a * doubled, a * np.conjugate(doubled)  # 2 a b, 2 a b*
    aa, bb = a * a, b * b
    both, apart = aa + bb, aa - bb
    size = np.square(a.real)
    size += np.square(a.imag)
    size *= 2
    size -= 1
    for row, column, value in (
        (0, 0, size),
        (0, 1, along.imag),
        (0, 2, along.real),
        (1, 0, across.imag),
        (1, 1, both.real),
        (2, 1, both.imag),
        (2, 2, apart.real),
    ):
        np.multiply(value, weight, out=found[..., row, column, :])
    minus = -weight
    np.multiply(apart.imag, minus, out=found[..., 1, 2, :])
    np.multiply(across.real, minus, out=found[..., 2, 0, :])


def _at(pairs: Pairs, place: int) -> Pairs:
    return pairs[0][..., place], pairs[1][..., place]


def _every_second(pairs: Pairs, first: int, stop: int) -> Pairs:
    return pairs[0][..., first:stop:2], pairs[1][..., first:stop:2]


# Rotations as unit quaternions (..., 4), scalar first.
#
# ``q_ab`` maps vectors in b to a.  Products of many rotations need no loop over time: neighbours are multiplied, halving the length each
# time.

#: below this squared half-angle the series is exact to double precision (its next term is below 1e-18)
_SERIES_BELOW = 1e-2


def join(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Join components (...) to an array (..., n), each contiguous in memory, which is twice as fast as interleaved components."""
    whole = _components(len(parts), parts[0])
    for i, part in enumerate(parts):
        whole[..., i] = part
    return whole


def _components(count: int, like: np.ndarray) -> np.ndarray:
    """Empty array (..., count), each component contiguous in memory."""
    whole = np.empty((count, *like.shape))
    return whole.transpose(*range(1, whole.ndim), 0)


def split(q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Split (..., n) into components (...)."""
    return tuple(q[..., i] for i in range(q.shape[-1]))


def multiply(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton product (..., 4): first q, then p."""
    (pw, px, py, pz), (qw, qx, qy, qz) = split(p), split(q)
    return join(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ]
    )


def conjugate(q: np.ndarray) -> np.ndarray:
    """The inverse of a unit quaternion (..., 4)."""
    w, x, y, z = split(q)
    return join([w, -x, -y, -z])


def exp(vector: np.ndarray) -> np.ndarray:
    """Quaternion (..., 4) of a rotation vector (..., 3) rad, exact at any angle."""
    x, y, z = split(vector)
    h2 = (x * x + y * y + z * z) / 4
    cos = 1 - h2 / 2 * (1 - h2 / 12 * (1 - h2 / 30 * (1 - h2 / 56 * (1 - h2 / 90))))
    sinc = 1 - h2 / 6 * (1 - h2 / 20 * (1 - h2 / 42 * (1 - h2 / 72 * (1 - h2 / 110))))
    small = h2 < _SERIES_BELOW
    if not bool(small.all()):
        # Whole turns take this branch, steps between samples never do.
        h = np.sqrt(np.where(small, 1.0, h2))
        cos, sinc = np.where(small, cos, np.cos(h)), np.where(small, sinc, np.sin(h) / h)
    half_sinc = sinc / 2
    return join([cos, half_sinc * x, half_sinc * y, half_sinc * z])


def log(q: np.ndarray) -> np.ndarray:
    """Shortest rotation vector (..., 3) rad, |vector| <= pi, of unit quaternions."""
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2 * np.arctan2(sine, q[..., 0])
    ratio = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, sine, 1), 2.0)
    return ratio[..., None] * q[..., 1:]


def from_matrix(matrix: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) of a rotation matrix (3, 3), by its largest component (Shepperd 1978)."""
    trace, i = np.trace(matrix), int(np.argmax(np.diag(matrix)))
    if trace > matrix[i, i]:
        skew = matrix - matrix.T
        q = np.array([1 + trace, skew[2, 1], skew[0, 2], skew[1, 0]])
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0], q[1 + i] = matrix[k, j] - matrix[j, k], 1 - trace + 2 * matrix[i, i]
        q[1 + j], q[1 + k] = matrix[j, i] + matrix[i, j], matrix[k, i] + matrix[i, k]
    return q / np.linalg.norm(q)


def matrix(q: np.ndarray) -> np.ndarray:
    """Rotation matrix (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = split(q)
    elements = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]
    elements += [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]
    elements += [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    # Each contiguous in memory, as ``join`` has components.
    return np.moveaxis(np.stack(elements).reshape(3, 3, *w.shape), (0, 1), (-2, -1))


def from_euler(roll: np.ndarray | float, pitch: np.ndarray | float, yaw: np.ndarray | float) -> np.ndarray:
    """Quaternion (..., 4) of R = Rz(yaw) Ry(pitch) Rx(roll), angles in rad."""
    (cr, cp, cy), (sr, sp, sy) = ([half(angle / 2) for angle in (roll, pitch, yaw)] for half in (np.cos, np.sin))
    parts = cy * cp * cr + sy * sp * sr, cy * cp * sr - sy * sp * cr, cy * sp * cr + sy * cp * sr, sy * cp * cr - cy * sp * sr
    return join(np.broadcast_arrays(*parts))


def from_gravity(accel: np.ndarray) -> np.ndarray:
    """Attitude q_nb (..., 4) with yaw 0 of a body at rest with specific force accel (..., 3): docs/formats.md, frames and signs."""
    x, y, z = (accel[..., i] for i in range(3))
    return from_euler(np.arctan2(-y, -z), np.arctan2(x, np.hypot(y, z)), 0.0)


def nearest_yaw(q_tb: np.ndarray, q_tilt: np.ndarray) -> np.ndarray:
    """Rotate ``q_tilt`` (..., 4) about the vertical to be as near as possible to ``q_tb`` (..., 4)."""
    turn = multiply(q_tb, conjugate(q_tilt)) * [1.0, 0.0, 0.0, 1.0]
    length = np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.where(length > 1e-9, multiply(turn / np.maximum(length, 1e-9), q_tilt), q_tilt)


def compose(steps: np.ndarray) -> np.ndarray:
    """Product q_0 q_1 … q_T-1 (..., 4) of body-frame steps (..., T, 4), in log2(T) vectorised multiplications."""
    tail = None
    while steps.shape[-2] > 1:
        even = steps.shape[-2] // 2 * 2
        if even < steps.shape[-2]:
            last = steps[..., -1, :]
            tail = last if tail is None else multiply(last, tail)
        steps = multiply(*_neighbours(steps, even))
    first = steps[..., 0, :]
    return first if tail is None else multiply(first, tail)


def _neighbours(steps: np.ndarray, even: int) -> tuple[np.ndarray, np.ndarray]:
    """The steps with even and with odd index among the first ``even``."""
    return steps[..., 0:even:2, :], steps[..., 1:even:2, :]


def accumulate(steps: np.ndarray) -> np.ndarray:
    """All partial products q_0 … q_k (..., T, 4) of steps (..., T, 4): a scan of neighbours' products (Ladner and Fischer 1980).

    Twice as many multiplications as there are steps, in 2 log2(T) vectorised calls.
    """
    count = steps.shape[-2]
    if count < 2:
        return steps
    even = count // 2 * 2
    pairs = accumulate(multiply(*_neighbours(steps, even)))  # the partial products that end at an odd index
    later = multiply(pairs[..., : (count - 1) // 2, :], steps[..., 2::2, :])
    whole = _components(4, steps[..., 0])
    whole[..., :1, :], whole[..., 2::2, :], whole[..., 1::2, :] = steps[..., :1, :], later, pairs
    return whole


# Vectors and matrices of rotations.


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3), which takes w to v x w, of vectors v (..., 3)."""
    found = np.zeros((*np.shape(v), 3))
    x, y, z = np.moveaxis(v, -1, 0)
    found[..., 0, 1], found[..., 0, 2], found[..., 1, 2] = -z, y, -x
    found[..., 1, 0], found[..., 2, 0], found[..., 2, 1] = z, -y, x
    return found


def identities(*shape: int) -> np.ndarray:
    """Identity matrices (*shape, 3, 3), read only."""
    return np.broadcast_to(np.eye(3), (*shape, 3, 3))


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) nearest to a matrix, by its singular vectors."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def unit_vectors(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., n) over their lengths."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle (...), rad, between vectors (..., 3) of any length."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


# From rates to rotation steps.
#
# The step's rotation vector is the mean rate times dt plus a coning term, c dt^2 w_k x w_k+1.  For a rate linear between two samples,
# c = 1/12 (Savage 1998, part 1; Bortz's equation for a linear rate).  For a curved rate the trapezoid omits dt^3/12 w'' per step;
# summed over a movement from rest to rest, by parts, sum R w'' dt = -sum R (w x w') dt: one more coning term of the same size.  So
# c = 1/6, and the remaining error is of fourth order: 6e-7 deg instead of 8e-4 deg per hand turn at 208 Hz.

CONING = 1 / 6


def steps(rate: np.ndarray, dt: np.ndarray) -> np.ndarray:
    """Rotations (..., T-1, 4) of the body from each sample to the next; rate (..., T, 3) rad/s, dt (..., T-1) s."""
    return exp(step_vectors(rate, dt))


def step_vectors(rate: np.ndarray, dt: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., T-1, 3) rad of the steps."""
    before, after = zip(*((part[..., :-1], part[..., 1:]) for part in split(rate)), strict=True)
    half, coning = dt / 2, dt**2 * CONING
    mean = [(b + a) * half for b, a in zip(before, after, strict=True)]
    (bx, by, bz), (ax, ay, az) = before, after
    bent = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
    return join([m + c * coning for m, c in zip(mean, bent, strict=True)])


def sample_weights(dt: np.ndarray) -> np.ndarray:
    """Trapezoidal weights (..., T) s of the samples."""
    pad = np.zeros_like(dt[..., :1])
    return (np.concatenate([dt, pad], -1) + np.concatenate([pad, dt], -1)) / 2
