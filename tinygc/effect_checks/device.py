"""Its C against the NumPy that is declared for it, bit for bit, and both against the model in double precision."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from session.common.units import NS_PER_S
from session.log.samples import Samples
from tinygc.deploy.embedded.program import Program, program
from tinygc.deploy.embedded.source import FLAGS, SOURCE, source_files
from tinygc.deploy.embedded.stage import Inputs
from tinygc.effect_checks.live import RATE_HZ
from tinygc.effect_checks.report import NotChecked, Wrong
from tinygc.effect_checks.scene import Trial, log
from tinygc.effects import FoundAt, NoC

RANDOM = 2000
#: of the rate, or of 1 rad/s
DOUBLE_WITHIN = 1e-5


def c(trial: Trial) -> str:
    """Compiled with the host's gcc; a stated reason where there is no C."""
    code = trial.effect.device
    if isinstance(code, NoC):
        if not code.why.strip() or "\n" in code.why:
            raise Wrong("there is no C, and no reason in one line")
        return f"none: {code.why}"
    model = trial.model()
    chosen = program(model)
    samples = _samples(trial.at)
    inputs = Inputs.of(samples.gyro, samples.accel, samples.temp_c)
    single = chosen.run(inputs)
    if single.dtype != np.float32 or single.shape != (len(samples), 3):
        raise Wrong(f"its NumPy gives {single.dtype} of shape {single.shape}, expected float32 of {(len(samples), 3)}")
    double = model.calibrate(samples, live=True)
    off = float((np.abs(single - double) / (1 + np.abs(double))).max())
    if not off < DOUBLE_WITHIN:
        raise Wrong(f"its NumPy in single precision differs from correct by {off:.2g} of the rate (at most {DOUBLE_WITHIN:g})")
    if shutil.which("gcc") is None:
        raise NotChecked(f"no gcc on this machine; its NumPy is within {off:.2g} of correct")
    differ = int(np.count_nonzero(_compiled(chosen, inputs).view(np.uint32) != single.view(np.uint32)))
    if differ:
        raise Wrong(f"its C differs from its NumPy in {differ} of {single.size} rates")
    return f"its C is its NumPy bit for bit over {len(samples)} samples, and within {off:.2g} of correct"


def _samples(at: FoundAt) -> Samples:
    """A hand's movement, then readings that have nothing to do with one another."""
    moved, rng = log(RATE_HZ, at), np.random.default_rng(0)
    assert moved.temp_c is not None  # as ``log`` makes it
    rate, force = rng.uniform(-at.fs_rps, at.fs_rps, (RANDOM, 3)), 9.8 * rng.normal(size=(RANDOM, 3))
    stamps = moved.t_ns[-1] + np.rint(np.arange(1, RANDOM + 1) * (NS_PER_S / RATE_HZ)).astype(np.int64)
    temp_c = np.concatenate([moved.temp_c, at.first_temp_c + rng.uniform(-15, 15, RANDOM)])
    t_ns, gyro, accel = (np.concatenate(pair) for pair in ((moved.t_ns, stamps), (moved.gyro, rate), (moved.accel, force)))
    return Samples(t_ns, gyro, accel, temp_c)


def _compiled(chosen: Program, inputs: Inputs) -> np.ndarray:
    """(N, 3) float32, sample after sample."""
    files = source_files(chosen, None, "A check of an effect.", {})
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="ascii")
        library = Path(folder) / "model.so"
        command = ["gcc", *FLAGS.split(), "-O2", "-shared", "-fPIC", str(Path(folder) / SOURCE), "-o", str(library)]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode:
            raise Wrong(f"its C does not compile: {' '.join(made.stderr.split())[:200]}")
        loaded = ctypes.CDLL(str(library))
    told = re.search(r"state_is_(\d+)_bytes", files[SOURCE])
    assert told is not None  # ``source_files`` writes it
    size = int(told[1])
    state = ctypes.create_string_buffer(b"\xa5" * size, size)  # what was in memory before must not matter
    loaded.tinygc_start(state)
    table = np.ascontiguousarray(np.column_stack([inputs.rate, inputs.force, inputs.temp_c]), dtype=np.float32)
    rates = np.zeros((len(table), 3), np.float32)
    for n in range(len(table)):
        loaded.tinygc_step(state, ctypes.c_void_p(table.ctypes.data + 28 * n), ctypes.c_void_p(rates.ctypes.data + 12 * n))
    return rates
