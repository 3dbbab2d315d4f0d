"""The watch in C: bit for bit what Python does, over long and hostile inputs; small, without a library, without a word of the compiler."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import processes
import pytest
from conftest import DEG, broad
from watched import ACCEL_WHITE, RATE_HZ, WHITE, CompiledWatch, chosen

from tinygc.annexes.watch.detector import Detector
from tinygc.annexes.watch.embedded import HEADER, SOURCE, STATE_BYTES, watch_files
from tinygc.deploy.embedded.source import FLAGS

needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="not installed: gcc")
needs_arm = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="not installed: arm-none-eabi-gcc")
NUMBERS = chosen(
    2e4,
    reference_c=25.0,
    earth_rps=5e-5,
    white=WHITE * np.array([1.0, 1.3, 0.8]),
    wander=lambda t, span: np.full(3, 1e-11 * t + 1e-10 * (1 - np.exp(-t / 30))),
    accel_wander=lambda t, span: np.full(3, 1e-9 * t + 1e-8 * (1 - np.exp(-t / 30))),
)


def hostile(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rests with steps, turns, other attitudes, readings that are none, infinities, huge and tiny ones, at random moments."""
    rng = np.random.default_rng(seed)
    rate = rng.normal(size=(count, 3)) * WHITE * np.sqrt(RATE_HZ) + [2e-3, -1e-3, 5e-4]
    force = rng.normal(size=(count, 3)) * ACCEL_WHITE * np.sqrt(RATE_HZ) + [0.0, 0.5, -9.78]
    temp_c = 25 + np.arange(count) / 20_000 + 0.01 * rng.normal(size=count)
    rate[count // 2 :, 0] += 0.2 * DEG
    for _ in range(count // 4000):
        at, length = int(rng.integers(0, count)), int(rng.integers(1, 600))
        part, kind = slice(at, at + length), int(rng.integers(0, 9))
        rows = len(rate[part])
        if kind == 0:
            rate[part] += rng.normal(size=(rows, 3))
        elif kind == 1:
            rate[at] = [np.nan, np.inf, 1e38]
        elif kind == 2:
            force[at] = [-np.inf, 0.0, np.nan]
        elif kind == 3:
            temp_c[part] = np.nan
        elif kind == 4:
            temp_c[at] = rng.choice([1e30, -1e30, np.inf, 199.9999, 200.0, -200.0])
        elif kind == 5:
            force[at:] = force[at:] @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        elif kind == 6:
            rate[part] *= 1e30
        elif kind == 7:
            force[at] = rng.choice([31.9999, 32.0, -32.0, 1e-40, -0.0], 3)
        else:
            rate[at] = rng.choice([0.49999997, 0.5, -0.5, 1e-45, -0.0], 3)
    with np.errstate(over="ignore"):  # 1e30 times 1e30 and 1e38 is infinite: a reading, too
        return tuple(each.astype(np.float32) for each in (rate, force, temp_c))


def answers(detector: Detector, rate, force, temp_c) -> list[tuple[int, int]]:
    """What the C answers, by Python."""
    found = []
    for begin in range(0, len(rate), 1777):
        part = slice(begin, begin + 1777)
        for position, _, _, judged in detector.feed(rate[part], force[part], temp_c[part]):
            if judged is not None:
                signs = judged.alarm[:, 0].tolist()
                found.append((position, 1 + sum((2 << k if sign > 0 else 32 << k) for k, sign in enumerate(signs) if sign)))
    return found


def same_bits(state, detector: Detector) -> None:
    filters = detector.filter
    for name in ("P", "x", "gravity_P", "gravity_x", "own", "noise", "cusum"):
        theirs = np.array(getattr(state, name), np.float32).ravel().view(np.uint32)
        ours = np.ascontiguousarray(getattr(filters, name)[..., 0], dtype=np.float32).ravel().view(np.uint32)
        assert np.count_nonzero(theirs != ours) == 0, name
    assert (state.ticks, state.blocks, state.state) == (detector.ticks, detector.blocks, detector.state)
    assert list(state.window_sums) == [*detector.sums.tolist(), detector.temperature]
    assert list(state.window_squares) == detector.squares.tolist()


@needs_compiler
@pytest.mark.parametrize("seed", [1, broad(2), broad(3)])
def test_no_bit_differs(tmp_path, seed):
    """The answers of every sample, and all that is remembered at the end."""
    count = 60_000 if seed == 1 else 1_000_000
    compiled, detector, inputs = CompiledWatch(tmp_path, NUMBERS), Detector(NUMBERS), hostile(count, seed)
    theirs, ours = compiled.run(*inputs), answers(detector, *inputs)
    assert theirs == ours
    assert len(ours) > count / RATE_HZ / 4
    assert any(answer > 1 for _, answer in ours)
    same_bits(compiled.state, detector)


@needs_compiler
def test_no_bit_differs_over_gaps(tmp_path):
    compiled, detector = CompiledWatch(tmp_path, NUMBERS), Detector(NUMBERS)
    for seed, lost in ((4, 0), (5, 3), (6, 1000), (7, 10**9), (8, 12)):
        inputs = hostile(3000, seed)
        assert [answer for _, answer in compiled.run(*inputs)] == [answer for _, answer in answers(detector, *inputs)]
        compiled.gap(lost)
        detector.gap(lost)
        same_bits(compiled.state, detector)


@needs_compiler
def test_the_zero_is_that_of_python(tmp_path):
    compiled, detector, inputs = CompiledWatch(tmp_path, NUMBERS), Detector(NUMBERS), hostile(9000, 9)
    compiled.run(*inputs)
    answers(detector, *inputs)
    found = compiled.zero()
    ours = detector.filter.zero[:, 0] * NUMBERS.rate_sigma_rps.astype(np.float32)
    np.testing.assert_array_equal(found, ours)
    np.testing.assert_allclose(found, [0.002 + 0.2 * DEG, -0.001, 0.0005], atol=2e-4)  # the second half has a step


@needs_compiler
@pytest.mark.parametrize("flags", ["-std=c99 -pedantic", "-std=c11 -pedantic -Wconversion -Wshadow -Wfloat-conversion"])
def test_it_compiles_without_a_word_and_needs_no_library(tmp_path, flags):
    compiled = CompiledWatch(tmp_path, NUMBERS, *flags.split())
    names = processes.run(["nm", compiled.path], capture_output=True, text=True, check=True).stdout
    assert {line.split()[-1].partition("@")[0] for line in names.splitlines() if " U " in line} <= {"memset"}
    text = "".join(watch_files(NUMBERS, "A test.", {}, "30 days", RATE_HZ).values())
    assert re.findall(r"#include.*", text) == ["#include <stdint.h>", f'#include "{HEADER}"']
    assert not re.search(r"\b(sqrtf?|expf?|logf?|malloc|free)\(", text)
    assert not re.search(r"\d\.\d+(?!\d*f|\d*e[-+]?\d+f)[^\df.e]", re.sub(r"/\*.*?\*/", "", text, flags=re.S)), "a double"


@needs_arm
@pytest.mark.parametrize("cpu", ["-mfpu=fpv4-sp-d16 -mfloat-abi=hard", "-mfloat-abi=soft"])
def test_it_is_small_on_a_controller(tmp_path, cpu):
    """4096 bytes of code with its constants, 512 of state."""
    for name, text in watch_files(NUMBERS, "A test.", {}, "30 days", RATE_HZ).items():
        (tmp_path / name).write_text(text)
    wanted = f'#include "{HEADER}"\nchar bytes[sizeof(tinygc_watch) == {STATE_BYTES} ? 1 : -1];\n'
    (tmp_path / "size.c").write_text(wanted)
    compiler = ["arm-none-eabi-gcc", *FLAGS.split(), "-Os", "-mcpu=cortex-m4", "-mthumb", *cpu.split(), "-c"]
    for name in (SOURCE, "size.c"):
        made = processes.run([*compiler, tmp_path / name, "-o", tmp_path / f"{name}.o"], capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
    table = processes.run(["arm-none-eabi-size", tmp_path / f"{SOURCE}.o"], capture_output=True, text=True, check=True).stdout
    code, data, state = map(int, table.split()[6:9])
    assert code <= 4096
    assert (data, state) == (0, 0)
    assert STATE_BYTES <= 512


@pytest.mark.parametrize("name", ["*/ int x = 1; /*", "??/", "\x00\x1b[31m\n#error", "Gerät °", "%s {0} {title}", "*" + "/" * 300])
def test_no_name_can_leave_its_comment(name):
    files = watch_files(NUMBERS, name, {name: name}, name, RATE_HZ)
    assert all(text.isascii() and max(map(len, text.splitlines())) < 300 for text in files.values())
    assert all(text.count("/*") == text.count("*/") for text in files.values())


@needs_compiler
def test_export_writes_it_beside_the_model(simulated, tmp_path):
    import calibrate

    folder = tmp_path / "session"
    shutil.copytree(simulated(), folder)
    assert calibrate.main(["fit", str(folder), "--methods", "least_squares", "--quiet"]) == 0
    words = ["export", str(folder), "--quiet", "--out", str(tmp_path / "c"), "--json", str(tmp_path / "said.json")]
    assert calibrate.main([*words, "--to", "c", "--watch", "12h"]) == 0
    written = [each.rpartition("/")[2] for each in json.loads((tmp_path / "said.json").read_text())["files"]]
    assert written == ["tinygc_model.h", "tinygc_model.c", HEADER, SOURCE]
    assert "once in 0.5 days of rest" in (tmp_path / "c" / HEADER).read_text()
    built = ["gcc", *FLAGS.split(), "-c", tmp_path / "c" / SOURCE, "-o", tmp_path / "w.o"]
    assert processes.run(built, capture_output=True).returncode == 0
    assert calibrate.main([*words, "--to", "json", "--watch"]) == 2
