"""The array's C on this machine: the same rates as Python to single precision, and the same votes at the same samples."""

import ctypes
import shutil
from dataclasses import replace

import numpy as np
import processes
import pytest
from simulated_array import DEG, DENSITY, measured, model_of, motion, units

import calibrate
from tinygc.annexes.arrays.c_code import array_source, c_constants, self_test_vectors
from tinygc.annexes.arrays.fusion import save_array_model
from tinygc.annexes.arrays.voting import DIFFERS, REASONS, LiveArray, Tables
from tinygc.deploy import ExportError
from tinygc.deploy.embedded.source import FLAGS

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="not installed: gcc")


class Compiled:
    """The two files as a shared library."""

    def __init__(self, folder, files, count: int):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="ascii")
        flags = [*FLAGS.split(), "-std=c99", "-pedantic", "-Wconversion", "-Wshadow", "-ffreestanding", "-O2", "-shared", "-fPIC"]
        made = processes.run(["gcc", *flags, folder / "tinygc_array.c", "-o", folder / "a.so"], capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        self.library = ctypes.CDLL(str(folder / "a.so"))

        class Input(ctypes.Structure):
            _fields_ = [("rate", ctypes.c_float * 3 * count), ("present", ctypes.c_uint8 * count)]

        class Output(ctypes.Structure):
            _fields_ = [
                ("rate", ctypes.c_float * 3),
                ("variance", ctypes.c_float * 3),
                *[(name, ctypes.c_uint8) for name in ("valid", "at_end", "disagree", "changed")],
                ("used", ctypes.c_uint8 * count),
                ("why", ctypes.c_uint8 * count),
                ("score", ctypes.c_float * count),
            ]

        self.input, self.output, self.count = Input, Output, count

    def run(self, raw, said=True):
        """rates, variances (T, 3); used, why (T, N); disagree (T,); said: ``present`` says which units have none, else NaN alone does."""
        state = ctypes.create_string_buffer(b"\xa5" * 16384, 16384)  # what was in memory before must not matter
        self.library.tinygc_array_start(state)
        given, answer, found = self.input(), self.output(), []
        for sample in raw.astype(np.float32):
            there = np.isfinite(sample).all(axis=1)
            given.present[:] = there.astype(int).tolist() if said else [1] * self.count
            ctypes.memmove(given.rate, np.ascontiguousarray(sample).ctypes.data, 12 * self.count)
            self.library.tinygc_array_step(state, ctypes.byref(given), ctypes.byref(answer))
            rates = list(answer.rate) if answer.valid else [np.nan] * 3
            found.append((rates, list(answer.variance), list(answer.used), list(answer.why), answer.disagree))
        return [np.array(each) for each in zip(*found, strict=True)]

    def self_test(self):
        worst = ctypes.c_float(-1)
        return self.library.tinygc_array_self_test(ctypes.byref(worst)), worst.value


def everything_goes_wrong(raw):
    """Faults of many kinds, one after the other, some at once, and clipping in all units."""
    raw, count = raw.copy(), raw.shape[1]
    raw[300:500, 1] = np.nan
    raw[600:900, 2 % count] += 5 * DEG
    raw[1000:1200, 3 % count] = raw[1000, 3 % count]
    raw[1200:1500:40, 4 % count] += 60 * DEG
    raw[1500:1700, 5 % count] *= -1
    raw[1500:1900, 6 % count] += 3 * DEG
    raw[1950:2000] = np.nan
    return np.clip(raw, -500 * DEG, 500 * DEG)


@pytest.mark.parametrize("count", [2, 3, 8])
def test_c_fuses_and_votes_as_python_does(count, tmp_path):
    density = np.linspace(1, 2, count) * DENSITY
    model = model_of(units(count, density=density, full_scale=500))
    raw = everything_goes_wrong(measured(model, motion(2400, top_dps=450)))
    raw = raw.astype(np.float32).astype(float)
    compiled = Compiled(tmp_path, array_source(model), count)
    rates, variances, used, why, disagree = compiled.run(raw)
    for found, again in zip((rates, variances, used, why, disagree), compiled.run(raw, said=False), strict=True):
        np.testing.assert_array_equal(found, again)
    fused = LiveArray(model)(raw)
    standing, two = np.zeros(why.shape, dtype=int), np.zeros(len(raw), dtype=bool)
    for event in fused.events:
        if event.unit is None:
            two[event.sample :] = event.what == "disagree"
        else:
            codes = {reason: code for code, reason in REASONS.items()}
            standing[event.sample :, event.unit] = codes.get(event.reason, 0)
    np.testing.assert_array_equal(why, standing)
    np.testing.assert_array_equal(disagree, two)
    np.testing.assert_array_equal(used, fused.used)
    np.testing.assert_allclose(rates, fused.rate, rtol=2e-6, atol=5e-6, equal_nan=True)
    sigma = fused.sigma
    some = np.isfinite(sigma)
    np.testing.assert_allclose(np.sqrt(variances[some]), sigma[some], rtol=2e-3)
    assert len(set(why.ravel())) >= (2 if count == 2 else 3)
    assert disagree.any() == (count < 8)


def test_self_test_vectors_are_a_turn_in_which_the_last_unit_lies_from_the_25th_sample_on():
    """sin of one, two and half a circle by 0.3, 0.2 and 0.4 rad/s, each unit's own noise on it, 2 rad/s from sample 24 on."""
    model = model_of(units(4, density=np.array([1.0, 2, 3, 4]) * DENSITY))
    inputs, rates, why = self_test_vectors(model)
    assert inputs.shape == (64, 4, 3)
    assert inputs.dtype == rates.dtype == np.float32
    omega = np.sin(2 * np.pi * np.arange(64)[:, None] / 64 * [1.0, 2.0, 0.5]) * [0.3, 0.2, 0.4]
    clean = np.einsum("nij,tnj->tni", np.linalg.inv(model.matrices), omega[:, None] - model.offsets)
    clean[24:, 3] += 2.0
    off = (inputs - clean) / (np.array([1.0, 2, 3, 4]) * DENSITY * np.sqrt(model.rate_hz / 2))[:, None]
    np.testing.assert_allclose(off.std(axis=(0, 2)), 1.0, atol=5 / np.sqrt(2 * 192))
    assert off.std() == pytest.approx(1.0, abs=5 / np.sqrt(2 * 768))
    assert np.abs(off.mean(axis=(0, 2))).max() < 5 / np.sqrt(192)
    assert np.abs(off).max() < 5
    np.testing.assert_array_equal(why, [0, 0, 0, DIFFERS])
    np.testing.assert_allclose(rates, LiveArray(model)(inputs.astype(float)).rate, rtol=1e-6)
    again = self_test_vectors(model)[0]
    np.testing.assert_array_equal(again, inputs)


def test_tables_and_scalars_are_the_votes_in_single_precision():
    model = model_of(units(2))
    table, constants, files = Tables.of(model), c_constants(model), array_source(model)
    for name, of in {"MATRIX": "matrix", "OFFSET": "offset", "WEIGHT": "weights", "SHARE": "share", "NOISE": "noise", "FIXED": "fixed",
                     "SPREAD": "spread", "OWN": "own", "END_OF_RANGE": "end"}.items():  # fmt: skip
        np.testing.assert_array_equal(constants[name], getattr(table, of).astype(np.float32))
    defined = dict(line.split()[1:3] for line in files["tinygc_array.c"].splitlines() if line.startswith("#define") and "UNITS" not in line)
    numbers = {name: float(value.rstrip("f")) for name, value in defined.items()}
    expected = {
        "SCALE2": table.scale2, "DELAY2": table.delay2, "ALPHA": table.alpha, "MEAN_SHARE": table.alpha / (2 - table.alpha), "ASIDE2": 36,
        "SLOW2": 36, "FAST": 9, "BACK": 0.5, "ALONE": 0.25, "DEAD_AFTER": table.dead, "STUCK_AFTER": table.stuck, "HOLD_FOR": table.hold,
        "FEWEST": 3, "SOON_STUCK": 4, "TEST_COUNT": 64,
    }  # fmt: skip
    assert numbers == pytest.approx(expected, rel=1e-6)
    assert "2e-05f * (1.0f + size)" in files["tinygc_array.c"]
    assert "TINYGC_ARRAY_UNITS 2" in files["tinygc_array.h"]
    assert " * session  -\n" in files["tinygc_array.h"]
    assert " * session  desk\n" in array_source(replace(model, session="desk"))["tinygc_array.h"]
    unknown = model_of([replace(unit, sensor=None) for unit in units(2)])
    np.testing.assert_array_equal(c_constants(unknown)["END_OF_RANGE"], np.float32(1e30))
    assert "from_registers" not in "".join(array_source(unknown).values())


@pytest.mark.parametrize(("size", "refused"), [(1.1e30, True), (0.9e30, False)])
def test_numbers_that_single_precision_cannot_reckon_with_are_refused(size, refused):
    found = units(2)
    found[1] = replace(
        found[1], model=replace(found[1].model, B=np.array([size, 0.0, 0.0])), place=replace(found[1].place, mounting=np.eye(3))
    )
    model = model_of([replace(unit, covariance=None) for unit in found])
    if refused:
        with pytest.raises(ExportError, match=r"the model has a number of 1\.1e"):
            array_source(model)
    else:
        assert array_source(model)


def test_the_self_test_passes_and_fails_where_a_table_is_another(tmp_path):
    model = model_of(units())
    files = array_source(model)
    failed, worst = Compiled(tmp_path / "right", files, 8).self_test()
    assert failed == 0
    assert worst < 1e-5
    wrong = files["tinygc_array.c"].replace(
        "static const float OFFSET[8][3] = {\n    {", "static const float OFFSET[8][3] = {\n    {0.5f + ", 1
    )
    assert wrong != files["tinygc_array.c"]
    assert Compiled(tmp_path / "wrong", files | {"tinygc_array.c": wrong}, 8).self_test()[0] > 0


def test_registers_are_rates(tmp_path):
    model = model_of(units(3))
    compiled = Compiled(tmp_path, array_source(model), 3)
    registers, given = np.arange(-4, 5, dtype=np.int16) * 3000, compiled.input()
    compiled.library.tinygc_array_from_registers(ctypes.c_void_p(registers.ctypes.data), ctypes.byref(given))
    per_lsb = model.units[0].sensor.register_units.gyro_rps
    np.testing.assert_allclose(np.array([list(row) for row in given.rate]).ravel(), registers * per_lsb, rtol=2e-7)
    assert list(given.present) == [1, 1, 1]


def test_the_command_writes_c_and_json_and_refuses_one_sensors_formats(tmp_path, capsys):
    path = tmp_path / "array.json"
    save_array_model(model_of(units(3)), path)
    assert calibrate.main(["export", str(path), "--to", "c", "--quiet"]) == 0
    files = {each.name: each.read_text() for each in (tmp_path / "export").iterdir()}
    assert Compiled(tmp_path / "c", files, 3).self_test()[0] == 0
    assert calibrate.main(["export", str(path), "--to", "json", "--quiet", "--out", str(tmp_path / "json")]) == 0
    assert (tmp_path / "json" / "array.json").read_text() == path.read_text()
    assert calibrate.main(["export", str(path), "--to", "px4", "--quiet"]) == 2
    said = capsys.readouterr().err
    assert "px4 holds one sensor's calibration" in said
    assert said.count("\n") == 1
