"""A twin of a few turns that is exactly linear, made from arrays: its evidence, search and decision can be worked out by linear algebra."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import patch

import numpy as np

from session.base.units import MG
from tinygc.effects import Effect, Parameter, Scan
from tinygc.explanation import evidence
from tinygc.explanation.evidence import Evidence
from tinygc.inference.noise import Sparse
from tinygc.models.linear import PRIOR_SIGMA, LinearModel
from tinygc.noise.components import STILL_RATE, TURN, Component, SessionNoise
from tinygc.noise.twin import Channels, State
from tinygc.noise.whitening import PRECALIBRATION_MPS2

#: of the calibration's columns: the Earth's two are known, gravity's length to 20 mg
PRIORS = np.r_[PRIOR_SIGMA, 1.0, 1.0, 20 * MG]


def effect(name, size=1, plausible=100.0, equation="", **more):
    """An effect of ``size`` numbers, whose columns the twin has under its id and shape."""
    parameter = Parameter("value", (size,), "unit", 0.5, plausible)
    return Effect(
        f"test.{name}", equation or name, parameter, ("turn",), lambda m: None, lambda theta: f"{theta[0]:.2f} of {name}", "", **more
    )


def stepped(name, values, size=1):
    """An effect with a scanned shape ``at_s`` in milliseconds."""
    scan = Scan("at_s", "ms", make=lambda value: effect(name, size, equation=f"{name} at {value:.9f}"), si=1e-3, grid=lambda moves: values)
    return effect(name, size, scan=scan)


class LinearTwin:
    """S turns of two angles with a still before and behind each (none if ``resting`` is false): n rows of residuals.

    columns: function of an effect -> (n, P), what one unit of each parameter adds to the residuals.  Rows have standard deviations of 1
    (closure), 0.5 (stills' rates) and 0.2 (gravity's length), a component that widens all angles alike, and one of all stills' rates.
    """

    clock, errors, slow = None, (), ()

    def __init__(self, columns=lambda effect: None, turns=8, resting=True, seed=0, wide=False):
        rng = np.random.default_rng(seed)
        s, q = turns, (turns + 1) * resting
        self.sizes, self.columns_of = (2 * s, 3 * q, q), columns
        self.n = sum(self.sizes)
        spans = [SimpleNamespace(log=0, start=10 * k, stop=10 * k + 5, start_s=1.0 * k, duration_s=0.5) for k in range(2 * s + 1)]
        self.segments = [SimpleNamespace(**vars(span), number=k + 1) for k, span in enumerate(spans[1::2])]
        self.stills = [(0, span) for span in spans[::2]] if resting else []
        self.first, self.last = (np.arange(s) + end if resting else np.full(s, -1) for end in (0, 1))
        self.batch = SimpleNamespace(angles=2, known=np.ones((s, 2), dtype=bool))
        self.q_tb, self.axes = np.tile([1.0, 0, 0, 0], (q, 1)), np.tile(np.eye(3), (s, 1, 1))
        walks = SimpleNamespace(angle_random_walk=np.full(3, 0.5 * np.sqrt(0.5)), velocity_random_walk=np.full(3, 0.2 * np.sqrt(0.5)))
        floor = SimpleNamespace(dense=lambda: np.eye(2 * s), tilt_rms=np.sqrt(2.0))
        log = SimpleNamespace(noise=walks, samples=SimpleNamespace(period_s=0.1))
        self.problem = SimpleNamespace(floor=floor, logs=[log], earth=SimpleNamespace(source="none"))
        self.movements = [SimpleNamespace(t_s=0.1 * np.arange(20 * s + 10), duration_s=2.0 * s)]
        calibration = 10 * rng.normal(size=(self.n, 15)) / PRIORS
        calibration[:, 12:14] = 0.0  # the Earth is known
        if not resting:
            calibration[:, 2:12] = calibration[:, 14:] = 0.0
        self.calibration, self._allowed = calibration, rng.normal(size=(self.n, 12)) * wide
        #: (n,) residuals without any effect and with the first calibration
        self.recorded = rng.normal(size=self.n) * np.repeat([1.0, 0.5, 0.2], self.sizes)

    def spoil(self, effect, theta):
        """Add what an effect would do: a fit with it finds theta."""
        self.recorded = self.recorded - self.columns_of(effect) @ np.atleast_1d(theta)

    def noise(self, white):
        """Two components, which a search begins with at zero."""
        V = [Sparse.of_diagonal(np.repeat(rows, self.sizes)) for rows in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])]
        components = tuple(Component(name, each, 1.0, "", 1.0, name) for name, each in zip((TURN, STILL_RATE), V, strict=True))
        return SessionNoise(components, [np.arange(self.n)], SimpleNamespace(rms_rad=0.0), np.zeros(2), np.zeros(2))

    def evidence(self):
        with patch.object(evidence, "first_noise", lambda twin, white: twin.noise(white)):
            return Evidence(self)

    # What a fit asks of a twin.

    def start(self):
        return State(LinearModel(np.eye(3), np.zeros(3)), np.zeros(2), 9.8, np.eye(3)[:2])

    def rates(self, state):
        return state

    def residuals(self, state, rates=None):
        moved = self.recorded + self.calibration @ (state.vector[:15] - self.start().vector)
        return self._channels(sum((self.columns_of(claim.effect) @ claim.theta for claim in state.claims), moved))

    def sensitivity(self, state, rates):
        return None

    def linear_columns(self, sensitivity):
        return self._channels(self.calibration[:, :12])

    def earth_columns(self):
        return self._channels(np.zeros((self.n, 3)))

    def gravity_columns(self):
        return self._channels(self.calibration[:, 14:])

    def effect_columns(self, effect, state, sensitivity, rates):
        return self._channels(self.columns_of(effect))

    def precalibration_columns(self, start, rates):
        return self._channels(self._allowed / PRECALIBRATION_MPS2)

    def _channels(self, stacked):
        closure, still, length = np.split(stacked, np.cumsum(self.sizes)[:2])
        return Channels(closure.reshape(-1, 2, *stacked.shape[1:]), still.reshape(-1, 3, *stacked.shape[1:]), length)


def fixed_columns():
    """Columns (n, P) drawn once for each effect of a twin by its id and equation, so that different effects are hardly alike."""
    made: dict = {}

    def columns(effect):
        twin_rows = columns.rows
        key = effect.id, effect.equation
        if key not in made:
            rng = np.random.default_rng([7, *map(ord, effect.id + effect.equation)])
            made[key] = rng.normal(size=(twin_rows, effect.parameter.size))
        return made[key]

    return columns


def linear_twin(seed=0, columns=None, **options):
    """A twin with ``fixed_columns``."""
    columns = columns or fixed_columns()
    twin = LinearTwin(columns, seed=seed, **options)
    columns.rows = twin.n
    return twin


def minus_twice_log(twin, s, effects=(), sigmas=()):
    """-2 log of the density of the recording, all parameters integrated out (normal), with the components' sizes s (2,) and prior sigmas
    of the effects."""
    variance = np.repeat([1.0, 0.25, 0.2**2 + (0.03e-3 * 9.80665) ** 2], twin.sizes)
    variance += np.repeat([s[0] ** 2, s[1] ** 2, 0.0], twin.sizes)
    J = twin.calibration * np.where(np.arange(15) // 2 == 6, 0.0, PRIORS)
    own = [twin.columns_of(each) * sigma for each, sigma in zip(effects, sigmas, strict=True)]
    half = np.concatenate([J, twin._allowed, *own], axis=1)
    covariance = np.diag(variance) + half @ half.T
    _, size = np.linalg.slogdet(covariance)
    return float(size + twin.recorded @ np.linalg.solve(covariance, twin.recorded))
