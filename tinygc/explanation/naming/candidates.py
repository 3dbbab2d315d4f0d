"""What can be tried on a recording, and where a scanned shape stands best."""

from __future__ import annotations

import numpy as np

from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.selection import Selection
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: a shape is scanned over so many values, and sharpened between them: more would make the work grow with the session's square
#: (benchmarks/explain_speed.py)
MOST_TIMES = 60


def candidates(twin: Twin) -> list[Effect]:
    """What can be tried on this recording; an effect with a scanned shape gives one candidate for each value."""
    has_temp = all(np.isfinite(movement.temp_c).all() for movement in twin.movements)
    found = []
    for effect in catalogue().values():
        if effect.kind in ("register", "motion") or ("temperature" in effect.inputs and not has_temp):
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


def selection_of(twin: Twin, whiten: Whitener, fit: Refit, rest: list[Effect], seed: int, replay: Replay | None = None) -> Selection[int]:
    """The candidates' columns, whitened, against what the fit already has.  replay: of the fit, where somebody has it already."""
    replay = replay or Replay(twin, fit)
    stacked = (replay.columns(effect).stacked() for effect in rest)
    columns = dict(enumerate(whiten.each(stacked)))
    along = frozenset(number for number, effect in enumerate(rest) if effect.kind == "force")
    # An angle that no reference sees is 0 whatever the noise, and tells nothing of its scale.
    rows = np.concatenate([np.flatnonzero(twin.batch.known), np.arange(whiten.parts["still"].start, whiten.parts["still"].stop)])
    return Selection(fit.J, columns, seed, allowances=whiten.allowances, scale_rows=rows, along=along)


def sharpened(twin: Twin, whiten: Whitener, fit: Refit, effect: Effect, replay: Replay) -> Effect:
    """A scanned shape between its neighbours on the coarse grid, found on finer and finer ones; replay: of the fit."""
    if effect.scan is None:
        return effect
    values = scanned(twin, effect)
    at = effect.shape[effect.scan.name] * effect.scan.si
    reach = float(np.median(np.diff(values))) if effect.scan.grid is None else _spacing(values, at)
    for _ in range(3):
        at = effect.shape[effect.scan.name] * effect.scan.si
        trials = effect.variants(np.linspace(at - reach, at + reach, 15))
        gains = selection_of(twin, whiten, fit, trials, 0, replay).gains(fit.r)
        if not gains:  # between its neighbours nothing of it is seen beside what is fitted already
            return effect
        effect = trials[max(gains, key=gains.__getitem__)]
        reach /= 6
    return effect


def _spacing(values: np.ndarray, at: float) -> float:
    """To the farther neighbour of a value on its grid, but never so far as zero: what is searched keeps its sign."""
    number = int(np.argmin(np.abs(values - at)))
    reach = float(np.max(np.abs(np.delete(values, number)[max(number - 1, 0) : number + 1] - at), initial=0.0))
    return min(reach, 0.9 * abs(at)) if at else reach
