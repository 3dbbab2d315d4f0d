"""Detection limits: the smallest law that this search would find here, by the chi-square that each form takes up of it."""

from __future__ import annotations

import numpy as np

from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import PLAUSIBLE_RPS
from tinygc.features.discovery.projections import Projection, price_of, promise, seen_basis, seen_directions
from tinygc.features.discovery.quantities import QUANTITIES
from tinygc.features.discovery.responses import planned
from tinygc.features.discovery.screening import Screening, passed
from tinygc.inference.choose import ONE_SIDED
from tinygc.noise.whitening import Whitener

#: squared correlation with the law's rate from which a form counts as having found it: correlation 0.99
COVERED = 0.98
#: forms considered in a law's place: the best by promise, and the simplest of the same quantities
NEAR_LAW = 300
#: chi-square of a law at which its rivals are selected
RIVALS_AT = 60.0
#: range of factors on a law's size that is searched, either way; steps of it, of 2 % each
MOST_FACTOR, STEP = 64.0, 1.02
#: rad/s rms: smaller laws are not considered (a tenth of a degree an hour)
LEAST_RPS = 5e-7


def learnable_from(screening: Screening, form: LawForm, theta: np.ndarray, chance: float, whiten: Whitener | None = None) -> float | None:
    """Factor on a law's size, theta (P,) in rad/s, from which this search would find it in 95 % of all cases; None: not at any.

    Linear, in the last projection; whiten: the noise estimated with the law in the fit, as otherwise it absorbs the law.
    """
    responses, projection = screening.all_responses, screening.all_projections[-1]
    projection = projection if whiten is None else projection.with_noise(whiten)
    response, rank = responses.columns(form) @ theta, seen_basis(responses.columns(form), projection).shape[1]
    if not rank:
        return None
    quantities = {factor.quantity for factor in form.factors}
    kin = [number for number, other in enumerate(screening.forms) if {factor.quantity for factor in other.factors} <= quantities]
    near = np.union1d(screening.order[:NEAR_LAW], np.array(kin[:NEAR_LAW], dtype=int))
    free, found = projection.seen(response), [(float(np.sum(projection.seen(response) ** 2)), rank, price_of(form))]
    for some in passed(planned([screening.forms[number] for number in near]), responses, [projection], [free[:, None]]):
        weights, ranks, _ = seen_directions(some.free, some.length)
        gains = np.sum((weights @ some.along) ** 2, axis=(1, 2))
        found += zip(gains.tolist(), ranks.tolist(), screening.price[near[some.forms]].tolist(), strict=True)
    taken, ranks, prices = np.array(found).T
    return _least(screening, projection, projection.whitened(response), (taken, ranks, prices), chance, (1 / MOST_FACTOR, MOST_FACTOR))


def learnable(screening: Screening, chance: float, least: float = 0.0) -> dict[str, float | None]:
    """Detection limit of a plain law of each quantity, rad/s rms of its rate after a calibration; None: at no plausible size, or the
    quantity is missing.  From there the law is found in 95 % of all cases (as ``learnable_from``) and gains at least ``least`` chi-square.
    The law is the most visible function of the quantity, the same for each axis (``probes``)."""
    found: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    for number, probe in enumerate(screening.probes):
        forms, range_ = (
            (screening.shares[:, number], screening.rank[-1], screening.price),
            (LEAST_RPS / probe.rms, PLAUSIBLE_RPS / probe.rms),
        )
        factor = _least(screening, screening.projections[-1], probe.whitened, forms, chance, range_, least)
        found[probe.quantity] = None if factor is None else factor * probe.rms
    return found


def _least(
    screening: Screening,
    projection: Projection,
    whitened: np.ndarray,
    forms: tuple[np.ndarray, np.ndarray, np.ndarray],
    chance: float,
    factors: tuple[float, float],
    least: float = 0.0,
) -> float | None:
    """The smallest factor on a law's response (n,) at which it is found, of a range; None where there is none.

    forms: chi-square (F,) that each takes up of the response, rank, price.  A law is found where the most promising form is one that
    correlates with its rate to 0.99, noise alone does as well in no more than the share ``chance`` of searches, and it gains ``least``.  Of
    a gain, and of a lead in it over another form, the lower limit counts, which holds with 95 %: noise adds to a response of length l a
    normal variable of sigma 2 l.
    """
    size = np.exp(np.arange(np.log(factors[0]), np.log(factors[1]), np.log(STEP)))
    taken, rank, cost = (np.asarray(each, dtype=float)[np.asarray(forms[1]) > 0] for each in forms)
    whole = float(np.sum(projection.free_of(whitened) ** 2))
    near = np.argsort(-promise(RIVALS_AT * taken / whole + rank, rank, cost), kind="stable")[:NEAR_LAW]
    taken, rank, cost = taken[near], rank[near], cost[near]
    covers = taken > COVERED * whole
    if not covers.any():
        return None
    gain = np.maximum(np.sqrt(taken[covers])[:, None] * size - ONE_SIDED, 0.0) ** 2
    own = promise(gain + rank[covers][:, None] - 1, rank[covers], cost[covers])
    best, columns = np.argmax(own, axis=0), np.arange(len(size))
    lead = np.sqrt(np.maximum(taken[covers][best] - taken[~covers][:, None], 0.0)) * size
    others = np.maximum(gain[best, columns] - lead**2 + 2 * ONE_SIDED * lead, 0.0) + rank[~covers][:, None] - 1
    ahead = own[best, columns] > promise(others, rank[~covers], cost[~covers]).max(axis=0, initial=-np.inf)
    scatter = projection.freedom + size**2 * projection.scatters(projection.left_of(whitened))
    tested = promise(projection.studentised(gain, rank[covers], scatter), rank[covers], cost[covers])[best, columns]
    found = ahead & (tested > max(screening.chance.level(chance), 0.0)) & (gain[best, columns] >= least)
    lost = np.flatnonzero(~found)
    first = lost[-1] + 1 if len(lost) else 0
    return float(size[first]) if first < len(size) else None
