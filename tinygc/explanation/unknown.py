"""Beyond the catalogue: shapes without a physical cause.

Each finding is a family of columns like an effect's, but without physics: a line in time, a direction fixed in the world, a smooth curve
over attitude, time, temperature or rate, two axes that move together.  It shows where the misfit occurs, not its cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from session.io.units import DEG, EARTH_RATE_RPS
from tinygc.attitude.earth import EarthRate
from tinygc.effects import Effect, Movement, Parameter, Reach, Scan, diagonal, per_axis, without_vibration
from tinygc.effects.effect import WORLD
from tinygc.effects.movement import HAND_S, NOWHERE
from tinygc.noise.twin import Twin

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
    return slow_candidates(twin) + _lines(line_frequencies(twin))


def line_frequencies(twin: Twin) -> np.ndarray:
    """(K,) Hz, increasing from the stills' rate, spaced at the session's resolution; a long session has only the slowest."""
    rows = sum(len(movement.t_s) for movement in twin.movements)
    found = np.arange(0.5 / _interval(twin), HIGHEST_HZ, 1 / twin.movements[0].duration_s)
    return found[: max(int(MOST_LINE_ROWS / rows), 1)]


def lines_end_hz(twin: Twin) -> float | None:
    """Highest line that is searched for, if a long session cannot be searched up to ``HIGHEST_HZ``; None if it can."""
    highest, apart = float(line_frequencies(twin)[-1]), 1 / twin.movements[0].duration_s
    return highest if highest + apart < HIGHEST_HZ else None


def slow_candidates(twin: Twin) -> list[Effect]:
    """Shapes that follow a slow variable or the movement: all except the hundreds of lines above the stills' rate."""
    duration = twin.movements[0].duration_s
    found = _lines(1 / np.geomspace(duration, 2.2 * _interval(twin), 40))
    found += [_curve("time", "s", lambda m: 2 * m.t_s / m.duration_s - 1, order) for order in ORDERS]
    if np.isfinite(twin.movements[0].temp_c).all():
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
    """All terms of the smooth curve to which a shape belongs, including itself; none if the shape is not such a curve."""
    if "curve_over_" not in shape.id:
        return []
    return [other for other in slow_candidates(twin) if other.id == shape.id and (SIGNED in other.equation) == (SIGNED in shape.equation)]


def _interval(twin: Twin) -> float:
    """Seconds between stills."""
    return twin.movements[0].duration_s / max(len(twin.stills), 2)


def _finding(
    name: str,
    equation: str,
    size: int,
    says: str,
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
        seen_in=("still", "turn"),
        columns=columns,
        basis=basis,
        says=lambda theta: f"{says} (up to {np.abs(theta).max() / DEG:.3f} dps); nothing in the catalogue does this",
        splits="repeat the session with this variable changed on purpose, all else alike",
        regime=regime,
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
    says = f"the zero-rate offset oscillates with a period of {1 / frequency_hz:.1f} s"
    return _finding("periodic", equation, 6, says, ("time", "s"), basis=basis, inputs=("time",))


def _warm_ups(seconds: np.ndarray) -> list[Effect]:
    """The zero-rate offset settles like a body that warms up, with these time constants, increasing; for logs without temperature."""
    scan = Scan("time_constant_s", "s", make=_warm_up, grid=lambda movements: seconds)
    return replace(_warm_up(float(seconds[0])), scan=scan).variants(seconds)


def _warm_up(time_constant_s: float) -> Effect:
    def basis(movement: Movement) -> np.ndarray:
        return np.exp(-movement.t_s / time_constant_s)[:, None]

    equation = f"ω += b exp(−t / τ), τ = {time_constant_s:.0f} s"
    says = f"the zero-rate offset settles within some {time_constant_s:.0f} s, as of a sensor that warms up: log its temperature"
    return _finding("warm_up", equation, 3, says, ("time", "s"), basis=basis, inputs=("time",))


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
        return np.stack([to_the[i][:, 0] * to_the[j][:, 1] * to_the[k][:, 2] for i, j, k in powers], axis=-1)

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
    def says(theta: np.ndarray) -> str:
        whole = earth.rate_t + theta
        seen = -np.arcsin(whole[2] / np.linalg.norm(whole)) / DEG
        as_long = abs(np.linalg.norm(whole) / EARTH_RATE_RPS - 1) < LIKE_THE_EARTH
        if latitude_deg is not None and as_long and abs(seen - latitude_deg) > ANOTHER_DEG:
            return (
                f"the stills turn with the Earth at a latitude of about {seen:.0f} deg, session.toml says {latitude_deg:g}: "
                "look at site.latitude_deg and its sign (south is negative)"
            )
        return f"{np.linalg.norm(theta) / DEG:.4f} dps is fixed in the world beyond the Earth's: does the table turn?"

    return Effect(
        id="unknown.world_direction",
        equation="ω += R_bt w, w fixed in the table's frame",
        parameter=Parameter("rate_dps", (3,), "dps", DEG, plausible=PLAUSIBLE_RPS),
        seen_in=("still",),
        kind="earth",
        columns=lambda movement: np.zeros((*movement.rate.shape, 3)),
        says=says,
        splits="correct site.latitude_deg in session.toml; if it is right, record stills with each axis up and down and pointing each way",
        regime=("attitude", "g"),
        picture=WORLD,
    )


def _field(twin: Twin) -> Effect:
    """A field fixed in the world, such as a magnet's, to which each axis responds differently; its vertical part looks like
    g-sensitivity."""
    began = {float(movement.t_s[0]): number for number, movement in enumerate(twin.movements)}

    def basis(movement: Movement) -> np.ndarray:
        return twin.level_axes[began[float(movement.t_s[0])]]

    says = "the zero-rate offset follows a level direction that is fixed in the world: a magnetic field, a draught, the sun"
    return _finding(
        "world_field", "ω += K n, n two level directions fixed in the table", 18, says, ("attitude", "g"), basis=basis, inputs=("time",)
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
