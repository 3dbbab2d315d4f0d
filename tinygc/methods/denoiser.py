"""Train the denoising subnet with the calibration frozen: its data, its losses, second order."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from session.base.errors import FitError
from session.base.progress import Steps, no_report
from tinygc.closure import residual
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch
from tinygc.estimation.held_out import report, run_method
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.inference.noise import Cost, lowest
from tinygc.models.denoiser import DILATIONS, KERNEL, PARAMETERS, REACH, DenoisedNet, Denoiser
from tinygc.models.model import Model

# Its data: segments with the samples before and after them.

#: number of segments, and of stills, that is enough for 56 weights an axis (benchmarks/whole_process.py)
ENOUGH = 400
#: samples at rest used for the noise, an hour of them: of longer rests the first samples of each, and never fewer than a few seconds
MOST_AT_REST, FEWEST_OF_EACH = 1 << 20, 1 << 10


@dataclass(frozen=True, eq=False)
class Material:
    """Training data: batch and sigma as for the calibration; context (S, REACH + T + REACH, 3) rad/s, the measured rates of the batch with
    their surroundings; counts (S,) samples of each segment; stills: measured rates (n, 3) of each; rate_hz."""

    batch: Batch
    sigma: np.ndarray
    context: np.ndarray
    counts: np.ndarray
    stills: list[np.ndarray]
    rate_hz: float

    @property
    def stretches(self) -> list[np.ndarray]:
        """Return the measured rates (n, 3) of each segment, with its surroundings."""
        return [rate[: 2 * REACH + count] for rate, count in zip(self.context, self.counts, strict=True)]

    def pick(self, which: np.ndarray) -> Material:
        """Select segments by index or mask; the stills, which only show noise, stay."""
        return replace(self, batch=self.batch.pick(which), sigma=self.sigma[which], context=self.context[which], counts=self.counts[which])

    def enough(self) -> Material:
        """Return a sufficient subset: segments and stills spaced evenly over the session."""
        every, apart = (-(-len(each) // ENOUGH) for each in (self.counts, self.stills))
        if every <= 1 and apart <= 1:
            return self
        return replace(self.pick(np.arange(0, len(self.counts), max(every, 1))), stills=self.stills[:: max(apart, 1)])

    def rate(self, model: DenoisedNet) -> np.ndarray:
        """Return the whole net's rates (S, T, 3) rad/s of the segments, each corrected for the delay."""
        return model.undelayed(self.context)[:, REACH : REACH + self.batch.rate.shape[1]]


def of_problem(problem: Problem) -> Material:
    """Take the accepted segments of a session in their logs; beyond a log's ends the end values are repeated."""
    longest = problem.batch.rate.shape[1]
    context = np.empty((len(problem.batch), longest + 2 * REACH, 3))
    for row, segment in zip(context, problem.used, strict=True):
        gyro = problem.logs[segment.log].samples.gyro
        row[:] = gyro[np.clip(np.arange(segment.start - REACH, segment.start + longest + REACH), 0, len(gyro) - 1)]
    counts = np.array([segment.stop - segment.start for segment in problem.used])
    stills = [(problem.logs[log].samples.gyro, still) for log, still in problem.references]
    each = max(MOST_AT_REST // max(len(stills), 1), FEWEST_OF_EACH)
    long = sum(still.stop - still.start for _, still in stills) > MOST_AT_REST
    at_rest = [gyro[still.start : min(still.stop, still.start + each) if long else still.stop] for gyro, still in stills]
    period_s = float(np.median([log.samples.period_s for log in problem.logs]))
    return Material(problem.batch, problem.floor.sigma, context, counts, at_rest, 1 / period_s)


def denoised_angles(material: Material, model: DenoisedNet) -> np.ndarray:
    """Return error angles (S, d) rad of the whole net, corrected for its delay."""
    return residual.error_angles(residual.segment_residuals(material.batch, material.rate(model)))


# Losses that reward smoothing without new labels: neighbouring samples of the log, and the known rate in the stills.
#
# The endpoint loss integrates, and integration hides noise.  Two measures of a filter h (one axis, taps h_j, sum 1) do not, and both are
# quadratic in h:
#
#     at rest     E f^2 = h' R h                                                     R_ij = r(i - j), r the noise's autocovariance
#     in motion   E (f_k - s_k-D)^2 = h' A h + 2 sum_j h_j r(j - D) - r(0)           A_ij = mean (x_k-i - x_k-D)(x_k-j - x_k-D)
#
# x = s + n is the calibrated rate, s the true rate D samples ago, which is unknown.  Using the noisy neighbour x_k-D instead
# is noise-to-noise learning (Lehtinen et al. 2018); since x_k-D is in the window itself, the noise that filter and target share is
# corrected for (Stein 1981), with r estimated from the stills, where the true rate is the Earth's.
#
# The two conflict.  ``ideal`` weighs them so that noise at rest falls by a stated factor at the least error in motion, among
# the filters that pass every cubic unchanged, delayed by D samples: moments 1 to 3 of the taps about D are zero.  The reason: by parts,
# over a movement from rest to rest, a difference of the axes' first moments is a skew of the axes, and the second acts like
# -m2/2 sum R (w x w') dt, a coning error; without these constraints a threefold reduction cost half of the closure and more.

#: lags beyond which the noise of a gyroscope after its low-pass is assumed independent
LAGS = 12
#: least power at any frequency relative to white noise of the same variance: rounding to whole steps alone leaves more
LEAST_POWER = 0.01
#: powers of ten between which the weight of rest against motion is searched
WEIGHTS = (-8.0, 9.0)
#: moments of the taps about the delay, the zeroth (the gain) included
MOMENTS = 4


@dataclass(frozen=True, eq=False)
class Risk:
    """The quadratic loss of a session at one delay: noise (3, K) rad^2/s^2, r at lags 0 to K - 1; motion (3, K, K), A; delay D; samples:
    number used for A."""

    noise: np.ndarray
    motion: np.ndarray
    delay: int
    samples: int

    @cached_property
    def covariance(self) -> np.ndarray:
        """Return the noise covariance R (3, K, K)."""
        k = np.arange(self.noise.shape[1])
        return self.noise[:, np.abs(k[:, None] - k)]

    @property
    def shared(self) -> np.ndarray:
        """Return r(j - D) (3, K), the covariance of tap j's noise with the target's."""
        return self.noise[:, np.abs(np.arange(self.noise.shape[1]) - self.delay)]

    def at_rest(self, taps: np.ndarray) -> np.ndarray:
        """Return the variance (3,) rad^2/s^2 of filtered noise; taps (3, K)."""
        return np.einsum("ai,aij,aj->a", taps, self.covariance, taps)

    def ideal(self, reduction: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the taps (3, K) best in motion among those that divide noise at rest by ``reduction`` or more, and rest's weight (3,)."""
        low, high = (np.full(3, power) for power in WEIGHTS)
        for _ in range(40):
            middle = (low + high) / 2
            enough = self.at_rest(self._best(10.0**middle)) * reduction**2 <= self.noise[:, 0]
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        return self._best(10.0**high), 10.0**high

    def _best(self, weight: np.ndarray) -> np.ndarray:
        """Minimise h' (A + weight R) h + 2 shared' h of each axis, with gain 1 and the other moments zero (Lagrange); weight (3,)."""
        pins = moments(self.noise.shape[1], self.delay)
        form = self.motion + weight[:, None, None] * self.covariance
        right = np.concatenate([-self.shared[..., None], np.broadcast_to(pins.T, (3, *pins.T.shape))], axis=2)
        solved = np.linalg.solve(form, right)
        free, pulls = solved[..., :1], solved[..., 1:]
        return (free + pulls @ np.linalg.solve(pins @ pulls, np.eye(MOMENTS)[:, :1] - pins @ free))[..., 0]


def moments(taps: int, delay: int) -> np.ndarray:
    """Return the matrix (MOMENTS, taps) from taps to their moments about the delay, in tens of samples."""
    return ((np.arange(taps) - delay) / 10.0) ** np.arange(MOMENTS)[:, None]


def autocovariance_at_rest(stills: list[np.ndarray], taps: int) -> np.ndarray:
    """Return the autocovariance (3, taps) of the rates (n, 3) rad/s in each still about their mean, zero beyond LAGS."""
    lags = min(LAGS + 1, taps)
    total, count = np.zeros((3, taps)), np.zeros(taps)
    for rate in stills:
        x = np.concatenate([np.zeros((lags - 1, 3)), rate - rate.mean(axis=0)])
        total[:, :lags] += _lagged(x, lags)
        count[:lags] += np.maximum(len(rate) - 1 - np.arange(lags), 0)
    return np.array([_positive(each) for each in total / np.maximum(count, 1)])


def _lagged(x: np.ndarray, lags: int) -> np.ndarray:
    """Return the sums (3, lags) over k of x_k x_k-lag of x (n, 3), from the first k that has all lags."""
    newest_first = np.lib.stride_tricks.sliding_window_view(x, lags, axis=0)[..., ::-1]
    return np.einsum("ka,kal->al", x[lags - 1 :], newest_first)


def _positive(noise: np.ndarray) -> np.ndarray:
    """Make an autocovariance (K,) positive definite.  Lags that were estimated one by one, and cut off at LAGS, need not be: then the
    power of frequencies below ``LEAST_POWER`` is raised to that; the rest stays."""
    taps = len(noise)
    k = np.arange(taps)
    if not noise[0] > 0 or not np.isfinite(noise).all() or np.linalg.eigvalsh(noise[np.abs(k[:, None] - k)])[0] > 0:
        return noise
    around = np.concatenate([noise, np.zeros(2 * taps), noise[:0:-1]])  # circular, but long enough that K lags do not wrap
    power = np.fft.fft(around).real
    raised = np.fft.ifft(np.maximum(power, LEAST_POWER * noise[0])).real[:taps]
    return raised * (noise[0] / raised[0])


def risk_of(rates: list[np.ndarray], stills: list[np.ndarray], taps: int, delay: int) -> Risk:
    """Estimate the loss from calibrated rates (n, 3) rad/s of whole stretches of movement, and of stills."""
    # C_ij, the sum over k of d_k-i d_k-j, d the steps from sample to sample: along each diagonal it grows by what enters at the first k,
    # and shrinks by what leaves at the last.
    lags, count = taps - 1, 0
    C, grown = np.zeros((3, lags, lags)), np.zeros((3, lags - 1, lags - 1))
    for rate in rates:
        d = np.diff(rate, axis=0)
        C[:, 0] += _lagged(d, lags)
        for sign, edge in ((1, d[lags - 2 :: -1]), (-1, d[:-lags:-1])):
            grown += sign * edge.T[:, :, None] * edge.T[:, None]
        count += len(rate) - lags
    for i in range(lags - 1):
        C[:, i + 1, i + 1 :] = C[:, i, i:-1] + grown[:, i, i:]
    C += np.triu(C, 1).transpose(0, 2, 1)
    # x_k-i - x_k-D is the sum of the steps between.
    tap, step = np.arange(taps), np.arange(lags)[:, None]
    between = 1.0 * ((tap <= step) & (step < delay)) - 1.0 * ((delay <= step) & (step < tap))
    return Risk(autocovariance_at_rest(stills, taps), between.T @ C @ between / max(count, 1), delay, count)


# The start of the denoiser's training.


def start(seed: int) -> Denoiser:
    """Return the identity with a second, trainable channel, which has no output weight yet."""
    noise = Denoiser.from_vector(0.1 * np.random.default_rng(seed).standard_normal((3, PARAMETERS // 3)))
    net = Denoiser.identity()
    net.conv1[:, 1], net.conv2[:, 1] = noise.conv1[:, 1], noise.conv2[:, 1]
    return net


# Levenberg-Marquardt on the taps of the denoiser: a fraction of a second.

#: rows (R,), their design (R, 3, K), and the taps (3, K) at which the rows hold
Term = tuple[np.ndarray, np.ndarray, np.ndarray]

#: sigma of the prior around the weights at the start.  It determines what no loss observes, such as one layer's scale against another's;
#: the endpoint loss alone needs a close one, or it trades noise (up to thirty times more) for closure
PRIOR_SIGMA = {"endpoint": 0.1, "neighbours": 3.0}
#: samples by which the output of ``neighbours`` is late, and the factor by which its noise at rest falls
DELAY, REDUCTION = 12, 3.2


MAX_STEPS = 200
#: steps from weights that smooth already: only the closure remains, which needs few
NEAR_STEPS = 12


#: in units of chi-square: a step with a smaller gain is not significant, and the last
ENOUGH_GAIN = 0.1


#: in sigmas for a moment of 1: how hard ``neighbours`` holds the moments of the taps at zero
PIN = 1e4


#: number of linearisations of the closure
ROUNDS = 2


#: of the signals that are multiplied out, which then do not come round; and each layer's waves (KERNEL, F), one for each of its taps
_LENGTH = 2 * (REACH + 1)
_WAVES = [np.exp(-2j * np.pi * dilation * np.arange(KERNEL)[::-1, None] * np.arange(_LENGTH // 2 + 1) / _LENGTH) for dilation in DILATIONS]
#: of the 56 weights of an axis: what the other two layers make, of eight; and its samples (K, 56) that reach each tap
_OTHERS = np.repeat(np.arange(8), KERNEL)
_REACHED = np.arange(REACH + 1)[:, None] - np.repeat(DILATIONS, (2 * KERNEL, 4 * KERNEL, 2 * KERNEL)) * np.tile(np.arange(KERNEL)[::-1], 8)


def taps_of(vector: np.ndarray) -> tuple[np.ndarray, Callable[[], np.ndarray]]:
    """Return taps (3, K) of the subnet with unit gain, newest first, and the function that gives their derivatives (3, K, 56) by its
    weights.

    They are computed in the frequency domain, where convolutions are products, linear in each of the three layers.
    """
    net = Denoiser.from_vector(vector)
    c1, c2, c3 = (weight @ waves for weight, waves in zip((net.conv1, net.conv2, net.conv3), _WAVES, strict=True))
    first, third = c1[:, :, 0], c3[:, 0]
    inner = np.sum(c2 * first[:, None], axis=2)
    h = np.fft.irfft(np.sum(third * inner, axis=1), _LENGTH)[:, : REACH + 1]
    gain = h.sum(axis=1)[:, None]
    if np.any(gain < 1e-6):
        raise FitError("the denoiser lost its gain at constant rates")
    h = h / gain

    def jacobian() -> np.ndarray:
        through, outside = np.sum(third[:, :, None] * c2, axis=1), third[:, :, None] * first[:, None]
        others = np.concatenate([through, outside.reshape(3, 4, -1), inner], axis=1)
        J = np.fft.irfft(others, _LENGTH)[:, _OTHERS, _REACHED]
        return (J - h[..., None] * J.sum(axis=1)[:, None]) / gain[..., None]

    return h, jacobian


def smoothing_rows(material: Material, calibration: Model) -> Term:
    """Return rows and their design (rows, 3, K): the square root of the quadratic loss, less its minimum, in units of that minimum."""
    rates = [calibration(x) for x in material.stretches]
    stills = [calibration(x) for x in material.stills]
    risk = risk_of(rates, stills, REACH + 1, DELAY)
    if not (np.isfinite(risk.motion).all() and (risk.noise[:, 0] > 0).all()):
        raise FitError("no noise in the stills to learn from, or rates that are not finite; is the log made of smoothed values?")
    best, weight = risk.ideal(REDUCTION)
    form = risk.motion + weight[:, None, None] * risk.covariance
    least = np.einsum("ai,aij,aj->a", best, form, best)
    root = np.linalg.cholesky(form).transpose(0, 2, 1) * np.sqrt(risk.samples / least)[:, None, None]
    pins = moments(REACH + 1, DELAY)[1:] * PIN
    root = np.concatenate([root, np.broadcast_to(pins, (3, *pins.shape))], axis=1)
    design = np.zeros((3, root.shape[1], 3, REACH + 1))
    design[np.arange(3), :, np.arange(3)] = root
    return np.zeros(3 * root.shape[1]), design.reshape(-1, 3, REACH + 1), best


def _closing(material: Material, calibration: Model, taps: np.ndarray, delay: int) -> Term:
    """Return rows (S d,) of the closure in sigmas at these taps, and their design (S d, 3, K), to first order in the taps."""
    batch = material.batch
    x = calibration(material.context)
    windows = np.lib.stride_tricks.sliding_window_view(x[:, delay : delay + REACH + batch.rate.shape[1]], REACH + 1, axis=1)[..., ::-1]
    rate = np.einsum("staj,aj->sta", windows, taps)
    end, turn = residual.end_and_sensitivity(batch, rate)
    turn, weight = turn[:, :, : batch.angles], 1 / material.sigma.reshape(len(batch), -1)
    rows = (2 * residual.batch_residual(batch, end) * weight).ravel()
    design = np.empty((len(batch), batch.angles, 3, REACH + 1))
    for axis in range(3):
        design[:, :, axis] = turn[..., axis].transpose(0, 2, 1) @ windows[:, :, axis]
    return rows, (design * weight[..., None, None]).reshape(len(rows), 3, REACH + 1), taps


def _settle(vector: np.ndarray, terms: list[Term], prior: float, steps: int) -> np.ndarray:
    """Minimise the sum of squares of all terms (rows, design, taps at which the rows hold) and a weak prior."""
    whole, began = np.concatenate([design for _, design, _ in terms]), vector.ravel()

    def cost(x: np.ndarray) -> Cost:
        try:
            h, jacobian = taps_of(x.reshape(3, -1))
        except FitError:
            return Cost(np.inf, x, np.eye(len(x)))
        r = np.concatenate([rows + design.reshape(len(rows), -1) @ (h - at).ravel() for rows, design, at in terms])
        J = np.concatenate([whole[:, axis] @ by for axis, by in enumerate(jacobian())], axis=1)
        off = (x - began) / prior
        if not np.isfinite(value := float(r @ r)):
            raise FitError("training the denoiser left the finite numbers; are the rates in the log in the unit of its header?")
        return Cost(value + float(off @ off), 2 * (J.T @ r + off / prior), 2 * (J.T @ J + np.eye(len(x)) / prior**2))

    x, _ = lowest(cost, began, -np.inf, steps=steps, settled=ENOUGH_GAIN)
    return x.reshape(vector.shape)


# Train the denoising subnet, calibration frozen.
#
# There are two losses.  ``endpoint`` is the paper's: the closure of the segments.  It hardly rewards smoothing, since integration hides
# noise.  ``neighbours`` adds the variance in the stills and the expected error in motion (``Risk``), weighed so that noise at rest falls by
# a stated factor at a stated delay.
#
# The closure is linear in the taps to first order, and the other loss is quadratic in them.  All samples therefore reduce to a matrix of
# 49 x 49 an axis, and training is Levenberg-Marquardt on 168 weights: a fraction of a second.


def train_denoiser(
    material: Material,
    calibration: Model,
    loss: str = "neighbours",
    *,
    seed: int = 0,
    progress: Steps = no_report,
    near: Denoiser | None = None,
    closing: bool = True,
    smoothing: Term | None = None,
) -> DenoisedNet:
    """Train the whole net with this calibration frozen, by the second order.

    loss: "neighbours" or "endpoint"; near: the weights that smooth best, from which it converges faster; closing: whether the closure is
    part of the loss; smoothing: the rows of the other part, where they are known.  Raises FitError where the loss is not finite, or there
    is nothing to smooth.
    """
    neighbours = loss == "neighbours"
    terms = [smoothing or smoothing_rows(material, calibration)] if neighbours else []
    vector = (start(seed) if near is None else near).vector
    steps = MAX_STEPS if near is None else NEAR_STEPS
    for number in range(ROUNDS):
        taps, _ = taps_of(vector)
        rows = [_closing(material, calibration, taps, DELAY if neighbours else 0)] if closing else []
        vector = _settle(vector, [*rows, *terms], PRIOR_SIGMA[loss], steps)
        progress(number + 1, ROUNDS)
    denoiser = Denoiser.from_vector(vector).normalised()
    return DenoisedNet(calibration, denoiser, material.rate_hz)


# The method ``tinygc_denoised``: the frozen calibration of ``tinygc``, and the denoising subnet after it.


def run(problem: Problem, options: FitOptions, progress: Steps, before: dict[str, MethodFit]) -> MethodFit:
    """Fit the calibration of ``tinygc``, unless it is among ``before``, and the denoiser after it.

    The denoiser is trained on all segments, then on all but each fold with that fold's calibration, which excludes it as well.  A fold's
    search begins at the best smoothing weights, which were fitted to all rates, but to no attitude.  Raises FitError where no still is as
    long as its window.
    """
    calibrated = before.get("tinygc") or run_method("tinygc", problem, options, progress)
    material = of_problem(problem)
    # A session without rests does not show the noise, and a vehicle's few stills do not show the noise of its flight.
    endpoint = not material.stills or problem.session.reference is not None
    if not endpoint and (longest := max(map(len, material.stills))) <= REACH:
        window_s, still_s = (REACH + 1) / material.rate_hz, longest / material.rate_hz
        raise FitError(f"its window of {REACH + 1} samples ({window_s:.2g} s) is longer than the stills (at most {still_s:.2g} s)")
    steps, loss = len(calibrated.fold_models) + 1, "endpoint" if endpoint else "neighbours"

    def train(seen: Material, calibration: Model, done: int, **how: Any) -> DenoisedNet:
        return train_denoiser(seen, calibration, loss, seed=options.seed, progress=partial(report, progress, done, steps), **how)

    began, enough, smooth = time.perf_counter(), material.enough(), None
    smoothing = None if endpoint else smoothing_rows(enough, calibrated.model)
    model = train(enough, calibrated.model, 0, smoothing=smoothing)
    seconds = time.perf_counter() - began
    if not endpoint:
        smooth = train_denoiser(enough, calibrated.model, seed=options.seed, closing=False, smoothing=smoothing).denoiser
    held_out = np.zeros_like(calibrated.held_out)
    fold = np.arange(len(problem.batch)) % len(calibrated.fold_models)
    for k, calibration in enumerate(calibrated.fold_models):
        part = train(material.pick(fold != k).enough(), calibration, k + 1, near=smooth)
        held_out[fold == k] = denoised_angles(material.pick(fold == k), part)
    notes = {"denoiser": figures(material, model) | {"loss": loss}}
    angles = denoised_angles(material, model)
    return MethodFit("tinygc_denoised", model, angles, held_out, calibrated.seconds + seconds, notes)


def figures(material: Material, model: DenoisedNet) -> dict:
    """Return the figures for the user: noise_reduction (3,), the factor by which the standard deviation in the stills falls (None where no
    still is as long as the window); delay_s; delay_samples."""
    before, after = [], []
    for still in (each for each in material.stills if len(each) > REACH + 1):
        rate = model.calibration(still)
        filtered = model.denoiser.windowed(rate)
        before.append(rate[REACH:] - rate.mean(axis=0))
        after.append(filtered - filtered.mean(axis=0))
    ratio = None
    if before:
        ratio = (np.concatenate(before).std(axis=0) / np.concatenate(after).std(axis=0)).tolist()
    return {"noise_reduction": ratio, "delay_s": model.delay_s, "delay_samples": model.delay_samples}
