"""Detection limits: the smallest law that this search would find here, from laws injected into simulated noise of this recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import PLAUSIBLE_RPS
from tinygc.features.discovery.projections import Projection, basis_of, promise, seen_directions
from tinygc.features.discovery.quantities import QUANTITIES
from tinygc.features.discovery.responses import Responses, planned
from tinygc.features.discovery.screening import Screening, passed
from tinygc.noise.whitening import Whitener

#: draws of noise that a law is injected into, and the share in which it must be found: nineteen of twenty, known to 3 %
DRAWS, SURE = 64, 0.95
#: squared correlation with the law's rate from which a form counts as having found it: correlation 0.99
SAID = 0.98
#: forms considered in a law's place: the best by promise or of the same quantities; and the best approximations of a plain law
NEAR_LAW, NEAR_PROBE = 300, 40
#: chi-square of a plain law at which its rivals are selected
RIVALS_AT = 60.0
#: range of factors on a law's size that is searched, either way, and bisections: to 2 %
MOST_FACTOR, HALVINGS = 64.0, 9
#: rad/s rms: smaller laws are not considered (a tenth of a degree an hour)
LEAST_RPS = 5e-7


class _Form(NamedTuple):
    """basis (m, r) of a form in a projection, its price, and own: whether it is the law itself."""

    basis: np.ndarray
    price: float
    own: bool


def learnable_from(screening: Screening, form: LawForm, theta: np.ndarray, chance: float, whiten: Whitener | None = None) -> float | None:
    """Factor on a law's size, theta (P,) in rad/s, from which this search would find it in 95 % of all cases; None: not at any.

    A law is found where the best of all forms is the law, or correlates with its added rate to 0.99, and noise alone does as well in no
    more than the share ``chance`` of searches.  Linear, in the last projection; whiten: the noise estimated with the law in the fit, as
    otherwise it absorbs the law.  The form has the price of those screened forms that differ from it by constants alone.
    """
    responses, projection = screening.all_responses, screening.all_projections[-1]
    projection = projection if whiten is None else projection.with_noise(whiten)
    basis = basis_of(form, responses, projection)
    if not basis.shape[1]:
        return None
    response = responses.columns(form) @ theta
    # Numbers of the cheapest forms of the same quantities
    quantities = {factor.quantity for factor in form.factors}
    kin = [number for number, other in enumerate(screening.forms) if {factor.quantity for factor in other.factors} <= quantities]
    near = np.union1d(screening.order[:NEAR_LAW], np.array(sorted(kin, key=lambda number: screening.price[number])[:NEAR_LAW], dtype=int))
    forms = [_Form(basis, screening.price_of(form), own=True), *_forms(screening, near, responses, projection).values()]
    found = _trial(screening, projection, projection.whitened(response), projection.seen(response), forms, 0, chance)
    return _threshold(found, 1 / MOST_FACTOR, MOST_FACTOR)


def learnable(screening: Screening, chance: float, least: float = 0.0) -> dict[str, float | None]:
    """Detection limit of a plain law of each quantity, rad/s rms of its rate after a calibration; None: at no plausible size, or the
    quantity is missing.  From there the law is found in 95 % of all cases (as ``learnable_from``) and gains at least ``least`` chi-square.
    The law is the most visible function of the quantity, the same for each axis (``probes``)."""
    found: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    responses, projection = screening.responses, screening.projections[-1]
    near = [_rivals(screening, number) for number in range(len(screening.probes))]
    if not near:
        return found
    forms = _forms(screening, np.unique(np.concatenate(near)), responses, projection)
    for number, (probe, own) in enumerate(zip(screening.probes, near, strict=True)):
        some = [forms[rival] for rival in own.tolist() if rival in forms]
        is_found = _trial(screening, projection, probe.whitened, probe.unit, some, 1 + number, chance, least)
        factor = _threshold(is_found, LEAST_RPS / probe.rms, PLAUSIBLE_RPS / probe.rms)
        found[probe.quantity] = None if factor is None else factor * probe.rms
    return found


def _rivals(screening: Screening, probe: int) -> np.ndarray:
    """Numbers of the forms with the largest promise for a noise-free plain law, itself among them."""
    rank = screening.rank[-1]
    expected = promise(RIVALS_AT * screening.shares[:, probe].astype(float) + rank, rank, screening.price)
    expected[rank == 0] = -np.inf
    return np.argsort(-expected, kind="stable")[:NEAR_PROBE]


def _forms(screening: Screening, numbers: np.ndarray, responses: Responses, projection: Projection) -> dict[int, _Form]:
    """Bases and prices of the numbered forms."""
    found = {}
    for some in passed(planned([screening.forms[number] for number in numbers]), responses, [projection], [np.zeros((projection.free, 0))]):
        weights, rank, _ = seen_directions(some.free, some.length)
        for form, basis, r in zip(numbers[some.forms].tolist(), weights @ some.free, rank.tolist(), strict=True):
            found[form] = _Form(basis[:r].T, float(screening.price[form]), own=False)
    return found


def _trial(
    screening: Screening,
    projection: Projection,
    whitened: np.ndarray,
    free: np.ndarray,
    forms: Sequence[_Form],
    number: int,
    chance: float,
    least: float = 0.0,
) -> Callable[[float], bool]:
    """Whether a law is found in ``SURE`` of the draws at so many times its size, by its response, whitened (n,) and free (m,), among forms;
    the same noise draws are used for every size."""
    generator, level = np.random.default_rng([screening.seed, number]), max(screening.chance.level(chance), 0.0)
    law, noise = projection.beside(whitened), projection.beside(generator.standard_normal((len(whitened), DRAWS)))
    # The promise of all other forms in noise alone.
    others = generator.choice(screening.drawn, DRAWS)
    rank, prices = np.array([each.basis.shape[1] for each in forms]), np.array([each.price for each in forms])
    starts = np.concatenate([[0], np.cumsum(rank)[:-1]]).astype(int)
    bases = np.concatenate([each.basis for each in forms], axis=1)
    along_law, along_noise = bases.T @ free, bases.T @ projection.free_of(noise)
    said = np.add.reduceat(along_law**2, starts) / float(free @ free)
    says = (said > SAID) | np.array([each.own for each in forms])

    def found(factor: float) -> bool:
        gains = np.add.reduceat((factor * along_law[:, None] + along_noise) ** 2, starts, axis=0)
        scatter = projection.scatters(factor * law[:, None] + noise)
        tested = promise(projection.studentised(gains, rank, scatter), rank, prices)
        best = np.argmax(tested, axis=0)
        ahead = tested[best, np.arange(DRAWS)] > np.maximum(others, level)
        enough = gains[best, np.arange(DRAWS)] >= least
        return bool(np.mean(says[best] & ahead & enough) >= SURE)

    return found


def _threshold(found: Callable[[float], bool], least: float, most: float) -> float | None:
    """The smallest factor that is found, by bisection of its logarithm; None where even the largest is not."""
    if not found(most):
        return None
    low, high = np.log(least), np.log(most)
    for _ in range(HALVINGS + int(np.log2(max((high - low) / np.log(MOST_FACTOR**2), 1.0)))):
        middle = (low + high) / 2
        low, high = (low, middle) if found(float(np.exp(middle))) else (middle, high)
    return float(np.exp(high))
