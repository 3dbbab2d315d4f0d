"""Search for the hypothesis with the most evidence, its detection limits, and what is left without a name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from session.base.progress import Reporter, no_report
from session.base.units import DEG, EARTH_RATE_RPS
from tinygc.closure.earth import EarthRate
from tinygc.effects import Effect, Movement, Parameter, Reach, Scan, diagonal, per_axis, without_vibration
from tinygc.effects.effect import WORLD
from tinygc.effects.movement import HAND_S, NOWHERE
from tinygc.explanation.evidence import Evidence, Guess, Hypothesis, sharpened, without_claim
from tinygc.inference.choose import climb, least_gain, promised
from tinygc.inference.solve import left_of, orthonormal
from tinygc.noise.refit import Refit, Replay, candidates
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import TOGETHER, Whitener

# Search for the hypothesis with the most evidence, and the detection limits of all other effects.

# The search for the hypothesis with the most evidence: forward, with elimination and exchange after every step, and a beam.
#
# Candidates are ranked by a linear approximation under two noise estimates: the prior one and that of the present hypothesis. The former
# shows what a noise component has absorbed, the latter a weak effect.  The best are refitted exactly.

MOST_EFFECTS = 5  #: each costs a round (benchmarks/whole_process.py)
#: candidates evaluated in each round, from either ranking
MOST_TRIALS = 3
#: -2 log evidence within which a hypothesis is extended further, and a competing effect is evaluated
WITHIN = 12.0
BEAM = 2
#: error of -2 log evidence from linear columns; hypotheses evaluated exactly in a round
NEAR, MOST_EXACT = 8.0, 3
#: relative error of a gain from linear columns; competing effects evaluated in place of an effect
LINEAR_SHARE, MOST_LOOKALIKES = 0.1, 4


def search(
    evidence: Evidence,
    tried: list[Effect],
    begin: Hypothesis,
    most: int = MOST_EFFECTS,
    progress: Reporter = no_report,
) -> Hypothesis:
    """Find the hypothesis with the most evidence that can be reached from ``begin``."""
    evidence.will_try(tried)
    best, beam = begin, [begin]
    for number in range(most):
        progress(f"naming, round {number + 1}")
        found = [trial for each in beam for trial in _with_one_more(evidence, tried, each)]
        if not found:
            break
        found.sort(key=lambda h: h.score)
        ahead = resharpened(evidence, without_idle(evidence, found[0]))
        if ahead.score >= best.score:
            break
        best = ahead
        beam = [best, *(h for h in found[1:BEAM] if h.score < best.score + WITHIN and h.ids != best.ids)]
    return best


def ranked(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Effect]:
    """Candidates to add to a hypothesis, each effect once, at its best shape."""
    rest = [effect for effect in tried if effect.id not in have.ids]
    found: dict[str, Effect] = {}
    replay = Replay(evidence.twin, have.fit)
    looks = [(whiten, rewhitened(have, whiten)) for whiten in (evidence.first_whiten, have.whiten)]
    for (whiten, fit), promise in zip(looks, promises(evidence, looks, rest), strict=True):
        found |= _most_promising(evidence, (whiten, fit, replay), rest, promise, 0.0, MOST_TRIALS, found)
    return list(found.values())


def _most_promising(
    evidence: Evidence,
    fitted: tuple[Whitener, Refit, Replay],
    rest: list[Effect],
    promise: np.ndarray,
    least: float,
    most: int,
    known: Mapping[str, Effect],
) -> dict[str, Effect]:
    """Up to ``most`` new candidates with the greatest promise, each at least ``least``; each once, at its best shape."""
    found: dict[str, Effect] = {}
    for number in np.argsort(-promise):
        if promise[number] < least or len(found) >= most:
            break
        effect = rest[number]
        key = effect.id if effect.scan is not None else effect.equation
        if key not in found and key not in known:
            whiten, fit, replay = fitted
            found[key] = sharpened(evidence.twin, whiten, fit, effect, replay)
    return found


def promises(evidence: Evidence, looks: list[tuple[Whitener, Refit]], rest: list[Effect]) -> np.ndarray:
    """(len(looks), len(rest)) twice the log evidence that each candidate would add by its linear columns, for each fit and its whitening,
    with the noise fixed.  Columns are computed once for all fits."""
    found = np.empty((len(looks), len(rest)))
    left = []
    for _, fit in looks:
        q = orthonormal(fit.J)
        left.append((q, fit.r - q @ (q.T @ fit.r)))
    for first in range(0, len(rest), TOGETHER):
        some = rest[first : first + TOGETHER]
        stacked = [evidence.columns(effect) for effect in some]
        for look, ((whiten, _), (q, r)) in enumerate(zip(looks, left, strict=True)):
            for number, (effect, columns) in enumerate(zip(some, whiten.each(stacked), strict=True), first):
                basis = left_of(q, columns)
                gain = float(np.sum((basis.T @ r) ** 2))
                found[look, number] = promised(gain, max(basis.shape[1], 1)) - evidence.price(effect)
    return found


def rewhitened(have: Hypothesis, whiten: Whitener) -> Refit:
    """The fit of a hypothesis whitened with another covariance."""
    if whiten is have.whiten:
        return have.fit
    return replace(have.fit, r=whiten(have.whiten.back(have.fit.r)), J=whiten(have.whiten.back(have.fit.J)))


def _with_one_more(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Hypothesis]:
    """The best hypotheses with one more effect: the best by linear columns and those near it, evaluated exactly."""
    found = guesses(evidence, tried, have)
    near = [g for g in found[:MOST_EXACT] if g.score < found[0].score + NEAR]
    if any(_delays(g.effects[-1]) for g in near):
        near += [g for g in found if _delays(g.effects[-1]) and g not in near]
    return [evidence.of(g.effects, have) for g in near]


def _delays(effect: Effect) -> bool:
    """Whether an effect is a delay, which linear columns rank poorly: they miss the curvature of a long delay and cannot separate two."""
    return effect.gauge_convention is not None and bool(effect.gauge_convention.delays)


def guesses(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Guess]:
    """Approximate hypotheses with each ranked candidate added, by linear columns, the best first."""
    evidence.will_try(tried)
    return sorted((evidence.guess(have, add=effect) for effect in ranked(evidence, tried, have)), key=lambda g: g.score)


def without_idle(evidence: Evidence, best: Hypothesis) -> Hypothesis:
    """Remove effects that others have made redundant."""

    def fewer(have: Hypothesis) -> list[Hypothesis]:
        several = sum(map(_delays, have.effects)) > 1  # delays can replace one another
        without = [(effect, evidence.guess(have, without=effect)) for effect in have.effects if len(have.effects) > 1]
        near = [guess for effect, guess in without if guess.score < have.score + NEAR / 2 or (several and _delays(effect))]
        return [evidence.of(guess.effects, have) for guess in near]

    return climb(best, fewer)


def resharpened(evidence: Evidence, best: Hypothesis) -> Hypothesis:
    """Search each scanned shape again with the other effects: found with fewer, the time of a step bends towards what they explain.
    Shapes on which an effect depends smoothly are fitted with all else (``refit``)."""
    for number, effect in enumerate(best.effects):
        if len(best.effects) < 2 or effect.scan is None or effect.scan.smooth:
            continue
        fit = without_claim(best.fit, number)
        again = sharpened(evidence.twin, best.whiten, fit, effect, Replay(evidence.twin, best.fit))
        effects = tuple(again if other is effect else other for other in best.effects)
        best = min(best, evidence.of(effects, best), key=lambda h: h.score)
    return best


def exchanged(evidence: Evidence, tried: list[Effect], best: Hypothesis) -> Hypothesis:
    """Try to replace each effect by others that fit in its place; an effect named before others were found may thus be removed."""
    for _ in range(MOST_EFFECTS):
        trials = []
        for effect in best.effects:
            own = evidence.guess(best, without=effect).score - best.score
            for other in in_place_of(evidence, tried, best, effect, own):
                guess = evidence.guess(best, without=effect, add=other)
                if guess.score < best.score + NEAR or (_delays(effect) and _delays(other)):
                    trials.append(evidence.of(guess.effects, best))
        ahead = min([*trials, best], key=lambda h: h.score)
        if ahead is best:
            break
        best = resharpened(evidence, without_idle(evidence, ahead))
    return best


def in_place_of(evidence: Evidence, tried: list[Effect], best: Hypothesis, effect: Effect, own: float) -> list[Effect]:
    """Candidates whose linear columns remove nearly as much as an effect worth ``own`` in -2 log evidence."""
    whiten, number = best.whiten, next(i for i, e in enumerate(best.effects) if e is effect)
    fit = without_claim(best.fit, number)
    others = best.ids - {effect.id}
    rest = [other for other in tried if other.id not in others and other is not effect and (other.id != effect.id or other.scan is None)]
    looks, replay = [(whiten, fit)], Replay(evidence.twin, fit)
    (promise,), ((mine,),) = promises(evidence, looks, rest), promises(evidence, looks, [effect])
    least = max(mine - WITHIN - LINEAR_SHARE * abs(mine), 0)
    return list(_most_promising(evidence, (whiten, fit, replay), rest, promise, least, MOST_LOOKALIKES, {}).values())


# Detection limits: the size from which each effect would have been detected in this recording.


def detection_limits(twin: Twin, whiten: Whitener, fit: Refit, replay: Replay | None = None) -> dict[str, float]:
    """Effect id -> detection limit in the parameter's unit, for half of the effect's directions; inf if no plausible size would be
    detected.

    An effect is detected if it is more probable than no effect (``evidence.least_gain``).  An effect with a scanned shape (a step) is taken
    at the value that shows it best.  Linear, in addition to everything in ``fit``; replay: of it, if available.
    """
    q, sizes = orthonormal(fit.J), dict[str, float]()
    tried, replay = [effect for effect in candidates(twin) if effect not in twin.errors], replay or Replay(twin, fit)
    shapes = Counter(effect.id for effect in tried)
    for effect, columns in zip(tried, whiten.each(map(replay.stacked, tried)), strict=True):
        left, plausible = columns - q @ (q.T @ columns), effect.parameter.plausible
        # Use the median: the part of a delay common to all axes belongs to the clock and is hardly observable in any recording.
        strength = float(np.median(np.linalg.svd(left * plausible, compute_uv=False)))
        sigmas = float(np.sqrt(least_gain(effect.parameter.size, shapes[effect.id])))
        size = sigmas / strength * plausible / effect.parameter.si if strength > sigmas else np.inf
        sizes[effect.id] = min(size, sizes.get(effect.id, np.inf))
    return sizes


# The probability of each effect and of its competitors.


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """One effect with its family-wise p-value, the chi-square it removes, its probability, its equivalents, and the probability of every
    competing effect that was evaluated, by id."""

    effect: Effect
    p_value: float
    gain: float
    probability: float
    equivalent: tuple[str, ...] = ()
    rivals: dict[str, float] = field(default_factory=dict)


# Beyond the catalogue: shapes without a physical cause.
#
# Each finding is a family of columns like an effect's, but without physics: a line in time, a direction fixed in the world, a smooth curve
# over attitude, time, temperature or rate, two axes that move together.  It shows where the misfit occurs, not its cause.

#: prefix of the ids of shapes without a name
NAMELESS = "unknown."
#: orders of the smooth curves
ORDERS = (2, 3, 4, 5)
#: number of settling time constants tried: neighbours differ by about half of their value, and are refined
WARM_UPS = 10
#: powers of the rate, each with whether it changes sign with the rate
RATE_POWERS = ((1.5, True), (2, False), (2, True), (5, True))
#: marks those that do in the equation
SIGNED = "sign(ω_i)"
#: scale of a prior, not a limit: beyond the zero-rate level of any good part (3 dps)
PLAUSIBLE_RPS = 5 * DEG
#: degC, least change of temperature: at a data sheet's 0.005 dps/degC it gives 2.5 mdps, the noise of one still
LEAST_CHANGE_C = 0.5
#: a rate fixed in the world is the Earth's, at another latitude, if its sum with the assumed Earth rate has the Earth's magnitude within
#: this share: 15 deg/h, measured with a bias that wanders by 3
LIKE_THE_EARTH = 0.25
#: and if the latitude differs by more than the stills of a usual session can resolve: directions of the Earth's rate are good to 7 degrees
#: rms (benchmarks/closure_table.py)
ANOTHER_DEG = 10.0
#: limit on the number of lines above the stills' rate, times rows of the session in the twin: some minutes of computing. It admits all
#: lines up to ``HIGHEST_HZ`` for 28 minutes at 208 Hz; for a day, with a quarter of a million lines, one in a hundred
MOST_LINE_ROWS = 2e9
#: highest frequency of a line that is searched for
HIGHEST_HZ = 3.0
#: reach of the force averaged over a hand's movement
HAND_REACH = Reach.around(samples=2, seconds=HAND_S / 2)


#: of a movement (N samples): columns (N, 3, P), curves (N, K), or a variable (N,)
OfMovement = Callable[[Movement], np.ndarray]


def unknown_candidates(twin: Twin) -> list[Effect]:
    """Shapes to try on this recording."""
    # In the stills a line above their rate is aliased; the segments still observe it.
    return slow_candidates(twin) + _lines(_line_frequencies(twin))


def _line_frequencies(twin: Twin) -> np.ndarray:
    """(K,) Hz, increasing from the stills' rate, spaced at the session's resolution; a long session has only the slowest."""
    rows = sum(len(movement.t_s) for movement in twin.movements)
    found = np.arange(0.5 / _interval(twin), HIGHEST_HZ, 1 / twin.movements[0].duration_s)
    return found[: max(int(MOST_LINE_ROWS / rows), 1)]


def lines_end_hz(twin: Twin) -> float | None:
    """Highest line that is searched for, if a long session cannot be searched up to ``HIGHEST_HZ``; None if it can."""
    highest, apart = float(_line_frequencies(twin)[-1]), 1 / twin.movements[0].duration_s
    return highest if highest + apart < HIGHEST_HZ else None


def slow_candidates(twin: Twin) -> list[Effect]:
    """Shapes that follow a slow variable or the movement: all except the hundreds of lines above the stills' rate."""
    duration = twin.movements[0].duration_s
    found = _lines(1 / np.geomspace(duration, 2.2 * _interval(twin), 40))
    found += [_curve("time", "s", lambda m: 2 * m.t_s / m.duration_s - 1, order) for order in ORDERS]
    if twin.has_thermometer:
        low, high = (f([f(movement.temp_c) for movement in twin.movements]) for f in (np.min, np.max))
        if high - low > LEAST_CHANGE_C:
            found += [_curve("temperature", "°C", lambda m: 2 * (m.temp_c - low) / (high - low) - 1, order) for order in ORDERS]
    else:
        found += _warm_ups(np.geomspace(2 * _interval(twin), duration, WARM_UPS))
    found += [_attitude(order) for order in (2, 3)]
    found += [_products(), _field(twin)]
    if twin.problem.earth.source != "none":  # without a known Earth rate the catalogue has an effect for it
        found.append(_world(twin.problem.earth, twin.problem.session.config.site.latitude_deg))
    return found + [_rate_curve(power, odd) for power, odd in RATE_POWERS]


def curves_like(twin: Twin, shape: Effect) -> list[Effect]:
    """All terms of the smooth curve to which a shape belongs, including itself; none if the shape is not such a curve.  Of a warm-up these
    are all time constants, which are fitted."""
    if not any(kind in shape.id for kind in ("curve_over_", "warm_up")):
        return []
    return [other for other in slow_candidates(twin) if other.id == shape.id and (SIGNED in other.equation) == (SIGNED in shape.equation)]


def _interval(twin: Twin) -> float:
    """Seconds between stills."""
    return twin.movements[0].duration_s / max(len(twin.stills), 2)


def _finding(
    name: str,
    equation: str,
    size: int,
    words: str,
    regime: tuple[str, str],
    *,
    columns: OfMovement | None = None,
    basis: OfMovement | None = None,
    inputs: tuple[str, ...] = (),
    reach: Reach = NOWHERE,
) -> Effect:
    """Build a shape from its ``columns`` (N, 3, size), or from the curves (N, K) of a ``basis``, for which each axis has its own
    coefficients; inputs and reach as an ``Effect`` declares them."""
    if columns is None:
        assert basis is not None
        columns = per_axis(basis)
    return Effect(
        id=f"{NAMELESS}{name}",
        equation=equation,
        parameter=Parameter("coefficients_dps", (size,), "dps", DEG, plausible=PLAUSIBLE_RPS),
        observable_in=("still", "turn"),
        columns=columns,
        basis=basis,
        describe=lambda theta: f"{words} (up to {np.abs(theta).max() / DEG:.3f} dps); nothing in the catalogue does this",
        discriminating_motion="repeat the session with this variable changed on purpose, all else alike",
        conditions=regime,
        inputs=inputs,
        reach=reach,
    )


def _lines(frequencies_hz: np.ndarray) -> list[Effect]:
    """Lines at these frequencies, increasing; they can be refined between them."""
    scan = Scan("frequency_hz", "Hz", make=_periodic, grid=lambda movements: frequencies_hz)
    return replace(_periodic(float(frequencies_hz[0])), scan=scan).variants(frequencies_hz) if len(frequencies_hz) else []


def _periodic(frequency_hz: float) -> Effect:
    def basis(movement: Movement) -> np.ndarray:
        phase = 2 * np.pi * frequency_hz * movement.t_s
        return np.stack([np.cos(phase), np.sin(phase)], axis=-1)

    equation = f"ω += a cos(2π f t) + b sin(2π f t), f = {frequency_hz:.4f} Hz"
    words = f"the zero-rate offset oscillates with a period of {1 / frequency_hz:.1f} s"
    return _finding("periodic", equation, 6, words, ("time", "s"), basis=basis, inputs=("time",))


def _warm_ups(seconds: np.ndarray) -> list[Effect]:
    """The zero-rate offset settles like a body that warms up, with these time constants, increasing; for logs without temperature."""
    scan = Scan("time_constant_s", "s", make=_warm_up, grid=lambda movements: seconds)
    return replace(_warm_up(float(seconds[0])), scan=scan).variants(seconds)


def _warm_up(time_constant_s: float) -> Effect:
    def basis(movement: Movement) -> np.ndarray:
        return np.exp(-movement.t_s / time_constant_s)[:, None]

    equation = f"ω += b exp(−t / τ), τ = {time_constant_s:.0f} s"
    words = f"the zero-rate offset settles within some {time_constant_s:.0f} s, as of a sensor that warms up: log its temperature"
    return _finding("warm_up", equation, 3, words, ("time", "s"), basis=basis, inputs=("time",))


def _curve(variable: str, unit: str, scaled: OfMovement, order: int) -> Effect:
    def basis(movement: Movement) -> np.ndarray:
        return np.polynomial.legendre.legvander(np.clip(scaled(movement), -1, 1), order)[:, 1:]

    return _finding(
        f"curve_over_{variable}",
        f"ω += smooth curve of {variable}, Legendre order {order}",
        3 * order,
        f"the zero-rate offset follows {variable} on a curve that is no straight line",
        (variable, unit),
        basis=basis,
        inputs=(variable,),
    )


def _attitude(order: int) -> Effect:
    powers = [p for n in range(2, order + 1) for p in _powers(n)]  # the linear term is g-sensitivity

    def basis(movement: Movement) -> np.ndarray:
        down = without_vibration(movement.force_g, movement.dt_s)  # the square of vibration does not depend on attitude
        to_the = [np.ones_like(down)]
        for _ in range(order):
            to_the.append(to_the[-1] * down)
        found = np.empty((len(down), len(powers)))
        for column, (i, j, k) in zip(found.T, powers, strict=True):
            column[:] = to_the[i][:, 0] * to_the[j][:, 1] * to_the[k][:, 2]
        return found

    return _finding(
        "attitude",
        f"ω += polynomial of the specific force, orders 2 to {order}",
        3 * len(powers),
        "the zero-rate offset depends on attitude in a way that no g-sensitivity has",
        ("attitude", "g"),
        basis=basis,
        inputs=("force",),
        reach=HAND_REACH,
    )


def _powers(order: int) -> list[tuple[int, int, int]]:
    return [(i, j, order - i - j) for i in range(order + 1) for j in range(order + 1 - i)]


def _world(earth: EarthRate, latitude_deg: float | None) -> Effect:
    def describe(theta: np.ndarray) -> str:
        whole = earth.rate_t + theta
        seen = -np.arcsin(whole[2] / np.linalg.norm(whole)) / DEG
        as_long = abs(np.linalg.norm(whole) / EARTH_RATE_RPS - 1) < LIKE_THE_EARTH
        if latitude_deg is not None and as_long and abs(seen - latitude_deg) > ANOTHER_DEG:
            return (
                f"the stills turn with the Earth at a latitude of about {seen:.0f} deg, session.toml has {latitude_deg:g}: "
                "look at site.latitude_deg and its sign (south is negative)"
            )
        return f"{np.linalg.norm(theta) / DEG:.4f} dps is fixed in the world beyond the Earth's: does the table turn?"

    return Effect(
        id="unknown.world_direction",
        equation="ω += R_bt w, w fixed in the table's frame",
        parameter=Parameter("rate_dps", (3,), "dps", DEG, plausible=PLAUSIBLE_RPS),
        observable_in=("still",),
        kind="earth",
        columns=lambda movement: np.zeros((*movement.rate.shape, 3)),
        describe=describe,
        discriminating_motion="correct site.latitude_deg in session.toml; if it is right, record stills with each axis up and down "
        "and pointing each way",
        conditions=("attitude", "g"),
        picture=WORLD,
    )


def _field(twin: Twin) -> Effect:
    """A field fixed in the world, such as a magnet's, to which each axis responds differently; its vertical part looks like
    g-sensitivity."""
    began = {float(movement.t_s[0]): number for number, movement in enumerate(twin.movements)}

    def basis(movement: Movement) -> np.ndarray:
        return twin.level_axes[began[float(movement.t_s[0])]]

    words = "the zero-rate offset follows a level direction that is fixed in the world: a magnetic field, a draught, the sun"
    return _finding(
        "world_field", "ω += K n, n two level directions fixed in the table", 18, words, ("attitude", "g"), basis=basis, inputs=("time",)
    )


def _rate_curve(power: float, odd: bool) -> Effect:
    def columns(movement: Movement) -> np.ndarray:
        u = movement.rate / movement.fs_rps
        return diagonal(movement.fs_rps * (np.sign(u) if odd else 1.0) * np.abs(u) ** power)

    shape = f"{SIGNED} |ω_i / FS|^{power:g}" if odd else f"|ω_i / FS|^{power:g}"
    return _finding(
        "curve_over_rate",
        f"ω_i += c_i FS {shape}",
        3,
        f"the {'scale' if odd else 'zero'} bends with the rate, like {shape}",
        ("rate", "dps"),
        columns=columns,
    )


def _products() -> Effect:
    def columns(movement: Movement) -> np.ndarray:
        w = movement.rate / movement.fs_rps
        return np.concatenate([diagonal(movement.fs_rps * w[:, i] * w[:, j]) for i, j in combinations(range(3), 2)], axis=-1)

    return _finding(
        "rate_products",
        "ω += C (ω_x ω_y, ω_x ω_z, ω_y ω_z) / FS",
        9,
        "two axes that turn together make a third read",
        ("rate", "dps"),
        columns=columns,
    )
