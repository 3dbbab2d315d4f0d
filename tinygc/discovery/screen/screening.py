"""All forms by their linear columns beside each look, and what chance makes of so many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.chance import Chance
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.plan import Plan, Wiring, planned
from tinygc.discovery.screen.responses import Block, Responses
from tinygc.explanation.naming.evidence import PRIOR_ODDS, SCALES
from tinygc.explanation.naming.selection import UNSEEN
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.whitening import Whitener

#: draws of noise alone: a level of 5 % is then known to 1.5 % (binomial)
DRAWS = 200
#: bytes of partners' values at once, and products of components that are seen through a look at once (benchmarks/discover_speed.py)
TILE_BYTES, TOGETHER = 1 << 26, 1536
#: draws whose gains are kept of each form: what tells forms apart that are none
MARKS = 48

Progress = Callable[[str, int, int], None]


def price(bits: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Twice the logarithm of what forms cost before they are looked at, as ``evidence.price``: bits (F,), sizes (F,) coefficients."""
    return 2 * (np.log(2) * bits + np.log(SCALES / PRIOR_ODDS)) + sizes


def promise(gain: np.ndarray, rank: np.ndarray, price: np.ndarray) -> np.ndarray:
    """Twice the logarithm of the evidence that forms would add, as ``search.promises``; gain (F,) or (F, D)."""
    rank, price = (each.reshape(-1, *(1,) * (gain.ndim - 1)) for each in (np.maximum(rank, 1), price))
    return gain - rank * np.log(np.maximum(gain / rank, 1.0)) - price


@dataclass(frozen=True, eq=False)
class Screening:
    """forms (F), bits (F,), sizes (F,) coefficients; of every look (L, F): gain in chi-square, promise, rank: directions that are seen, and
    left: the share of the columns' length, squared, that the nuisance leaves; marks (F, MARKS): gains in noise alone beside the last look;
    tested (F,): promise, studentised, of the look that shows most; chance: the largest of these in noise alone."""

    forms: Sequence[Form]
    bits: np.ndarray
    sizes: np.ndarray
    gain: np.ndarray
    promise: np.ndarray
    rank: np.ndarray
    left: np.ndarray
    tested: np.ndarray
    marks: np.ndarray
    chance: Chance
    responses: Responses
    looks: tuple[Look, ...]
    noise: np.ndarray

    @property
    def order(self) -> np.ndarray:
        """(F,) numbers of the forms, the most promising first; each by the look that shows most."""
        return np.argsort(-self.promise.max(axis=0), kind="stable")

    def chance_p(self, promise: float) -> float:
        """Probability that noise alone gives the best of all forms a studentised promise like this."""
        return self.chance.p(promise)


def screened(
    replay: Replay,
    forms: Sequence[Form],
    bits: np.ndarray,
    looks: Sequence[tuple[Whitener, Refit]],
    seed: int,
    draws: int = DRAWS,
    progress: Progress = lambda what, done, of: None,
) -> Screening:
    """Every form beside each look (whiten, fit); they share the signals of one replay.  bits (F,) of each form among all."""
    plan, responses = planned(forms), Responses(replay)
    seen = tuple(Look(replay.twin, whiten, fit) for whiten, fit in looks)
    noise = np.random.default_rng(seed).standard_normal((responses.channels, draws))
    bits = np.asarray(bits, dtype=float)
    work = _Work(plan, price(bits, plan.sizes), seen, noise)
    tiles = list(plan.tiles(max(TILE_BYTES // (4 * responses.values.samples), 1)))
    done = 0
    for tile in tiles:
        for hub, partners, block, largest in _blocks(plan, responses, tile):
            done += work.add(hub, partners, block, largest)
            progress("screening forms", done, len(forms))
    drawn = work.best.max(axis=0)
    return Screening(
        forms, bits, plan.sizes, work.gain, work.promise, work.rank, work.left, work.tested.max(axis=0), work.marks, Chance(drawn),
        responses, seen, noise,
    )  # fmt: skip


def _blocks(plan: Plan, responses: Responses, tile: np.ndarray):
    """(hub, partners, block, largest sizes) of all pairs that forms ask for with partners of this tile."""
    parts = [responses.values.single(plan.factors[partner]) for partner in tile]
    values = np.concatenate([part for part, _ in parts])
    largest = np.array([size for _, size in parts])
    ends = np.cumsum(plan.width[tile])
    place = np.full(len(plan.factors), -1)
    place[tile] = np.arange(len(tile))
    own = place[plan.partner] >= 0
    for hub in np.unique(plan.hub[own]):
        wanted = np.unique(place[plan.partner[own & (plan.hub == hub)]])
        hub_values, hub_largest = responses.values.single(plan.factors[hub])
        for run in _runs(wanted, ends, plan.width[tile], TOGETHER // len(hub_values)):
            first, stop = ends[run[0]] - plan.width[tile[run[0]]], ends[run[-1]]
            inside = np.arange(run[0], run[-1] + 1)
            yield int(hub), tile[inside], responses.block(hub_values, values[first:stop]), hub_largest * largest[inside]


def _runs(wanted: np.ndarray, ends: np.ndarray, width: np.ndarray, most: int):
    """Neighbours among the wanted partners, so many components at once: those between two that are near are computed for nothing."""
    run: list[int] = []
    for number in wanted.tolist():
        if run and (ends[number] - ends[run[0]] + width[run[0]] > most or number - run[-1] > 3):
            yield run
            run = []
        run.append(number)
    yield run


class _Work:
    """What is gathered, block by block."""

    def __init__(self, plan: Plan, price: np.ndarray, looks: tuple[Look, ...], noise: np.ndarray):
        self.plan, self.price, self.looks = plan, price, looks
        shape = len(looks), len(price)
        self.gain, self.promise, self.tested, self.left = np.zeros(shape), np.full(shape, -np.inf), np.full(shape, -np.inf), np.zeros(shape)
        self.rank = np.zeros(shape, dtype=int)
        self.best = np.full((len(looks), noise.shape[1]), -np.inf)
        self.marks = np.zeros((len(price), min(MARKS, noise.shape[1])), dtype=np.float32)
        self._matrices = [look.matrix.astype(np.float32) for look in looks]
        self._scatter = [np.concatenate([[look.scatter], look.scatters(self._beside(look, noise))]) for look in looks]
        # One column for the recording, then one for each draw.
        self._targets = [np.concatenate([look.residual[:, None], look.free_of(noise)], axis=1).astype(np.float32) for look in looks]
        order = np.lexsort([plan.wiring, plan.partner, plan.hub])
        self._order, self._keys = order, plan.hub[order] * len(plan.factors) + plan.partner[order]

    @staticmethod
    def _beside(look: Look, noise: np.ndarray) -> np.ndarray:
        return noise - look.q @ (look.q.T @ noise)

    def add(self, hub: int, partners: np.ndarray, block: Block, largest: np.ndarray) -> int:
        """The forms of one hub with these partners; how many there were."""
        s, d, _, h, k = block.closure.shape
        begins = np.concatenate([[0], np.cumsum(self.plan.width[partners])])
        rows_of, forms_of = {}, {}
        count = 0
        for number, partner in enumerate(partners.tolist()):
            key = hub * len(self.plan.factors) + partner
            own = self._order[np.searchsorted(self._keys, key) : np.searchsorted(self._keys, key, side="right")]
            count += len(own)
            if not largest[number]:
                continue
            for form in own.tolist():
                wiring = self.plan.wirings[self.plan.wiring[form]]
                row = (wiring.axis * h + wiring.hub) * k + begins[number] + wiring.partner
                rows_of.setdefault(wiring.size, []).append(row)
                forms_of.setdefault(wiring.size, []).append(form)
        if not rows_of:
            return count
        rows = {size: np.array(each) for size, each in rows_of.items()}
        used = np.unique(np.concatenate([each.ravel() for each in rows.values()]))
        closure = [block.closure[:, :, axis].reshape(s * d, h * k) for axis in range(3)]
        still = block.still.reshape(len(block.still), h * k)
        for number, (matrix, targets) in enumerate(zip(self._matrices, self._targets, strict=True)):
            seen = _seen(matrix, closure, still, used)
            free = np.ascontiguousarray(seen[:, : len(targets)])
            length = np.linalg.norm(seen, axis=1)
            along = free @ targets
            for size, each in rows.items():
                at = np.searchsorted(used, each)
                self._weigh(number, np.array(forms_of[size]), free[at], length[at], along[at])
        return count

    def _weigh(self, look: int, forms: np.ndarray, free: np.ndarray, length: np.ndarray, along: np.ndarray) -> None:
        """forms (F,): their columns beside the nuisance (F, P, m), lengths with it (F, P), and along the targets (F, P, 1 + D)."""
        length = np.where(length > 0, length, 1.0).astype(float)
        unit = free / length[:, :, None]
        size, turn = np.linalg.eigh(unit @ unit.transpose(0, 2, 1))
        kept = size > UNSEEN**2
        scale = np.where(kept, 1 / np.sqrt(np.where(kept, size, 1.0)), 0.0)
        weights = (turn * scale[:, None, :] / length[:, :, None]).transpose(0, 2, 1)
        gains = np.sum((weights.astype(np.float32) @ along) ** 2, axis=1)
        rank = kept.sum(axis=1)
        self.rank[look, forms], self.gain[look, forms] = rank, gains[:, 0]
        self.left[look, forms] = np.sum(size * kept, axis=1) / size.shape[1]
        self.promise[look, forms] = np.where(rank > 0, promise(gains[:, 0].astype(float), rank, self.price[forms]), -np.inf)
        tested = promise(self.looks[look].studentised(gains, rank, self._scatter[look]), rank, self.price[forms])
        tested[rank == 0] = -np.inf
        self.tested[look, forms] = tested[:, 0]
        np.maximum(self.best[look], tested[:, 1:].max(axis=0), out=self.best[look])
        if look == len(self.looks) - 1:
            self.marks[forms] = gains[:, 1 : 1 + self.marks.shape[1]]


def _seen(matrix: np.ndarray, closure: list[np.ndarray], still: np.ndarray, used: np.ndarray) -> np.ndarray:
    """(U, n) products of components, ``axis * products + product``, as a look sees them."""
    turns, products = len(closure[0]), still.shape[1]
    found = np.empty((len(used), len(matrix)), dtype=np.float32)
    for axis in range(3):
        first, stop = np.searchsorted(used, [axis * products, (axis + 1) * products])
        own = used[first:stop] - axis * products
        np.matmul(closure[axis][:, own].T, matrix[:, :turns].T, out=found[first:stop])
        if len(still):
            rest = matrix[:, turns + axis : turns + 3 * len(still) : 3]
            found[first:stop] += still[:, own].T @ rest.T
    return found
