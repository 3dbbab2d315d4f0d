"""A law drawn at random from a grammar that is wider than any search: trees of products, ratios, bends and lags over all signals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from session.common.units import DEG, G
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.linear import beyond_linear, rms
from tinygc.challenge.discover.laws.shapes import energy, lagged
from tinygc.challenge.discover.laws.signals import LEAVES, WEIGHTS, Curve, Signals
from tinygc.challenge.rate_effects import shaking

#: rad/s rms beyond a linear calibration, strong
SIZES = (0.05 * DEG, 0.3 * DEG)
#: of its own rms must be beyond a linear calibration: else it is hardly a law
LEAST_BEYOND = 0.2
PLAIN = ("f", "T", "t", "a")
FACTORS = ((1, 2, 3), (0.35, 0.45, 0.2))
BENT = 0.55  #: share of the factors that are bent
AXES = {"all": 0.6, "one": 0.25, "two": 0.15}
LAGS_S = (0.2, 20.0)
#: a bend leaves sizes of one at sizes of one
BENDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh(2 {})": lambda x: np.tanh(2 * x),
    "tanh(8 {})": lambda x: np.tanh(8 * x),
    "log(1 + |{}|)": lambda x: np.log1p(np.abs(x)),
    "exp(-|{}|)": lambda x: np.exp(-np.abs(x)),
    "exp({})": lambda x: np.exp(np.clip(x, -3, 2)),
    "sqrt(|{}|)": lambda x: np.sqrt(np.abs(x)),
    "|{}|": np.abs,
    "({})²": np.square,
    "{0} |{0}|": lambda x: x * np.abs(x),
    "max({}, 0)": lambda x: np.maximum(x, 0),
    "sin(3 {})": lambda x: np.sin(3 * x),
    "1/(1 + ({})²)": lambda x: 1 / (1 + x**2),
}
JOINS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "({} + {})": np.add,
    "({} - {})": np.subtract,
    "{}/(1 + |{}|)": lambda x, y: x / (1 + np.abs(y)),
    "max({}, {})": np.maximum,
}
JOINED = 0.25  #: share of the factors that join two signals


def draw_expression(rng: np.random.Generator) -> tuple[str, Curve]:
    """Its text and its curve: drawn until a trial movement shows enough of it beyond a linear calibration, and beyond a zero that follows
    force, temperature, time or angular acceleration, which every catalogue has."""
    trial = _trial_movement()
    plain = np.hstack([trial.rate, *(LEAVES[name](trial) for name in PLAIN)])
    while True:
        text, curve = _product(rng)
        values = np.broadcast_to(curve(trial), trial.rate.shape)
        if np.isfinite(values).all() and rms(values) > 0 and rms(beyond_linear(plain, values)) > LEAST_BEYOND * rms(values):
            return text, curve


def random_law(scene: Scene) -> Concealment:
    """An expression on all, two or one of the axes, of a drawn rms beyond a linear calibration on the session's own movement."""
    rng, options, log_s = scene.rng, scene.options, scene.plan.log_s
    text, curve = draw_expression(rng)
    pattern = str(rng.choice(list(AXES), p=list(AXES.values())))
    on = np.zeros(3)
    on[rng.permutation(3)[: {"all": 3, "two": 2, "one": 1}[pattern]]] = 1.0
    shares = on * rng.uniform(0.5, 1.5, 3) * rng.choice((-1.0, 1.0), 3)
    size = scene.strength * float(rng.uniform(*SIZES))
    shaken = shaking(scene) if "v" in _words(text) else None

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        vibration = np.zeros(len(t)) if shaken is None else energy(t, shaken)
        signals = Signals(t, np.clip(t / log_s, 0, 1), rate, force, temp - options.temperature_start_c, vibration)
        added = curve(signals) * shares
        inside = (t >= 0) & (t < log_s)
        beyond = rms(beyond_linear(rate[inside], added[inside]))
        return rate + added * size / max(beyond, LEAST_BEYOND / 4 * rms(added[inside]))

    told = {"expression": text, "shares": shares.tolist(), "rps_rms": size}
    return Concealment("law.random", told, distort=distort, disturb=None if shaken is None else shaken.disturb)


def _words(text: str) -> set[str]:
    return set("".join(c if c.isalnum() or c == "_" else " " for c in text).split())


def _product(rng: np.random.Generator) -> tuple[str, Curve]:
    """One, two or three factors, and now and then a lag of it all."""
    factors = [_factor(rng) for _ in range(int(rng.choice(FACTORS[0], p=FACTORS[1])))]
    text = " × ".join(each for each, _ in factors)

    def curve(s: Signals) -> np.ndarray:
        value = factors[0][1](s)
        for _, factor in factors[1:]:
            value = value * factor(s)
        return value

    return (text, curve) if rng.uniform() > 0.15 else _lag(text, curve, rng)


def _factor(rng: np.random.Generator) -> tuple[str, Curve]:
    text, curve = _leaf(rng)
    if rng.uniform() < JOINED:
        other, second = _leaf(rng)
        joint = str(rng.choice(list(JOINS)))
        text, curve = joint.format(text, other), _joined(JOINS[joint], curve, second)
    if rng.uniform() < BENT:
        bend = str(rng.choice(list(BENDS)))
        text, curve = bend.format(text), _bent(BENDS[bend], curve)
    return (text, curve) if rng.uniform() > 0.15 else _lag(text, curve, rng)


def _leaf(rng: np.random.Generator) -> tuple[str, Curve]:
    weights = np.array(list(WEIGHTS.values()), dtype=float)
    name = str(rng.choice(list(WEIGHTS), p=weights / weights.sum()))
    return name, LEAVES[name]


def _lag(text: str, curve: Curve, rng: np.random.Generator) -> tuple[str, Curve]:
    tau_s = float(np.exp(rng.uniform(*np.log(LAGS_S))))
    return f"lag[{tau_s:.3g} s]({text})", lambda s: lagged(s.t, curve(s), tau_s)


def _bent(bend: Callable[[np.ndarray], np.ndarray], curve: Curve) -> Curve:
    return lambda s: bend(curve(s))


def _joined(join: Callable[[np.ndarray, np.ndarray], np.ndarray], first: Curve, second: Curve) -> Curve:
    return lambda s: join(first(s), second(s))


def _trial_movement() -> Signals:
    """A minute of smooth turns between stills, the same for all: only whether a law bends at all is asked of it."""
    rng, t = np.random.default_rng(0), np.arange(0, 60, 0.02)
    bell = np.maximum(np.sin(2 * np.pi * t / 6), 0)[:, None] ** 2
    rate = bell * np.repeat(rng.normal(0, 130 * DEG, (10, 3)), len(t) // 10, axis=0)
    up = np.repeat(rng.normal(size=(10, 3)), len(t) // 10, axis=0)
    force = G * up / np.linalg.norm(up, axis=1, keepdims=True)
    return Signals(t, t / 60, rate, force, -10 * np.expm1(-t / 40), 0.16 * (bell[:, 0] > 0.2) * (np.arange(len(t)) % 600 < 300))


DRAWN: dict[str, Maker] = {"law.random": random_law}
