"""Programs of C on few inputs: what each stage computes, by hand; tables, literals, costs, state, registers and self-test vectors."""

import re
import zlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from exported_models import KNOWN, LINEAR, NET, physics

from session.io.config import Accelerometer, Sensor
from session.io.registers import DEFAULT, RegisterUnits
from tinygc.deploy import ExportError
from tinygc.deploy.embedded.program import TOLERANCE, Program, Registers, program, vectors
from tinygc.deploy.embedded.source import LONGEST, commented, constant, initialiser, literal, source_files
from tinygc.deploy.embedded.stages import CalibrationNetStage, Denoise, Inputs, Linear, affine, single, table
from tinygc.effects import AppliedEffect, catalogue
from tinygc.models.denoiser import DILATIONS, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import PhysicsModel

G = 9.80665
F = np.float32
ROWS = np.array([[1.0, -2.0, 3.0], [-0.5, 0.25, -4.0]], F)


def given(rate=ROWS, force=None, temp_c=None) -> Inputs:
    return Inputs.of(rate, force, temp_c)


# Stages.


def test_missing_inputs_are_zero():
    none = given()
    assert none.rate.dtype == none.force.dtype == none.temp_c.dtype == F
    np.testing.assert_array_equal(none.force, np.zeros((2, 3)))
    np.testing.assert_array_equal(none.temp_c, np.zeros(2))
    full = given(force=ROWS.astype(float), temp_c=[20.0, 30.0])
    np.testing.assert_array_equal(full.force, ROWS)
    assert full.temp_c.dtype == F


def test_an_affine_map_adds_bias_first_and_columns_in_order():
    """In single precision the order shows: ((b + w0 x0) + w1 x1) + w2 x2."""
    w = np.array([[1.0, 1.0, -1.0, 2.0**25], [2.0**25, 1.0, 0.0, 0.0], [0.5, 0.25, 0.125, 0.0625]], F)
    x = np.array([[1.0, 1.0, 2.0**25]], F)
    expected = [[0.0, 2.0**25, 0.5 + 0.25 + 2.0**22 + 0.0625]]  # 2^25 + 1 is 2^25
    np.testing.assert_array_equal(affine(w, x), np.array(expected, F))


def test_numbers_beyond_single_precision_are_refused_and_others_rounded():
    assert single([1 / 3], "x").dtype == F
    with pytest.raises(ExportError, match="x holds numbers beyond single precision"):
        single([3.5e38], "x")
    np.testing.assert_array_equal(table(np.eye(3), [1.0, 2.0, 3.0], "x"), np.column_stack([np.eye(3), [1, 2, 3]]))


def test_a_linear_stage_adds_a_small_correction():
    E, B = np.eye(3) + np.array([[0, 0.5, 0], [0, 0, 0.25], [-0.5, 0, 0.5]]), np.array([0.5, 0.0, -1.0])
    stage = Linear(LinearModel(E, B), "LINEAR", "f")
    np.testing.assert_array_equal(stage.run(given(), ROWS), (ROWS @ E.T + B).astype(F))
    np.testing.assert_array_equal(stage.constants["LINEAR"], np.column_stack([E - np.eye(3), B]))


SLOPE = np.array([0.5, 0.25, 2.0])
W1, W2 = np.array([[1.0, 0, 0.5], [0, -1, 0], [0.25, 0, 1]]), np.array([[0.5, 0, 0], [0.25, 1, 0], [0, 0.5, -1]])
B1, B2 = np.array([0.5, -0.25, 1.0]), np.array([1.0, 0.0, -0.5])


def bent(x, slope):
    return np.where(x < 0, slope * x, x)


def net_by_hand(rate):
    return rate + bent(rate @ W1.T + B1, SLOPE) @ W2.T + B2


def small_net() -> CalibrationNet:
    return CalibrationNet(**{name: value for name, value in zip(("W1", "b1", "slope", "W2", "b2"), (W1, B1, SLOPE, W2, B2), strict=True)})


def test_a_net_by_hand():
    np.testing.assert_array_equal(CalibrationNetStage(small_net()).run(given(), ROWS), net_by_hand(ROWS))


def test_a_denoiser_is_three_causal_convolutions_of_each_axis():
    """Written out sample by sample; before the first, the rate has stood."""
    smooth = Denoiser.from_vector(np.random.default_rng(2).integers(-4, 5, (3, 56)) / 8)
    rate = np.random.default_rng(3).integers(-8, 9, (60, 3)) / 8
    layers = (smooth.conv1, smooth.conv2, smooth.conv3)

    def net(series, axis):
        x = series[None]
        for w, dilation in zip(layers, DILATIONS, strict=True):
            y = np.zeros((w.shape[1], x.shape[1]))
            for n in range(x.shape[1]):
                for tap in range(w.shape[3]):
                    at = max(n - (w.shape[3] - 1 - tap) * dilation, 0)
                    y[:, n] += w[axis, :, :, tap] @ x[:, at]
            x = y
        return x[0]

    expected = np.stack([net(rate[:, a], a) for a in range(3)], axis=1)
    stage = Denoise(smooth)
    np.testing.assert_allclose(stage.run(given(rate), rate.astype(F)), expected, rtol=2e-6, atol=1e-5)
    sizes = [
        tuple(map(int, size)) for size in re.findall(r"float ring\d((?:\[\d+\])+);", stage.state) for size in [re.findall(r"\d+", size)]
    ]
    slots = [(w.shape[3] - 1) * d + 1 for w, d in zip(layers, DILATIONS, strict=True)]
    assert sizes == [(3, s, w.shape[2]) for s, w in zip(slots, layers, strict=True)]
    products = sum(w.size for w in layers)
    assert (stage.cost.multiply, stage.cost.add, stage.cost.compare) == (products, products, 0)
    assert stage.state_bytes == 4 * sum(np.prod(size) for size in sizes) + 4
    for n, (w, s) in enumerate(zip(layers, slots, strict=True), 1):
        np.testing.assert_array_equal(stage.constants[f"CONV{n}"].reshape(3, w.shape[3], *w.shape[1:3]), np.moveaxis(w, 3, 1))
        assert f"newest[{n - 1}] + 1u < {s}u" in stage.body


# A program.


def test_a_program_runs_its_stages_in_order_and_knows_itself():
    model = physics("gyro.g_sensitivity")
    made = program(model)
    rate = ROWS
    inputs = given(force=ROWS)
    for stage in made.stages:
        rate = stage.run(inputs, rate)
    np.testing.assert_array_equal(made.run(inputs), rate)
    assert made.parameters == model.parameters
    whole = b"".join(stage.constants[name].astype("<f4").tobytes() for stage in made.stages for name in stage.constants)
    assert made.identity == zlib.crc32(whole)
    assert made.cost.multiply == sum(stage.cost.multiply for stage in made.stages) > 0
    twice = Program((made.stages[0], made.stages[0]), 1)
    assert twice.cost.add == 2 * made.stages[0].cost.add


def test_two_constants_of_one_name_and_names_that_c_has_not_are_refused():
    with pytest.raises(ExportError, match=r"two parts of the model call a constant [A-Z_]+ in C"):
        program(physics("gyro.g_sensitivity", "gyro.g_sensitivity"))
    for name, good in (("K2_G", True), ("k", False), ("2K", False), ("K G", False)):
        effect = catalogue()["gyro.g_sensitivity"]
        named = AppliedEffect(replace(effect, device=replace(effect.device, name=name)), np.zeros(9))
        model = PhysicsModel(LINEAR, (named,), KNOWN)
        if good:
            assert name in program(model).constants
        else:
            with pytest.raises(ExportError, match="is no name for a constant, expected capital letters"):
                program(model)


# Registers.


def test_registers_scale_rate_force_and_temperature():
    """By hand: rad/s per LSB; M (lsb a - b); degC."""
    M, b = np.array([[1.0, 0.5, 0], [0, 2, 0], [0, 0, 1]]), np.array([0.5, -1.0, 2.0])
    sensor = Registers(250, 8, 104.0, Accelerometer(M, b), own_units={})
    units = RegisterUnits(sensor.model, 250, 8)
    raw = np.array([[1, -2, 3, 1000, -2000, 3000, 256], [-32768, 32767, 0, 0, 0, 0, -512]], np.int16)
    found = sensor.inputs(raw)
    np.testing.assert_allclose(found.rate, raw[:, :3] * units.gyro_rps, rtol=2e-7)
    np.testing.assert_allclose(found.force, (raw[:, 3:6] * units.accel_mps2 - b) @ M.T, rtol=1e-6)
    np.testing.assert_allclose(found.temp_c, raw[:, 6] / units.thermometer.lsb_per_c + units.thermometer.at_zero_c)
    assert found.rate.dtype == found.force.dtype == found.temp_c.dtype == F


def test_registers_of_a_session_are_known_where_their_units_are():
    sensor = Sensor(DEFAULT, "s", odr_hz=104, gyro_fs_dps=250, accel_fs_g=8)
    config = SimpleNamespace(sensor=sensor, accelerometer=Accelerometer(2 * np.eye(3), np.zeros(3)))
    assert (Registers().gyro_fs_dps, Registers().accel_fs_g, Registers().odr_hz) == (500, 4, 208.0)
    found = Registers.of(config)
    assert (found.gyro_fs_dps, found.accel_fs_g, found.odr_hz) == (250, 8, 104)
    np.testing.assert_array_equal(found.accelerometer.matrix, 2 * np.eye(3))
    other = Accelerometer(3 * np.eye(3), np.zeros(3))
    assert Registers.of(config, other).accelerometer is other
    config.sensor = replace(sensor, model="unheard of")
    assert Registers.of(config) is None


@pytest.mark.parametrize("accel_fs_g", [2, 4, 8])
def test_vectors_cover_rates_gravity_and_temperatures_and_are_the_programs(accel_fs_g):
    sensor, made = Registers(500, accel_fs_g), program(LINEAR)
    registers, rates = vectors(made, sensor)
    assert registers.shape == (64, 7)
    assert registers.dtype == np.int16
    assert rates.dtype == F
    np.testing.assert_array_equal(rates, made.run(sensor.inputs(registers)))
    np.testing.assert_array_equal(registers, vectors(made, sensor)[0])
    assert (np.abs(registers[:, :3]) <= 28000).all()
    registers = registers.astype(float)
    assert (np.ptp(registers[:, :3], axis=0) > 40_000).all()
    one_g = np.linalg.norm(registers[:, 3:6], axis=1)
    np.testing.assert_allclose(one_g, 32768 / accel_fs_g, atol=1)
    assert (np.ptp(registers[:, 3:6], axis=0) > one_g[0]).all()
    span = 16 * sensor.thermometer.lsb_per_c
    assert (np.abs(registers[:, 6]) <= span).all()
    assert registers[:, 6].max() > 0.9 * span
    assert registers[:, 6].min() < -0.9 * span
    assert TOLERANCE == 2e-6


# Text.


def test_literals_read_back_as_the_same_number():
    for value in (0.1, 1 / 3, -2.5e-10, 3e38, 1.0, 16777216.0):
        text = literal(F(value))
        assert text.endswith("f")
        assert F(text[:-1]) == F(value)
    assert literal(F(1.0)) == "1.0f"
    assert literal(np.int16(-7)) == "-7"


def test_tables_are_rows_with_seven_numbers_a_line():
    assert initialiser(np.arange(3, dtype=np.int16)) == "{0, 1, 2}"
    assert initialiser(np.arange(7, dtype=np.int16)) == "{0, 1, 2, 3, 4, 5, 6}"
    assert initialiser(np.arange(15, dtype=np.int16)) == "{0, 1, 2, 3, 4, 5, 6,\n     7, 8, 9, 10, 11, 12, 13,\n     14}"
    assert initialiser(np.array([[1, 2], [3, 4]], np.int16)) == "{\n    {1, 2},\n    {3, 4}}"
    assert constant("A", np.array([[0.5, 1]], F)) == "static const float A[1][2] = {\n    {0.5f, 1.0f}};"


def test_text_in_comments_has_at_most_120_characters():
    assert LONGEST == 120
    assert commented("a" * 200) == "a" * 120
    assert "*/" not in commented("*/ x")


def test_the_header_says_memory_cost_and_what_is_not_read():
    made = program(NET)
    files = source_files(made, Registers(250, 8, 104.0), "T.", {"model": "m", "made": "today"})
    header, source = files["tinygc_model.h"], files["tinygc_model.c"]
    assert "108 bytes of weights, 1 bytes of state" in header
    assert f"{made.cost.multiply} multiplications, {made.cost.add} additions, {made.cost.compare} comparisons" in header
    assert (made.cost.multiply, made.cost.add, made.cost.compare) == (21, 21, 3)
    assert header.count("; this model does not read it") == 2
    assert "mean over a second" not in header
    assert f"0x{made.identity:08x}u" in header
    assert "#define TINYGC_GYRO_FS_DPS 250\n#define TINYGC_ACCEL_FS_G 8\n#define TINYGC_ODR_HZ 104.0f" in header
    assert " * model    m\n * made     today\n" in header
    assert "sizeof(tinygc_state) == 1 ?" in source
    assert "static void tinygc_from_registers" not in source
    assert "TEST_REGISTERS[64][7]" in source
    assert "2e-06f * (1.0f + size)" in source
    warm = source_files(program(physics("gyro.thermal_bias", "gyro.g_sensitivity")), None, "T.", {})
    assert "this model does not read it" not in warm["tinygc_model.h"]
    assert "mean over a second" in warm["tinygc_model.h"]
    assert "TINYGC_ODR_HZ" not in warm["tinygc_model.h"]
    assert "tinygc_from_registers" not in warm["tinygc_model.h"]
    assert "static void tinygc_from_registers" in warm["tinygc_model.c"]


def test_the_accelerometers_calibration_is_in_its_table():
    M, b = np.array([[1.0, 0.5, 0], [0, 2, 0], [0, 0, 1]]), np.array([0.5, -1.0, 2.0])
    source = source_files(program(LINEAR), None, "T.", {}, Accelerometer(M, b))["tinygc_model.c"]
    expected = constant("ACCELEROMETER", np.column_stack([M, -M @ b]).astype(F))
    assert expected in source
    own = source_files(program(LINEAR), Registers(accelerometer=Accelerometer(M, b)), "T.", {})["tinygc_model.c"]
    assert expected in own
