"""Models of every kind that C can carry, inputs for them, and their C as a library: on the host and on the board."""

import ctypes
import re
import shutil
from types import SimpleNamespace

import numpy as np
import processes
import pytest

from tinygc.effects import AppliedEffect, Conditions, NoC, catalogue
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel

DEG = np.pi / 180
CARRIED = [name for name, effect in catalogue().items() if not isinstance(effect.device, NoC)]
RNG = np.random.default_rng(5)
KNOWN = Conditions(duration_s=200.0, fs_rps=500 * DEG, first_temp_c=25.3)

LINEAR = LinearModel(np.eye(3) + 0.012 * RNG.normal(size=(3, 3)), 0.01 * RNG.normal(size=3))
NET = CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.01 * RNG.normal(size=27))


def denoiser():
    """One that smooths."""
    return Denoiser.from_vector(np.abs(RNG.normal(size=(3, 56)))).normalised()


def claim(effect):
    """An effect of a size that a sensor may have."""
    parameter = catalogue()[effect].parameter
    return AppliedEffect(catalogue()[effect], 0.1 * parameter.plausible * RNG.normal(size=parameter.size))


def physics(*effects):
    return PhysicsModel(LINEAR, tuple(map(claim, effects)), KNOWN)


WHOLE = DenoisedNet(NET, denoiser(), 208.0)
MODELS = {
    "linear": LINEAR,
    "tinygc": NET,
    **{effect: physics(effect) for effect in CARRIED},
    "physics": physics(*CARRIED),
    "tinygc_physics": CarriedNet(physics("gyro.g_sensitivity", "gyro.thermal_bias"), NET),
    "tinygc_denoised": WHOLE,
    "all of it": DenoisedNet(CarriedNet(physics(*CARRIED), NET), denoiser(), 208.0),
}


def random_inputs(count=10_000, top=500 * DEG, seed=0):
    """(N, 7) float32: rates over the full scale, gravity and a hand's jerks, 10 to 40 degC."""
    rng = np.random.default_rng(seed)
    force = 9.8 * rng.normal(size=(count, 3))
    return np.column_stack([rng.uniform(-top, top, (count, 3)), force, rng.uniform(10, 40, count)]).astype(np.float32)


def as_inputs(table):
    """What a program takes."""
    return SimpleNamespace(rate=table[:, :3], force=table[:, 3:6], temp_c=table[:, 6])


# C


needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="not installed: gcc")


def built(folder, files, *flags):
    """All sources as one shared library, by the flags that their headers name; no compiler says a word."""
    (words,) = {line.split(maxsplit=2)[2] for text in files.values() for line in text.splitlines() if line.startswith(" * build ")}
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    command = ["gcc", *words.split(), *flags, "-O1", "-shared", "-fPIC", *sorted(folder.glob("*.c")), "-o", folder / "all.so"]
    done = processes.run(command, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    return ctypes.CDLL(str(folder / "all.so"))


def state_bytes(files):
    return int(re.search(r"sizeof\(tinygc_state\) == (\d+) ", files["tinygc_model.c"])[1])


def pointer(array):
    return ctypes.c_void_p(array.ctypes.data)


class Compiled:
    """A model's functions, called sample by sample."""

    def __init__(self, folder, files):
        self.library, self.state_bytes = built(folder, files), state_bytes(files)

    @classmethod
    def of(cls, library, size):
        made = cls.__new__(cls)
        made.library, made.state_bytes = library, size
        return made

    def state(self):
        state = ctypes.create_string_buffer(b"\xa5" * self.state_bytes, self.state_bytes)  # what was in memory before must not matter
        self.library.tinygc_start(state)
        return state

    def run(self, table, state=None):
        table, rates, state = np.ascontiguousarray(table), np.zeros((len(table), 3), np.float32), state or self.state()
        for row, rate in zip(table, rates, strict=True):
            self.library.tinygc_step(state, pointer(row), pointer(rate))
        return rates

    def self_test(self):
        worst = ctypes.c_float(-1)
        return self.library.tinygc_self_test(ctypes.byref(worst)), worst.value
