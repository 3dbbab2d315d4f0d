"""Unit quaternions as pairs of complex numbers, NumPy only: w + x i + y j + z k = a + b j with a = w + x i and b = y + z i.

As j c = c* j, (a + b j)(c + d j) = (a c - b d*) + (a d + b c*) j (Cayley and Dickson).  Four complex products of arrays take less than
half the time of the sixteen real ones: each reads and writes its arrays once.
"""

from __future__ import annotations

import numpy as np

#: a and b (...), complex
Pairs = tuple[np.ndarray, np.ndarray]

#: of powers of h^2, h half the angle: cos h and sin h / 2 h; below ``SERIES_BELOW`` the next term is below 1e-18
COSINE = (-1 / 3628800, 1 / 40320, -1 / 720, 1 / 24, -1 / 2, 1.0)
HALF_SINC = (-1 / 79833600, 1 / 725760, -1 / 10080, 1 / 240, -1 / 12, 1 / 2)
SERIES_BELOW = 1e-2


def of(q: np.ndarray) -> Pairs:
    """Of quaternions (..., 4)."""
    a, b = np.empty(q.shape[:-1], dtype=complex), np.empty(q.shape[:-1], dtype=complex)
    a.real, a.imag, b.real, b.imag = (q[..., i] for i in range(4))
    return a, b


def quaternions(pairs: Pairs) -> np.ndarray:
    """(..., 4), each component contiguous in memory."""
    a, b = pairs
    q = np.empty((4, *a.shape))
    q[0], q[1], q[2], q[3] = a.real, a.imag, b.real, b.imag
    return np.moveaxis(q, 0, -1)


def exp_small(vector: np.ndarray, into: Pairs) -> bool:
    """Rotation vectors (..., 3) rad, none longer than 0.2 rad, into pairs; False, and nothing done, where one is longer."""
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
    """Horner's scheme, the highest power first."""
    np.multiply(of, coefficients[0], out=into)
    for coefficient in coefficients[1:-1]:
        into += coefficient
        into *= of
    into += coefficients[-1]
    return into


def multiply(p: Pairs, q: Pairs) -> Pairs:
    """Hamilton product of as many p as q: first q, then p."""
    (a, b), (c, d) = p, q
    first, term = a * c, np.conjugate(d)
    term *= b
    first -= term
    second = a * d
    np.conjugate(c, out=term)
    term *= b
    second += term
    return first, second


def compose(steps: Pairs) -> Pairs:
    """``rotation.compose`` of steps (..., T): (...)."""
    tail: Pairs | None = None
    while steps[0].shape[-1] > 1:
        even = steps[0].shape[-1] // 2 * 2
        if even < steps[0].shape[-1]:
            last = _at(steps, even)
            tail = last if tail is None else multiply(last, tail)
        steps = multiply(_every_second(steps, 0, even), _every_second(steps, 1, even))
    first = _at(steps, 0)
    return first if tail is None else multiply(first, tail)


def accumulate(steps: Pairs) -> Pairs:
    """``rotation.accumulate`` of steps (..., T), in their own memory: all partial products (..., T)."""
    count = steps[0].shape[-1]
    if count < 2:
        return steps
    even = count // 2 * 2
    odd = accumulate(multiply(_every_second(steps, 0, even), _every_second(steps, 1, even)))
    between = (count - 1) // 2
    later = multiply((odd[0][..., :between], odd[1][..., :between]), _every_second(steps, 2, count))
    for whole, at_odd, at_even in zip(steps, odd, later, strict=True):
        whole[..., 1::2], whole[..., 2::2] = at_odd, at_even
    return steps


def matrices_into(found: np.ndarray, pairs: Pairs, weight: np.ndarray) -> None:
    """found (..., 3, 3, T): the rotation matrices of pairs (..., T), each times its weight (..., T)."""
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
