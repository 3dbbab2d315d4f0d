"""The model over temperature: its formula, its file, its streams, its C, and what other programs make of its exports."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from exported_models import LINEAR, Compiled, needs_compiler
from exports_read_back import autopilot_parameters, autopilot_zero, context
from noise_records import figures

from session.log.samples import Samples
from tinygc import CalibrationError
from tinygc.deploy.calibration import Calibration
from tinygc.deploy.embedded.program import Inputs, program
from tinygc.deploy.embedded.source import source_files
from tinygc.deploy.exports import ExportError, exporter
from tinygc.features.temperature.model import ThermalModel, element_temperature
from tinygc.library.reports import Exported
from tinygc.models.denoiser import DenoisedNet, Denoiser

RNG = np.random.default_rng(5)
RATE_HZ = 104.0
ZERO = np.array([[0.5, -0.3, 0.6], [0.034, 0.01, -0.02], [2e-4, 0.0, -1e-4], [1e-6, 2e-6, 0.0]]) * DEG
MODEL = ThermalModel(
    E_terms=np.stack([np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), 1e-4 * RNG.normal(size=(3, 3)), 1e-6 * RNG.normal(size=(3, 3))]),
    zero_terms=ZERO,
    lag_s=np.array([20.0, 0.0, -15.0]),
    reference_c=28.0,
    range_c=(-10.0, 70.0),
)
PROMPT = replace(MODEL, lag_s=np.zeros(3))
ZERO_ONLY = replace(PROMPT, E_terms=np.eye(3)[None])


def log(count=3000, seed=0):
    rng = np.random.default_rng(seed)
    t_ns = np.rint(np.arange(count) / RATE_HZ * 1e9).astype(np.int64)
    temp = 30 + 55 * np.sin(np.arange(count) / count * 7) + rng.normal(size=count) * 0.01
    return Samples(t_ns, rng.uniform(-5, 5, (count, 3)), rng.normal(size=(count, 3)), temp)


def by_hand(model, samples):
    """The formula of docs/model-json.md, a sample at a time."""
    element = np.column_stack([element_temperature(samples.temp_c, tau, samples.period_s) for tau in model.lag_s])
    out = []
    for m, temp, own in zip(samples.gyro, samples.temp_c, element, strict=True):
        held = lambda celsius: np.clip(celsius, *model.range_c) - model.reference_c  # noqa: E731
        E = sum(term * held(temp) ** n for n, term in enumerate(model.E_terms))
        zero = sum(term * held(own) ** n for n, term in enumerate(model.zero_terms))
        out.append(E @ (m - zero))
    return np.array(out)


@pytest.mark.parametrize("model", [MODEL, ZERO_ONLY])
def test_its_formula(model):
    samples = log(300)
    np.testing.assert_allclose(model.calibrate(samples), by_hand(model, samples), atol=1e-12)
    still = replace(samples, temp_c=np.full(300, 41.5))
    np.testing.assert_allclose(model.calibrate(still), model.at(41.5)(still.gyro), atol=1e-12)
    change = np.array([0.01, -0.02, 0.03])
    still = replace(samples, temp_c=np.full(300, model.reference_c))
    moved = model.with_bias_moved(change).calibrate(still) - model.calibrate(still)
    np.testing.assert_allclose(moved, np.tile(change, (300, 1)), atol=1e-12)


# In use


def test_pieces_and_single_samples_give_what_the_whole_gives():
    samples = log(800)
    whole = Calibration(MODEL, RATE_HZ)(samples.gyro, temp=samples.temp_c)
    stream = Calibration(MODEL, RATE_HZ).stream()
    parts = [stream.push(samples.gyro[a:b], None, samples.temp_c[a:b]) for a, b in ((0, 1), (1, 300), (300, 800))]
    np.testing.assert_allclose(np.concatenate([*parts, stream.flush()]), whole, atol=1e-10)
    live = Calibration(MODEL, RATE_HZ).live()
    each = [live(m, temp=t) for m, t in zip(samples.gyro[:200], samples.temp_c[:200], strict=True)]
    np.testing.assert_allclose(each, whole[:200], atol=1e-10)


def test_it_asks_for_what_it_needs():
    assert Calibration(MODEL, RATE_HZ).needs == ("temp",)
    for call, says in (
        (lambda: Calibration(MODEL, RATE_HZ)(np.zeros((5, 3))), "needs temp"),
        (lambda: Calibration(MODEL)(np.zeros((5, 3)), temp=np.zeros(5)), "lag: time matters"),
        (lambda: MODEL.calibrate(replace(log(), temp_c=None)), "no temperature"),
        (lambda: program(MODEL), "needs the data rate"),
        (lambda: exporter("kalibr").export(MODEL, context()), "cannot carry a calibration over temperature"),
    ):
        with pytest.raises(CalibrationError, match=says):
            call()
    assert np.isfinite(Calibration(PROMPT)(np.zeros((5, 3)), temp=np.zeros(5))).all()
    assert program(PROMPT).parameters == PROMPT.parameters


# C


@needs_compiler
@pytest.mark.parametrize("model", [MODEL, PROMPT, ZERO_ONLY])
def test_c_is_bit_for_bit_numpy_and_close_to_the_model(model, tmp_path):
    made = program(model, RATE_HZ)
    device = Compiled(tmp_path, source_files(made, None, "A test.", {}))
    assert device.self_test() == (0, 0.0)
    samples = log(4000, seed=3)
    inputs = Inputs.of(samples.gyro, samples.accel, samples.temp_c)
    table = np.column_stack([inputs.rate, inputs.force, inputs.temp_c]).astype(np.float32)
    there = device.run(table)
    np.testing.assert_array_equal(there, made.run(inputs))
    expected = Calibration(model, RATE_HZ)(samples.gyro, temp=samples.temp_c)
    assert np.abs(there - expected).max() < 5e-6


# Autopilots: read back by their own formulas, as their sources have them


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_autopilots_have_the_models_zero(name):
    said = []
    made = context(said, table={"accel_change_mps2": [[1e-3, 0, -2e-3], [1e-5, 0, 0]]})
    (text,) = exporter(name).export(PROMPT, made).values()
    p, celsius = autopilot_parameters(text), np.linspace(-30, 90, 200)
    expected = PROMPT.zero(np.column_stack([celsius] * 3))
    # Their parameters are single precision.
    assert np.abs(autopilot_zero(name, p, celsius) - expected).max() < 2e-6 * np.abs(expected).max() + 1e-8
    change = np.clip(celsius, -10, 70) - 28
    accel = autopilot_zero(name, p, celsius, gyro=False)
    np.testing.assert_allclose(accel, np.stack([1e-3 * change + 1e-5 * change**2, 0 * change, -2e-3 * change], axis=-1), atol=1e-6)
    assert "no scale and no misalignment" in said[0]
    assert len(said) == 1


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_what_a_cubic_cannot_carry_is_said_with_its_size(name):
    said, fifth = [], np.zeros((6, 3))
    fifth[:4], fifth[5, 0] = ZERO, 1e-9 * DEG
    model = replace(ZERO_ONLY, zero_terms=fifth, lag_s=np.array([100.0, 0, 0]))
    (text,) = exporter(name).export(model, context(said, table={})).values()
    celsius = np.linspace(-10, 70, 200)
    off = np.abs(autopilot_zero(name, autopilot_parameters(text), celsius) - model.zero(np.column_stack([celsius] * 3))).max() / DEG
    stated = float(next(line for line in said if "nearest cubic" in line).split("by up to ")[1].split()[0])
    assert off == pytest.approx(stated, rel=0.1)
    assert any("has no lag (100, 0, 0 s)" in line and "0.057 dps" in line for line in said)


def test_rest_logs_leave_as_noise_where_their_model_cannot():
    """``fit`` of rest logs makes a model over temperature; noise figures beside it go where it does not, and the command says so."""
    said: list[str] = []
    of_rests = context(said, method="thermal", noise=figures())
    made = Exported.of("kalibr", lambda name: (MODEL, of_rests), said)
    assert list(made.files) == ["imu.yaml"]
    assert any("cannot carry a calibration over temperature" in line and "the noise alone is exported" in line for line in said)
    for name, names in ("px4", ["px4.params", "px4-noise.params"]), ("ardupilot", ["ardupilot.param", "ardupilot-noise.param"]):
        assert list(Exported.of(name, lambda name: (MODEL, of_rests), said).files) == names
    denoised = DenoisedNet(LINEAR, Denoiser.identity(), 208.0)  # not of rest logs: it is refused
    for model, other, says in ((MODEL, replace(of_rests, noise=None), "a calibration over temp"), (denoised, of_rests, "has no memory")):
        with pytest.raises(ExportError, match=says):
            Exported.of("kalibr", lambda name, known=(model, other): known, said)
