"""The nets and what trains them: equations and derivatives against autograd, and the linear solution where the sensor is linear."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from conftest import DEG, Turns, wxyz
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from small_turns import PERFECT, TYPICAL, angles_by_scipy, small_turns, turned_ends, turns_by_scipy

from session.base import rotation
from session.base.errors import FitError, FormatError
from tinygc import models
from tinygc.closure import residual
from tinygc.closure.least_squares import LinearEnds, Nearby, fit_least_squares, vague
from tinygc.methods import denoiser, network, particle_swarm
from tinygc.models.denoiser import DILATIONS, REACH, SHAPES, WINDOW, DenoisedNet, Denoiser
from tinygc.models.linear import LinearModel, bias_only
from tinygc.models.nets import CalibrationNet

RNG = np.random.default_rng(0)
RATE = RNG.normal(size=(4, 50, 3)) * 3
LINE = RNG.normal(size=(200, 3)) + np.array([0.3, -0.2, 0.0])
START = np.array([3.0, -2.0, 1.0])
MODEL = LinearModel(np.array([[1.01, 0.005, -0.004], [-0.006, 0.988, 0.003], [0.005, -0.002, 1.008]]), np.array([1.0, -0.7, 0.4]) * DEG)


# The calibration subnet.


def some_net(seed=1):
    return CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.3 * np.random.default_rng(seed).normal(size=27))


def in_torch(torch, vector, rate):
    """The calibration subnet of 27 weights in PyTorch, for its derivatives."""
    W1, b1, slope, W2, b2 = vector.split([9, 3, 3, 9, 3])
    h = rate @ W1.reshape(3, 3).T + b1
    return rate + torch.where(h >= 0, h, slope * h) @ W2.reshape(3, 3).T + b2


def test_it_computes_its_equation(torch):
    """omega = m + W2 PReLU(W1 m + b1) + b2, of 27 parameters as in the paper: the exact identity at the start, and the linear model with
    slope one."""
    net, m = some_net(), RATE[0, 0]
    h = net.W1 @ m + net.b1
    bent = np.array([value if value >= 0 else slope * value for value, slope in zip(h, net.slope, strict=True)])
    assert_allclose(net(RATE)[0, 0], m + net.W2 @ bent + net.b2, atol=1e-14)
    assert_array_equal(CalibrationNet.identity()(RATE), RATE)
    assert {field.name: getattr(net, field.name).size for field in fields(net)} == {"W1": 9, "b1": 3, "slope": 3, "W2": 9, "b2": 3}
    assert_allclose(CalibrationNet.from_linear(MODEL)(RATE), MODEL(RATE), atol=1e-14)
    assert_allclose(in_torch(torch, torch.as_tensor(net.vector), torch.as_tensor(RATE)).numpy(), net(RATE), atol=1e-14)


@pytest.mark.parametrize("angles", [2, 3])
def test_columns_are_the_chain_rule(angles, torch):
    """phi = sum_k S_k omega(m_k) is linear in omega: autograd's Jacobian of it is exact, and so must the columns be."""
    sensitivity, net = RNG.normal(size=(4, 50, angles, 3)), some_net(3)

    def phi(vector):
        return torch.einsum("stdi,sti->sd", torch.as_tensor(sensitivity), in_torch(torch, vector, torch.as_tensor(RATE)))

    exact = torch.autograd.functional.jacobian(phi, torch.as_tensor(net.vector)).numpy()
    assert_allclose(net.columns(sensitivity, RATE), exact, atol=1e-10)


# The denoising subnet.


def some_denoiser():
    return Denoiser.from_vector(Denoiser.identity().vector + 0.3 * np.random.default_rng(1).normal(size=(3, 56))).normalised()


def test_a_denoiser_is_odd_homogeneous_of_unit_gain_and_looks_back_49_samples():
    """Each axis for itself, from the identity on; a movement from rest to rest keeps its integral, of which an attitude is made."""
    net, changed = some_denoiser(), LINE.copy()
    assert (
        DenoisedNet(CalibrationNet.identity(), net, 208.0).parameters == 195 == 27 + 3 * sum(int(np.prod(s[1:])) for s in SHAPES.values())
    )
    assert_allclose(Denoiser.identity()(LINE), LINE, atol=1e-14)
    changed[100, 1] += 1.0
    touched = np.abs(net(changed) - net(LINE))
    assert np.flatnonzero(touched[:, 1])[[0, -1]].tolist() == [100, 148]
    assert touched[:, [0, 2]].max() == 0
    assert REACH + 1 == 49 <= WINDOW
    for rate in ([0, 0, 0], [1e-6, -1e-6, 3], [-0.02, 0.7, -8]):
        constant = np.tile(np.array(rate, float), (60, 1))
        assert_allclose(net(constant), constant, rtol=1e-12, atol=0)
    assert_allclose(net(-1e-3 * LINE), -1e-3 * net(LINE), atol=1e-15)
    movement = np.zeros((400, 3))
    movement[100:200] = np.cumsum(RNG.normal(size=(100, 3)), axis=0) * np.hanning(100)[:, None]
    assert_allclose(net(movement).sum(axis=0), movement.sum(axis=0), rtol=1e-12)
    with pytest.raises(ValueError, match="no constant"):
        Denoiser.from_vector(np.zeros((3, 56))).normalised()


def test_its_forms_agree():
    """Whole, by windows, in single precision as on a microcontroller, and from its file."""
    net = some_denoiser()
    held = np.concatenate([np.tile(LINE[:1], (WINDOW - 1, 1)), LINE])
    windows = np.lib.stride_tricks.sliding_window_view(held, WINDOW, axis=0).transpose(0, 2, 1)
    assert_allclose(net.windowed(windows)[:, -1], net(LINE), atol=1e-14)
    single = Denoiser(*(getattr(net, name).astype(np.float32) for name in SHAPES))
    assert_allclose(single(LINE.astype(np.float32)), net(LINE), atol=3e-6 * np.abs(LINE).max())
    model = DenoisedNet(CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.01), net, 211.3)
    table = json.loads(json.dumps(models.to_dict(model, session="s"), allow_nan=False))
    again = models.from_dict(table)
    assert_array_equal(again(LINE), model(LINE))
    assert (again.rate_hz, again.parameters) == (211.3, 195)
    table["denoiser"]["slope"] = 1.0  # as an earlier file says
    assert_array_equal(models.from_dict(table)(LINE), model(LINE))


def test_taps_and_delay_of_a_moving_average():
    """Seven sevenths in the first layer: 3 samples late; without its delay a ramp comes back."""
    net = Denoiser.identity()
    net.conv1[:, 0, 0, :] = 1 / 7
    assert_allclose(net.taps(), np.tile(np.where(np.arange(REACH + 1) < 7, 1 / 7, 0), (3, 1)))
    assert_allclose(net.delay_samples, 3.0)
    model = DenoisedNet(CalibrationNet.identity(), net, 208.0)
    ramp = np.tile(np.arange(100.0)[:, None], 3)
    assert_allclose(model.undelayed(ramp)[10:-3], ramp[10:-3])
    assert model.delay_s == pytest.approx(3 / 208)


def broken(where="denoiser", **changes):
    table = json.loads(json.dumps(models.to_dict(DenoisedNet(CalibrationNet.identity(), Denoiser.identity(), 208.0))))
    (table if where is None else table[where]).update(changes)
    return table


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        (broken(conv1=[1, 2]), "conv1 has shape"),
        (broken(slope=float("nan")), "denoiser.slope is NaN, which is not finite"),
        (broken(slope=0.3), "another slope than 1"),
        (broken(dilations=3), "denoiser.dilations is 3, expected 3 whole numbers from 1 to 50"),
        (broken(None, rate_hz=0), "rate_hz"),
        (broken(None, calibration=broken()), "does not follow"),
        (broken(conv1=(2 * Denoiser.identity().conv1).tolist()), "gain"),
        (broken(conv2=np.full(SHAPES["conv2"], np.nan).tolist()), "finite"),
    ],
)
def test_malformed_tables_are_refused_with_the_reason(table, complaint):
    with pytest.raises(FormatError, match=complaint):
        models.from_dict(table, "bad.json")


# What trains the denoiser.

NOISE_RPS = 0.05 * DEG


def material(seed=0, count=12):
    """A chain of turns, still for a second at either end of each, with white noise of 0.05 dps; stills of two seconds."""
    turns, rng, rest = Turns(count, seed=11, odr_hz=208.0), np.random.default_rng(seed), 208
    clean = np.pad(turns.rate, ((0, 0), (rest, rest), (0, 0)))
    around = np.pad(clean, ((0, 0), (REACH, REACH), (0, 0)))
    around += NOISE_RPS * rng.standard_normal(around.shape)
    dt = np.full((count, clean.shape[1] - 1), 1 / 208.0)
    batch = residual.Batch(around[:, REACH:-REACH], dt, np.zeros_like(clean), turns.q[:-1], turns.q[1:], False)
    stills = [NOISE_RPS * rng.standard_normal((2 * rest, 3)) for _ in range(count + 1)]
    sigma = np.full(count, NOISE_RPS / np.sqrt(208.0) * np.sqrt(5.0))
    return denoiser.Material(batch, sigma, around, np.full(count, clean.shape[1]), stills, 208.0), clean


def test_taps_and_their_derivatives(torch):
    """Against the subnet itself, and autograd; from the identity it can learn."""
    vector = denoiser.start(3).vector + 0.2 * np.random.default_rng(4).normal(size=(3, 56))
    taps, jacobian = denoiser.taps_of(vector)
    assert_allclose(taps, Denoiser.from_vector(vector).normalised().taps(), atol=1e-12)

    def of(weights):
        """Newest sample first, which PyTorch's correlation gives for an impulse, over the gain, which is their sum."""
        x = torch.zeros((1, 3, 2 * REACH + 1), dtype=torch.float64)
        x[..., REACH] = 1.0
        parts = weights.split([int(np.prod(shape[1:])) for shape in SHAPES.values()], -1)
        for part, shape, dilation in zip(parts, SHAPES.values(), DILATIONS, strict=True):
            x = torch.nn.functional.conv1d(x, part.reshape(-1, *shape[2:]), dilation=dilation, groups=3)
        return x[0] / x[0].sum(-1, keepdim=True)

    exact = torch.autograd.functional.jacobian(of, torch.as_tensor(vector)).numpy()
    for axis in range(3):
        assert_allclose(jacobian()[axis], exact[axis, :, axis], atol=1e-10)
    assert_allclose(denoiser.start(0)(LINE), LINE, atol=1e-14)
    assert np.linalg.matrix_rank(denoiser.taps_of(denoiser.start(0).vector)[1]()[0]) >= 15


def test_the_error_in_motion_is_measured_without_the_truth():
    """The risk of filters against noisy neighbours, and their squared error against the truth that it never saw; ideal taps keep the
    moments that they promise."""
    seen, clean = material(seed=2, count=24)
    delay = 8
    risk = denoiser.risk_of(list(seen.batch.rate), seen.stills, REACH + 1, delay)
    assert_allclose(np.sqrt(risk.noise[:, 0]), NOISE_RPS, rtol=0.03)
    ideal, _ = risk.ideal(2.0)
    assert_allclose(denoiser.moments(REACH + 1, delay) @ ideal.T, np.eye(4)[:, [0, 0, 0]], atol=1e-8)
    assert (np.sqrt(risk.noise[:, 0] / risk.at_rest(ideal)) > 1.999).all()
    for taps in (np.eye(REACH + 1)[delay], np.full(REACH + 1, 1 / 17) * (np.arange(REACH + 1) < 17), ideal[0]):
        taps = np.tile(taps, (3, 1))
        windows = np.lib.stride_tricks.sliding_window_view(seen.batch.rate, REACH + 1, axis=1)[..., ::-1]
        answer = np.einsum("staj,aj->sta", windows, taps)
        true = np.mean((answer - clean[:, REACH - delay : clean.shape[1] - delay]) ** 2, axis=(0, 1))
        said = np.einsum("ai,aij,aj->a", taps, risk.motion, taps) + 2 * np.sum(risk.shared * taps, axis=1) - risk.noise[:, 0]
        assert_allclose(said, true, rtol=0.05, atol=0.08 * NOISE_RPS**2)


def test_the_error_in_motion_is_that_of_all_windows_multiplied_out():
    """Also of one window alone; the noise at rest ends at its last lag, and a still shorter than that has its few products."""
    rng, taps, delay = np.random.default_rng(7), 15, 4
    rates, stills = ([rng.normal(size=(count, 3)) for count in counts] for counts in ((taps, taps + 1, 40), (3, 3000)))
    noise, about = np.zeros((3, taps)), [still - still.mean(axis=0) for still in stills]
    for lag in range(13):
        products = [np.sum(x[lag:] * x[: max(len(x) - lag, 0)], axis=0) for x in about]
        noise[:, lag] = sum(products) / sum(max(len(x) - 1 - lag, 0) for x in about)
    for some in (rates, rates[:1]):
        risk = denoiser.risk_of(some, stills, taps, delay)
        steps = np.concatenate([[x[k - taps : k][::-1] - x[k - 1 - delay] for k in range(taps, len(x) + 1)] for x in some])
        assert_allclose(risk.motion, np.einsum("kia,kja->aij", steps, steps) / len(steps), atol=1e-12)
        assert_allclose(risk.noise, noise, atol=1e-12)
        assert risk.samples == len(steps)


def test_noise_at_rest_falls_threefold_twelve_samples_late_and_the_closure_does_not_suffer():
    """On noise and turns that it has not seen; a cubic passes late but whole; bad input is refused."""
    seen, _ = material()
    calibration = bias_only()
    trained = denoiser.train_denoiser(seen, calibration)
    assert trained.calibration is calibration
    noise = np.random.default_rng(9).standard_normal((40000, 3))
    assert (noise.std(axis=0) / trained.denoiser(noise).std(axis=0) > 3.0).all()
    assert_allclose(trained.denoiser.delay_samples, 12, atol=0.01)
    assert_allclose(trained.denoiser.gain, 1, atol=1e-12)
    t = np.arange(200.0)[:, None] / 50
    cubic = 1 + 2 * t - t**2 + 0.5 * t**3 * np.array([1.0, -1.0, 0.5])
    assert_allclose(trained.denoiser(cubic)[60:], cubic[48:-12], atol=5e-4)
    fresh, _ = material(seed=5)
    before, after = (np.linalg.norm(residual.segment_residuals(fresh.batch, rate)) for rate in (fresh.batch.rate, fresh.rate(trained)))
    assert after < 1.05 * before
    with pytest.raises(FitError, match="noise"):
        denoiser.train_denoiser(replace(seen, stills=[np.zeros((100, 3))]), bias_only())
    seen.context[1, 50, 0] = np.nan
    with pytest.raises(FitError, match="finite"), np.errstate(invalid="ignore"):
        denoiser.train_denoiser(seen, bias_only())


# What trains the calibration.


def recording(seed, asymmetry=0.0, count=20):
    """A chain of turns with the gyro's noise; its sensitivity differs by ± asymmetry for + and − rates, on every axis."""
    turns, rng, noise = Turns(count, seed=11, odr_hz=52.0), np.random.default_rng(seed), 0.005 * DEG
    measured = (turns.rate + asymmetry * np.abs(turns.rate) - MODEL.B) @ np.linalg.inv(MODEL.E).T
    measured = measured + noise * np.sqrt(52.0 / 2) * rng.standard_normal(measured.shape)
    batch = residual.Batch(measured, turns.dt, np.zeros_like(measured), turns.q[:-1], turns.q[1:], False)
    return batch, np.full(count, noise / np.sqrt(2) * 2)  # the angle random walk over 4 s


def test_where_the_sensor_is_linear_it_finds_least_squares():
    """With the bend tied down: the same minimum of the same loss.  What is known of where it begins need not be found again: residuals and
    columns between other references follow from those between the first ones."""
    batch, sigma = recording(0)
    linear = fit_least_squares(batch, sigma, bias_only()).model
    trained = network.train_second_order(batch, sigma, ties=(0.0,))
    assert trained.tie == 0
    assert_allclose(trained.net(batch.rate), linear(batch.rate), atol=2e-5 * np.abs(batch.rate).max())
    net, some = CalibrationNet.from_linear(linear), np.arange(len(batch)) % 3 > 0
    ends = LinearEnds.of(net, batch, net.columns)
    turned = rotation.exp(np.random.default_rng(5).normal(size=(2, int(some.sum()), 3)) * 0.01 * DEG)
    other = batch.pick(some)
    other = replace(other, start=rotation.multiply(turned[0], other.start), end=rotation.multiply(turned[1], other.end))
    for more in ({"ends": ends.rows(other, some)}, {}):
        known, found = (network.train_second_order(other, sigma[some], **how) for how in ({"begin": linear, **more}, {}))
        assert_allclose(known.net.vector, found.net.vector, atol=1e-9)


def test_the_weights_that_are_taken_are_settled():
    """What one step more gains of chi-square, its ties to the identity included, does not count."""
    given = recording(0, asymmetry=0.01)
    trained, problem = network.train_second_order(*given), network._Problem(*given)
    prior, here = dict(CalibrationNet.identity().rungs(problem.typical_rps, network.TIES))[trained.tie], trained.net.vector
    there, *_ = problem.settle(here, problem.residuals(here), prior, np.inf)
    cost, less = (np.sum(problem.residuals(at) ** 2) + np.sum(((at - problem.identity) / prior) ** 2) for at in (here, there))
    assert trained.tie > 0
    assert 0 <= cost - less < 10 * network.ENOUGH


@pytest.mark.broad
def test_an_asymmetry_of_scale_is_learnt():
    """0.3 % between + and − rates about each axis: omega = E m + B is what the net should undo, and |omega| k is to be taken off."""
    batch, sigma = recording(0, asymmetry=0.003, count=40)
    net = network.train_second_order(batch, sigma).net
    both = 1.5 * np.stack([np.eye(3), -np.eye(3)])
    bent = np.einsum("kii->i", net(both) - net(np.zeros(3))) / 2 / 1.5
    assert_allclose(bent, -0.003, atol=0.0015)
    batch, sigma = recording(5, count=8)
    batch.rate[2, 5, 1] = np.inf
    with np.errstate(invalid="ignore", over="ignore"), pytest.raises(FitError, match="finite"):
        network.train_second_order(batch, sigma)


# The swarm.


def swarmed(batch, sigma):
    return particle_swarm.search(Nearby.about(PERFECT, batch), PERFECT, sigma, 1.0, seed=0, prior=PERFECT)[0]


def test_the_swarm_never_ends_above_where_it_started_and_the_same_seed_is_the_same_swarm():
    """The centre is one of the particles; a bottom outside of the box is found."""

    def bowl(x):
        return np.sum((x - 0.3) ** 2, axis=-1)

    def found(centre, width, seed):
        return particle_swarm.minimise(bowl, np.array(centre), np.array(width), np.random.default_rng(seed))

    assert_allclose(found([0.0] * 6, [0.1] * 6, 0), 0.3, atol=1e-3)
    assert_array_equal(found([0.0] * 6, [0.1] * 6, 0), found([0.0] * 6, [0.1] * 6, 0))
    assert bowl(found([0.3] * 4, [10.0] * 4, 2)) == 0


def test_on_a_pendulum_the_swarm_leaves_the_start_where_least_squares_holds_hardly_observed_directions():
    """Rates about one axis but for 2 %: least squares keeps at the start what it hardly observes, and so closes worse.  It is no local
    minimum: with the prior alone in place of that, least squares ends where the swarm does."""
    true = LinearModel.from_vector(PERFECT.vector + 8 * TYPICAL * ([1] * 9 + [1 / 8] * 3))
    batch = small_turns(12, yaw_known=True)
    batch = replace(batch, rate=batch.rate * [0.02, 1.0, 0.02], earth=0 * batch.earth)
    begun, sigma = Rotation.from_quat(batch.start, scalar_first=True), np.full(len(batch), 3e-3)
    batch = replace(batch, end=wxyz(begun * turns_by_scipy(batch, true)))
    batch = turned_ends(batch, sigma[0] * np.random.default_rng(1).normal(size=(12, 3)))
    held, free = fit_least_squares(batch, sigma, PERFECT), fit_least_squares(batch, sigma, PERFECT, prior=vague(PERFECT.vector))
    assert {"E_xx", "E_zz"} <= set(held.unobserved)
    swarm, held, free = (np.linalg.norm(angles_by_scipy(batch, model.vector)) for model in (swarmed(batch, sigma), held.model, free.model))
    assert swarm < 0.9 * held
    assert free == pytest.approx(swarm, rel=1e-3)
