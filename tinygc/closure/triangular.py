"""Lower triangular systems, in NumPy alone: ``scipy.linalg`` has them as well, and takes longer to import than a fit takes."""

from __future__ import annotations

import numpy as np

#: rows below which a system is solved at once; above, halves are, and what joins them is a product of matrices
AT_ONCE = 48


def solve_lower(factor: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x of ``factor @ x = right``: factor (..., n, n), of which only the lower triangle is looked at to be nonzero; right (..., n, m), or
    (n,) of a single system."""
    if right.ndim == 1:
        return solve_lower(factor, right[:, None])[:, 0]
    count = factor.shape[-1]
    if count <= AT_ONCE:
        # Last row first it is an upper one, in which elimination finds nothing to do: what is left of ``solve`` is substitution.
        return np.linalg.solve(factor[..., ::-1, ::-1], right[..., ::-1, :])[..., ::-1, :]
    half = count // 2
    first = solve_lower(factor[..., :half, :half], right[..., :half, :])
    last = solve_lower(factor[..., half:, half:], right[..., half:, :] - factor[..., half:, :half] @ first)
    return np.concatenate([first, last], axis=-2)


def inverse_lower(factor: np.ndarray) -> np.ndarray:
    """Inverse (n, n) of a lower triangular factor (n, n): half of the work of ``solve_lower`` on a unit matrix."""
    count = len(factor)
    if count <= AT_ONCE:
        return solve_lower(factor, np.eye(count))
    half, inverse = count // 2, np.zeros_like(factor)
    first = inverse[:half, :half] = inverse_lower(factor[:half, :half])
    last = inverse[half:, half:] = inverse_lower(factor[half:, half:])
    inverse[half:, :half] = -last @ (factor[half:, :half] @ first)
    return inverse
