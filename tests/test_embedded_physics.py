"""The C of a model: each stage by hand, every kind of model against NumPy bit for bit and against the tool in double precision."""

import dataclasses
import re
import zlib
from types import SimpleNamespace

import numpy as np
import processes
import pytest
from exported_models import (
    CARRIED,
    KNOWN,
    LINEAR,
    MODELS,
    NET,
    RNG,
    Compiled,
    as_inputs,
    built,
    claim,
    needs_compiler,
    physics,
    pointer,
    random_inputs,
    state_bytes,
)
from numpy.testing import assert_allclose, assert_array_equal

from session.base.units import DEG, G
from session.log.config import Accelerometer, Sensor
from session.log.samples import Samples
from tinygc.deploy.embedded.program import COUNT, TOLERANCE, Registers, program, vectors
from tinygc.deploy.embedded.source import source_files
from tinygc.deploy.exports import ExportError
from tinygc.effects import AppliedEffect, catalogue
from tinygc.models.linear import LinearModel
from tinygc.models.physics import PhysicsModel

F = np.float32
ACCELEROMETER = Accelerometer(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.array([0.1, -0.2, 0.3]))
SENSOR = Registers(accelerometer=ACCELEROMETER)
each_model = pytest.mark.parametrize("name", MODELS)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """``compiled(name)``; all models are made by one call of gcc, each with names of its own."""
    files, sizes = {}, []
    for n, model in enumerate(MODELS.values()):
        made = source_files(program(model), SENSOR, "A test.", {})
        sizes.append(state_bytes(made))
        files |= {
            file.replace("tinygc", f"m{n}"): text.replace("tinygc_", f"m{n}_").replace("TINYGC", f"M{n}") for file, text in made.items()
        }
    library = built(tmp_path_factory.mktemp("c") / "all", files)
    functions = ("start", "step", "self_test", "from_registers", "force")

    def named(name):
        n = list(MODELS).index(name)
        return Compiled.of(SimpleNamespace(**{f"tinygc_{each}": getattr(library, f"m{n}_{each}") for each in functions}), sizes[n])

    return named


# Every kind of model


@needs_compiler
@each_model
def test_no_bit_differs_from_numpy_and_the_self_test_agrees(name, compiled):
    """Over several windows of the denoiser; two states do not touch each other, and start forgets."""
    model, table = compiled(name), random_inputs(200)
    expected = program(MODELS[name]).run(as_inputs(table))
    assert expected.dtype == F
    first, second = model.state(), model.state()
    model.run(random_inputs(30, seed=1), second)
    begun, _, ended = (model.run(rows, state) for rows, state in ((table[:120], first), (table[::-1], second), (table[120:], first)))
    assert_array_equal(np.append(begun, ended, axis=0).view(np.uint32), expected.view(np.uint32))
    model.library.tinygc_start(second)
    assert_array_equal(model.run(table, second), expected)
    assert model.self_test() == (0, 0.0)


@pytest.mark.parametrize("name", [name for name in MODELS if name != "all of it"])
def test_single_precision_costs_nothing_that_matters(name):
    """1e-6 of the rate or of 1 rad/s against the tool's own float64.  The temperature, of which it takes a second's mean, stands."""
    model, table = MODELS[name], random_inputs(1000)
    table[:, 6] = 31.5
    rate, force, temp_c = np.split(table.astype(float), [3, 6], axis=1)
    samples = Samples(np.arange(len(table)) * 4_807_692, rate, force, temp_c[:, 0])
    expected = model(rate) if model.rates_only else model.calibrate(samples)
    off = np.abs(program(model).run(as_inputs(table)) - expected) / np.maximum(1, np.abs(expected))
    assert off.max() < 1e-6


# Stages by hand


def test_a_constant_rate_passes_at_once_and_a_false_reading_is_gone_after_the_window():
    """Not a number, infinity: gone 48 samples later, since nothing is fed back."""
    chosen, table = program(MODELS["tinygc_denoised"]), random_inputs(200)
    still = chosen.run(as_inputs(np.tile(table[:1], (60, 1))))
    assert np.abs(still - NET(table[0, :3].astype(float))).max() < 2e-6
    assert np.ptp(still, axis=0).max() == 0
    clean = chosen.run(as_inputs(table))
    for bad in (np.nan, np.inf):
        hurt = table.copy()
        hurt[100, :3] = bad
        with np.errstate(invalid="ignore"):
            rates = chosen.run(as_inputs(hurt))
        assert not np.isfinite(rates[100:149]).all(axis=1).any()
        assert_array_equal(rates[149:], clean[149:])


def test_a_program_knows_its_size_and_its_weights():
    made = program(NET)
    files = source_files(made, Registers(Sensor("ASM330LHH", "", 104.0, 250, 8)), "T.", {"model": "m", "made": "today"})
    header = files["tinygc_model.h"]
    assert made.parameters == 27
    assert made.identity == zlib.crc32(b"".join(array.tobytes() for array in made.constants.values()))
    for words in (
        "108 bytes of weights, 1 of state; the self-test adds 1664:",
        f"0x{made.identity:08x}u",
        " * model    m\n * made     today\n",
    ):
        assert words in header
    assert "#define TINYGC_GYRO_FS_DPS 250\n#define TINYGC_ACCEL_FS_G 8\n#define TINYGC_ODR_HZ 104.0f" in header
    assert header.count("; this model does not read it") == 2
    warm = source_files(program(physics("gyro.thermal_bias", "gyro.g_sensitivity")), None, "T.", {})
    for words in ("this model does not read it", "TINYGC_ODR_HZ", "tinygc_from_registers"):
        assert (words in header, words in warm["tinygc_model.h"]) == (True, False), words
    assert ("mean over a second" in header, "mean over a second" in warm["tinygc_model.h"]) == (False, True)
    assert "static void tinygc_from_registers" in warm["tinygc_model.c"]


# Registers and force


@needs_compiler
def test_registers_and_force_mean_what_they_mean_in_a_log(compiled):
    """By the data sheet: 17.5 mdps, 0.122 mg and 1/256 degC per LSB at 500 dps and 4 g; M (a - b)."""
    registers = np.random.default_rng(3).integers(-32768, 32768, (300, 7)).astype(np.int16)
    registers[:2] = [[32767] * 7, [-32768] * 7]
    table, force, library = np.zeros((300, 7), F), np.zeros((300, 3), F), compiled("linear").library
    measured = (registers[:, 3:6] * 0.122e-3 * G).astype(F)
    for n in range(300):
        library.tinygc_from_registers(pointer(registers[n]), pointer(table[n]))
        library.tinygc_force(pointer(measured[n]), pointer(force[n]))
    inputs = SENSOR.inputs(registers)
    assert_array_equal(table, np.column_stack([inputs.rate, inputs.force, inputs.temp_c]))
    assert_allclose(table[:, :3], registers[:, :3] * 17.5e-3 * DEG, rtol=2e-7)
    expected = ACCELEROMETER.correct(measured.astype(float))
    assert_allclose(table[:, 3:6], expected, atol=1e-5)
    assert_allclose(force, expected, atol=1e-5)
    assert_array_equal(table[:, 6], 25 + registers[:, 6] / 256)


@pytest.mark.parametrize("accel_fs_g", [2, 8])
def test_vectors_cover_rates_gravity_and_temperatures_and_are_the_programs(accel_fs_g):
    sensor, made = Registers(Sensor("ASM330LHH", "", 208.0, 500, accel_fs_g)), program(LINEAR)
    registers, rates = vectors(made, sensor)
    assert (registers.shape, registers.dtype, COUNT, TOLERANCE) == ((COUNT, 7), np.int16, 64, 2e-6)
    assert_array_equal(rates, made.run(sensor.inputs(registers)))
    assert_array_equal(registers, vectors(made, sensor)[0])
    numbers, one_g = registers.astype(float), 32768 / accel_fs_g
    assert (np.abs(numbers[:, :3]) <= 28000).all()
    assert (np.ptp(numbers[:, :3], axis=0) > 40_000).all()
    assert_allclose(np.linalg.norm(numbers[:, 3:6], axis=1), one_g, atol=1)
    assert (np.ptp(numbers[:, 3:6], axis=0) > one_g).all()
    warm = numbers[:, 6] / (16 * 256)  # 16 degC
    assert 0.9 < warm.max() <= 1
    assert -1 <= warm.min() < -0.9


# Compilers, comments, refusals


@needs_compiler
def test_the_self_test_fails_where_a_weight_is_wrong(tmp_path):
    """A weight changed by 2e-5: 0.01 dps at full scale."""
    files = source_files(program(NET), SENSOR, "A test.", {})
    row = re.search(r"OUTER\[3\]\[4\] = \{\n +\{(\S+)f,", files["tinygc_model.c"])
    files["tinygc_model.c"] = files["tinygc_model.c"].replace(row[1], repr(float(row[1]) + 2e-5), 1)
    failed, worst = Compiled(tmp_path, files).self_test()
    assert failed == 1
    assert 1e-5 < worst < 2e-4


@needs_compiler
def test_it_compiles_without_a_word_needs_no_library_and_no_name_leaves_its_comment(tmp_path):
    hostile = ["*/ int x = 1; /*", "??/", "a\\", "//", "\x00\x1b[31m\n#error", "Gerät °", '"', "*" + "/" * 300, "%s {0} {title}"]
    files = source_files(program(MODELS["all of it"]), None, " ".join(hostile), {name: name for name in hostile})
    assert max(len(line) for text in files.values() for line in text.splitlines()) < 260
    built(tmp_path, files, "-std=c99", "-Os", "-ffreestanding", "-pedantic", "-Wconversion", "-Wshadow")
    text = processes.run(["nm", tmp_path / "all.so"], capture_output=True, text=True, check=True).stdout
    assert [line for line in text.splitlines() if " U " in line] == []
    assert re.findall(r"#include.*", "".join(files.values())) == ["#include <stdint.h>", '#include "tinygc_model.h"']


REFUSED = [name for name, effect in catalogue().items() if effect.kind == "rate" and name not in CARRIED]


def named(constant):
    """A physics model whose effect has a constant of this name."""
    effect = catalogue()["gyro.g_sensitivity"]
    code = dataclasses.replace(effect.device, name=constant)
    return PhysicsModel(LINEAR, (AppliedEffect(dataclasses.replace(effect, device=code), np.zeros(9)),), KNOWN)


@pytest.mark.parametrize(
    ("model", "says"),
    [
        *((physics(name), f"{name} cannot be exported to C: {re.escape(catalogue()[name].device.why)}; json") for name in REFUSED),
        (object(), "there is no C for it; json carries it"),
        (LinearModel(np.eye(3), np.array([0, 0, 3.5e38])), "holds numbers beyond single precision; C cannot carry it, json can"),
        (
            PhysicsModel(LINEAR, (claim("gyro.thermal_bias"),), dataclasses.replace(KNOWN, first_temp_c=float("nan"))),
            "gyro.thermal_bias|beyond single precision",
        ),
        (physics("gyro.g_sensitivity", "gyro.g_sensitivity"), r"two parts of the model call a constant [A-Z_]+ in C"),
        *((named(name), "is no name for a constant, expected capital letters") for name in ("k", "2K", "K G")),
    ],
)
def test_what_cannot_run_on_a_device_is_refused_in_one_line(model, says):
    with pytest.raises(ExportError, match=says) as caught:
        program(model)
    assert "\n" not in str(caught.value)


def test_every_effect_of_a_rate_is_either_carried_or_refused_by_a_reason_of_its_own():
    assert len(CARRIED) >= 6
    assert "K2_G" in program(named("K2_G")).constants
    assert "there is no C for it" not in [catalogue()[name].device.why for name in REFUSED]
