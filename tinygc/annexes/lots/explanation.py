"""A lot and one unit's effects: the lot's prior for them, a session's estimates for the lot, and the lot's prior for the coach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.bench.messages import AcceptedTurn
from session.io.errors import CalibrationError
from session.io.units import DEG, EARTH_RATE_RPS
from tinygc.annexes.lots.fit import Belonging, belonging, farthest, prior_of
from tinygc.annexes.lots.lot import Lot, PooledEffect, Weighed
from tinygc.annexes.lots.report import read_lot
from tinygc.closure.residual import Batch, closure_angles
from tinygc.effects import AppliedEffect, Effect, catalogue
from tinygc.explanation.claims import readable
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import PRIOR_ODDS, SCALES, WIDE, component_names, linear_estimate, without_claim
from tinygc.models.linear import BIAS, MATRIX, PARAMETERS, LinearModel
from tinygc.noise.candidates import candidates
from tinygc.noise.refit import Refit, Replay
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener
from tinygc.planning.coach import BoardPrior

# The lot's prior for a unit's effects: probability and size of each in this unit.
#
# The prior odds of an effect that pooling found in many units are the lot's; the likelihood ratio is from the unit's own recording, for a
# size like theirs: linear, together with the calibration and the other reported effects.

#: bounds of a lot's share, as prior probability of a unit: no lot is entirely uniform
LEAST, MOST = 0.02, 0.95
#: least spread relative to a size known from the lot: units always differ somewhat
LEAST_SPREAD = 0.1


@dataclass(frozen=True, eq=False)
class LotEffect:
    """One effect of the lot in this unit.

    share of the lot's units that have it; probability that this one has; theta (P,) SI and its covariance, of lot and recording together,
    if it has; sigmas: error of the closure and the stills without it; closure_rad: rms tilt that it leaves at the ends of these turns,
    after the calibration has absorbed its part.
    """

    effect: Effect
    share: float
    probability: float
    theta: np.ndarray
    covariance: np.ndarray
    sigmas: float
    closure_rad: float
    equivalent: tuple[str, ...] = ()

    def to_json(self) -> dict:
        """Return one of ``lot.effects`` of ``tinygc-explain/2``."""
        _, parameters, std = readable(AppliedEffect(self.effect, self.theta), self.covariance)
        return {
            "id": self.effect.id,
            "share": self.share,
            "probability": self.probability,
            "parameters": parameters,
            "std": std,
            "worth_sigmas": self.sigmas,
            "worth_closure_deg": self.closure_rad / DEG,
            "equivalent": list(self.equivalent),
        }

    @property
    def words(self) -> str:
        """Return one line of text."""
        as_well = f"; could as well be {', '.join(self.equivalent)}" if self.equivalent else ""
        return (
            f"{self.effect.id}: {self.share:.0%} of the lot have it, this unit with probability {self.probability:.2g}; worth "
            f"{self.closure_rad / DEG:.4f}° of closure, {self.sigmas:.1f} sigmas of this recording{as_well}"
        )


@dataclass(frozen=True, eq=False)
class LotEffects:
    """Effects of a lot's units, in the form ``explain`` takes (``KnownEffects`` of ``tinygc.explanation.engine``)."""

    lot: Lot

    @property
    def odds(self) -> dict[str, float]:
        """Return the prior odds that a unit has each of the lot's effects, by id."""
        shares = {name: float(np.clip(pooled.share, LEAST, MOST)) for name, pooled in self.lot.effects.items()}
        return {name: share / (1 - share) for name, share in shares.items()}

    def in_unit(self, twin: Twin, whiten: Whitener, fit: Refit) -> list[LotEffect]:
        """Return the lot's effects that are in the catalogue with all their numbers, given a fit; the most probable first."""
        known = catalogue()
        found = [_in_unit(twin, whiten, fit, known[name], pooled) for name, pooled in self.lot.effects.items() if name in known]
        return sorted((each for each in found if each is not None), key=lambda each: -each.probability)


def known_effects(lot: Lot | Path | str, sensor: str) -> LotEffects:
    """Return the effects of a lot, or of its file.  Raises the errors of ``read_lot``, and CalibrationError for a lot of another sensor."""
    lot = lot if isinstance(lot, Lot) else read_lot(lot)
    if lot.sensor != sensor:
        raise CalibrationError(f"a lot of {lot.sensor}, and the session's sensor is {sensor}; give the lot of its own model")
    return LotEffects(lot)


def _in_unit(twin: Twin, whiten: Whitener, fit: Refit, effect: Effect, pooled: PooledEffect) -> LotEffect | None:
    names = component_names(effect)
    mean, spread = _known(pooled.mean, names), _known(pooled.spread, names)
    if effect.kind not in ("rate", "force") or effect.scan is not None or not mean.any():
        return None
    number = next((n for n, claim in enumerate(fit.state.claims) if claim.effect.id == effect.id), None)
    beside = fit if number is None else without_claim(fit, number)
    stacked = Replay(twin, fit).columns(effect).stacked()
    theta, own = linear_estimate(beside.r, beside.J, whiten(stacked), effect.parameter.plausible)
    before = np.diag(spread**2 + (LEAST_SPREAD * np.abs(mean).max()) ** 2)
    # three hypotheses: normal about the lot's mean; zero; or an effect of its own, of its own size
    share = float(np.clip(pooled.share, LEAST, MOST))
    size = np.eye(len(theta)) * max(float(np.mean(theta**2)), float(np.mean(mean**2)))
    chances = np.array(
        [
            np.log(share) + _log_normal(theta - mean, own + before),
            np.log(1 - share) + _log_normal(theta, own),
            np.log(PRIOR_ODDS / SCALES) + _log_normal(theta, own + size),
        ]
    )
    probability = float(np.exp(chances[0] - np.logaddexp.reduce(chances)))
    gain = before @ np.linalg.inv(own + before)
    both, covariance = mean + gain @ (theta - mean), before - gain @ before
    information = np.linalg.inv(own)
    rows = len(twin.segments) * twin.batch.angles
    left = _beside_the_fit(stacked[:rows] @ both, whiten.back(beside.J)[:rows])
    tilt = float(np.sqrt(np.mean(np.sum(left.reshape(-1, twin.batch.angles)[:, :2] ** 2, axis=1))))
    return LotEffect(
        effect, pooled.share, probability, both, covariance, float(np.sqrt(both @ information @ both)), tilt, pooled.equivalent
    )


def _known(values: Mapping[str, float], names: tuple[str, ...]) -> np.ndarray:
    return np.nan_to_num(np.array([values.get(name, 0.0) for name in names], dtype=float))


def _log_normal(x: np.ndarray, covariance: np.ndarray) -> float:
    from scipy.stats import multivariate_normal

    return float(multivariate_normal.logpdf(x, np.zeros(len(x)), covariance, allow_singular=True))


def _beside_the_fit(closure: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the part (n,) that no column of the fit absorbs."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.asarray(closure - scaled @ np.linalg.lstsq(scaled, closure, rcond=None)[0])


# A session's estimate of every effect of the catalogue, reported or not, for pooling over a lot (docs/lots.md).
#
# An effect that is weak in each of many units is reported in none of them, but its estimate exists: the effect's columns are fitted
# linearly together with the calibration and the other reported effects. There is no selection, so the average of many is unbiased.

#: limit of a sigma relative to the prior's; above it, a number is undetermined
SENSOR_ERRORS = 0.3
CLOCKS = "timing.gyro_accel_offset"


def effects_of(explanation: Explanation) -> dict[str, Weighed]:
    """Return effect id -> this session's estimate, SI; NaN for numbers that it does not determine.

    Effects that data repair removes before any fit (lost samples, glitches) have no columns and are not included.  Only differences of
    delays between axes are estimated.  An effect with a searched shape (the moment of a step) is taken in the middle of the search range:
    its best fit would be a selected estimate. The delay between gyro and accelerometer is that beyond the filters' own.  chi_square is that
    of all its numbers together.
    """
    twin, fit, whiten = explanation.twin, explanation.naming.fit, explanation.whiten
    claims = {claim.effect.id: number for number, claim in enumerate(fit.state.claims)}
    chances = {each.id: each.probability for each in explanation.considered}
    chances |= {claim.effect.id: claim.probability for claim in explanation.claimed}
    replay, found = Replay(twin, fit), dict[str, Weighed]()
    forms: dict[str, list[Effect]] = {}
    for effect in candidates(twin):
        forms.setdefault(effect.id, []).append(effect)
    for name, shapes in forms.items():
        effect = shapes[0] if shapes[0].scan is None else shapes[len(shapes) // 2]
        beside = fit if name not in claims else without_claim(fit, claims[name])
        columns = whiten(replay.columns(effect).stacked())
        theta, covariance = linear_estimate(beside.r, beside.J, columns, effect.parameter.plausible)
        told = _told(effect)
        theta, covariance = told @ theta, told @ covariance @ told.T
        chi_square = float(theta @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ theta)
        sigma = np.sqrt(np.diag(covariance))
        unseen = sigma > SENSOR_ERRORS * WIDE * effect.parameter.plausible
        theta, sigma = np.where(unseen, np.nan, theta), np.where(unseen, np.nan, sigma)
        found[name] = _weighed(effect, theta, sigma, chi_square, name in claims, chances.get(name))
    gravity, clocks = explanation.gravity, catalogue().get(CLOCKS)
    if clocks is not None and np.isfinite(gravity.offset_s) and np.isfinite(gravity.sigma_s) and gravity.sigma_s > 0:
        beyond = np.sign(gravity.offset_s) * max(abs(gravity.offset_s) - gravity.filters_s, 0.0)
        offset, sigma = np.array([beyond]), np.array([gravity.sigma_s])
        named = any(claim.effect.id == CLOCKS for claim in explanation.claimed)
        found[CLOCKS] = _weighed(clocks, offset, sigma, float((offset / sigma)[0] ** 2), named, chances.get(CLOCKS))
    return found


def _told(effect: Effect) -> np.ndarray:
    """Return (P, P): the projection on the part of theta that a closure determines: of delays, the differences between axes."""
    told = np.eye(effect.parameter.size)
    if effect.gauge_convention is not None and effect.gauge_convention.delays:
        told[np.ix_(effect.gauge_convention.delays, effect.gauge_convention.delays)] -= 1 / len(effect.gauge_convention.delays)
    return told


def _weighed(effect: Effect, theta: np.ndarray, sigma: np.ndarray, chi_square: float, named: bool, probability: float | None) -> Weighed:
    names = component_names(effect)
    values, sigmas = (dict(zip(names, map(float, each), strict=True)) for each in (theta, sigma))
    return Weighed(values, sigmas, chi_square, named, probability)


# The lot's prior for the board on the table, and whether the board belongs to the lot, by the turns so far.
#
# Linear, as all of the coach: the closure error that the lot's mean leaves on each turn, with its bias taken from the stills.

#: sigma of a bias from a still, due to the Earth's rate, whose direction is unknown to the coach
STILL_BIAS_RPS = EARTH_RATE_RPS
#: probability of belonging below which the coach does not use the lot; the same as for ``fit``
BELONGS = 0.95


def board_prior(
    lot: Lot, turns: tuple[AcceptedTurn, ...], columns: np.ndarray, noise: np.ndarray, directions: np.ndarray, by_turns: bool = True
) -> BoardPrior:
    """Return the lot's prior for a board given its turns.

    columns (S, 2, 12) and noise (S, 2, 2) of each; directions (S, 2, 4): attitudes of its ends. Where the lot has no mean for a number,
    that is as open as without it.  by_turns: whether the turns' closure is used, too: with an uncalibrated accelerometer it would show that
    one's errors, and only the stills' rates decide whether the board belongs.
    """
    stills = np.array([still.gyro_mean for turn in turns for still in turn.segment.stills])
    bias = stills.mean(axis=0)
    start = LinearModel(np.eye(3), -bias)
    prior = prior_of(lot, start.vector)
    model = LinearModel(prior.centre[MATRIX].reshape(3, 3), np.zeros(3))
    angles = np.array([_angles(turn, model, ends) for turn, ends in zip(turns, directions, strict=True)])
    weight, design = np.linalg.inv(noise), columns[:, :, MATRIX] * by_turns
    known = np.einsum("sdp,sde,seq->pq", design, weight, design)
    own = np.linalg.inv(prior.covariance[MATRIX, MATRIX])
    inverse = np.linalg.inv(known + own)
    moved, kept, covariance = np.zeros(PARAMETERS), np.eye(PARAMETERS), np.zeros((PARAMETERS, PARAMETERS))
    moved[MATRIX] = -inverse @ np.einsum("sdp,sde,se->p", design, weight, angles)
    kept[MATRIX, MATRIX] = inverse @ known
    covariance[MATRIX, MATRIX] = inverse @ known @ inverse
    moved[BIAS] = -model.E @ bias - prior.centre[BIAS]
    covariance[BIAS, BIAS] = np.eye(3) * STILL_BIAS_RPS**2
    found = belonging(prior, moved, covariance, kept, lot.tails)
    if found.probability >= BELONGS:
        return BoardPrior(prior, "")
    return BoardPrior(None, _words(lot, found, prior.centre + moved, covariance, kept))


def _words(lot: Lot, found: Belonging, vector: np.ndarray, covariance: np.ndarray, kept: np.ndarray) -> str:
    off = farthest(lot, vector, covariance, np.diag(kept) > 0.5)
    far = "" if off is None else f": {off[0]} is {off[1]:+.1f} of its sigmas from its mean"
    return f"this board seems not to be of the lot (probability that it is: {found.probability:.2g}){far}; the lot is not used"


def _angles(turn: AcceptedTurn, model: LinearModel, ends: np.ndarray) -> np.ndarray:
    """Return (2,) rad: tilt error of a turn with the lot's mean, after subtraction of the bias of its own stills."""
    measured = turn.samples.gyro[None]
    bias = (turn.segment.stills[0].gyro_mean + turn.segment.stills[1].gyro_mean) / 2
    batch = Batch(measured - bias, turn.samples.dt_s[None], np.zeros_like(measured), ends[:1], ends[1:], yaw_known=False)
    return np.asarray(closure_angles(batch, model)[0, :2])
