"""The exported C on this machine: bit for bit what NumPy does in single precision in the same order, and the model it was made of."""

from __future__ import annotations

import ctypes
import dataclasses
import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import processes
import pytest
import torch
from conftest import broad
from exported_models import CARRIED, KNOWN, LINEAR, MODELS, NET, RNG, WHOLE, as_inputs, claim, physics, random_inputs

from session.io.config import Accelerometer
from session.io.registers import accel_mps2_per_lsb, gyro_rps_per_lsb
from session.io.samples import Samples
from tinygc.deploy.embedded.program import Registers, program
from tinygc.deploy.embedded.source import FLAGS, source_files
from tinygc.deploy.exports import ExportError
from tinygc.effects import catalogue
from tinygc.effects.device import NONE
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import PhysicsModel

needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="not installed: gcc")
SENSOR = Registers(500, 4, 208.0, Accelerometer(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.array([0.1, -0.2, 0.3])))


class Compiled:
    """The two files as a shared library, called sample by sample."""

    def __init__(self, folder: Path, files: dict[str, str], *flags: str):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="ascii")
        command = ["gcc", *(flags or FLAGS.split()), "-O2", "-shared", "-fPIC", folder / "tinygc_model.c", "-o", folder / "model.so"]
        made = processes.run(command, capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        self.library = ctypes.CDLL(str(folder / "model.so"))
        self.state_bytes = int(re.search(r"state_is_(\d+)_bytes", files["tinygc_model.c"])[1])

    def state(self):
        state = ctypes.create_string_buffer(b"\xa5" * self.state_bytes, self.state_bytes)  # what was in memory before must not matter
        self.library.tinygc_start(state)
        return state

    def run(self, table: np.ndarray, state=None) -> np.ndarray:
        table, rates = np.ascontiguousarray(table), np.zeros((len(table), 3), np.float32)
        state = state or self.state()
        step, at, to = self.library.tinygc_step, table.ctypes.data, rates.ctypes.data
        for n in range(len(table)):
            step(state, ctypes.c_void_p(at + 28 * n), ctypes.c_void_p(to + 12 * n))
        return rates

    def self_test(self) -> tuple[int, float]:
        worst = ctypes.c_float(-1)
        return self.library.tinygc_self_test(ctypes.byref(worst)), worst.value


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """``compiled("linear")``; all models are made by one call of gcc, each with names of its own, which costs half the time."""
    folder, made = tmp_path_factory.mktemp("c"), {}
    for n, name in enumerate(MODELS):
        made[name] = files = source_files(program(MODELS[name]), SENSOR, "A test.", {"model": name})
        for file, text in files.items():
            (folder / file.replace("tinygc", f"m{n}")).write_text(text.replace("tinygc_", f"m{n}_").replace("TINYGC", f"M{n}"))
    sources = [folder / f"m{n}_model.c" for n in range(len(MODELS))]
    command = ["gcc", *FLAGS.split(), "-O1", "-shared", "-fPIC", *sources, "-o", folder / "all.so"]
    result = processes.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    library = ctypes.CDLL(str(folder / "all.so"))

    def make(name: str) -> Compiled:
        one, n = Compiled.__new__(Compiled), list(MODELS).index(name)
        functions = ("start", "step", "self_test", "from_registers")
        one.library = SimpleNamespace(**{f"tinygc_{each}": getattr(library, f"m{n}_{each}") for each in functions})
        one.state_bytes = int(re.search(r"state_is_(\d+)_bytes", made[name]["tinygc_model.c"])[1])
        return one

    return make


@needs_compiler
@pytest.mark.parametrize("name", MODELS)
def test_no_bit_differs_from_numpy(name, compiled):
    """Over six windows of the denoiser."""
    table = random_inputs(300)
    expected = program(MODELS[name]).run(as_inputs(table))
    assert expected.dtype == np.float32
    differ = compiled(name).run(table).view(np.uint32) != expected.view(np.uint32)
    assert np.count_nonzero(differ) == 0


@needs_compiler
@pytest.mark.parametrize("name", MODELS)
def test_the_self_test_passes_exactly(name, compiled):
    assert compiled(name).self_test() == (0, 0.0)


@needs_compiler
def test_the_self_test_fails_where_a_weight_is_wrong(tmp_path):
    """A weight changed by 2e-5: 0.01 dps at full scale."""
    files = source_files(program(NET), SENSOR, "A test.", {})
    row = re.search(r"OUTER\[3\]\[4\] = \{\n +\{(\S+)f,", files["tinygc_model.c"])
    files["tinygc_model.c"] = files["tinygc_model.c"].replace(row[1], repr(float(row[1]) + 2e-5), 1)
    failed, worst = Compiled(tmp_path, files).self_test()
    assert failed == 1
    assert 1e-5 < worst < 2e-4


def double(model, table: np.ndarray) -> np.ndarray:
    """What the tool itself makes of the samples, in float64.  The temperature is taken as it is, as the device takes it."""
    rate, force, temp_c = np.split(table.astype(float), [3, 6], axis=1)
    if model.rates_only:
        return model(rate)
    samples = Samples(np.arange(len(table)) * 4_807_692, rate, force, temp_c[:, 0])
    return model.calibrate(samples)


@pytest.mark.parametrize("name", [name for name in MODELS if name != "all of it"])
def test_single_precision_costs_nothing_that_matters(name):
    """1e-6 of the rate or of 1 rad/s: the temperature, of which the tool takes the mean over a second, stands."""
    table = random_inputs(2000)
    table[:, 6] = 31.5
    expected = double(MODELS[name], table)
    off = np.abs(program(MODELS[name]).run(as_inputs(table)) - expected) / np.maximum(1, np.abs(expected))
    assert off.max() < 1e-6


class Counted(np.ndarray):
    """Counts the floating-point operations that are done with it."""

    done: ClassVar[dict[str, int]] = {}

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        plain = [np.asarray(value) for value in inputs]
        result = getattr(ufunc, method)(*plain, **kwargs)
        self.done[ufunc.__name__] = self.done.get(ufunc.__name__, 0) + np.size(result)
        return np.asarray(result).view(Counted)

    def __array_function__(self, function, types, arguments, options):
        result = super().__array_function__(function, types, arguments, options)
        return result.view(Counted) if isinstance(result, np.ndarray) else result


@pytest.mark.parametrize("name", ["linear", "tinygc", "gyro.scale_nonlinearity", "tinygc_denoised"])
def test_the_operations_that_the_header_names_are_those_that_are_done(name):
    Counted.done.clear()
    chosen, inputs, count = program(MODELS[name]), as_inputs(random_inputs(100)), 100
    counted = dataclasses.replace(inputs, rate=inputs.rate.view(Counted), force=inputs.force.view(Counted))
    chosen.run(counted)
    done = Counted.done
    assert done["multiply"] == count * chosen.cost.multiply
    assert done["add"] + done.get("subtract", 0) == count * chosen.cost.add
    assert done.get("greater_equal", 0) == count * chosen.cost.compare


def as_float32(array) -> torch.Tensor:
    return torch.tensor(np.asarray(array), dtype=torch.float32)


def turning(top: float, count: int = 10_000, seed: int = 2) -> np.ndarray:
    """A hand's movement (N, 3) float32 up to ``top`` rad/s at 208 Hz, with the sensor's noise."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(count) / 208.0
    return (top * np.sin(2 * np.pi * np.outer(t_s, [0.2, 0.3, 0.15])) + 1e-3 * rng.normal(size=(count, 3))).astype(np.float32)


@pytest.mark.parametrize(("top_dps", "limit"), [(250, 2e-6), (500, 4e-6)])
def test_pytorch_in_single_precision_agrees(top_dps, limit):
    """2e-6 rad/s at a hand's rates; at full scale, where a float's last place is 1e-6 rad/s, relative: 2e-6 of the rate."""
    rate = turning(np.radians(top_dps))
    net = CalibrationNet(*(as_float32(getattr(NET, field.name)) for field in dataclasses.fields(NET)))
    smooth = WHOLE.denoiser
    whole = DenoisedNet(net, Denoiser(*map(as_float32, (smooth.conv1, smooth.conv2, smooth.conv3))), 208.0)
    theirs, ours = whole(torch.tensor(rate)).numpy(), program(WHOLE).run(as_inputs(np.pad(rate, ((0, 0), (0, 4)))))
    assert theirs.dtype == np.float32
    assert np.abs(theirs - ours).max() < limit
    assert (np.abs(theirs - ours) / np.maximum(1, np.abs(theirs))).max() < 1e-6


@needs_compiler
@pytest.mark.parametrize("flags", ["-std=c99 -pedantic", "-std=c11 -pedantic -Wconversion -Wshadow", "-std=c11 -Os -ffreestanding"])
@pytest.mark.parametrize("name", ["all of it", *(broad(each) for each in ("linear", "tinygc_denoised"))])
def test_it_compiles_without_a_word_and_needs_no_library(name, flags, tmp_path):
    files = source_files(program(MODELS[name]), None, "A test.", {})
    Compiled(tmp_path, files, *FLAGS.split(), *flags.split())
    text = processes.run(["nm", tmp_path / "model.so"], capture_output=True, text=True, check=True).stdout
    undefined = {line.split()[-1] for line in text.splitlines() if " U " in line}
    assert undefined == set()
    assert re.findall(r"#include.*", "".join(files.values())) == ["#include <stdint.h>", '#include "tinygc_model.h"']


@needs_compiler
def test_two_states_do_not_touch_each_other_and_start_forgets(compiled):
    model, table = compiled("tinygc_denoised"), random_inputs(200)
    alone = model.run(table)
    first, second = model.state(), model.state()
    for n in range(len(table)):
        np.testing.assert_array_equal(model.run(table[n : n + 1], first)[0], alone[n])
        model.run(random_inputs(1, seed=n), second)
    model.library.tinygc_start(first)
    np.testing.assert_array_equal(model.run(table, first), alone)


@needs_compiler
def test_a_constant_rate_passes_the_denoiser_from_the_first_sample(compiled):
    """No transient: before the first sample the rate is taken to have stood."""
    table = np.tile(random_inputs(1), (120, 1))
    rates = compiled("tinygc_denoised").run(table)
    assert np.abs(rates - NET(table[0, :3].astype(float))).max() < 2e-6
    assert np.ptp(rates, axis=0).max() == 0


@needs_compiler
def test_a_false_reading_is_forgotten_after_the_window(compiled):
    """Not a number, infinity: gone 48 samples later, since nothing is fed back."""
    table = random_inputs(200)
    clean = compiled("tinygc_denoised").run(table)
    for bad in (np.nan, np.inf):
        hurt = table.copy()
        hurt[100, :3] = bad
        rates = compiled("tinygc_denoised").run(hurt)
        assert not np.isfinite(rates[100:149]).all(axis=1).any()
        np.testing.assert_array_equal(rates[149:], clean[149:])


@needs_compiler
def test_registers_mean_what_they_mean_in_a_log(compiled):
    registers = np.random.default_rng(3).integers(-32768, 32768, (500, 7)).astype(np.int16)
    registers[:2] = [[32767] * 7, [-32768] * 7]
    table = np.zeros((500, 7), np.float32)
    convert = compiled("linear").library.tinygc_from_registers
    for n in range(500):
        convert(ctypes.c_void_p(registers.ctypes.data + 14 * n), ctypes.c_void_p(table.ctypes.data + 28 * n))
    expected = SENSOR.inputs(registers)
    np.testing.assert_array_equal(table, np.column_stack([expected.rate, expected.force, expected.temp_c]))
    np.testing.assert_allclose(table[:, :3], registers[:, :3] * gyro_rps_per_lsb(500), rtol=2e-7)
    force = SENSOR.accelerometer.correct(registers[:, 3:6] * accel_mps2_per_lsb(4))
    np.testing.assert_allclose(table[:, 3:6], force, atol=1e-5)
    np.testing.assert_array_equal(table[:, 6], 25 + registers[:, 6] / 256)


@pytest.mark.parametrize("effect", [name for name, e in catalogue().items() if e.kind == "rate" and name not in CARRIED])
def test_what_cannot_run_on_a_device_is_refused_in_one_line(effect):
    why = re.escape(catalogue()[effect].device.why)
    with pytest.raises(ExportError, match=f"{effect} cannot be exported to C: {why}; json carries it") as caught:
        program(physics("gyro.g_sensitivity", effect))
    assert "\n" not in str(caught.value)


def test_every_effect_of_a_rate_is_either_carried_or_refused_by_name():
    """An effect that is added to the catalogue must be thought about here: the reason is its own, not the one that stands without."""
    refused = {name: effect.device for name, effect in catalogue().items() if effect.kind == "rate" and name not in CARRIED}
    assert len(CARRIED) >= 6
    assert NONE not in refused.values()


@pytest.mark.parametrize("model", [object(), LinearModel(1e39 * np.eye(3), np.zeros(3)), LinearModel(np.eye(3), np.array([0, 0, 1e300]))])
def test_other_models_and_numbers_beyond_single_precision_are_refused(model):
    with pytest.raises(ExportError, match=r"json can|json carries"):
        program(model)


def test_thermal_physics_without_a_temperature_is_refused():
    known = dataclasses.replace(KNOWN, first_temp_c=float("nan"))
    with pytest.raises(ExportError, match="thermal_bias"):
        program(PhysicsModel(LINEAR, (claim("gyro.thermal_bias"),), known))


@needs_compiler
@pytest.mark.parametrize(
    "name", ["*/ int x = 1; /*", "??/", "a\\", "//", "\x00\x1b[31m\n#error", "Gerät °", '"', "*" + "/" * 300, "%s {0} {title}"]
)
def test_no_name_can_leave_its_comment(name, tmp_path):
    files = source_files(program(LINEAR), None, name, {name: name})
    assert all(text.isascii() and max(map(len, text.splitlines())) < 260 for text in files.values())
    assert Compiled(tmp_path, files).self_test() == (0, 0.0)


@needs_compiler
def test_export_writes_what_compiles_and_agrees_with_the_fit(simulated, tmp_path):
    """From the command line to the rates of the session's own log."""
    import calibrate
    from tinygc import models, read_session

    folder = tmp_path / "session"
    shutil.copytree(simulated(), folder)
    assert calibrate.main(["fit", str(folder), "--methods", "least_squares,tinygc", "--folds", "2", "--quiet"]) == 0
    out = ["--quiet", "--out", str(tmp_path / "c"), "--json", str(tmp_path / "said.json")]
    assert calibrate.main(["export", str(folder), "--to", "c", "--model", "tinygc", *out]) == 0
    assert [Path(name).name for name in json.loads((tmp_path / "said.json").read_text())["files"]] == ["tinygc_model.h", "tinygc_model.c"]
    files = {path.name: path.read_text() for path in (tmp_path / "c").iterdir()}
    for said in ("tinygc, 27 parameters", "104 Hz", "108 bytes of weights", "sha256"):
        assert said in files["tinygc_model.h"]
    rate = read_session(folder).logs[0].samples.gyro[:3000]
    expected = models.load(folder / "fit" / "model_tinygc.json")(rate)
    rates = Compiled(tmp_path / "built", files).run(np.pad(rate.astype(np.float32), ((0, 0), (0, 4))))
    np.testing.assert_allclose(rates, expected, rtol=1e-6, atol=1e-7)
