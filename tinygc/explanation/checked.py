"""Check the effects that one recording shows on another recording, with the numbers of the first (docs/explain.md).

Held-out turns of one session share its drift, its temperature and its reference.  Another session does not.  So every named effect is taken
there with its size and sigma: the other recording is predicted, and nothing of the effect is fitted to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc, logsumexp

from session.base.errors import DataError
from session.log.folder import Session, hash_of_log
from tinygc.effects import AppliedEffect, Effect
from tinygc.explanation.claims import Claim, readable
from tinygc.explanation.evidence import Evidence, Hypothesis
from tinygc.explanation.search import NAMELESS
from tinygc.inference.choose import LEVEL, ONE_SIDED, Standing
from tinygc.noise.twin import claim_slice

#: 2 ln of the odds that decide: 20 to 1, "strong" (Kass & Raftery 1995), which even odds turn into the 95 % of ``standing``
STRONG = 2 * float(np.log(20))
#: probability of such odds below which the other recording could not have decided, and their draws (known to 1.6 %)
LEAST_POWER, DRAWS = 0.5, 1000
#: headings tried for an Earth's rate, whose direction depends on how the table stood: a twelfth of its horizontal part apart
HEADINGS = 72


#: outcome of ``KINDS`` -> standing of the effect; of others it is undecided
STANDINGS = {"confirmed": Standing.FOR, "another size": Standing.FOR, "contradicted": Standing.AGAINST}


@dataclass(frozen=True, eq=False)
class CheckedEffect:
    """A named effect in another recording.

    odds: 2 ln of the odds of the named size against none; same_p: of the test that both sizes are one; power: probability of odds that
    decide if the effect is there as named; there: the effect's own estimate in that recording, None where it cannot be estimated.
    size, its share of the named size, with sigma; closure_rad: held-out rms there without the effect and with the named numbers.
    """

    named: Claim
    outcome: str
    odds: float = 0.0
    same_p: float = 1.0
    power: float = 0.0
    there: Claim | None = None
    size: tuple[float, float] = (np.nan, np.nan)
    closure_rad: tuple[float, float] | None = None

    @property
    def standing(self) -> Standing:
        """Standing of the effect by this recording."""
        return STANDINGS.get(self.outcome, Standing.UNDECIDED)

    @property
    def other_size(self) -> bool:
        """Whether the effect is there, but not at the named size."""
        return self.outcome in ("confirmed", "another size") and self.same_p < LEVEL


@dataclass(frozen=True, eq=False)
class Checked:
    """A recording on which the effects of another were checked; same_unit: whether both name the same serial number, None if one names
    none; error: why nothing could be checked there, or ``""``."""

    session: Session
    same_unit: bool | None
    effects: list[CheckedEffect] = field(default_factory=list)
    error: str = ""


# What a recording names, with numbers.


def named_in(e: Any) -> list[Claim]:
    """Return the claimed effects, strongest first, without shapes that have no name."""
    named = [claim for claim in e.claimed if not claim.effect.id.startswith(NAMELESS)]
    known = {
        claim.effect.id: dict(zip(("theta", "covariance"), found, strict=True))
        for claim in named
        if (found := e.measured.get(claim.effect.id))
    }
    return [replace(claim, **known.get(claim.effect.id, {})) for claim in named]


def _of_recording(effect: Effect) -> bool:
    """Whether an effect belongs to one recording: a course of time, the motion, moments, or readings at a limit."""
    return "time" in effect.inputs or effect.kind == "motion" or effect.occurs is not None


def of_unit(effect: Effect) -> bool:
    """Whether an effect belongs to one device, and not to what devices share: the Earth and the reference."""
    return effect.kind not in ("earth", "reference")


# The check: the other recording is predicted with the named numbers.


def check_on(first: Any, other: Any, seed: int = 0) -> Checked:
    """Check the effects named in one recording on another, which was explained by itself; seed: of the draws behind the power.

    Raises DataError if both hold the same log: no recording confirms itself.
    """
    if {hash_of_log(log) for log in first.session.logs} & {hash_of_log(log) for log in other.session.logs}:
        raise DataError(f"{other.session.name}: holds a log of {first.session.name} itself, which confirms nothing; give another recording")
    serials = [e.session.config.sensor.serial for e in (first, other)]
    checked = Checked(other.session, serials[0] == serials[1] if all(serials) else None)
    evidence: Evidence | None = None
    for named in named_in(first):
        if _of_recording(named.effect):
            checked.effects.append(CheckedEffect(named, "of one recording", there=_same_name(other, named.effect)))
        elif not named.covariance.size:
            checked.effects.append(CheckedEffect(named, "no numbers"))
        elif checked.same_unit is False and of_unit(named.effect):
            checked.effects.append(CheckedEffect(named, "of one unit", there=_same_name(other, named.effect)))
        elif named.effect.id in first.measured | other.measured:
            measured = other.measured.get(named.effect.id)
            there = None if measured is None else replace(named, theta=measured[0], covariance=measured[1])
            checked.effects.append(CheckedEffect(named, "no power") if there is None else _weighed_by(named, there, seed))
        else:
            evidence = evidence or Evidence(other.twin)
            checked.effects.append(predicted(named, other, evidence, seed))
    return checked


def _same_name(other: Any, effect: Effect) -> Claim | None:
    """The effect with the same id that the other recording names by itself."""
    return next((n for n in named_in(other) if n.effect.id == effect.id and n.covariance.size), None)


def _weighed_by(named: Claim, there: Claim, seed: int, odds: float | None = None) -> CheckedEffect:
    """Decide by the two estimates; odds: 2 ln, where they are known better than from them."""
    if odds is None:
        odds = float(_odds_of(there.theta, named, there.covariance)[0])
    together = named.covariance + there.covariance
    apart = named.theta - there.theta
    same_p = float(chdtrc(len(apart), apart @ np.linalg.solve(together, apart)))
    drawn = np.random.default_rng(seed).standard_normal((DRAWS, len(apart))) @ np.linalg.cholesky(together).T + named.theta
    power = float(np.mean(_odds_of(drawn, named, there.covariance) >= STRONG))
    size = size_of(named, there)
    if odds >= STRONG:
        outcome = "confirmed"
    elif same_p < LEVEL and size[0] > ONE_SIDED * size[1]:
        outcome = "another size"
    elif odds <= -STRONG and same_p < LEVEL:
        outcome = "contradicted"
    else:
        outcome = "not confirmed" if power >= LEAST_POWER else "no power"
    return CheckedEffect(named, outcome, odds, same_p, power, there, size)


def _odds_of(estimates: np.ndarray, named: Claim, covariance: np.ndarray) -> np.ndarray:
    """2 ln of the odds, (K,), that estimates (K, P) with a covariance (P, P) give the named size, as uncertain as it is, against zero."""
    estimates = np.atleast_2d(estimates)
    found = np.zeros(len(estimates))
    for sign, mean, spread in ((1, np.zeros_like(named.theta), covariance), (-1, named.theta, covariance + named.covariance)):
        apart = estimates - mean
        found += sign * (np.einsum("ki,ki->k", apart, np.linalg.solve(spread, apart.T).T) + np.linalg.slogdet(spread)[1])
    return found


def size_of(named: Claim, there: Claim) -> tuple[float, float]:
    """Share of the named size that the other estimate has along it, and its sigma."""
    weight = np.linalg.solve(named.covariance + there.covariance, named.theta)
    length = float(weight @ named.theta)
    return (float(weight @ there.theta) / length, float(np.sqrt(1 / length))) if length > 0 else (np.nan, np.nan)


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Residuals of a hypothesis as linear columns: r (n,) without the effect, J (n, p) of all else in units of its priors, own (n, P) of
    the effect, all stacked; estimate of the effect; score of the other effects alone, less the part of the residuals."""

    hypothesis: Hypothesis
    r: np.ndarray
    J: np.ndarray
    own: np.ndarray
    estimate: Claim
    price: float

    def value(self, theta: np.ndarray | None = None, covariance: np.ndarray | None = None) -> float:
        """-2 log evidence, the noise estimated again: without the effect, or with it at theta (P,), as uncertain as its covariance."""
        r, J, noise = self.r, self.J, self.hypothesis.noise
        if theta is not None and covariance is not None:
            size, axes = np.linalg.eigh(covariance)
            r, J = r + self.own @ theta, np.concatenate([J, self.own @ (axes * np.sqrt(np.maximum(size, 0)))], axis=1)
        white = self.hypothesis.whiten(J)
        moved = np.linalg.solve(white.T @ white + np.eye(J.shape[1]), white.T @ self.hypothesis.whiten(r))
        return noise.estimated(self.hypothesis.whiten.base, r - J @ moved, J, noise.s).value + self.price


def _prediction(evidence: Evidence, others: tuple[Effect, ...], named: Claim, begin: Hypothesis) -> _Prediction:
    # The effect keeps the shape that was named: without a scan it is not fitted again.
    effect = named.effect if named.effect.scan is None else replace(named.effect, scan=None)
    found = evidence.of((*others, effect), begin)
    fit, number = found.fit, len(others)
    part = claim_slice(fit.state.claims, number)
    J = found.whiten.back(fit.J)
    estimate = replace(named, theta=fit.state.claims[number].theta, covariance=fit.theta_covariance(number))
    r = found.whiten.back(fit.r) - J[:, part] @ estimate.theta
    rest = np.delete(J * evidence.prior(fit), part, axis=1)
    return _Prediction(found, r, rest, J[:, part], estimate, sum(evidence.price(other) for other in others))


def predicted(named: Claim, other: Any, evidence: Evidence, seed: int) -> CheckedEffect:
    """Predict the other recording with the named numbers, together with what it shows by itself.

    What it names in place of the effect, and shapes without a name, may stand for the effect there: the odds are those of the better of
    two hypotheses, with these and without.
    """
    own = tuple(claim.effect for claim in other.fit.state.claims if claim.effect.id != named.effect.id)
    fewer = tuple(e for e in own if e.id not in named.lookalikes and not e.id.startswith(NAMELESS))
    begin = evidence.of(own, evidence.nothing)
    hypotheses = [_prediction(evidence, others, named, begin) for others in dict.fromkeys((own, fewer))]
    nothing = min(each.value() for each in hypotheses)
    turned = headings(named) if named.effect.kind == "earth" else [named]
    tried = []
    for prediction in hypotheses:
        odds = np.array([float(_odds_of(prediction.estimate.theta, each, prediction.estimate.covariance)[0]) for each in turned])
        best = int(np.argmax(odds))
        value = prediction.value(turned[best].theta, turned[best].covariance)
        # Over all headings, each as probable as the others.
        value -= 2 * float(logsumexp((odds - odds[best]) / 2) - np.log(len(odds)))
        tried.append((value, prediction, turned[best]))
    value, prediction, best_named = min(tried, key=lambda each: each[0])
    there = _weighed_by(best_named, prediction.estimate, seed, nothing - value)
    before, after = (_closure(other, prediction, theta) for theta in (np.zeros_like(best_named.theta), best_named.theta))
    return replace(there, named=named, closure_rad=None if before is None or after is None else (before, after))


def headings(named: Claim) -> list[Claim]:
    """The Earth's rate with the table turned to each heading."""
    found = []
    for angle in np.arange(HEADINGS) * 2 * np.pi / HEADINGS:
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        found.append(replace(named, theta=turn @ named.theta, covariance=turn @ named.covariance @ turn.T))
    return found


def _closure(other: Any, prediction: _Prediction, theta: np.ndarray) -> float | None:
    """Held-out closure rms, rad, that ``fit`` states of the other recording without the effect at theta (P,), which nothing there gave, and
    without the other effects; None where it does not settle."""
    state = prediction.hypothesis.fit.state
    found: float | None = other.closure_without(replace(state, claims=(*state.claims[:-1], replace(state.claims[-1], theta=theta))))
    return found


# Outcome over several recordings.

#: outcomes of a prediction, and where nothing was predicted
TESTED = ("contradicted", "confirmed", "another size", "not confirmed", "no power")
UNTESTED = ("no numbers", "of one unit", "of one recording")
#: all of them, the one that counts most first
OUTCOMES = TESTED + UNTESTED


def outcome_of(there: Sequence[CheckedEffect]) -> str:
    """Outcome of one effect over several recordings: a contradiction anywhere, else a confirmation, else the best that is left."""
    return min((each.outcome for each in there), key=OUTCOMES.index)


def numbers_of(named: Claim) -> tuple[dict, dict]:
    """Parameters of an effect by their JSON names, and their std."""
    _, parameters, std = readable(AppliedEffect(named.effect, named.theta), named.covariance)
    return parameters, std


def checked_to_json(checked: Sequence[Checked]) -> list[dict]:
    """Return ``checked`` of ``tinygc-explain/2``."""
    return [
        {
            "session": each.session.name,
            "same_unit": each.same_unit,
            "error": each.error or None,
            "effects": [_entry(there) for there in each.effects],
        }
        for each in checked
    ]


def _entry(there: CheckedEffect) -> dict:
    estimate = None if there.there is None else dict(zip(("parameters", "std"), numbers_of(there.there), strict=True))
    closure = None if there.closure_rad is None else dict(zip(("before", "after"), np.degrees(there.closure_rad).tolist(), strict=True))
    tested = there.outcome in TESTED and there.there is not None
    share, sigma = there.size
    return {
        "id": there.named.effect.id,
        "outcome": there.outcome.replace(" ", "_"),
        "standing": there.standing.value,
        "log_odds": there.odds / 2 if tested else None,
        "same_size_p": there.same_p if tested else None,
        "power": there.power if tested else None,
        "size_share": {"value": share, "std": sigma} if np.isfinite([share, sigma]).all() else None,
        "there": estimate,
        "closure_rms_deg": closure,
    }
