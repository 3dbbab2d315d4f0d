"""One pass over all forms: their columns as each look sees them, block by block, so that memory does not grow with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.plan import Plan
from tinygc.discovery.screen.responses import Block, Responses

#: bytes of partners' values at once, and products of components that are seen through a look at once (benchmarks/discover_speed.py)
TILE_BYTES, TOGETHER = 1 << 26, 1536
#: partners between two that are wanted, which are computed for nothing rather than apart (benchmarks/discover_speed.py)
GAP = 16

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Passed:
    """Some forms of one size P beside one look, single precision, each column of an arbitrary length: forms (F,), their numbers; free
    (F, P, m): columns beside the nuisance; length (F, P): with it; along (F, P, T): free times the look's targets."""

    look: int
    forms: np.ndarray
    free: np.ndarray
    length: np.ndarray
    along: np.ndarray


def passed(
    plan: Plan, responses: Responses, looks: Sequence[Look], targets: Sequence[np.ndarray], progress: Progress = lambda what, done, of: None
) -> Iterator[Passed]:
    """Every form that is not zero or no number throughout, beside each look; targets (m, T): of each look."""
    matrices = [look.matrix() for look in looks]
    goals = [each.astype(np.float32) for each in targets]
    order = np.lexsort([plan.wiring, plan.partner, plan.hub])
    keys = plan.hub[order] * len(plan.factors) + plan.partner[order]
    done = 0
    for tile in plan.tiles(max(TILE_BYTES // (4 * responses.values.samples), 1)):
        for hub, partners, block, alive in _blocks(plan, responses, tile):
            wanted = hub * len(plan.factors) + partners
            firsts, stops = np.searchsorted(keys, wanted), np.searchsorted(keys, wanted, side="right")
            forms_of, rows_of = _rows(plan, [order[a:b] for a, b in zip(firsts, stops, strict=True)], partners, block, alive)
            done += int(np.sum(stops - firsts))
            if rows_of:
                yield from _through(block, forms_of, rows_of, matrices, goals)
            progress("screening forms", done, len(keys))


def _blocks(plan: Plan, responses: Responses, tile: np.ndarray) -> Iterator[tuple[int, np.ndarray, Block, np.ndarray]]:
    """hub, partners of this tile (K,), their block, and whether it is other than zero (K,)."""
    parts = [responses.values.single(plan.factors[partner]) for partner in tile]
    values = np.concatenate([part for part, _ in parts])
    alive = np.array([size > 0 for _, size in parts])
    ends = np.cumsum(plan.width[tile])
    place = np.full(len(plan.factors), -1)
    place[tile] = np.arange(len(tile))
    own = place[plan.partner] >= 0
    for hub in np.unique(plan.hub[own]):
        wanted = np.unique(place[plan.partner[own & (plan.hub == hub)]])
        hub_values, hub_size = responses.values.single(plan.factors[hub])
        for run in _runs(wanted, ends, plan.width[tile], TOGETHER // len(hub_values)):
            first, stop = ends[run[0]] - plan.width[tile[run[0]]], ends[run[-1]]
            inside = slice(run[0], run[-1] + 1)
            yield int(hub), tile[inside], responses.block(hub_values, values[first:stop]), alive[inside] & (hub_size > 0)


def _runs(wanted: np.ndarray, ends: np.ndarray, width: np.ndarray, most: int) -> Iterator[list[int]]:
    """Neighbours among the wanted partners, so many components at once."""
    run: list[int] = []
    for number in wanted.tolist():
        if run and (ends[number] - ends[run[0]] + width[run[0]] > most or number - run[-1] > GAP):
            yield run
            run = []
        run.append(number)
    yield run


def _rows(
    plan: Plan, forms: list[np.ndarray], partners: np.ndarray, block: Block, alive: np.ndarray
) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """By size P: numbers (F,) of the forms of each partner, and where their columns (F, P) are among ``axis * products + product``."""
    _, _, _, h, k = block.closure.shape
    begins = np.concatenate([[0], np.cumsum(plan.width[partners])])
    numbers: dict[int, list[int]] = {}
    rows: dict[int, list[np.ndarray]] = {}
    for own, begin, is_alive in zip(forms, begins[:-1], alive, strict=True):
        for form in own.tolist() if is_alive else ():
            wiring = plan.wirings[plan.wiring[form]]
            numbers.setdefault(wiring.size, []).append(form)
            rows.setdefault(wiring.size, []).append((wiring.axis * h + wiring.hub) * k + begin + wiring.partner)
    return {size: np.array(each) for size, each in numbers.items()}, {size: np.array(each) for size, each in rows.items()}


def _through(
    block: Block, forms: dict[int, np.ndarray], rows: dict[int, np.ndarray], matrices: list[np.ndarray], targets: list[np.ndarray]
) -> Iterator[Passed]:
    s, d, _, h, k = block.closure.shape
    used = np.unique(np.concatenate([each.ravel() for each in rows.values()]))
    closure = [block.closure[:, :, axis].reshape(s * d, h * k) for axis in range(3)]
    still = block.still.reshape(len(block.still), h * k)
    for look, (matrix, goal) in enumerate(zip(matrices, targets, strict=True)):
        seen = _seen(matrix, closure, still, used)
        free = np.ascontiguousarray(seen[:, : len(goal)])
        length, along = np.linalg.norm(seen, axis=1), free @ goal
        for size, each in rows.items():
            at = np.searchsorted(used, each)
            yield Passed(look, forms[size], free[at], length[at], along[at])


def _seen(matrix: np.ndarray, closure: list[np.ndarray], still: np.ndarray, used: np.ndarray) -> np.ndarray:
    """(U, n) columns, ``axis * products + product``, through a look's matrix."""
    turns, products = len(closure[0]), still.shape[1]
    found = np.empty((len(used), len(matrix)), dtype=np.float32)
    for axis in range(3):
        first, stop = np.searchsorted(used, [axis * products, (axis + 1) * products])
        own = used[first:stop] - axis * products
        np.matmul(closure[axis][:, own].T, matrix[:, :turns].T, out=found[first:stop])
        if len(still):
            found[first:stop] += still[:, own].T @ matrix[:, turns + axis : turns + 3 * len(still) : 3].T
    return found
