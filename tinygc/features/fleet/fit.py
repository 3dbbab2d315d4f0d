"""Least squares with a lot as prior: the prior, whether the unit belongs to the lot, and the fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.special import chdtrc

from session.base.errors import CalibrationError
from session.base.texts import probability
from session.detect.segments import FEWEST_SEGMENTS
from session.log.folder import file_key, sha256_of
from tinygc.closure.least_squares import GaussianPrior, vague
from tinygc.closure.problem import Problem
from tinygc.closure.residual import closure_angles
from tinygc.closure.uncertainty import covariance_parts, goodness
from tinygc.estimation.bias import BiasChoice, choose
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.estimation.spread import Spread
from tinygc.estimation.stated_noise import StatedNoise, prior_share, stated_covariance, stated_goodness
from tinygc.features.fleet.lot import Lot
from tinygc.features.fleet.report import read_lot
from tinygc.models.linear import NAMES, PARAMETERS, PRIOR_SIGMA, LinearModel, bias_only

# A lot as prior of one unit's gyroscope, and the probability that the unit belongs to it (docs/features/fleet/lots.md).
#
# The next session's numbers are normal about the lot's mean, each by itself, with the variances of that mean, of the spread between units,
# and of the change from session to session.  A unit that does not belong has one number, or all of them, several times as far off: both
# hypotheses are weighted, and the lot contributes nothing under the second.

#: fewest units for a covariance of twelve numbers of the next unit
FEWEST_UNITS = 10
#: prior probability that a unit does not belong (benchmarks/lot_prior.py: costs and benefits)
OFF_LOT = 0.03
#: factors by which a unit that does not belong is off, in spreads of the lot: equally probable
OFF_SCALES = (3.0, 10.0, 30.0, 100.0)
#: share of the predicted covariance, from noise and prior, below which a direction is unobserved
UNSEEN = 1e-9
#: least sigma from a lot, relative to a parameter's wide prior, which keeps matrices invertible
LEAST = 1e-6


def prior_of(lot: Lot, start: np.ndarray) -> GaussianPrior:
    """Return the prior of the next session of a unit that belongs to the lot; start (12,): the centre of numbers unknown to the lot."""
    known = _known(lot)
    parts = (lot.spread, np.nan_to_num(lot.mean_sigma), np.nan_to_num(lot.repeatability))
    variance = sum(each[:PARAMETERS] ** 2 for each in parts) + (LEAST * PRIOR_SIGMA) ** 2
    return GaussianPrior(np.where(known, lot.mean[:PARAMETERS], start), np.diag(np.where(known, variance, PRIOR_SIGMA**2)), known)


def _known(lot: Lot) -> np.ndarray:
    """Return (12,): the gyroscope's numbers that the lot has."""
    return np.isfinite(lot.mean + lot.spread)[:PARAMETERS]


def _require_usable(lot: Lot, sensor: str, where: str) -> None:
    """Raise CalibrationError, in one line, where a lot contains nothing on a session's sensor."""
    if lot.sensor != sensor:
        raise CalibrationError(f"{where}: a lot of {lot.sensor}, and the session's sensor is {sensor}; give the lot of its own model")
    if lot.units < FEWEST_UNITS:
        raise CalibrationError(
            f"{where}: a lot of {lot.units} units, expected at least {FEWEST_UNITS} for a prior; add sessions of more units"
        )
    if not _known(lot).any():
        raise CalibrationError(
            f"{where}: has none of the gyroscope's {PARAMETERS} numbers; estimate the lot from sessions that were fitted"
        )


def _belonging(prior: GaussianPrior, moved: np.ndarray, noise: np.ndarray, kept: np.ndarray) -> tuple[float, float, int, float]:
    """Test whether a unit belongs, from the shift of its fit with the lot's prior away from the lot's mean: what ``LotUse`` has of it.

    moved (12,): the fit's vector less the centre; noise (12, 12): covariance of the fit by the session's own noise; kept (12, 12): response
    of the fit to the unit's true distance from the centre, I less the prior's share.  Unobserved directions do not move.
    """
    root = np.linalg.cholesky(prior.covariance)
    to = np.linalg.inv(root)
    y, white = to @ moved, to @ noise @ to.T
    follows = to @ kept @ root
    inside = white + follows @ follows.T
    size, axes = np.linalg.eigh((inside + inside.T) / 2)
    seen = size > UNSEEN
    project = axes[:, seen] / np.sqrt(size[seen])  # a unit that belongs is unit normal here
    d = project.T @ y
    square, freedom = float(d @ d), int(seen.sum())
    if freedom == 0:
        return 1.0 - OFF_LOT, 0.0, 0, 1.0
    # a unit that does not belong: one number, or all, each from a normal this many times as wide
    shift = project.T @ to
    outside = []
    for scale in OFF_SCALES:
        more = scale**2 - 1
        whole = project.T @ follows
        outside.append((_log_normal(d, np.eye(freedom) + more * whole @ whole.T), 0.5))
        for k in np.flatnonzero(prior.known):
            alone = (shift @ kept[:, k]) * np.sqrt(prior.covariance[k, k])
            outside.append((_log_normal(d, np.eye(freedom) + more * np.outer(alone, alone)), 0.5 / prior.known.sum()))
    logs = np.array([log + np.log(share / len(OFF_SCALES)) for log, share in outside])
    log_out = float(np.logaddexp.reduce(logs))
    odds = np.log1p(-OFF_LOT) - square / 2 - np.log(OFF_LOT) - log_out
    probability = float(1 / (1 + np.exp(-np.clip(odds, -700, 700))))
    return probability, float(np.sqrt(square)), freedom, float(chdtrc(freedom, square))


def _log_normal(d: np.ndarray, covariance: np.ndarray) -> float:
    """Return the log density at d, less that of a unit normal at zero."""
    half = np.linalg.cholesky(covariance)
    return float(-np.sum(np.linalg.solve(half, d) ** 2) / 2 - np.log(np.diag(half)).sum())


def farthest(lot: Lot, vector: np.ndarray, covariance: np.ndarray, seen: np.ndarray) -> tuple[str, float] | None:
    """Return the parameter, of those observed (12,), that is farthest from the lot's mean, and its distance in sigmas of the lot.

    The fit is without the lot's prior; None where no parameter is observed.
    """
    sigma = lot.spread[:PARAMETERS]
    off = vector - lot.mean[:PARAMETERS]
    both = np.abs(off) / np.sqrt(sigma**2 + np.diag(covariance))
    both[~(seen & np.isfinite(both))] = -1.0
    worst = int(np.argmax(both))
    return None if both[worst] < 0 else (NAMES[worst], float(off[worst] / max(sigma[worst], LEAST * PRIOR_SIGMA[worst])))


# Least squares with a lot as prior: the probability that the unit belongs, and the lot's share in the fit (docs/features/fleet/lots.md).

#: probability of belonging from which a unit is reported as belonging, and up to which the lot's prior is not used
#: (benchmarks/lot_prior.py: coverage). Between SURE and FOREIGN the result is the mean of both, with the mixture's covariance; with turns
#: too few to determine the unit alone, between BELONGS and FOREIGN
BELONGS, FOREIGN, SURE = 0.95, 0.05, 0.9999
#: least share of the lot in a parameter that is reported
NAMED_SHARE = 0.05
MOST_NAMED = 6


@dataclass(frozen=True, eq=False)
class LotUse:
    """Use of a lot in a fit.

    file and hash of it; units it was made of; probability that this one belongs to it; distance from its mean, in sigmas of lot and session
    together; freedom: number of directions that the session observes; p_value of so large a distance in a unit that belongs; used: ``yes``,
    ``no``, or ``partly`` where belonging is undecided; share (12,) of the lot's mean in each parameter; off: the parameter that is farthest
    from the lot, and by how many of its sigmas; more (12, 12): covariance added by the prior, or by the undecided belonging.
    """

    file: str
    hash: str
    units: int
    probability: float
    distance: float
    freedom: int
    p_value: float
    used: str
    share: np.ndarray
    more: np.ndarray
    off: tuple[str, float] | None = None
    #: what ``more`` is called among the sources of the uncertainty
    source: str = "prior of the lot"

    def of_model(self) -> dict:
        """Return its part of the model's file."""
        return {"lot": {key: self.to_json()["lot"][key] for key in ("file", "hash", "used", "belongs_probability")}}

    def to_json(self) -> dict:
        """Return ``lot`` of ``tinygc-fit/2``."""
        table = {
            "file": self.file,
            "hash": self.hash,
            "units": self.units,
            "used": self.used,
            "belongs_probability": self.probability,
            "distance": self.distance,
            "freedom": self.freedom,
            "p_value": self.p_value,
            "off": None if self.off is None else {"parameter": self.off[0], "sigmas": self.off[1]},
            "share": self.share.tolist(),
        }
        return {"lot": table}

    @property
    def words(self) -> str:
        """Return one line of text."""
        far = f"{self.distance:.1f} sigmas from its mean in {self.freedom} directions, {probability(self.p_value)}"
        off = "" if self.off is None else f"{self.off[0]} is {self.off[1]:+.1f} sigmas off"
        if self.used == "no":
            return f"The unit does not belong to the lot of {self.file} ({far}): {off}; its prior is not used."
        if self.used == "partly":
            sure = f"probability {self.probability:.2f}"
            return f"Undecided whether the unit belongs to the lot of {self.file} ({sure}; {far}): {off}; the sigmas cover both."
        shares = [(share, name) for share, name in zip(self.share, NAMES, strict=True) if share >= NAMED_SHARE]
        largest = ", ".join(f"{name} {share:.0%}" for share, name in sorted(shares, reverse=True)[:MOST_NAMED])
        came = f"the lot gave: {largest}" if largest else f"the lot gave less than {NAMED_SHARE:.0%} of each"
        return f"The unit belongs to the lot of {self.file}, {self.units} units ({far}); {came}."


@dataclass(frozen=True, eq=False)
class LotFile:
    """A lot as prior of one unit, with its file's name and hash."""

    #: where none are given; of the fitted methods, only least squares uses the prior
    methods = ("raw", "raw_bias_removed", "least_squares")

    lot: Lot
    file: str
    hash: str

    def prior(self, start: np.ndarray) -> GaussianPrior:
        """Return the prior of a unit that belongs to the lot; start (12,): the centre of numbers unknown to the lot."""
        return prior_of(self.lot, start)

    @property
    def spread(self) -> Spread:
        """How far the 21 numbers of a unit of the lot move between its sessions, as far as the lot shows it."""
        lot = self.lot
        words = f"{lot.sessions} sessions of {lot.units} units of a lot"
        repeats = np.r_[lot.repeatability[PARAMETERS:], lot.repeatability[:PARAMETERS]]
        return Spread.of(slice(None), repeats, words, max(1, lot.sessions - lot.units))

    def fit(self, problem: Problem, options: FitOptions, noise: StatedNoise | None) -> tuple[BiasChoice, Problem, MethodFit, LotUse]:
        """Return the choice of the bias, the problem with it and with the prior used, its least squares, and the use of the lot.

        Raises the errors of ``choose``.
        """
        lot, still = self.lot, problem.still_rates.rate
        start = bias_only(still[0] if len(still) else -problem.first.B).vector
        prior = prior_of(lot, start).weighed(_noise_factor(problem, noise))
        bias_from, level, linear = choose(problem.changed(prior=prior), options)
        share = prior_share(level, linear.linear)
        inside = _noise_covariance(level, linear, noise)
        found = _belonging(prior, linear.linear.vector - prior.centre, inside, np.eye(PARAMETERS) - share)
        few = len(problem.batch) < FEWEST_SEGMENTS
        p, use = found[0], partial(LotUse, self.file, self.hash, lot.units, *found)
        if p >= (BELONGS if few else SURE):
            more = share @ prior.covariance @ share.T
            return bias_from, level, linear, use("yes", np.clip(np.diag(share), 0, 1), more)
        # with few turns the unit's own numbers are hardly determined, and the report states so
        own_prior = vague(start).weighed(prior.weight) if few else None
        free = level.changed(prior=own_prior)
        alone = run_method("least_squares", free, options)
        covariance = _noise_covariance(free, alone, noise)
        more = np.zeros((PARAMETERS, PARAMETERS))
        if own_prior is not None:
            free_share = prior_share(free, alone.linear)
            more = free_share @ own_prior.covariance @ free_share.T
            covariance = covariance + more
        unseen = alone.notes.get("unobserved", ())
        off = farthest(lot, alone.linear.vector, covariance, np.array([name not in unseen for name in NAMES]))
        if p <= FOREIGN:
            bias_from, level, linear = choose(problem.changed(prior=own_prior), options)
            return bias_from, level, linear, use("no", np.zeros(PARAMETERS), more, off)
        # undecided: the mean of both, weighted by their probabilities, with the covariance of the mixture
        own = linear.linear.vector
        apart = own - alone.linear.vector
        vector = own - (1 - p) * apart
        mixed = LinearModel.from_vector(vector)
        whole = p * (inside + share @ prior.covariance @ share.T) + (1 - p) * covariance + p * (1 - p) * np.outer(apart, apart)
        linear = replace(linear, model=mixed, angles=closure_angles(level.batch, mixed))
        used, off = ("yes", None) if p >= BELONGS else ("partly", off)
        return bias_from, level, linear, use(used, np.clip(p * np.diag(share), 0, 1), whole - inside, off)


def lot_for(path: Path, sensor: str) -> LotFile:
    """Read the lot for units with this sensor.  Raises the errors of ``read_lot`` and ``_require_usable``."""
    lot = read_lot(path)
    _require_usable(lot, sensor, file_key(path))
    return LotFile(lot, file_key(path), sha256_of(path))


def _noise_covariance(level: Problem, linear: MethodFit, noise: StatedNoise | None) -> np.ndarray:
    """Return (12, 12) by the session's own noise, widened."""
    model = linear.linear
    if noise is None:
        wide = goodness(level.batch, level.floor, model, level.wander).excess
        parts = covariance_parts(level.batch, level.floor, model, level.earth, level.wander, level.prior)
        return wide * np.sum([*parts.values()], axis=0)
    wide = stated_goodness(level, model, noise)[1]
    return wide * stated_covariance(level, model, noise)[0]


def _noise_factor(problem: Problem, noise: StatedNoise | None) -> float:
    """Return the ratio of the noise's variance to the floor that the fit weights its segments by."""
    if noise is None:
        return goodness(problem.batch, problem.floor, problem.first, problem.wander).excess
    wide = stated_goodness(problem, problem.first, noise)[1]
    return float(max(1.0, wide * (noise.tilt_rms / problem.floor.tilt_rms) ** 2))
