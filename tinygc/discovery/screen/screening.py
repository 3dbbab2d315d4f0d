"""All forms by their linear columns beside each look, and what chance makes of so many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.alike import alike, leaders
from tinygc.discovery.screen.chance import Chance
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.passing import Progress, passed
from tinygc.discovery.screen.plan import Plan, planned
from tinygc.discovery.screen.probes import Probe, probes_of
from tinygc.discovery.screen.responses import Responses
from tinygc.discovery.screen.sharpen import Sharpened, sharpened_in
from tinygc.discovery.screen.spread import spread
from tinygc.discovery.screen.weighing import price, promise, seen_directions
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.whitening import Whitener

#: draws of noise alone: a level of 5 % is then known to 1.5 % (binomial)
DRAWS = 200
#: draws whose gains are kept of each form: what tells apart forms that differ in nothing else
MARKS = 48
#: of a session that is screened by part of its turns: forms that are weighed with all of them
FINALISTS = 2000
#: forms of other constants that a law is asked with: of one constant those within a factor of five on the coarsest grid, of two a ring
NEIGHBOURS = 8


@dataclass(frozen=True, eq=False)
class Screening:
    """forms (F); bits, sizes, price (F,): of each, sizes in coefficients; of every look (L, F): gain in chi-square, promise, rank:
    directions that are seen, left: the share of the columns' length, squared, that the nuisance leaves.

    tested (F,): promise, studentised, of the look that shows most, which is what ``chance`` is of; best_beside_last: the largest of them
    beside the last look, the likeliest hypothesis as it is; drawn (D,): the largest of these of each
    draw of noise alone; marks (F, MARKS): gains in draws, beside the last look; probes: plain laws of each quantity, shares (F, probes): of
    each one's response what a form can say; responses, looks: of the turns that all forms are screened by; noise (n, D): the draws, white;
    all_responses, all_looks: of all turns; seed: of whatever else is drawn.
    """

    forms: Sequence[Form]
    bits: np.ndarray
    sizes: np.ndarray
    price: np.ndarray
    gain: np.ndarray
    promise: np.ndarray
    rank: np.ndarray
    left: np.ndarray
    tested: np.ndarray
    best_beside_last: float
    drawn: np.ndarray
    marks: np.ndarray
    probes: tuple[Probe, ...]
    shares: np.ndarray
    responses: Responses
    looks: tuple[Look, ...]
    noise: np.ndarray
    all_responses: Responses
    all_looks: tuple[Look, ...]
    seed: int

    @cached_property
    def order(self) -> np.ndarray:
        """(F,) numbers of the forms, the most promising first, each by the look that shows most."""
        return np.argsort(-self.promise.max(axis=0), kind="stable")

    @cached_property
    def chance(self) -> Chance:
        """Of the best of all forms in noise alone."""
        return Chance(self.drawn)

    def chance_p(self, promise: float) -> float:
        """Probability that noise alone gives the best of all forms such a studentised promise."""
        return self.chance.p(promise)

    def price_of(self, form: Form) -> float:
        """As ``price``, of any form: that of those which differ from it by their constants alone, the dearest's where there are none."""
        return self._prices.get(form.shape, float(self.price.max()))

    @cached_property
    def _prices(self) -> dict[Form, float]:
        return {form.shape: float(cost) for form, cost in zip(self.forms, self.price, strict=True)}

    def neighbours(self, form: Form, most: int = NEIGHBOURS) -> list[Form]:
        """Forms that differ from one by their constants alone, the nearest first; itself where there are none."""
        own = np.log(form.constants)
        return sorted(self._shapes.get(form.shape, [form]), key=lambda other: np.sum((np.log(other.constants) - own) ** 2))[:most]

    @cached_property
    def _shapes(self) -> dict[Form, list[Form]]:
        found: dict[Form, list[Form]] = {}
        for form in self.forms:
            found.setdefault(form.shape, []).append(form)
        return found

    def sharpened(self, form: Form, look: int = -1) -> Sharpened:
        """Its constants at their best beside one of the looks."""
        return sharpened_in(form, self.all_responses, self.all_looks[look])

    @cached_property
    def leaders(self) -> np.ndarray:
        """(F,) of each form the simplest that this recording hardly tells from it; -1: nothing of it is seen."""
        return leaders(self.marks, self.rank[-1], self.bits)

    @property
    def distinct(self) -> int:
        """How many of the forms differ in this recording."""
        return len(np.unique(self.leaders[self.leaders >= 0]))

    def same_as(self, form: Form, most: int = 8) -> list[Form]:
        """Forms whose columns span what this one's do (cosine of every principal angle above ``alike.SAME``), the simplest first."""
        numbers = alike(form, self.responses, self.looks[-1], self.noise, self.marks, self.rank[-1], self.forms)
        numbers = sorted(numbers, key=lambda number: (self.bits[number], self.sizes[number], number))
        return [self.forms[number] for number in numbers if self.forms[number] != form][:most]


def screened(
    replay: Replay,
    forms: Sequence[Form],
    bits: np.ndarray,
    looks: Sequence[tuple[Whitener, Refit]],
    seed: int,
    draws: int = DRAWS,
    progress: Progress = lambda what, done, of: None,
) -> Screening:
    """Every form beside each look (whiten, fit); they share the signals of one replay.  bits (F,) of each form among all.

    A session of many turns is screened by some of them, spread over it (``spread.MOST_TURNS``), and the most promising forms are weighed
    with all; what chance does is drawn for the former, whose best promise is as large: it hangs on how many forms differ, hardly on how
    many rows there are.
    """
    bits, plan = np.asarray(bits, dtype=float), planned(forms)
    every = Responses(replay)
    all_looks = tuple(Look(replay.twin, whiten, fit) for whiten, fit in looks)
    part = spread(replay.twin)
    responses, seen = every, all_looks
    if part is not None:
        responses = Responses(replay, part.segments, part.stills, every.values)
        seen = tuple(Look(replay.twin, whiten, fit, part.rows) for whiten, fit in looks)
    noise = np.random.default_rng(seed).standard_normal((responses.channels, draws))
    probes = probes_of(forms, responses, seen[-1])
    work = _Work(plan, price(bits, plan.sizes), seen, noise, probes)
    work.over(plan, responses, progress)
    if part is not None:
        best = np.argsort(-work.promise.max(axis=0), kind="stable")[:FINALISTS]
        some = planned([forms[number] for number in best])
        final = _Work(some, work.price[best], all_looks, np.zeros((every.channels, 0)), ())
        final.over(some, every, progress)
        for name in ("gain", "promise", "rank", "left", "tested"):
            getattr(work, name)[:, best] = getattr(final, name)
    return Screening(
        forms=forms,
        bits=bits,
        sizes=plan.sizes,
        price=work.price,
        gain=work.gain,
        promise=work.promise,
        rank=work.rank,
        left=work.left,
        tested=work.tested.max(axis=0),
        best_beside_last=float(work.tested[-1].max()),
        drawn=work.best.max(axis=0),
        marks=work.marks,
        probes=probes,
        shares=work.shares,
        responses=responses,
        looks=seen,
        noise=noise,
        all_responses=every,
        all_looks=all_looks,
        seed=seed,
    )


class _Work:
    """What is gathered of forms of these prices (F,), beside each look."""

    def __init__(self, plan: Plan, price: np.ndarray, looks: tuple[Look, ...], noise: np.ndarray, probes: tuple[Probe, ...]):
        shape, draws = (len(looks), len(price)), noise.shape[1]
        self.price, self.looks = price, looks
        self.gain, self.left, self.rank = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=int)
        self.promise, self.tested = np.full(shape, -np.inf), np.full(shape, -np.inf)
        self.best = np.full((len(looks), draws), -np.inf)
        self.marks = np.zeros((len(price), min(MARKS, draws)), dtype=np.float32)
        self.shares = np.zeros((len(price), len(probes)), dtype=np.float32)
        self._draws = slice(1, 1 + draws)
        # A column for the recording, one for each draw, and one for each probe.
        responses = np.stack([probe.unit for probe in probes], axis=1) if probes else np.zeros((looks[-1].free, 0))
        self._targets, self._scatter = [], []
        for look in looks:
            asked = responses if look is looks[-1] else np.zeros((look.free, 0))
            self._targets.append(np.concatenate([look.residual[:, None], look.free_of(noise), asked], axis=1))
            self._scatter.append(np.concatenate([[look.scatter], look.scatters(look.beside(noise))]))

    def over(self, plan: Plan, responses: Responses, progress: Progress) -> None:
        """One pass."""
        for some in passed(plan, responses, self.looks, self._targets, progress):
            look, forms = some.look, some.forms
            weights, rank, left = seen_directions(some.free, some.length)
            gains = np.sum((weights.astype(np.float32) @ some.along) ** 2, axis=1)
            cost, unseen = self.price[forms], rank == 0
            self.gain[look, forms], self.rank[look, forms], self.left[look, forms] = gains[:, 0], rank, left
            self.promise[look, forms] = np.where(unseen, -np.inf, promise(gains[:, 0].astype(float), rank, cost))
            own = gains[:, : self._draws.stop]
            tested = promise(self.looks[look].studentised(own, rank, self._scatter[look]), rank, cost)
            tested[unseen] = -np.inf
            self.tested[look, forms] = tested[:, 0]
            np.maximum(self.best[look], tested[:, self._draws].max(axis=0), out=self.best[look])
            if look == len(self.looks) - 1:
                self.marks[forms] = gains[:, 1 : 1 + self.marks.shape[1]]
                self.shares[forms] = gains[:, self._draws.stop :]
