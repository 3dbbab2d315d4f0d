"""The driver of firmware/ on an Arduino: its glue, compiled for this machine, with a sensor that makes known rows.

``arduino_board/`` is the board in simulated time, ``small_imu.c`` is the sensor."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from subprocess import CalledProcessError
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT, broad
from processes import run

from session.bench.decoder import StreamDecoder
from session.bench.events import Comment, SampleChunk
from session.bench.guided_session import UNKNOWN_S

FIRMWARE = ROOT / "firmware"
TESTS = ROOT / "tests"
SKETCH = FIRMWARE / "examples" / "lsm6dsx_to_record" / "lsm6dsx_to_record.ino"
DRIVER = sorted(FIRMWARE.glob("lsm6dsx*.c"))
FLAGS = ["-O1", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover", f"-I{FIRMWARE}", f"-I{TESTS}"]
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")  #: Debian's arduino-core-avr
TICK_US = 25.0


class Chip(NamedTuple):
    """An Arduino: its name on the page, its variant, where its chip select is, words in a burst, and the limits that the page states."""

    board: str
    variant: str
    select: tuple[str, int]
    words: int
    flash_kb: int
    ram: int


CHIPS = {
    "atmega328p": Chip("Uno, Nano", "standard", ("B", 2), 24, 24, 1550),
    "atmega2560": Chip("Mega 2560", "mega", ("B", 0), 96, 28, 3200),
}

needs_gcc = pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("g++")), reason="not installed: gcc, g++")


def compiled(compiler: str, *words: str | Path) -> None:
    run([compiler, *FLAGS, *words], check=True, capture_output=True, text=True)


def sketch(odr_hz: float, baud: int, dps: int = 500, g: int = 4) -> str:
    """The sketch as C++, for the data rate, the speed of its port, and ranges."""
    text = SKETCH.read_text(encoding="utf-8").replace("ODR_HZ = 104;", f"ODR_HZ = {odr_hz};")
    text = text.replace("GYRO_FS_DPS = 500, ACCEL_FS_G = 4;", f"GYRO_FS_DPS = {dps}, ACCEL_FS_G = {g};")
    return '#include "Arduino.h"\n' + text.replace("BAUD = 115200;", f"BAUD = {baud};")


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """``boards(odr_hz, baud, words, dps, g)``: the board's program; words of the FIFO in a burst; ranges."""
    folder, objects, made = tmp_path_factory.mktemp("glue"), {}, {}

    def driver(words):
        if words not in objects:
            sources = (*DRIVER, TESTS / "small_imu.c")
            objects[words] = [folder / f"{source.stem}_{words}.o" for source in sources]
            for source, into in zip(sources, objects[words], strict=True):
                compiled("gcc", "-std=c99", f"-DFIFO_WORDS={words}", "-c", source, "-o", into)
        return objects[words]

    def make(odr_hz=104, baud=115200, words=96, dps=500, g=4):
        name = f"{odr_hz}_{baud}_{words}_{dps}_{g}"
        if name not in made:
            source = folder / f"{name}.cpp"
            source.write_text(sketch(odr_hz, baud, dps, g), encoding="utf-8")
            rest = [TESTS / "arduino_board" / f"{of}.cpp" for of in ("board", "spi_sensor")]
            flags = ["-std=c++17", f"-I{TESTS / 'arduino_board'}", f"-DFIFO_WORDS={words}"]
            compiled("g++", *flags, source, *rest, *driver(words), "-o", folder / name)
            made[name] = folder / name
        return made[name]

    return make


def random_rows(count: int) -> np.ndarray:
    """(count, 6) int16, below what stands for a sample that has not settled."""
    return np.random.default_rng(3).integers(-32768, 0x7FFD, (count, 6))


def sent(program: Path, rows: np.ndarray, *, who=0x6B, fine=0, ticks=6.0, answers_s=0.0, spoilt=-1, start_us=0.0) -> bytes:
    """What the board sends while its sensor makes these rows."""
    given = "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()
    words = [program, who, fine, ticks, answers_s, spoilt, start_us]
    return run(words, input=given, stdin=None, capture_output=True, check=True).stdout


def decoded(data: bytes) -> tuple[StreamDecoder, list, np.ndarray, np.ndarray]:
    decoder = StreamDecoder()
    events = [*decoder.feed(data), *decoder.finish()]
    chunks = [event for event in events if isinstance(event, SampleChunk)]
    return decoder, events, *(np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("t_us", "registers"))


def place(found: np.ndarray, rows: np.ndarray) -> int:
    """Which row the first sample is."""
    (first,) = np.flatnonzero((rows == found[0, :6]).all(axis=1))
    return int(first)


def test_the_glue_has_a_hundred_lines_at_most():
    assert SKETCH.read_text(encoding="utf-8").count("\n") <= 100


def test_the_folder_is_a_library_of_the_arduino_ide():
    """``src/`` is what it compiles, ``examples/`` what it opens: the one source lies beside them."""
    keys = dict(line.split("=", 1) for line in (FIRMWARE / "library.properties").read_text(encoding="utf-8").splitlines())
    needed = {"name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures"}
    assert needed <= keys.keys()
    assert (FIRMWARE / "src" / keys["includes"]).is_file()
    assert all((folder / f"{folder.name}.ino").is_file() for folder in (FIRMWARE / "examples").iterdir())
    compiled_there = re.findall(r'#include "\.\./(.+)"', (FIRMWARE / "src" / "lsm6dsx.c").read_text(encoding="utf-8"))
    assert compiled_there == [source.name for source in DRIVER if source.stem != "lsm6dsx_self_test"]  # no sketch asks for it


@needs_gcc
@pytest.mark.parametrize(
    ("chip", "who", "fine", "ticks", "start_us"),
    [("ASM330LHH", 0x6B, 10, 40000 / 6667, 0.0), ("LSM6DSO", 0x6C, -3, 6.0, 2**32 - 3e6)],
)
def test_every_sample_arrives_as_the_sensor_made_it(boards, chip, who, fine, ticks, start_us):
    """None is lost, doubled or false behind the first one, and the stamps are the sensor's, also where 32 bits wrap."""
    rows = random_rows(1000)
    decoder, events, t_us, found = decoded(sent(boards(), rows, who=who, fine=fine, ticks=ticks, start_us=start_us))
    assert (decoder.lost, decoder.implausible, decoder.resets, decoder.garbage) == (0, 0, 0, 0)
    first = place(found, rows)
    np.testing.assert_array_equal(found[:, :6], rows[first : first + len(found)])
    assert first < 12  # slots in which the filters settle
    assert first + len(found) > 1000 - 16  # what is left in the FIFO
    assert np.all(found[:, 6] == 512)
    period_us = ticks * 2**6 * TICK_US / (1 + 0.0015 * fine)
    assert np.abs(np.diff(t_us) - period_us).max() < TICK_US + 1
    assert (t_us[-1] - t_us[0]) / (len(t_us) - 1) == pytest.approx(period_us, rel=1e-5)
    assert (decoder.info.gyro_fs_dps, decoder.info.accel_fs_g, decoder.info.serial, decoder.info.sensor) == (500, 4, "bench-1", chip)
    assert decoder.info.odr_hz == pytest.approx(1e6 / period_us, rel=1e-4)
    assert sum(isinstance(event, Comment) for event in events) == 3  # the header, each four seconds; there was no fault


@needs_gcc
@pytest.mark.parametrize("odr_hz", [12, broad(26), 104, broad(417)])
def test_who_comes_late_learns_the_ranges_in_time(boards, odr_hz):
    """Also at the lowest rate: the header comes by time.  Whoever misses it waits four seconds, and record waits ten."""
    data = sent(boards(odr_hz, 921600), random_rows(14 * odr_hz))
    first = re.search(rb"^# gyro_fs_dps=500 .*\r?\n(.*\n)", data)
    decoder, events, t_us, _ = decoded(data[first.end() :])
    assert decoder.garbage == decoder.lost == 0
    infos = [place for place, event in enumerate(events) if isinstance(event, Comment) and "gyro_fs_dps" in event.text]
    assert len(infos) == 3
    before = [event for event in events[: infos[0]] if isinstance(event, SampleChunk)]
    waited_s = (before[-1].t_us[-1] - t_us[0]) * 1e-6
    assert waited_s == pytest.approx(4.0, abs=0.2)
    assert waited_s < UNKNOWN_S / 2
    assert decoder.info.odr_hz == pytest.approx(12.5 if odr_hz == 12 else odr_hz, rel=0.05)


@needs_gcc
def test_faults_come_by_their_names(boards):
    """Those above 0, as the log of the firmware's frames has them."""
    rows = random_rows(1000)
    decoder, events, _, found = decoded(sent(boards(), rows, spoilt=500))
    assert decoder.lost == 2  # as text has no check, the line before a gap is left out as well
    said = [event.text for event in events if isinstance(event, Comment) and event.text.startswith("faults")]
    assert said == ["faults parity=1 incomplete=1 lost=1"]
    assert tuple(rows[500]) not in {tuple(row) for row in found[:, :6]}


def test_the_names_are_those_of_the_driver():
    (listed,) = re.findall(r"^enum fault \{(.*?)\n    FAULTS,", (FIRMWARE / "lsm6dsx_fifo.h").read_text(encoding="utf-8"), re.S | re.M)
    faults = [name.lower() for name in re.findall(r"^    FAULT_(\w+),", listed, re.M)]
    assert len(faults) == 16
    (arduino,) = re.findall(r'NAMES\[\] PROGMEM = .*\n  "(.*)";', SKETCH.read_text(encoding="utf-8"))
    assert arduino == f" {' '.join(faults)} "


@needs_gcc
@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"odr_hz": 500}, "no such data rate; 12 is 12.5"),
        ({"odr_hz": 100}, "no such data rate; 12 is 12.5"),
        ({"dps": 300}, "the gyroscope has no such range"),
        ({"g": 32}, "the accelerometer has no such range"),
    ],
    ids=str,
)
def test_what_the_sensor_does_not_have_is_not_compiled(boards, settings, says):
    with pytest.raises(CalledProcessError) as refused:
        boards(baud=921600, **settings)
    assert says in refused.value.stderr


@needs_gcc
def test_a_port_that_does_not_carry_the_rate_is_not_compiled(boards):
    with pytest.raises(CalledProcessError) as refused:
        boards(208, 115200)
    assert "does not carry the lines of this data rate" in refused.value.stderr


@needs_gcc
def test_a_sensor_that_is_not_there_is_named_once_a_second(boards):
    """Nobody drives the line, which is pulled up.  No sample is made up."""
    said = sent(boards(), random_rows(10), answers_s=1e9).replace(b"\r", b"").splitlines()
    assert set(said) == {b"# no sensor runs: look at CS, SCK, SDI, SDO, 3.3 V, GND, and its ranges; WHO_AM_I reads 255"}
    assert 2 <= len(said) <= 4


@pytest.fixture(scope="module")
def avr(tmp_path_factory):
    """``avr(chip, odr_hz, baud)``: the sketch for an Arduino's microcontroller, linked with its core, as the Arduino IDE does it."""
    if not (shutil.which("avr-g++") and ARDUINO.is_dir()):
        pytest.skip("not installed: gcc-avr, arduino-core-avr")

    def make(chip, odr_hz, baud):
        variant = CHIPS[chip].variant
        folder = tmp_path_factory.mktemp(chip)
        (folder / "sketch.cpp").write_text(sketch(odr_hz, baud), encoding="utf-8")
        core, spi = ARDUINO / "cores" / "arduino", ARDUINO / "libraries" / "SPI" / "src"
        flags = ["-c", "-Os", "-flto", "-ffunction-sections", "-fdata-sections", f"-mmcu={chip}", "-DF_CPU=16000000L", "-DARDUINO=10819"]
        flags += ["-DARDUINO_ARCH_AVR", "-DDECIMAL_DIG=__DECIMAL_DIG__"]  # Debian's core wants DECIMAL_DIG
        flags += [f"-I{path}" for path in (core, ARDUINO / "variants" / variant, spi, FIRMWARE / "src")]
        strict = ["-Wall", "-Wextra", "-Werror"]
        plus = ["-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics"]
        commands = [
            ["avr-gcc", "-std=gnu11", "-w", *core.glob("*.c")],
            ["avr-gcc", "-std=gnu11", *strict, FIRMWARE / "src" / "lsm6dsx.c"],
            ["avr-g++", *plus, "-w", *core.glob("*.cpp"), spi / "SPI.cpp"],
            ["avr-g++", *plus, *strict, folder / "sketch.cpp"],
        ]
        for compiler, *words in commands:
            run([compiler, *flags, *words], cwd=folder, check=True)
        elf = folder / "sketch.elf"
        run(["avr-gcc", "-Os", "-flto", "-Wl,--gc-sections", f"-mmcu={chip}", *folder.glob("*.o"), "-lm", "-o", elf], check=True)
        return elf

    return make


@pytest.mark.emulation
@pytest.mark.parametrize("chip", CHIPS)
def test_it_fits_into_an_arduino(avr, chip):
    """Flash and memory stay below what docs/boards.md says."""
    printed = run(["avr-size", avr(chip, 104, 115200)], check=True, capture_output=True, text=True).stdout
    text, data, bss = map(int, printed.splitlines()[1].split()[:3])
    assert text + data < 1000 * CHIPS[chip].flash_kb
    assert data + bss < CHIPS[chip].ram
    row = f"{CHIPS[chip].board} | {CHIPS[chip].words} | {CHIPS[chip].flash_kb} kB | {CHIPS[chip].ram} bytes |"
    assert row in (ROOT / "docs" / "boards.md").read_text(encoding="utf-8")


@pytest.mark.emulation
@pytest.mark.parametrize("chip", CHIPS)
def test_every_sample_arrives_from_an_emulated_arduino(avr, chip, tmp_path):
    """At 417 Hz, the most that eight bits at 16 MHz print, in simavr; and the stack does not reach what else is in memory."""
    emulator = tmp_path / "avr"
    sources = [TESTS / "arduino_board" / "avr.c", TESTS / "small_imu.c"]
    built = run(
        ["gcc", "-std=c99", "-O2", "-Wall", "-Wextra", f"-I{TESTS}", *sources, "-lsimavr", "-lm", "-o", emulator],
        capture_output=True,
        text=True,
    )
    if built.returncode:
        pytest.skip("not installed: libsimavr-dev")
    elf, flash, rows = avr(chip, 417, 500000), tmp_path / "flash.bin", random_rows(600)
    run(["avr-objcopy", "-O", "binary", elf, flash], check=True)
    given = "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()
    ran = run([emulator, chip, *CHIPS[chip].select, flash, 0x6B, 12, 6.0, 0, -1], input=given, stdin=None, capture_output=True, check=True)
    decoder, _, t_us, found = decoded(ran.stdout[: ran.stdout.rindex(b"\n") + 1])  # the last line is cut off
    assert (decoder.lost, decoder.implausible, decoder.garbage) == (0, 0, 0)
    first = place(found, rows)
    np.testing.assert_array_equal(found[:, :6], rows[first : first + len(found)])
    assert len(found) > 600 - 60
    assert (t_us[-1] - t_us[0]) / (len(t_us) - 1) == pytest.approx(6.0 * 2**4 * TICK_US / 1.018, rel=1e-4)
    symbols = run(["avr-nm", elf], check=True, capture_output=True, text=True).stdout
    taken = int(re.search(r"^(\w+) . _end$", symbols, re.M)[1], 16) & 0xFFFF
    assert int(ran.stderr) - taken > 200  # bytes that nothing has ever used
