"""Propagation of distributions (GUM Supplement 1, JCGM 101:2008): every source's errors drawn in the data, and the fit made again.

    y         sum of draws with the covariance of each source: errors of the turns' ends, of the stills' rates, of gravity's lengths
    data      references, known angles, rates of the stills, all rates (rounding), durations (clock), moved by them
    theta     nonlinear least squares of the moved data (``fit_least_squares``)

The sizes of the sources are those of the budget, so the draws check the propagation: its linearity, and the bookkeeping by source.  Where
accelerometer and gyroscope are estimated together, an error goes through the last linear system of that estimate, whose weights are held;
the references are turned by it exactly, and the gyroscope is fitted to these.  That the sizes are estimates themselves is the business of
k, and has its own check: ``_coverage_of`` draws each variance from chi-square with its degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri, stdtrit

from session.base import rotation
from session.base.errors import CalibrationError, FitError
from session.base.numeric import sigmas_in
from session.base.progress import Progress
from session.base.records import table_of
from tinygc.closure.build import bias_shares
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.motion import Motion
from tinygc.estimation.stated_noise import CALIBRATION, CLOCK, GRAVITY_LENGTH, MISFIT, ROUNDING, channel_sources, joint_response
from tinygc.features.unit.budget.quantities import ATTITUDE, Budget
from tinygc.fitting.results import FitResult
from tinygc.inference.solve import COVERAGE, Source, coverage_factor
from tinygc.models.linear import BIAS, NAMES, PARAMETERS, WORDS, LinearModel, field_vector

#: draws between two looks at whether the figures are stable
BLOCK = 200
#: of the fit that the draws start from and the one that the session has, in sigmas
SAME_SIGMAS = 0.01
#: draws of one source alone, at least; of sizes, for ``_coverage_of``
FEWEST, COVERAGE_DRAWS = 50, 20_000
#: share of a parameter's variance below which a source is not checked on it: errors of second order may be as large
LEAST_SHARE = 0.01
#: relative size of the directions of a covariance that are none
RANK = 1e-12
#: probability that the variances by source, all together, differ by chance as far as is called different
BY_CHANCE = 0.01


class _Redrawn:
    """A fitted session whose errors are drawn again.

    Errors are one vector: channels (n,), stacked; known (k,): in sigmas, of what was known of the accelerometer and gravity before the
    session; reading (3,) rad/s, common to all readings; clock (1,): relative error of all durations.  Raises CalibrationError for a fit
    whose sources are no errors of its data: without estimated noise, of a lot, of several days.
    """

    def __init__(self, result: FitResult, seed: int):
        options, problem = result.options, result.problem
        if result.noise is None or result.prior is not None or options.bias_per_log:
            raise CalibrationError(
                "--monte-carlo: the errors of this fit cannot be drawn in its data (a truth file, more than 400 segments, --lot or "
                "bias_per_log); leave it out"
            )
        self.result, self.problem, self.noise = result, problem, result.noise
        self.rng = np.random.default_rng(seed)
        self.model = result.linear.linear
        known = 0 if problem.joint is None else problem.joint.beforehand.shape[1]
        *edges, size = np.cumsum([len(self.noise.white), known, 3, 1])
        self.nothing = np.zeros(size)
        self.channels, self.known, self.reading, self.clock = map(slice, [0, *edges], [*edges, size])
        sigma = sigmas_in(result.covariance)
        if not (np.abs(self.refit(self.nothing) - self.model.vector) < SAME_SIGMAS * sigma).all():
            raise CalibrationError("--monte-carlo: the fit cannot be made again from its own data; leave it out")
        self._roots = {source.name: _root(source.covariance) for source in channel_sources(problem, self.noise)}

    def draw(self, source: Source) -> np.ndarray:
        """Draw the errors of one source."""
        name, rng, found = source.name, self.rng, self.nothing.copy()
        if name == MISFIT:
            others = (self.draw(each) for each in self.result.sources if each.name not in (MISFIT, ROUNDING, CLOCK))
            return sum(others, found) * float(np.sqrt(self.result.widened - 1))
        if name == ROUNDING:
            root = _root(source.covariance[BIAS, BIAS])
            found[self.reading] = -np.linalg.solve(self.model.E, root @ rng.normal(size=root.shape[1]))
        elif name == CLOCK:
            clock = self.result.session.clock
            assert clock is not None
            found[self.clock] = clock.sigma * float(rng.normal())
        elif name in self._roots:
            root = self._roots[name]
            found[self.channels] = root @ rng.normal(size=root.shape[1])
        else:
            assert name in (CALIBRATION, GRAVITY_LENGTH)
            known = found[self.known][slice(-1, None) if name == GRAVITY_LENGTH else slice(0, -1)]
            known[:] = rng.normal(size=len(known))
        return found

    def refit(self, errors: np.ndarray) -> np.ndarray:
        """(12,) least squares of the data with these errors.  Raises FitError where it does not converge."""
        # The batch, the stills' rates and the bias at rest with these errors
        problem, joint, count = self.problem, self.problem.joint, len(self.problem.batch)
        batch, rates, rest = problem.batch, problem.still_rates, problem.rest_rps
        channels, known, reading, clock = (errors[part] for part in (self.channels, self.known, self.reading, self.clock))
        if joint is not None:
            moved = np.zeros(len(joint.system.x))
            moved[joint.own] = joint_response(problem, joint) @ channels + joint.beforehand @ known
            batch = joint.shifted(batch, moved)
        rows = count * batch.angles
        ends = channels[:rows].reshape(count, batch.angles)
        still = channels[rows : rows + 3 * len(rates.rate)].reshape(-1, 3)
        turned = np.zeros((count, 3))
        turned[:, : ends.shape[1]] = ends
        if batch.turns is not None:
            turned[:, 2] = 0.0
            batch = replace(batch, turns=replace(batch.turns, angle_rad=batch.turns.angle_rad - ends[:, 2]))
        batch = replace(
            batch,
            end=rotation.multiply(rotation.exp(-turned), batch.end),
            rate=batch.rate + reading,
            dt=batch.dt * (1 + clock),
        )
        rates = replace(rates, rate=rates.rate + reading, earth=rates.earth - still)
        if rest is not None:
            first, last, share = self._shares
            apart = still[first][:, None] * (1 - share[..., None]) + still[last][:, None] * share[..., None] - still.mean(axis=0)
            batch = replace(batch, earth=batch.earth + apart)
            rest = rest + reading + np.linalg.solve(self.problem.first.E, still.mean(axis=0))
        options = self.result.options
        fit = fit_least_squares(
            batch,
            self.problem.floor.sigma,
            self.problem.first,
            still_rates=rates if options.still_rates and rest is None else None,
            integrator=options.integrator,
            rest_rps=rest,
            begin=self.model,
        )
        return fit.model.vector

    @cached_property
    def _shares(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return bias_shares(self.problem)


def _root(covariance: np.ndarray) -> np.ndarray:
    """(n, r) a root of a covariance (n, n) of rank r, of rows in different units."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size, axes = np.linalg.eigh(covariance / np.outer(unit := np.where(sigma > 0, sigma, 1.0), unit))
    kept = size > RANK * max(float(size[-1]), 0.0)
    return unit[:, None] * axes[:, kept] * np.sqrt(size[kept])


# The draws held against the budgets.


@dataclass(frozen=True)
class SourceCheck:
    """Variance of one parameter by one source alone: that of the draws over that of the budget, and by how many sigmas it is off one."""

    source: str
    parameter: str
    ratio: float
    sigmas: float


@dataclass(frozen=True)
class QuantityCheck:
    """One quantity by draws (JCGM 101, clause 8), SI.

    u and half: standard uncertainty and half of the 95 % interval of the budget with its sizes as they are; drawn_u; low, high: the
    symmetric 95 % interval of the draws' deviations; digits: significant digits of u to which the draws are stable, 0 to 2; tolerance: half
    a unit of the last of them; apart: the larger difference of the interval's ends.
    """

    name: str
    unit: str
    si: float
    u: float
    half: float
    drawn_u: float
    low: float
    high: float
    digits: int
    tolerance: float
    apart: float

    @property
    def answer(self) -> str:
        """``agrees``, ``differs``, or ``undecided`` where the draws are not stable to one digit."""
        return "undecided" if not self.digits else "agrees" if self.apart <= self.tolerance else "differs"

    def to_json(self) -> dict:
        """One entry of ``monte_carlo.quantities``, in its unit."""
        numbers = ("u", "half", "drawn_u", "low", "high", "tolerance", "apart")
        found = {name: getattr(self, name) / self.si for name in numbers}
        return {"name": self.name, "unit": self.unit, **found, "digits": self.digits, "answer": self.answer}


@dataclass(frozen=True)
class MonteCarlo:
    """seed; draws of all sources together, draws_by_source of each alone; failed: fits that did not converge; quantities; sources: those
    that have a share worth checking; sigmas_by_chance: what the farthest of them exceeds once in 1 / ``BY_CHANCE``; coverage: share of
    draws within U where the sizes are estimates themselves, by quantity."""

    written = ("answer", "seed", "draws", "draws_by_source", "failed", "quantities", "sources", "sigmas_by_chance")
    seed: int
    draws: int
    draws_by_source: int
    failed: int
    quantities: tuple[QuantityCheck, ...]
    sources: tuple[SourceCheck, ...]
    sigmas_by_chance: float
    coverage: dict[str, float]

    @property
    def farthest(self) -> SourceCheck:
        """The variance by source that is farthest from the budget's."""
        return max(self.sources, key=lambda each: abs(each.sigmas))

    @property
    def answer(self) -> str:
        """``differs`` if any quantity or source does, ``undecided`` if none does and some quantity is, else ``agrees``."""
        answers = {each.answer for each in self.quantities}
        if abs(self.farthest.sigmas) > self.sigmas_by_chance or "differs" in answers:
            return "differs"
        return "undecided" if "undecided" in answers else "agrees"

    @property
    def words(self) -> str:
        """The answer, and how many draws there were."""
        return f"{self.answer}: {self.draws} draws of all sources, {self.draws_by_source} of each alone"

    def to_json(self) -> dict:
        """``monte_carlo`` of ``tinygc-budget/1``."""
        return table_of(self) | {"quantities": [each.to_json() | {"coverage": self.coverage[each.name]} for each in self.quantities]}


def monte_carlo(
    result: FitResult,
    motion: Motion,
    in_use: Sequence[Source],
    budgets: Sequence[Budget],
    draws: int,
    seed: int,
    progress: Progress,
) -> MonteCarlo:
    """Draw the errors of a fit again, at most so often, and hold its budgets against them.

    in_use: sources (3, 3) of the attitude that are not the fit's; budgets: parameters, sensor errors, attitude about single axes.
    Raises CalibrationError as ``_Redrawn``, and where no fit of the drawn data converges.
    """
    redrawn, sources = _Redrawn(result, seed), result.sources
    alone = max(FEWEST, draws // 5)
    checks: list[SourceCheck] = []
    failed = 0
    for number, source in enumerate(sources):
        progress("draws, source by source", number, len(sources))
        moved = np.array(list(_converged(redrawn, [source], alone))).reshape(-1, PARAMETERS) - redrawn.model.vector
        failed += alone - len(moved)
        checks += _source_checks(source, moved, result.covariance)
    root = _root(sum((source.covariance for source in in_use), np.zeros((3, 3))))
    deviations: list[np.ndarray] = []
    checked_quantities: list[QuantityCheck] = []
    while len(deviations) < draws:
        progress("draws of all sources", len(deviations), draws)
        block = min(BLOCK, draws - len(deviations))
        found = [_deviations(redrawn, motion, budgets, root, vector) for vector in _converged(redrawn, sources, block)]
        failed += block - len(found)
        deviations += found
        if len(found) < block / 2:
            break
        checked_quantities = [_quantity_check(budget, np.array(deviations)[:, i]) for i, budget in enumerate(budgets)]
        if all(each.digits == 2 for each in checked_quantities):
            break
    if not checks or not checked_quantities:
        raise CalibrationError("--monte-carlo: no fit of the drawn data converged; leave it out")
    coverage = {budget.name: _coverage_of(budget, redrawn.rng) for budget in budgets}
    bound = float(ndtri(1 - BY_CHANCE / 2 / max(len(checks), 1)))
    return MonteCarlo(seed, len(deviations), alone, failed, tuple(checked_quantities), tuple(checks), bound, coverage)


def _converged(redrawn: _Redrawn, sources: Sequence[Source], count: int) -> Iterator[np.ndarray]:
    for _ in range(count):
        errors = sum((redrawn.draw(source) for source in sources), redrawn.nothing)
        with suppress(FitError):
            yield redrawn.refit(errors)


def _source_checks(source: Source, moved: np.ndarray, covariance: np.ndarray) -> Iterator[SourceCheck]:
    """Of the parameters of which a source has a share; the sigmas are those of chi-square (Wilson & Hilferty 1931)."""
    count = len(moved)
    for i, name in enumerate(NAMES):
        stated = float(source.covariance[i, i])
        if count and stated > LEAST_SHARE * covariance[i, i]:
            ratio = float(np.mean(moved[:, i] ** 2)) / stated
            spread = 2 / (9 * count)
            yield SourceCheck(source.name, name, ratio, float((np.cbrt(ratio) - (1 - spread)) / np.sqrt(spread)))


_FIELDS = [f"{word} {component}" for word, components, _, _ in WORDS for component in components]


def _deviations(redrawn: _Redrawn, motion: Motion, budgets: Sequence[Budget], root: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """(Q,) SI of the quantities of budgets under refitted parameters; root (3, r): of the covariance of the use itself."""
    model, names = redrawn.model, [budget.name for budget in budgets]
    values = dict(zip(NAMES, vector - model.vector, strict=True))
    values |= zip(_FIELDS, field_vector(vector) - field_vector(model.vector), strict=True)
    if any(name in ATTITUDE for name in names):
        attitude = motion.error(model, LinearModel.from_vector(vector)) + root @ redrawn.rng.normal(size=root.shape[1])
        values |= zip(ATTITUDE, attitude, strict=True)
    return np.array([values[name] for name in names])


def _quantity_check(budget: Budget, deviations: np.ndarray) -> QuantityCheck:
    """Hold the interval of a budget with its sizes as they are, u times the normal factor, against the symmetric interval of the draws."""
    count, u, factor, si = len(deviations), budget.u, coverage_factor(np.inf), budget.si
    low, high = (float(each) for each in np.quantile(deviations, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2]))
    # Twice the standard deviation of the ends, whose density is that of a normal variable there.
    tail, density = (1 - COVERAGE) / 2, np.exp(-(factor**2) / 2) / np.sqrt(2 * np.pi) / u
    unsure = 2 * np.sqrt(tail * (1 - tail) / count) / density
    unit = 10.0 ** np.floor(np.log10(u / si)) * si
    tolerances = {2: 0.05 * unit, 1: 0.5 * unit}
    digits = next((n for n, tolerance in tolerances.items() if unsure <= tolerance), 0)
    apart = max(abs(low + factor * u), abs(high - factor * u))
    drawn_u, tolerance = float(np.std(deviations)), float(tolerances[digits or 1])
    return QuantityCheck(budget.name, budget.unit, si, u, factor * u, drawn_u, low, high, digits, tolerance, apart)


def _coverage_of(budget: Budget, rng: np.random.Generator, count: int = COVERAGE_DRAWS) -> float:
    """Share of errors within U if each variance is an estimate with its degrees of freedom: U = k u from the estimates, as a laboratory
    has it (Welch–Satterthwaite)."""
    variances, freedoms = (np.array([getattr(row, name) for row in budget.rows]) for name in ("variance", "freedom"))
    there = variances > 0
    variances, freedoms = variances[there], freedoms[there]
    known = ~np.isfinite(freedoms)
    estimated = variances * np.where(
        known, 1.0, rng.chisquare(np.where(known, 1.0, freedoms), (count, len(freedoms))) / np.where(known, 1.0, freedoms)
    )
    combined = estimated.sum(axis=1)
    spread = np.sum(np.where(known, 0.0, estimated**2 / np.where(known, 1.0, freedoms)), axis=1)
    effective = np.divide(combined**2, spread, out=np.full(count, np.inf), where=spread > 0)
    error = rng.normal(size=count) * np.sqrt(variances.sum())
    k = np.where(
        np.isfinite(effective), stdtrit(np.maximum(1.0, np.floor(np.minimum(effective, 1e9))), (1 + COVERAGE) / 2), coverage_factor(np.inf)
    )
    return float(np.mean(np.abs(error) <= k * np.sqrt(combined)))
