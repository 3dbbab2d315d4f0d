"""By how much a filter's noise densities are to be larger than those at rest, and why.

A filter integrates the rate with a white density n (rad/s/sqrt(Hz), two-sided) and a bias walk k (rad/s/sqrt(s)).  Over a window of T
seconds, with the bias known at its start, it states for each axis an angle variance of

    n^2 T + k^2 T^3 / 3.

At rest n = N and k follows from K, B and the other slow terms.  On motion the angle is off further, by what the calibration leaves.  The
density for which the stated variance holds over windows of T is

    n^2 = N^2 + (variance of the angle error beyond N^2 T and beyond the reference's own error) / T.

**Coherent errors.**  An error d of the scale factor makes d times the angle turned, so the variance is d^2 E[angle^2], and n^2 grows by
d^2 E[angle^2] / T.  It depends on the motion.  One way at a rate w it is d^2 w^2 T: it grows with the window.  For motion back and forth
whose rate has the rms w and the correlation time c, it is 2 d^2 w^2 c (1 - c / T (1 - exp(-T / c))): for windows much longer than c this is
a white noise.  Motion that comes back after T leaves nothing.  A misalignment does the same with the rate about another axis.

**The unnamed.**  A session's noise components (``noise.turn``) hold what each turn is off by beyond white noise, bias drift, the
accelerometer and undersampling, with the calibration estimated together.  A turn is off by s whatever it is; over turns of mean duration T
this is s^2 / T.  Whether it goes with the angle, the time or the vibration of a turn is not seen in one session, so it has no other
name, and on slower motion it is an upper bound.

**Stills.**  The session's stills may be noisier than the rest log, in another temperature or on a table that trembles.

**Vibration.**  A gyroscope measures vibration, and that is no error.  What vibration leaves is undersampling (``motion.undersampled``), or
it is in the unnamed.

**The walk.**  A filter learns its bias by averaging; where white noise hides the slow terms, no filter sees them.  So the walk is the
smallest one whose Allan variance k^2 tau / 3 is at least that of the slow terms (G, B, K, R) at all tau from where these reach N^2 / tau.
For K alone this is K.  For bias instability it is 2 ln 2 / pi sqrt(3) B^2 / N.  The session's bias drift replaces B where it is larger.

**Factors.**  White densities add in variance: factor^2 = 1 + sum of part_i, with part_i relative to N^2.  A part is stated as the factor
that it alone would need, sqrt(1 + part_i); squares less one add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from session.base import rotation
from session.base.errors import DataError
from session.base.numeric import rms_of
from session.base.records import write_whole
from session.base.texts import significant
from session.base.units import DEG
from tinygc.closure import residual
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.fitting.fit_file import read_fit
from tinygc.fitting.results import FitResult
from tinygc.inference.choose import ONE_SIDED
from tinygc.models import linear
from tinygc.noise.components import TURN, UNDERSAMPLED, WANDER, SessionNoise
from tinygc.noise.figures import FILE, AxisNoise, Inflation, NoiseFigures, SensorNoise, unit_allan_variance
from tinygc.noise.measured import SHOWN

# The walk at rest.

#: terms that a filter takes for a drifting bias
SLOW = ("G", "B", "K", "R")
#: longest averaging time at which the walk has to hold, s: a filter that learns its bias for longer would need other states
LONGEST_S = 1000.0
TAUS_S = np.geomspace(0.01, LONGEST_S, 600)


def walk_density(axis: AxisNoise, white: float, more_instability: float = 0.0) -> float:
    """Walk density, u/sqrt(s), of a filter for the slow terms of an axis whose white density is ``white`` (u/sqrt(Hz), above 0).

    more_instability: a bias instability, u, that replaces the axis' B where it is larger.
    """
    slow = sum(axis.allan_variance(TAUS_S, name) for name in SLOW if name != "B")
    slow = slow + max(axis.terms["B"].mean_square, more_instability**2) * unit_allan_variance("B", TAUS_S)
    if not np.any(slow):
        return 0.0
    seen = slow * TAUS_S >= white**2
    first = int(np.argmax(seen)) if seen.any() else len(TAUS_S) - 1
    needed = 3 * slow[first:] / TAUS_S[first:]
    if first > 0 and seen.any():
        # Between two averaging times both curves are powers of tau.
        ratio = np.log(slow[first - 1 : first + 1] * TAUS_S[first - 1 : first + 1] / white**2)
        share = -ratio[0] / (ratio[1] - ratio[0])
        before, at = np.log(3 * slow[first - 1 : first + 1] / TAUS_S[first - 1 : first + 1])
        needed = np.append(needed, np.exp(before + share * (at - before)))
    return float(np.sqrt(needed.max()))


# Coherent errors: the square of the angle that a scale factor multiplies, by window.


def one_way(rate_rps: float, window_s: float) -> float:
    """Mean square of the angle over the window, rad^2/s: turning one way at a rate."""
    return rate_rps**2 * window_s


def _back_and_forth(rate_rps: float, correlation_s: float, window_s: float) -> float:
    """The same for a rate of this rms whose autocorrelation is exp(-|t| / correlation_s)."""
    x = window_s / correlation_s
    return 2 * rate_rps**2 * correlation_s * (1 + np.expm1(-x) / x)


# The inflations of a session.

#: turning slowly, one way, rad/s
SLOW_RPS = 10 * DEG
#: back and forth: correlation time of the rate, s
RETURN_S = 0.5
REST, TURNS, SLOWLY = "at rest", "hand turns", "slow turning"
SCALE, _MISALIGNMENT, STILLS, _UNDERSAMPLING, _UNNAMED = "scale", "misalignment", "stills", "undersampling", "unnamed"
#: elements (9,) of a linear model's matrix, row by row, that are scale factors
DIAGONAL = np.eye(3, dtype=bool).ravel()


def at_rest(figures: NoiseFigures, source: str = "") -> Inflation:
    """The inflation of a unit that does not move: none of N; the walk of all slow terms.

    Raises DataError where an axis has no white noise, which nothing can be a multiple of.
    """
    N = figures.gyro.values("N")
    if not np.all(N > 0):
        axis = "xyz"[int(np.argmin(N))]
        raise DataError(f"the noise figures show no N on gyroscope axis {axis}, so nothing can be a multiple of it; record a longer rest")
    walk = np.array([walk_density(axis, white) for axis, white in zip(figures.gyro.axes, N, strict=True)])
    return _inflation(figures, REST, {}, np.zeros(3), np.zeros(3), walk, source)


def inflations(result: FitResult, figures: NoiseFigures) -> tuple[Inflation, ...]:
    """Inflations of the calibrated gyroscope (least squares) at rest and, where the fit has estimated its noise, on turns as in its
    session, on slow turning and on motion back and forth.

    figures: of the same unit at rest.  Raises DataError as ``at_rest``.
    """
    rest = at_rest(figures, f"rest of {figures.duration_s:.0f} s")
    if result.noise is None:
        return (rest,)
    batch, model, noise, N = result.problem.batch, result.linear.linear, result.noise.noise, figures.gyro.values("N")
    window_s, rate = float(np.mean(batch.duration_s)), model(batch.rate)
    walk = np.array([walk_density(axis, white, noise.size(WANDER)) for axis, white in zip(figures.gyro.axes, N, strict=True)])
    held_out, expected = np.sqrt(np.mean(np.sum(result.linear.held_out[:, :2] ** 2, axis=1))), result.noise.tilt_rms
    source = f"{len(batch)} turns, held out {held_out / DEG:.3g}° where {expected / DEG:.3g}° are expected"
    own, variance = _of_noise(noise, window_s)
    own[STILLS] = np.maximum(result.problem.noise.angle_random_walk**2 - N**2, 0.0)
    spread = np.full(3, np.sqrt(variance))

    # On turns as in the session: the error of each turn's end for a unit error of each element of E, (S, 3, 9) rad.
    design = linear.columns(residual.sensitivity(batch, rate), batch.rate)[..., :9]
    square = result.covariance[:9, :9]
    turns = {name: _of_ends(design, square, which) / window_s for name, which in ((SCALE, DIAGONAL), (_MISALIGNMENT, ~DIAGONAL))}
    allowed = [] if result.allowed is None else [each[:9, :9] for each in result.allowed.by_effect.values()]
    limit = np.max([_of_ends(design, each, DIAGONAL | ~DIAGONAL) / window_s for each in allowed], axis=0, initial=0.0) + np.zeros(3)
    # The steps' lengths add up: an angle that is turned back counts twice.
    angle = np.mean(np.sum(np.linalg.norm(rotation.step_vectors(rate, batch.dt), axis=-1), axis=1))
    found = [
        rest,
        _inflation(figures, f"{TURNS} ({angle / DEG:.0f}° in {window_s:.2g} s)", turns | own, spread, limit, walk, source),
    ]

    # On other motion: row j of E is off by dE_j . omega, for a rate in any direction a third of its square times the row's variances.
    rows = np.diag(square).reshape(3, 3) / 3
    named = {SCALE: np.diag(rows), _MISALIGNMENT: rows.sum(axis=1) - np.diag(rows)}
    limit = np.max([np.diag(each).reshape(3, 3).sum(axis=1) / 3 for each in allowed], axis=0, initial=0.0) + np.zeros(3)
    turning = float(np.sqrt(np.mean(np.sum(rate[:, :-1] ** 2, axis=-1)[batch.dt > 0])))
    slowly = f"{SLOWLY} ({SLOW_RPS / DEG:.0f} °/s, corrected every {window_s:.2g} s)"
    both = f"back and forth ({turning / DEG:.0f} °/s rms, {RETURN_S:g} s)"
    for motion, grows, kept in (
        (slowly, one_way(SLOW_RPS, window_s), (STILLS, _UNNAMED)),
        (both, _back_and_forth(turning, RETURN_S, window_s), (STILLS, _UNNAMED, _UNDERSAMPLING)),
    ):
        parts = {name: share * grows for name, share in named.items()} | {name: own[name] for name in kept if name in own}
        found.append(_inflation(figures, motion, parts, spread, limit * grows, walk, source))
    return tuple(found)


def _of_ends(design: np.ndarray, square: np.ndarray, which: np.ndarray) -> np.ndarray:
    """(3,) rad^2: mean square of a turn's error from the elements ``which`` (9,) of each row of E, whose squares and products are
    ``square`` (9, 9).  Errors of one row are errors of one axis' rate."""
    rows = [np.flatnonzero(which[3 * axis : 3 * axis + 3]) + 3 * axis for axis in range(3)]
    return np.array([np.einsum("sap,pq,saq->", design[..., row], square[np.ix_(row, row)], design[..., row]) for row in rows]) / len(design)


def _of_noise(noise: SessionNoise, window_s: float) -> tuple[dict[str, np.ndarray], float]:
    """What the noise components add to the square of the white density, by cause, (3,) rad^2/s each, and the variance of their sum."""
    parts, variance = {}, 0.0
    for size, sigma, component in zip(noise.s, noise.sigma, noise.components, strict=True):
        if component.name not in (TURN, UNDERSAMPLED):
            continue
        unit = 1.0 if component.name == TURN else float(np.mean(noise.missed.predicted_rad**2))
        parts[_UNNAMED if component.name == TURN else _UNDERSAMPLING] = np.full(3, unit * size**2 / window_s)
        if np.isfinite(sigma):
            # That of the square of a normal variable.
            variance += (unit / window_s) ** 2 * (4 * size**2 * sigma**2 + 2 * sigma**4)
    return parts, variance


def _inflation(
    figures: NoiseFigures,
    motion: str,
    parts: dict[str, np.ndarray],
    sigma: np.ndarray,
    allowed: np.ndarray,
    walk: np.ndarray,
    source: str,
) -> Inflation:
    """Parts, the sigma of their sum, and what else the recording allows: (3,) each of the square of the white density."""
    N, K = figures.gyro.values("N"), figures.gyro.values("K")
    white = np.sqrt(1 + sum(parts.values(), np.zeros(3)) / N**2)
    return Inflation(
        motion,
        white,
        np.divide(walk, K, out=np.ones(3), where=K > 0),
        {name: np.sqrt(1 + part / N**2) for name, part in parts.items()},
        source,
        white_sigma=sigma / N**2 / (2 * white),
        at_most=np.sqrt(white**2 + (ONE_SIDED * sigma + allowed) / N**2),
        white_density=white * N,
        walk_density=walk,
    )


def inflations_of_folder(folder: Path, figures: NoiseFigures) -> tuple[Inflation, ...]:
    """The inflations of a fitted session folder; none where it has no ``fit/fit.json``.

    Least squares is fitted once more, with default options, and with these figures as prior rather than those of an earlier
    ``noise.json``, so that the same logs give the same factors.  Raises FormatError for a fit or a session that is not as documented, the
    errors of ``fit_session``, and DataError as ``at_rest``.
    """
    path = folder / "fit" / "fit.json"
    if not path.exists():
        return ()
    read_fit(path)
    with TemporaryDirectory() as place:
        prior = Path(place) / FILE
        write_whole(prior, figures)
        options = FitOptions(methods=("least_squares",), noise=prior)
        return inflations(fit_session(folder, options), figures)


def inflation_lines(found: Sequence[Inflation], gyro: SensorNoise, verbose: bool = False) -> list[str]:
    """The factor of the noise density on hand turns; verbose: on each motion, rms over the axes, with its sigma, its upper limit and its
    parts, and the walk.

    gyro: its noise at rest.  Where it shows no slow term and the limit of K is above the walk, the limit stands in its place.  No lines
    where an axis of it is not described.
    """
    if not gyro.is_described:
        return []
    if not verbose:
        return [f"Kalman filter, hand turns: noise density × {rms_of(each.white):.1f}." for each in found if each.motion.startswith(TURNS)]
    unit, si = SHOWN["gyro"]["K"]
    is_hidden, limit = not any(gyro.measured(name) for name in SLOW), float(gyro.at_most("K").max())
    below = f"walk < {significant(limit / si, 2)} {unit}" if np.isfinite(limit) else ""
    lines = []
    for each in found:
        factor = rms_of(each.white)
        text = f"Kalman filter, {each.motion}: noise density × {factor:.2f}"
        if each.white_sigma is not None and np.any(each.white_sigma > 0):
            text += f" ± {rms_of(each.white_sigma):.2f}"
        if each.at_most is not None and rms_of(each.at_most) > 1.005 * factor:
            text += f", < {rms_of(each.at_most):.2f}"
        causes = sorted(((rms_of(part), name) for name, part in each.parts.items()), reverse=True)
        # An error of each turn need not grow with a slower turn's time.
        bound = {_UNNAMED: "< "} if each.motion.startswith(SLOWLY) else {}
        details = [f"{name} {bound.get(name, '')}{part:.2f}" for part, name in causes if part > 1.005]
        if each.walk_density is not None:
            known = below and each.walk_density.any() and not np.all(each.walk_density < limit)
            walk = below if is_hidden and not known else f"walk {significant(rms_of(each.walk_density) / si, 2)} {unit}"
            details += [walk] if walk else []
        lines += [text, *([f"  {', '.join(details)}"] if details else [])]
    return lines
