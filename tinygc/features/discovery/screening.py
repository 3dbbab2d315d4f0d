"""Screen all forms by their linear columns, with a correction for the number of forms."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.base.numeric import rms_of, running_sum
from session.base.progress import Progress, no_report
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_effect import added, as_effect, left_by_calibration
from tinygc.features.discovery.projections import FAINT, Projection, basis_of, equivalent_forms, leaders, price_of, promise, seen_directions
from tinygc.features.discovery.responses import ColumnPlan, ResponseBlock, Responses, planned
from tinygc.noise.refit import Refit, Replay
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

# Plain laws, one of each quantity, for the detection limits of a recording without a law.


@dataclass(frozen=True, eq=False)
class Probe:
    """A law with equal coefficients: quantity; whitened (n,): its response in the projection's whitened channels, unit (m,): the same
    orthogonal to the nuisance and normalised, at the size rms: rad/s of its added rate beyond a calibration."""

    quantity: str
    whitened: np.ndarray
    unit: np.ndarray
    rms: float


def probes_of(forms: Sequence[LawForm], responses: Responses, projection: Projection) -> tuple[Probe, ...]:
    """For each quantity, the constant-free law of one function, the same for each axis, that is visible at the smallest rate."""
    best: dict[str, Probe] = {}
    movements = responses.values.movements
    for form in forms:
        (factor, *others) = form.factors
        if others or form.constants or form.pattern != "each":
            continue
        response = responses.columns(form).sum(axis=1)
        whitened = projection.whitened(response)
        free = projection.free_of(whitened)
        length = float(np.linalg.norm(free))
        if not length > FAINT * float(np.linalg.norm(whitened)):  # also true for NaN
            continue
        rms = rms_of(left_by_calibration(added(as_effect(form), np.ones(form.size), movements), movements)) / length
        if factor.quantity not in best or rms < best[factor.quantity].rms:
            best[factor.quantity] = Probe(factor.quantity, whitened / length, free / length, rms)
    return tuple(best.values())


# The turns of a long session by which all forms are screened.

#: turns: the work grows with their square
MOST_TURNS = 120
#: neighbours selected together, so that they share the stills between them
TURN_NEIGHBOURS = 10


def spread(twin: Twin) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Select groups of neighbouring turns, evenly over the session, with their stills; None where there are few enough to use all.

    Numbers of segments and of stills, and their rows (n,) among the stacked channels.
    """
    count, d, q = len(twin.segments), twin.batch.angles, len(twin.stills)
    if count <= MOST_TURNS:
        return None
    groups = MOST_TURNS // TURN_NEIGHBOURS
    first = np.round(np.linspace(0, count - TURN_NEIGHBOURS, groups)).astype(int)
    segments = np.unique(first[:, None] + np.arange(TURN_NEIGHBOURS))
    stills = np.unique(np.concatenate([twin.first[segments], twin.last[segments]]))
    stills = stills[stills >= 0]
    rows = [
        (segments[:, None] * d + np.arange(d)).ravel(),
        count * d + (stills[:, None] * 3 + np.arange(3)).ravel(),
        count * d + 3 * q + stills,
    ]
    return segments, stills, np.concatenate(rows)


# The distribution of the best promise of all forms in noise alone, for this recording.

#: share of the draws that determine the tail
TAIL = 0.2
#: the tail's prior scale in promise: that of the chi-square's, e^(-gain/2)
USUAL_SCALE = 2.0
#: weight of the prior in draws: a scale from so few exceedances is no better
WORTH = 20


class Chance:
    """drawn: the best studentised promise of all forms in each draw.

    The tail beyond the upper fifth of the draws is exponential: the promise is a logarithm of odds, whose tail is e^(-promise/2) whatever
    the forms (Markov's bound; Gumbel's law for the largest of many), so the scale estimated from the draws is shrunk towards that.
    """

    def __init__(self, drawn: np.ndarray):
        self.drawn = np.sort(drawn)
        count = max(int(TAIL * len(drawn)), 1)
        self._from = float(self.drawn[-count])
        self._share = count / (len(drawn) + 1)
        beyond = self.drawn[-count:] - self._from
        self._scale = float((beyond.sum() + WORTH * USUAL_SCALE) / (count - 1 + WORTH))

    def p(self, promise: float) -> float:
        """Probability that noise alone promises as much, over the whole search."""
        if promise < self._from:
            return float((1 + np.sum(self.drawn >= promise)) / (len(self.drawn) + 1))
        return self._share * float(np.exp(-(promise - self._from) / self._scale))

    def level(self, share: float) -> float:
        """The promise that noise alone exceeds in this share of cases."""
        if share <= self._share:
            return self._from + self._scale * float(np.log(self._share / share))
        return float(np.quantile(self.drawn, 1 - share))


# One pass over all forms: their projected columns, block by block, so that memory does not grow with the number of forms.

#: bytes of partners' values at once, and products of components that are projected at once
TILE_BYTES, TOGETHER = 1 << 26, 1536
#: most unwanted partners between two wanted ones for which one larger product is faster than two
GAP = 16


@dataclass(frozen=True, eq=False)
class Passed:
    """Forms of one size P in one projection, single precision, each column of an arbitrary length: forms (F,), their numbers; free (F, P,
    m): columns orthogonal to the nuisance; length (F, P): with it; along (F, P, T): free times the projection's targets."""

    projection: int
    forms: np.ndarray
    free: np.ndarray
    length: np.ndarray
    along: np.ndarray


def passed(
    plan: ColumnPlan,
    responses: Responses,
    projections: Sequence[Projection],
    targets: Sequence[np.ndarray],
    progress: Progress = no_report,
) -> Iterator[Passed]:
    """Every form with finite columns that are not all zero, in each projection; targets (m, T): of each projection."""
    matrices = [projection.matrix() for projection in projections]
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


def _blocks(plan: ColumnPlan, responses: Responses, tile: np.ndarray) -> Iterator[tuple[int, np.ndarray, ResponseBlock, np.ndarray]]:
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
    """Runs of neighbouring wanted partners, of at most so many components."""
    run: list[int] = []
    for number in wanted.tolist():
        if run and (ends[number] - ends[run[0]] + width[run[0]] > most or number - run[-1] > GAP):
            yield run
            run = []
        run.append(number)
    yield run


def _rows(
    plan: ColumnPlan, forms: list[np.ndarray], partners: np.ndarray, block: ResponseBlock, alive: np.ndarray
) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """By size P: numbers (F,) of the forms of each partner, and the indices (F, P) of their columns, ``axis * products + product``."""
    _, _, _, h, k = block[0].shape
    begins = running_sum(plan.width[partners])
    numbers: dict[int, list[int]] = {}
    rows: dict[int, list[np.ndarray]] = {}
    for own, begin, is_alive in zip(forms, begins[:-1], alive, strict=True):
        for form in own.tolist() if is_alive else ():
            axis, hub, partner = plan.wirings[plan.wiring[form]]
            numbers.setdefault(len(axis), []).append(form)
            rows.setdefault(len(axis), []).append((axis * h + hub) * k + begin + partner)
    return {size: np.array(each) for size, each in numbers.items()}, {size: np.array(each) for size, each in rows.items()}


def _through(
    block: ResponseBlock,
    forms: dict[int, np.ndarray],
    rows: dict[int, np.ndarray],
    matrices: list[np.ndarray],
    targets: list[np.ndarray],
) -> Iterator[Passed]:
    of_turns, of_stills = block
    s, d, _, h, k = of_turns.shape
    used = np.unique(np.concatenate([each.ravel() for each in rows.values()]))
    closure = [of_turns[:, :, axis].reshape(s * d, h * k) for axis in range(3)]
    still = of_stills.reshape(len(of_stills), h * k)
    for projection, (matrix, goal) in enumerate(zip(matrices, targets, strict=True)):
        # (U, n) columns, ``axis * products + product``, multiplied by a projection's matrix
        turns, products = len(closure[0]), still.shape[1]
        seen = np.empty((len(used), len(matrix)), dtype=np.float32)
        for axis in range(3):
            first, stop = np.searchsorted(used, [axis * products, (axis + 1) * products])
            own = used[first:stop] - axis * products
            np.matmul(closure[axis][:, own].T, matrix[:, :turns].T, out=seen[first:stop])
            if len(still):
                seen[first:stop] += still[:, own].T @ matrix[:, turns + axis : turns + 3 * len(still) : 3].T
        free = np.ascontiguousarray(seen[:, : len(goal)])
        length, along = np.linalg.norm(seen, axis=1), free @ goal
        for size, each in rows.items():
            at = np.searchsorted(used, each)
            yield Passed(projection, forms[size], free[at], length[at], along[at])


# All forms by their linear columns in each projection, and the chance level of so many forms.

#: draws of noise alone: a level of 5 % is then known to 1.5 % (binomial)
DRAWS = 200
#: draws whose gains are kept for each form, to recognise forms with the same columns
MARKS = 48
#: forms that are evaluated with all turns, in a session screened by part of them
FINALISTS = 2000
#: neighbouring forms for a law's chance: those within a factor of five of one constant on the coarsest grid, or a ring of two
NEIGHBOURS = 8


class Screening:
    """Results of one pass over the forms, in each of the projections.

    forms, the simplest first; price (F,) of each; of every projection (L, F): gain in chi-square, promise, rank: number of
    visible directions, left: share of the columns' squared length outside the nuisance.  marks (F, MARKS): gains in draws of noise (n, D),
    in the last projection; probes: plain laws of each quantity, shares (F, probes): of each one's response that a form can represent;
    responses, projections: of the turns by which all forms are screened, all_responses, all_projections: of all turns.
    """

    def __init__(
        self,
        forms: Sequence[LawForm],
        responses: Responses,
        projections: tuple[Projection, ...],
        noise: np.ndarray,
        probes: tuple[Probe, ...] = (),
    ):
        self._plan = planned(forms)
        self.forms, self.price = forms, np.array([price_of(form) for form in forms])
        self.responses, self.projections, self.noise, self.probes = responses, projections, noise, probes
        self.all_responses, self.all_projections = responses, projections
        shape, draws = (len(projections), len(forms)), noise.shape[1]
        self.gain, self.left, self.rank = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=int)
        self.promise, self._tested = np.full(shape, -np.inf), np.full(shape, -np.inf)
        self._best = np.full((len(projections), draws), -np.inf)
        self.marks = np.zeros((len(forms), min(MARKS, draws)), dtype=np.float32)
        self.shares = np.zeros((len(forms), len(probes)), dtype=np.float32)

    def screen(self, progress: Progress) -> None:
        """Make one pass over all forms."""
        draws = slice(1, 1 + self.noise.shape[1])
        # A column for the recording, one for each draw, and one for each probe; the probes are in the last projection alone.
        last = self.projections[-1]
        responses = np.stack([probe.unit for probe in self.probes], axis=1) if self.probes else np.zeros((last.free, 0))
        targets, scatters = [], []
        for projection in self.projections:
            probed = responses if projection is last else np.zeros((projection.free, 0))
            targets.append(np.concatenate([projection.residual[:, None], projection.free_of(self.noise), probed], axis=1))
            scatters.append(np.concatenate([[projection.scatter], projection.scatters(projection.left_of(self.noise))]))
        for some in passed(self._plan, self.responses, self.projections, targets, progress):
            number, forms = some.projection, some.forms
            weights, rank, left = seen_directions(some.free, some.length)
            gains = np.sum((weights.astype(np.float32) @ some.along) ** 2, axis=1)
            cost, unseen = self.price[forms], rank == 0
            self.gain[number, forms], self.rank[number, forms], self.left[number, forms] = gains[:, 0], rank, left
            self.promise[number, forms] = np.where(unseen, -np.inf, promise(gains[:, 0].astype(float), rank, cost))
            tested = promise(self.projections[number].studentised(gains[:, : draws.stop], rank, scatters[number]), rank, cost)
            tested[unseen] = -np.inf
            self._tested[number, forms] = tested[:, 0]
            np.maximum(self._best[number], tested[:, draws].max(axis=0), out=self._best[number])
            if number == len(self.projections) - 1:
                self.marks[forms] = gains[:, 1 : 1 + self.marks.shape[1]]
                self.shares[forms] = gains[:, draws.stop :]

    def weigh_with_all(self, responses: Responses, projections: tuple[Projection, ...], progress: Progress) -> None:
        """Screen the most promising forms again, with all turns of the recording."""
        self.all_responses, self.all_projections = responses, projections
        best = self.order[:FINALISTS]
        forms, no_noise = [self.forms[number] for number in best], np.zeros((responses.channels, 0))
        final = Screening(forms, responses, projections, no_noise)
        final.screen(progress)
        for name in ("gain", "promise", "rank", "left", "_tested"):
            getattr(self, name)[:, best] = getattr(final, name)
        del self.order  # of the former promises

    @cached_property
    def tested(self) -> np.ndarray:
        """Largest studentised promise (F,) over the projections, to which ``chance`` refers."""
        return self._tested.max(axis=0)

    @property
    def best_after_last(self) -> float:
        """The largest studentised promise in the last projection, that of the most probable hypothesis."""
        return float(self._tested[-1].max())

    @cached_property
    def drawn(self) -> np.ndarray:
        """Largest studentised promise (D,) of each draw of noise alone."""
        return self._best.max(axis=0)

    @cached_property
    def order(self) -> np.ndarray:
        """Numbers (F,) of the forms, the most promising first, each by its best projection."""
        return np.argsort(-self.promise.max(axis=0), kind="stable")

    @cached_property
    def chance(self) -> Chance:
        """Distribution of the best studentised promise of all forms in noise alone."""
        return Chance(self.drawn)

    def neighbours(self, form: LawForm, most: int = NEIGHBOURS) -> list[LawForm]:
        """Forms that differ from one by their constants alone, the nearest first; itself where there are none."""
        own = np.log(form.constants)
        return sorted(self._shapes.get(form.shape, [form]), key=lambda other: np.sum((np.log(other.constants) - own) ** 2))[:most]

    @cached_property
    def _shapes(self) -> dict[LawForm, list[LawForm]]:
        found: dict[LawForm, list[LawForm]] = {}
        for form in self.forms:
            found.setdefault(form.shape, []).append(form)
        return found

    @cached_property
    def leaders(self) -> np.ndarray:
        """(F,) the simplest form that is nearly equal to each form in this recording; -1: the form is not visible."""
        return leaders(self.marks, self.rank[-1])

    @property
    def distinct(self) -> int:
        """How many of the forms differ in this recording."""
        return len(np.unique(self.leaders[self.leaders >= 0]))

    def same_as(self, form: LawForm, most: int = 8) -> list[LawForm]:
        """Forms with the same span (cosines of the principal angles above ``projections.SAME``), the simplest first."""
        numbers = equivalent_forms(form, self.responses, self.projections[-1], self.noise, self.marks, self.rank[-1], self.forms)
        return [self.forms[number] for number in sorted(numbers) if self.forms[number] != form][:most]


def screened(
    replay: Replay,
    forms: Sequence[LawForm],
    projections: Sequence[tuple[Whitener, Refit]],
    seed: int,
    draws: int = DRAWS,
    progress: Progress = no_report,
) -> Screening:
    """Screen all forms in each projection (whiten, fit), which share the signals of one replay.

    A session of many turns is screened by some of them, spread over it (``MOST_TURNS``), and the most promising forms are evaluated with
    all. The chance level is drawn for the selected turns: it depends on how many forms differ and hardly on the number of rows.
    """
    every = Responses(replay)
    all_projections = tuple(Projection(replay.twin, whiten, fit) for whiten, fit in projections)
    part = spread(replay.twin)
    responses, seen = every, all_projections
    if part is not None:
        segments, stills, rows = part
        responses = Responses(replay, segments, stills, every.values)
        seen = tuple(Projection(replay.twin, whiten, fit, rows) for whiten, fit in projections)
    noise = np.random.default_rng(seed).standard_normal((responses.channels, draws))
    probes = probes_of(forms, responses, seen[-1])
    screening = Screening(forms, responses, seen, noise, probes)
    screening.screen(progress)
    if part is not None:
        screening.weigh_with_all(every, all_projections, progress)
    return screening


# The promise of one form against a hypothesis that was not screened, in the noise estimated with the form.


def promised_after(screening: Screening, form: LawForm, projection: Projection) -> float:
    """Studentised promise, as ``Screening.tested``; -inf where the form is not visible.  projection: of all turns, without the form."""
    basis = basis_of(form, screening.all_responses, projection)
    if not basis.shape[1]:
        return -np.inf
    gain, rank = np.array([np.sum((basis.T @ projection.residual) ** 2)]), np.array([basis.shape[1]])
    return float(promise(projection.studentised(gain, rank, projection.scatter), rank, np.array([price_of(form)]))[0])
