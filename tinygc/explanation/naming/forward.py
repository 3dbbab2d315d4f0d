"""Forward selection of effects on exact residuals: name the strongest, refit, look again; at most a handful."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.selection import FAMILY_WISE, SHAPE_SHARE, Selection
from tinygc.explanation.twin.common_delay import in_gauge
from tinygc.explanation.twin.refit import ENOUGH, Refit, refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

MOST_EFFECTS = 4  #: twice what `calibrate.py challenge` hides: each costs a round (benchmarks/explain_speed.py)
#: a further effect must be surer than the first: what the first explains is only as exact as its model
#: (not critical: benchmarks/thresholds.py)
LATER_FAMILY_WISE = 0.01
#: and take up at least this share of what has been explained so far: a model is good to a tenth of an effect's size,
#: and a tenth of the size is a hundredth of the chi-square
LATER_SHARE = 1e-2
#: or else this share of what is left beyond noise, and at least as much as noise: what an inexact model leaves must not be named
#: (not critical: benchmarks/thresholds.py)
WHOLE_SHARE = 0.95
#: candidates whose linear gain is at least this share of the best one's are refitted exactly before one is named
#: (not critical: benchmarks/thresholds.py); an exact refit is most of a round's time (benchmarks/explain_speed.py)
LOOKALIKE_SHARE = 0.75
MOST_LOOKALIKES = 4
#: a shape is scanned over so many values, and sharpened between them: more would make the work grow with the session's square
#: (benchmarks/explain_speed.py)
MOST_TIMES = 60
#: chi-square by which a stand-in may be worse and still be said: a likelihood ratio of 20 (2 ln 20)
STAND_IN = 6.0


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """One effect with its family-wise p-value, the chi-square it takes up, and the effects that could stand in for it."""

    effect: Effect
    p_value: float
    gain: float
    equivalent: tuple[str, ...] = ()


@dataclass(eq=False)
class Naming:
    """named, strongest first; fit with all of them; first_p: family-wise p-value of the first look; first: the fit without any."""

    first: Refit
    first_p: float
    fit: Refit
    named: list[NamedEffect] = field(default_factory=list)


def candidates(twin: Twin) -> list[Effect]:
    """What can be tried on this recording; an effect with a scanned shape gives one candidate for each value."""
    has_temp = all(np.isfinite(movement.temp_c).all() for movement in twin.movements)
    found = []
    for effect in catalogue().values():
        if effect.kind == "register" or ("temperature" in effect.inputs and not has_temp):
            continue
        if effect.kind == "earth" and twin.problem.earth.source != "none":
            continue
        found += effect.variants(scanned(twin, effect))
    return found


def scanned(twin: Twin, effect: Effect) -> np.ndarray:
    """(K,) values of an effect's scanned shape, SI, that are tried: its own grid, or the middles of the turns."""
    if effect.scan is None or effect.scan.grid is None:
        return segment_times(twin)
    return np.asarray(effect.scan.grid(twin.movements), dtype=float)


def segment_times(twin: Twin) -> np.ndarray:
    """Middle of each turn but the first and the last, s of the session; in a long session, of every so many."""
    times = [twin.movements[s.log].t_s[s.start] + s.duration_s / 2 for s in twin.segments][1:-1]
    return np.array(times[:: -(-len(times) // MOST_TIMES) or 1])


def name_effects(
    twin: Twin,
    whiten: Whitener,
    tried: list[Effect],
    seed: int,
    progress: Callable[[str], None] = lambda what: None,
    *,
    explained: float = 0.0,
    most: int = MOST_EFFECTS,
    stand_ins: bool = True,
) -> Naming:
    """Name what the recording shows beyond the present physics; ``explained``: chi-square that mending has taken up before."""
    fit = first = refit(twin, whiten, [], twin.start())
    effects: list[Effect] = []
    named: dict[str, tuple[float, float]] = {}
    first_p = 1.0
    while len(effects) < most:
        progress(f"naming, round {len(effects) + 1}")
        ids = {effect.id for effect in effects}
        rest = [effect for effect in tried if effect.id not in ids]
        selection = selection_of(twin, whiten, fit, rest, seed)
        if not selection.groups:
            break
        log_p = selection.log_p(fit.r)
        p_value = selection.p_value(fit.r)
        if not effects:
            first_p = p_value
        if p_value > SHAPE_SHARE * (LATER_FAMILY_WISE if effects else FAMILY_WISE):
            break
        effect, better = _best_exact(twin, whiten, fit, effects, rest, selection, log_p)
        gain = fit.chi_square - better.chi_square
        if gain < LATER_SHARE * (first.chi_square - fit.chi_square + explained) and not _completes(fit, better):
            break
        effects, fit = _sharpened_again(twin, whiten, [*effects, effect], better)
        named[effect.id] = (p_value, gain)
        effects, fit = _without_idle(twin, whiten, effects, fit)
    if not stand_ins:
        return Naming(first, first_p, fit, _sorted([NamedEffect(effect, *named[effect.id]) for effect in effects]))
    if effects:
        progress("lookalikes")
    effects, fit, others, named = _exchanged(twin, whiten, effects, fit, tried, seed, named)
    result = [
        NamedEffect(effect, *named[effect.id], _stand_ins(twin, whiten, fit, trials))
        for effect, trials in zip(effects, others, strict=True)
    ]
    return Naming(first, first_p, fit, _sorted(result))


def _sorted(named: list[NamedEffect]) -> list[NamedEffect]:
    return sorted(named, key=lambda n: -n.gain)


def _completes(fit: Refit, better: Refit) -> bool:
    """Whether a further effect, however small beside the others, takes up the whole of what they leave, and that is not little."""
    beyond = fit.chi_square - len(fit.r)
    return beyond > len(fit.r) and fit.chi_square - better.chi_square > WHOLE_SHARE * beyond


def selection_of(twin: Twin, whiten: Whitener, fit: Refit, rest: list[Effect], seed: int) -> Selection[int]:
    """The candidates' columns, whitened, against what the fit already has."""
    columns = {
        number: whiten(twin.effect_columns(effect, fit.state, fit.sensitivity, fit.rates).stacked()) for number, effect in enumerate(rest)
    }
    along = frozenset(number for number, effect in enumerate(rest) if effect.kind == "force")
    rows = slice(0, whiten.parts["still"].stop)
    return Selection(fit.J, columns, seed, allowances=whiten.allowances, scale_rows=rows, along=along)


def _best_exact(
    twin: Twin, whiten: Whitener, fit: Refit, effects: list[Effect], rest: list[Effect], selection: Selection[int], log_p: np.ndarray
) -> tuple[Effect, Refit]:
    """Of the candidates that linear columns cannot tell apart, the one whose exact refit is best for its number of parameters."""
    gains = np.array(list(selection.gains(fit.r).values()))
    best = int(np.argmin(log_p))
    close = [g for g in np.argsort(log_p) if gains[g] >= LOOKALIKE_SHARE * gains[best]]
    trials: dict[str, tuple[float, Effect, Refit]] = {}
    start = in_gauge(twin, whiten, fit).state  # not from where an earlier effect's common delay has run while this one was missing
    for g in close:
        effect = rest[selection.groups[g].name]
        if effect.id in trials or len(trials) >= MOST_LOOKALIKES:
            continue
        effect = sharpened(twin, whiten, fit, effect)
        trial, gauged = _settled(twin, whiten, refit(twin, whiten, [*effects, effect], start))
        # In its gauge: a lag may not win by what its sign and its common part are free to do.
        trials[effect.id] = (gauged.chi_square + effect.parameter.size * np.log(len(fit.r)), effect, trial)
    _, effect, trial = min(trials.values(), key=lambda item: item[0])
    return effect, trial


def _settled(twin: Twin, whiten: Whitener, fit: Refit) -> tuple[Refit, Refit]:
    """A fit and the same in its gauge.  A delay that all axes share is a direction that is hardly seen: a search that has run far along it
    stands where the columns no longer point down, and goes on from the gauge."""
    gauged = in_gauge(twin, whiten, fit)
    if gauged.chi_square > fit.chi_square - ENOUGH:
        return fit, gauged
    again = refit(twin, whiten, [claim.effect for claim in fit.state.claims], gauged.state)
    return again, in_gauge(twin, whiten, again)


def sharpened(twin: Twin, whiten: Whitener, fit: Refit, effect: Effect) -> Effect:
    """A scanned shape between its neighbours on the coarse grid, found on finer and finer ones."""
    if effect.scan is None:
        return effect
    values = scanned(twin, effect)
    at = effect.shape[effect.scan.name] * effect.scan.si
    reach = float(np.median(np.diff(values))) if effect.scan.grid is None else _spacing(values, at)
    for _ in range(3):
        at = effect.shape[effect.scan.name] * effect.scan.si
        trials = effect.variants(np.linspace(at - reach, at + reach, 15))
        gains = selection_of(twin, whiten, fit, trials, 0).gains(fit.r)
        effect = trials[max(gains, key=gains.__getitem__)]
        reach /= 6
    return effect


def _spacing(values: np.ndarray, at: float) -> float:
    """To the farther neighbour of a value on its grid, but never so far as zero: what is searched keeps its sign."""
    number = int(np.argmin(np.abs(values - at)))
    reach = float(np.max(np.abs(np.delete(values, number)[max(number - 1, 0) : number + 1] - at), initial=0.0))
    return min(reach, 0.9 * abs(at)) if at else reach


def _sharpened_again(twin: Twin, whiten: Whitener, effects: list[Effect], fit: Refit) -> tuple[list[Effect], Refit]:
    """The shapes of the earlier effects, found while the latest was still in their way, once more with it in the fit."""
    for number, effect in enumerate(effects[:-1]):
        if effect.scan is None:
            continue
        others = refit(twin, whiten, [other for other in effects if other is not effect], fit.state)
        trials = [*effects[:number], sharpened(twin, whiten, others, effect), *effects[number + 1 :]]
        trial = refit(twin, whiten, trials, fit.state)
        if trial.chi_square < fit.chi_square - ENOUGH:
            effects, fit = trials, trial
    return effects, fit


def _without_idle(twin: Twin, whiten: Whitener, effects: list[Effect], fit: Refit) -> tuple[list[Effect], Refit]:
    """Drop an earlier effect that the latest one has made needless: without it chi-square rises by no more than its parameters may."""
    from scipy.stats import chi2

    for effect in effects[:-1]:
        fewer = [other for other in effects if other is not effect]
        without = refit(twin, whiten, fewer, fit.state)
        if without.chi_square - fit.chi_square < chi2.isf(LATER_FAMILY_WISE, effect.parameter.size):
            return fewer, without
    return effects, fit


def _replacements(
    twin: Twin, whiten: Whitener, effects: list[Effect], effect: Effect, fit: Refit, tried: list[Effect], seed: int
) -> list[tuple[Effect, Refit]]:
    """Candidates that may replace an effect by their linear gain, each refitted exactly, with the fit in its gauge."""
    others = [other for other in effects if other is not effect]
    ids = {other.id for other in effects}
    base = refit(twin, whiten, others, fit.state)
    rest = [candidate for candidate in tried if candidate.id not in ids]
    selection = selection_of(twin, whiten, base, rest, seed)
    gains = selection.gains(base.r)
    bar = 0.9 * (base.chi_square - fit.chi_square) - STAND_IN
    found: dict[str, tuple[Effect, Refit]] = {}
    for number in sorted(gains, key=gains.__getitem__, reverse=True):
        candidate = rest[number]
        if gains[number] < bar or candidate.id in found or len(found) >= MOST_LOOKALIKES:
            continue
        candidate = sharpened(twin, whiten, base, candidate)
        found[candidate.id] = candidate, in_gauge(twin, whiten, refit(twin, whiten, [*others, candidate], base.state))
    return list(found.values())


def _exchanged(
    twin: Twin,
    whiten: Whitener,
    effects: list[Effect],
    fit: Refit,
    tried: list[Effect],
    seed: int,
    named: dict[str, tuple[float, float]],
) -> tuple[list[Effect], Refit, list[list[tuple[Effect, Refit]]], dict[str, tuple[float, float]]]:
    """An effect that was named while others were still in the way gives place to a lookalike that does better beside them, by Schwarz's
    criterion; at last effects, fit, each effect's replacements, and p-value and gain by id."""

    def score(each: Refit, effect: Effect) -> float:
        return each.chi_square + effect.parameter.size * np.log(len(each.r))

    named = dict(named)
    for rounds in range(MOST_EFFECTS + 1):
        trials = [_replacements(twin, whiten, effects, effect, fit, tried, seed) for effect in effects]
        own = in_gauge(twin, whiten, fit)
        # An effect alone was chosen among its lookalikes so already.
        swaps = [
            (score(trial, candidate) - score(own, effect), number, candidate, trial)
            for number, (effect, found) in enumerate(zip(effects, trials, strict=True))
            for candidate, trial in found
            if len(effects) > 1 and rounds < MOST_EFFECTS and score(trial, candidate) < score(own, effect) - ENOUGH
        ]
        if not swaps:
            break
        _, number, candidate, trial = min(swaps, key=lambda swap: swap[0])
        p_value, gain = named.pop(effects[number].id)
        named[candidate.id] = p_value, gain + fit.chi_square - trial.chi_square
        effects = [*effects[:number], candidate, *effects[number + 1 :]]
        fit = refit(twin, whiten, effects, trial.state)
    return effects, fit, trials, named


def _stand_ins(twin: Twin, whiten: Whitener, fit: Refit, trials: list[tuple[Effect, Refit]]) -> tuple[str, ...]:
    """The replacements that cost less than ``STAND_IN`` in chi-square."""
    bar = in_gauge(twin, whiten, fit).chi_square + STAND_IN
    return tuple(candidate.id for candidate, trial in trials if trial.chi_square < bar)
