"""The driver of firmware/ on other boards: its glue for Arduino and Zephyr, compiled for this machine, with a sensor that makes known rows.

``arduino_board/`` and ``zephyr_headers/`` are the boards in simulated time, ``small_imu.c`` is the sensor."""

from __future__ import annotations

import shutil
from pathlib import Path
from subprocess import CalledProcessError

import numpy as np
import pytest
from conftest import ROOT
from processes import run

from session.bench.decoder import StreamDecoder
from session.bench.events import Comment, SampleChunk

FIRMWARE = ROOT / "firmware"
TESTS = ROOT / "tests"
SKETCH = FIRMWARE / "arduino" / "lsm6dsx_to_record" / "lsm6dsx_to_record.ino"
ZEPHYR = FIRMWARE / "zephyr"
DRIVER = sorted(FIRMWARE.glob("lsm6dsx*.c"))
FLAGS = ["-O1", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover", f"-I{FIRMWARE}", f"-I{TESTS}"]
TICK_US = 25.0
BOARDS = ["arduino", "zephyr"]

needs_gcc = pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("g++")), reason="not installed: gcc, g++")


def compiled(compiler: str, *words: str | Path) -> None:
    run([compiler, *FLAGS, *words], check=True, capture_output=True, text=True)


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """``boards(kind, odr_hz, baud)``: the program of a board, for the data rate and the speed of its port."""
    folder, objects, made = tmp_path_factory.mktemp("glue"), [], {}
    for source in (*DRIVER, TESTS / "small_imu.c"):
        objects.append(folder / f"{source.stem}.o")
        compiled("gcc", "-std=c99", "-c", source, "-o", objects[-1])

    def make(kind, odr_hz=104, baud=115200):
        name = f"{kind}_{odr_hz}_{baud}"
        if name not in made:
            if kind == "arduino":
                text = SKETCH.read_text(encoding="utf-8").replace("ODR_HZ = 104;", f"ODR_HZ = {odr_hz};")
                source = folder / f"{name}.cpp"
                source.write_text('#include "Arduino.h"\n' + text.replace("BAUD = 115200;", f"BAUD = {baud};"), encoding="utf-8")
                rest = [TESTS / "arduino_board" / f"{of}.cpp" for of in ("board", "spi_sensor")]
                compiled("g++", "-std=c++17", f"-I{TESTS / 'arduino_board'}", source, *rest, *objects, "-o", folder / name)
            else:
                text = (ZEPHYR / "src" / "main.c").read_text(encoding="utf-8").replace("ODR_HZ 104", f"ODR_HZ {odr_hz}")
                source, main = folder / f"{name}.c", folder / f"{name}.main.o"
                source.write_text(text, encoding="utf-8")
                flags = ["-std=c11", "-Wdouble-promotion", f"-DCONSOLE_SPEED={baud}", f"-I{TESTS / 'zephyr_headers'}"]
                compiled("gcc", *flags, "-Dmain=app_main", "-c", source, "-o", main)
                compiled("gcc", *flags, TESTS / "zephyr_headers" / "board.c", main, *objects, "-lm", "-o", folder / name)
            made[name] = folder / name
        return made[name]

    return make


def random_rows(count: int) -> np.ndarray:
    """(count, 6) int16, below what stands for a sample that has not settled."""
    return np.random.default_rng(3).integers(-32768, 0x7FFD, (count, 6))


def sent(program: Path, rows: np.ndarray, *, who=0x6B, fine=0, ticks=6.0, answers_s=0.0, start_us=0.0) -> bytes:
    """What the board sends while its sensor makes these rows."""
    given = "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()
    return run([program, who, fine, ticks, answers_s, start_us], input=given, stdin=None, capture_output=True, check=True).stdout


def decoded(data: bytes) -> tuple[StreamDecoder, list, np.ndarray, np.ndarray]:
    decoder = StreamDecoder()
    events = [*decoder.feed(data), *decoder.finish()]
    chunks = [event for event in events if isinstance(event, SampleChunk)]
    return decoder, events, *(np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("t_us", "registers"))


def place(found: np.ndarray, rows: np.ndarray) -> int:
    """Which row the first sample is."""
    (first,) = np.flatnonzero((rows == found[0, :6]).all(axis=1))
    return int(first)


@pytest.mark.parametrize("path", [SKETCH, ZEPHYR / "src" / "main.c"], ids=lambda path: path.name)
def test_the_glue_has_a_hundred_lines_at_most(path):
    assert path.read_text(encoding="utf-8").count("\n") <= 100


@needs_gcc
@pytest.mark.parametrize("kind", BOARDS)
@pytest.mark.parametrize(("fine", "ticks", "start_us"), [(12, 40000 / 6667, 0.0), (-7, 6.0, 2**32 - 3e6)])
def test_every_sample_arrives_as_the_sensor_made_it(boards, kind, fine, ticks, start_us):
    """None is lost, doubled or false behind the first one, and the stamps are the sensor's, also where 32 bits wrap."""
    rows = random_rows(1000)
    decoder, events, t_us, found = decoded(sent(boards(kind), rows, fine=fine, ticks=ticks, start_us=start_us))
    assert (decoder.lost, decoder.implausible, decoder.resets, decoder.garbage) == (0, 0, 0, 0)
    first = place(found, rows)
    np.testing.assert_array_equal(found[:, :6], rows[first : first + len(found)])
    assert first < 12  # slots in which the filters settle
    assert first + len(found) > 1000 - 16  # what is left in the FIFO
    assert np.all(found[:, 6] == 512)
    period_us = ticks * 2**6 * TICK_US / (1 + 0.0015 * fine)
    assert np.abs(np.diff(t_us) - period_us).max() < TICK_US + 1
    assert (t_us[-1] - t_us[0]) / (len(t_us) - 1) == pytest.approx(period_us, rel=1e-5)
    assert (decoder.info.gyro_fs_dps, decoder.info.accel_fs_g, decoder.info.serial, decoder.info.sensor) == (500, 4, "bench-1", "ASM330LHH")
    assert decoder.info.odr_hz == pytest.approx(1e6 / period_us, rel=1e-4)
    assert sum(isinstance(event, Comment) for event in events) == 2 * 2  # each 512 samples


@needs_gcc
@pytest.mark.parametrize("kind", BOARDS)
def test_the_quickest_rate_that_text_carries(boards, kind):
    """833 Hz at 921600 baud: the port takes most of the time, and the FIFO holds what comes meanwhile."""
    rows = random_rows(3000)
    decoder, _, _, found = decoded(sent(boards(kind, 833, 921600), rows))
    assert (decoder.lost, decoder.implausible, decoder.garbage) == (0, 0, 0)
    first = place(found, rows)
    np.testing.assert_array_equal(found[:, :6], rows[first : first + len(found)])
    assert len(found) > 3000 - 120


@needs_gcc
@pytest.mark.parametrize("kind", BOARDS)
def test_a_port_that_does_not_carry_the_rate_is_not_compiled(boards, kind):
    with pytest.raises(CalledProcessError) as refused:
        boards(kind, 208, 115200)
    assert "does not carry the lines of this data rate" in refused.value.stderr


@needs_gcc
@pytest.mark.parametrize("kind", BOARDS)
def test_a_sensor_that_is_not_there_is_named_once_a_second(boards, kind):
    """Nobody drives the line, which is pulled up.  No sample is made up."""
    said = sent(boards(kind), random_rows(10), answers_s=1e9).replace(b"\r", b"").splitlines()
    assert set(said) == {b"# no sensor runs: look at CS, SCK, SDI, SDO, 3.3 V, GND; WHO_AM_I reads 255"}
    assert 2 <= len(said) <= 4
