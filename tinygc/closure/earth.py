"""The Earth's rotation in the table frame: Omega (cos lat, 0, -sin lat) in north-east-down.

The vertical part needs only gravity's direction.  The horizontal part needs the heading of the table: given, or estimated from the
rates in stills of different attitude.  Its length, Omega cos(lat), is known, so one angle h is estimated.  The horizontal vector is the
mean over its posterior p(h), which vanishes if the heading is not observed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from session.base import rotation
from session.base.rotation import identities
from session.base.units import DEG, EARTH_RATE_RPS
from tinygc.inference.solve import solve

_HEADINGS = np.arange(0, 360, 0.5) * DEG
#: a heading less certain than this is reported as unknown
UNKNOWN_ABOVE_RAD = 60 * DEG


@dataclass(frozen=True, eq=False)
class EarthRate:
    """rate_t (3,) rad/s in table axes; heading_rad of the table's x axis from true north, or None; its sigma; its source.

    ``source`` is "none" (no latitude), "given", "estimated" or "unknown" (latitude alone: only the vertical part is used).
    """

    rate_t: np.ndarray
    heading_rad: float | None
    heading_sigma_rad: float
    source: str

    def in_body(self, q_tb: np.ndarray) -> np.ndarray:
        """(..., 3) rad/s in body axes at attitudes q_tb (..., 4)."""
        return np.einsum("...ji,j->...i", rotation.matrix(q_tb), self.rate_t)


def earths_in_body(earths: Mapping[int, EarthRate], group: np.ndarray, q_tb: np.ndarray) -> np.ndarray:
    """(S, 3) rad/s in body axes at attitudes q_tb (S, 4), each by its group's (S,)."""
    found = np.empty((len(q_tb), 3))
    for number in np.unique(group):
        found[group == number] = earths[int(number)].in_body(q_tb[group == number])
    return found


def no_earth() -> EarthRate:
    """Zero rate, for a session without a latitude."""
    return EarthRate(np.zeros(3), None, np.inf, "none")


def vertical_only(latitude_deg: float) -> EarthRate:
    """Vertical part (0, 0, -Omega sin lat) rad/s in table axes; the heading is unknown."""
    return EarthRate(np.array([0, 0, _down(latitude_deg)]), None, np.inf, "unknown")


def with_heading(latitude_deg: float, heading_deg: float) -> EarthRate:
    """Earth's rate for a table whose x axis points ``heading_deg`` east of true north."""
    heading = heading_deg * DEG
    return EarthRate(_north(latitude_deg) * _direction(heading) + [0, 0, _down(latitude_deg)], heading, 0.0, "given")


def estimate_heading(latitude_deg: float, q_tb: np.ndarray, rate: np.ndarray, sigma: np.ndarray) -> EarthRate:
    """Estimate the heading from Q stills: attitudes q_tb (Q, 4), rates (Q, 3) calibrated up to a common bias, sigma (Q, 3) rad/s.

    Solves rate = b + R_bt w for the bias and the horizontal part of w; the vertical part is known.  Bias drift widens the heading's sigma.
    """
    turn = rotation.matrix(q_tb)
    found = _without_bias(turn[:, :2], rate - turn[:, 2] * _down(latitude_deg), sigma)
    if found is None:
        return vertical_only(latitude_deg)
    horizontal, covariance = found
    misfit = _north(latitude_deg) * _direction(_HEADINGS)[:, :2] - horizontal
    log_p = -0.5 * np.einsum("hi,ij,hj->h", misfit, np.linalg.inv(covariance), misfit)
    p = np.exp(log_p - log_p.max())
    mean = (p / p.sum()) @ _direction(_HEADINGS)
    length = float(np.linalg.norm(mean))
    spread = np.sqrt(-2 * np.log(min(max(length, 1e-12), 1.0)))
    heading = float(np.arctan2(-mean[1], mean[0]))
    source = "estimated" if spread < UNKNOWN_ABOVE_RAD else "unknown"
    return EarthRate(_north(latitude_deg) * mean + [0, 0, _down(latitude_deg)], heading, float(spread), source)


def vertical_rate(q_tb: np.ndarray, rate: np.ndarray, sigma: np.ndarray) -> tuple[float, float] | None:
    """Estimate the rate about down, rad/s, and its sigma from Q stills: attitudes q_tb (Q, 4), rates (Q, 3) calibrated up to a common bias,
    sigma (Q, 3) rad/s.  None if their attitudes do not separate it from the bias.
    """
    found = _without_bias(rotation.matrix(q_tb), rate, sigma)
    return None if found is None else (float(found[0][2]), float(np.sqrt(found[1][2, 2])))


def _without_bias(axes: np.ndarray, rate: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """The parts (n,) of rates (Q, 3) along axes (Q, n, 3), with a bias that all have in common, and their covariance (n, n), scaled up to
    the observed scatter.  None where the stills do not determine all of them."""
    design = np.concatenate([identities(len(rate)), axes.transpose(0, 2, 1)], axis=-1)
    jacobian, value = (design / sigma[..., None]).reshape(-1, design.shape[-1]), (rate / sigma).ravel()
    found, freedom = solve(jacobian, value), len(value) - design.shape[-1]
    if freedom < 1 or found.rank < design.shape[-1]:
        return None
    excess = max(1.0, float(np.sum((value - jacobian @ found.value) ** 2)) / freedom)
    return found.value[3:], found.covariance[3:, 3:] * excess


def unseen_covariance(earth: EarthRate, latitude_deg: float | None) -> np.ndarray:
    """(3, 3) (rad/s)^2 covariance, in table axes, of the horizontal rate that ``earth`` leaves out because its heading is uncertain.

    The horizontal rate has a known length.  ``rate_t`` is the mean over the heading's posterior, so what is left has the variance
    length^2 - |mean|^2: across the mean where the heading is estimated, the same in all directions where it is unknown.  Where the Earth's
    rate is left out, all of it is left: in any direction where the latitude is unknown.
    """
    if latitude_deg is None:
        return np.eye(3) * EARTH_RATE_RPS**2 / 3
    if earth.source == "none":
        return np.diag([_north(latitude_deg) ** 2 / 2] * 2 + [_down(latitude_deg) ** 2])
    if earth.source == "given":
        return np.zeros((3, 3))
    left = max(_north(latitude_deg) ** 2 - float(earth.rate_t[:2] @ earth.rate_t[:2]), 0.0)
    if earth.source == "unknown" or not earth.rate_t[:2].any():
        return np.diag([left / 2, left / 2, 0.0])
    across = np.array([-earth.rate_t[1], earth.rate_t[0], 0.0]) / np.linalg.norm(earth.rate_t[:2])
    return left * np.outer(across, across)


def contradicts(estimate: EarthRate, given: EarthRate) -> bool:
    """Whether the heading estimated from the stills differs significantly, by more than three sigmas, from the given one."""
    if estimate.source != "estimated" or estimate.heading_rad is None or given.heading_rad is None:
        return False
    apart = np.angle(np.exp(1j * (estimate.heading_rad - given.heading_rad)))
    return bool(abs(apart) > 3 * estimate.heading_sigma_rad and estimate.heading_sigma_rad < 30 * DEG)


def _north(latitude_deg: float) -> float:
    return EARTH_RATE_RPS * np.cos(latitude_deg * DEG)


def _down(latitude_deg: float) -> float:
    return -EARTH_RATE_RPS * np.sin(latitude_deg * DEG)


def _direction(heading: np.ndarray | float) -> np.ndarray:
    """North (..., 3) in table axes, for a table whose x axis points ``heading`` east of north."""
    return np.stack([np.cos(heading), -np.sin(heading), np.zeros_like(heading)], -1)
