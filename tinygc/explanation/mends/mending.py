"""What the registers and the stills themselves tell, found and mended before anything is fitted to what is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from session.common.errors import CalibrationError
from session.common.units import DEG
from session.detect.clipping import FALSE_ALARM
from session.detect.segments import Segment
from session.detect.session_stills import SessionStills
from session.detect.stills import CREEP_SIGMAS
from session.log.folder import Session
from session.log.logfile import Log
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles
from tinygc.explanation.mends import interpolation, lost_samples, plateaus
from tinygc.explanation.mends.ceilings import ReachedCeiling, find_ceiling
from tinygc.explanation.mends.false_readings import find_glitches, without_glitches
from tinygc.explanation.twin.refit import refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.problem.build import build_problem
from tinygc.problem.problem import Problem
from tinygc.problem.rejections import CLIPPED, LEFT_OUT

#: chi-square per missing-sample parameter that a loss must save: a chance of some 10^-9
SURE = 40.0
LONGEST_LOSS_S = 0.5  #: (not critical: benchmarks/thresholds.py)
#: segments without a loss from which a linear model can be had: twice as many angles as it has parameters
FEWEST_WHOLE = 12
#: share to which a level in the registers is known: three steps of 17.5 mdps at the least ceiling that is looked for, 25 dps
LEVEL_KNOWN = 0.002
#: segments with plateaus that miss by so many times what the others do were clipped: a tenth of a degree of a turn is enough
#: (not critical: benchmarks/thresholds.py)
PLATEAU_EXCESS = 10.0
#: a still that turns about the vertical shows only in the gyro: its rate must stand out by this much from stills that agree
#: (not critical: benchmarks/thresholds.py)
OUTLIER_SIGMAS = 10.0
#: and lie within 18 degrees of it
VERTICAL = 3.0
#: found by a detector, which gives the chance of its bar and no smaller one
FROM_THE_BAR = frozenset({"gyro.saturation", "data.glitches", "reference.not_still"})


@dataclass(frozen=True, eq=False)
class Mended:
    """problem: what is left to explain; found: effect id -> parameters for the JSON, with their std, in people's units; p_value: effect
    id -> upper bound of the chance that noise alone passes the finder's bar in this recording; misfit: chi-square of the closure
    before, 0 where nothing was mended."""

    problem: Problem
    found: dict[str, tuple[dict, dict]]
    p_value: dict[str, float]
    misfit: float = 0.0


@dataclass(frozen=True)
class Gap:
    """Where samples were put back: log, row of the first, and the rotation (rad per axis) that nobody can know."""

    log: int
    row: int
    missed_rad: float


def mend(problem: Problem, progress: Callable[[str], None] = lambda what: None) -> Mended:
    """Look at clipping, false readings, losses and creeping stills, in this order; each is mended before the next is looked for."""
    found: dict[str, tuple[dict, dict]] = {}
    chances: dict[str, float] = {}
    original = problem
    progress("registers")
    problem = _without_clipped(problem, found, chances)
    problem = _without_glitches(problem, found, chances)
    problem, gaps = _with_lost(problem, found, chances)
    progress("stills")
    problem = _with_gaps(_without_creeping(problem, found, chances), gaps)
    return Mended(problem, found, chances, _misfit(original) if found else 0.0)


def _misfit(problem: Problem) -> float:
    """Chi-square of the closure."""
    return float(np.sum((closure_angles(problem.batch, problem.first) / problem.floor.sigma) ** 2))


def _with_logs(session: Session, logs: list[Log]) -> Session:
    return replace(session, logs=tuple(logs))


def _without_clipped(problem: Problem, found: dict, chances: dict) -> Problem:
    """Leave out the segments in which a rate stands at a level."""
    full_scale = problem.session.config.sensor.gyro_fs_dps * DEG
    ceilings = [find_ceiling(log.samples, full_scale) for log in problem.logs]
    known_to, chance = LEVEL_KNOWN, 6 * len(ceilings) * FALSE_ALARM
    if not any(ceilings):
        known_to = plateaus.SAME  # the linear errors came after
        chance = float(chi2.sf(_misfit(problem), problem.floor.sigma.size))
        ceilings = [plateaus.find_plateaus(log.samples, full_scale) for log in problem.logs]
        if not _do_not_close(problem, _at_a_level(problem, ceilings)):
            return problem
    level = float(np.median([ceiling.level for ceiling in ceilings if ceiling is not None]))
    clipped = _at_a_level(problem, ceilings)
    found["gyro.saturation"] = ({"dps": level / DEG}, {"dps": known_to * level / DEG})
    chances["gyro.saturation"] = min(chance, 1.0)
    try:
        return _again(problem, problem.session, clipped=tuple(clipped))
    except CalibrationError:
        return problem


def _at_a_level(problem: Problem, ceilings: list[ReachedCeiling | None]) -> list[int]:
    """Numbers of the segments that reach a ceiling."""
    return [s.number for s in problem.segments if (c := ceilings[s.log]) is not None and c.mask[s.start : s.stop].any()]


def _do_not_close(problem: Problem, numbers: list[int]) -> bool:
    """Whether these segments close far worse than the others, by the linear model of the others (or of all, where those are few)."""
    hit = np.isin([segment.number for segment in problem.used], numbers)
    if not hit.any():
        return False
    own = ~hit if (~hit).sum() >= FEWEST_WHOLE else np.ones_like(hit)
    sigma = problem.floor.sigma
    model = fit_least_squares(problem.batch.pick(own), sigma[own], problem.first).model
    excess = np.sqrt(np.mean((closure_angles(problem.batch, model) / sigma) ** 2, axis=1))
    return bool(np.median(excess[hit]) > PLATEAU_EXCESS * (1 if own.all() else max(1.0, np.median(excess[~hit]))))


def _without_glitches(problem: Problem, found: dict, chances: dict) -> Problem:
    rows, lengths, logs, before = [], [], [], 0
    for log in problem.session.logs:
        glitches = find_glitches(log.samples)
        if glitches is not None:
            rows += (glitches.rows + before).tolist()
            lengths += glitches.samples.tolist()
            log = replace(log, samples=without_glitches(log.samples, glitches))
        before += len(log.samples)
        logs.append(log)
    if not rows:
        return problem
    found["data.glitches"] = ({"at": rows, "samples": int(np.median(lengths))}, {})  # counted, not measured: no std
    chances["data.glitches"] = min(1.0, before * float(chi2.sf(lost_samples.JUMP**2, 6)))
    return _again(problem, _with_logs(problem.session, logs))


def _again(problem: Problem, session: Session, *, clipped: tuple[int, ...] = (), moving: tuple[int, ...] = ()) -> Problem:
    """The problem of a mended session, or with clipped segments or moving stills, without what was left out before."""
    out = {why: [segment for segment in problem.segments if segment.problem == why] for why in (LEFT_OUT, CLIPPED)}
    found = SessionStills(session, problem.found)
    if moving:  # a still less joins two turns, and shifts the numbers behind it
        segments = build_problem(session, use_earth=False, moving=moving, found=found).segments
        out = {why: [new for new in segments if any(_inside(old, new) for old in gone)] for why, gone in out.items()}
    asked, at_level = (tuple(segment.number for segment in out[why]) for why in (LEFT_OUT, CLIPPED))
    use_earth = problem.earth.source != "none"
    return build_problem(session, use_earth=use_earth, exclude=asked, clipped=clipped + at_level, moving=moving, found=found)


def _inside(old: Segment, new: Segment) -> bool:
    return old.log == new.log and new.start <= (old.start + old.stop) // 2 < new.stop


def _with_lost(problem: Problem, found: dict, chances: dict) -> tuple[Problem, list[Gap]]:
    """Put lost samples back where there is a step in all channels, if that closes the segments."""
    at = []
    for log in problem.session.logs:
        samples = problem.session.calibrated(log)
        at.append(lost_samples.find_losses(lost_samples.find_jumps(samples), samples.duration_s))
    if not sum(map(len, at)):
        return problem, []
    count, gain = _lost_count(problem, at)
    if count < 1 or gain < SURE:
        return problem, []
    logs, times, gaps, began = [], [], [], 0.0
    for number, (log, rows) in enumerate(zip(problem.session.logs, at, strict=True)):
        period_s = log.samples.period_s
        times += [began + log.samples.t_s[row] + i * count * period_s for i, row in enumerate(rows)]
        if len(rows):
            order, missed_rad = interpolation.best_order(log.samples, rows, count)
            gaps += [Gap(number, int(row) + 1 + i * count, missed_rad) for i, row in enumerate(rows)]
            log = replace(log, samples=lost_samples.with_lost(log.samples, rows, count, order))
        logs.append(log)
        began += log.samples.duration_s  # with what was put back
    tried = LONGEST_LOSS_S / float(np.median([log.samples.period_s for log in problem.session.logs]))
    chances["timing.dropped_samples"] = min(1.0, tried * float(chi2.sf(gain, 1)))
    found["timing.dropped_samples"] = (
        {"at_s": [round(float(time), 3) for time in times], "length": count},
        {"length": 0.5},
    )  # whole samples: half a step
    return _again(problem, _with_logs(problem.session, logs)), gaps


def _with_gaps(problem: Problem, gaps: list[Gap]) -> Problem:
    """The floor of each segment, wider by what its gaps may hide."""
    if not gaps:
        return problem
    added = [sum(gap.missed_rad**2 for gap in gaps if gap.log == s.log and s.start <= gap.row < s.stop) for s in problem.used]
    own = problem.floor.own + np.array(added)[:, None, None] * np.eye(problem.batch.angles)
    return replace(problem, floor=replace(problem.floor, own=own))


def _lost_count(problem: Problem, at: list[np.ndarray]) -> tuple[int, float]:
    """How many samples were lost each time, from the closure, and the chi-square that putting them back saves.

    For this search a loss is one long step; the linear model is the one that the segments without a loss ask for.
    """
    batch, sigma = problem.batch, problem.floor.sigma
    steps = [[int(row) - segment.start for row in at[segment.log] if segment.start <= row < segment.stop - 1] for segment in problem.used]
    hit = np.array([bool(inside) for inside in steps])
    if not hit.any():
        return 0, 0.0
    period_s = float(np.median([log.samples.period_s for log in problem.session.logs]))
    whole = (~hit).sum() >= FEWEST_WHOLE
    tried = hit if whole else np.ones_like(hit)
    model = fit_least_squares(batch.pick(~hit), sigma[~hit], problem.first).model if whole else None
    part, weight = batch.pick(tried), 1 / sigma[tried]
    inside_of = [inside for inside, look in zip(steps, tried, strict=True) if look]

    def cost(count: int) -> float:
        dt = part.dt.copy()
        for row, inside in zip(dt, inside_of, strict=True):
            row[inside] += count * period_s
        trial = replace(part, dt=dt)
        # Where too few segments are whole, each count is given the model that suits it best; an absurd one has none.
        try:
            fitted = model or fit_least_squares(trial, sigma, problem.first).model
        except CalibrationError:
            return np.inf
        angles = closure.error_angles(closure.segment_residuals(trial, fitted(trial.rate)))
        return float(np.sum((angles * weight) ** 2))

    return _lowest(cost, round(LONGEST_LOSS_S / period_s))


def _lowest(cost: Callable[[int], float], most: int) -> tuple[int, float]:
    """The count of 0 … most with the lowest cost, a valley, and what it saves against 0: coarse steps first, then all between."""
    step = max(1, most // 16)
    costs = {count: cost(count) for count in range(0, most + 1, step)}
    best = min(costs, key=costs.__getitem__)
    costs |= {count: cost(count) for count in range(max(best - step + 1, 0), min(best + step, most + 1)) if count not in costs}
    best = min(costs, key=costs.__getitem__)
    return best, costs[0] - costs[best]


def _without_creeping(problem: Problem, found: dict, chances: dict) -> Problem:
    """Stills in which gravity moves were found by the detector; those that turn about the vertical stand out by their rate."""
    numbers = [i for i, still in enumerate(problem.stills) if still.problem is not None]
    if not numbers:
        return problem
    turning = _about_the_vertical(problem)
    found["reference.not_still"] = ({"stills": sorted(numbers + turning)}, {})
    chances["reference.not_still"] = min(1.0, len(problem.stills) * float(chi2.sf(CREEP_SIGMAS**2, 3)))
    if not turning:
        return problem
    return _again(problem, problem.session, moving=tuple(turning))


def _about_the_vertical(problem: Problem) -> list[int]:
    """Numbers of the stills whose rate stands out from the others', along gravity."""
    twin = Twin(problem)
    whiten = Whitener(twin)
    reference = [i for i, still in enumerate(problem.stills) if still.problem is None]
    still_rows = np.arange(whiten.parts["still"].start, whiten.parts["still"].stop).reshape(-1, 3)
    good = np.ones(len(reference), dtype=bool)
    fit = None
    for _ in range(8):
        rows = np.ones(whiten.parts["length"].stop, dtype=bool)
        rows[still_rows[~good].ravel()] = False
        fit = refit(twin, whiten, [], fit.state if fit else twin.start(), rows=rows, max_steps=4)
        rate = twin.residuals(fit.state, fit.rates).still
        spread = np.median(np.linalg.norm(rate, axis=1)) / 1.54
        size = np.linalg.norm(rate, axis=1) / max(spread, 1e-12)
        now = size < OUTLIER_SIGMAS
        if (now == good).all() or now.sum() < len(now) / 2:
            break
        good = now
    in_table = np.einsum("qij,qj->qi", rotation.matrix(twin.q_tb), rate)
    vertical = np.abs(in_table[:, 2]) > VERTICAL * np.linalg.norm(in_table[:, :2], axis=1)
    return [number for number, fine, along in zip(reference, good, vertical, strict=True) if not fine and along]
