"""The Arduino sketches, for somebody else's sensor and for the driver: compiled for this machine with a sensor that makes known rows.

``arduino_board/`` is an Arduino in simulated time, ``small_imu.c`` the sensor: bus and port take the time of their bits.
"""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from processes import run
from streams import decode, samples

from session.bench.events import Info

needs_gcc = pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("g++")), reason="not installed: gcc, g++")
TESTS, FIRMWARE = ROOT / "tests", ROOT / "firmware"
PAGE = (ROOT / "docs" / "boards.md").read_text(encoding="utf-8")


def decoded(data):
    """The decoder, its events, stamps and registers."""
    decoder, events = decode(data)
    return decoder, events, *samples(events)


def rows_of(count, most=32768, columns=7):
    return np.random.default_rng(2).integers(-32768, most, (count, columns))


def as_lines(rows):
    return "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()


# The sketch for somebody else's board.


OTHERS = ROOT / "firmware" / "examples" / "imu_to_record" / "imu_to_record.ino"


BOARD = Path(__file__).with_name("arduino_board")


SETTINGS = re.compile(r"const char INFO\[\].*?const bool HIGH_FIRST = \w+;", re.S)


PERIOD_US = 9_913.7  #: of a sensor that calls itself 100 Hz


def block_of_page(containing):
    (block,) = (block for block in re.findall(r"```cpp\n(.*?)```", PAGE, re.S) if containing in block)
    return block.strip()


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """``others(kind)``: the program of the sketch as it stands (mpu), with the page's block for ST's sensors (st)."""
    made = {}
    flags = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", f"-I{BOARD}"]
    rest = [tmp_path_factory.mktemp("board") / f"{name}.o" for name in ("board", "wire_sensor")]
    for made_of in rest:
        run(["g++", *flags, "-c", BOARD / f"{made_of.stem}.cpp", "-o", made_of], check=True)

    def make(kind):
        if kind not in made:
            folder = tmp_path_factory.mktemp(kind)
            text = OTHERS.read_text(encoding="utf-8")
            if kind == "st":
                text = SETTINGS.sub(lambda _: block_of_page("CHIP = 0x6A"), text)
            assert (text == OTHERS.read_text(encoding="utf-8")) == (kind == "mpu")
            (folder / "sketch.cpp").write_text(f'#include "Arduino.h"\n{text}', encoding="utf-8")
            run(["g++", *flags, folder / "sketch.cpp", *rest, "-o", folder / "board"], check=True)
            made[kind] = folder / "board"
        return made[kind]

    return make


def sent(program, rows, family="mpu", fail_each=0, who=0):
    """What the board sends while its sensor makes these rows; the sensor's registers behind the set-up."""
    ran = run([program, family, PERIOD_US, 0, fail_each, who], input=as_lines(rows), stdin=None, capture_output=True, check=True)
    return ran.stdout, [int(word) for word in ran.stderr.split()[1:]]


@needs_gcc
@pytest.mark.parametrize(
    ("family", "says", "registers"),
    [
        ("mpu", Info(500.0, 4.0, 100.0, "bench-1", "MPU-6050"), {0x6B: 1, 0x19: 9, 0x1B: 1 << 3, 0x1C: 1 << 3}),
        ("st", Info(500.0, 4.0, 104.0, "bench-2", "ASM330LHH"), {0x12: 0x44, 0x10: 4 << 4 | 2 << 2, 0x11: 4 << 4 | 4}),
    ],
)
def test_every_sample_of_another_sensor_arrives(others, family, says, registers):
    """Whatever the numbers are, in the order of the log, and the sensor is set as the line says that it is."""
    rows = rows_of(900)
    data, written = sent(others(family), rows, family)
    decoder, events, t_us, found = decoded(data)
    assert (decoder.lost, decoder.implausible, decoder.resets, decoder.garbage) == (0, 0, 0, 0)
    assert len(found) >= 898  # the last has no follower
    np.testing.assert_array_equal(found, rows[: len(found)])
    assert np.abs(np.diff(t_us) - PERIOD_US).max() < 700  # as often as the status is asked for
    assert (t_us[-1] - t_us[0]) / (len(t_us) - 1) == pytest.approx(PERIOD_US, rel=1e-4)
    assert decoder.info == says
    assert {address: written[address] for address in registers} == registers
    assert sum(event.kind == "comment" for event in events) == 3  # each four seconds


@needs_gcc
@pytest.mark.parametrize("who", [0x98, 0x70])
def test_kin_of_the_sensor_is_taken_with_a_remark(others, who):
    rows = rows_of(60)
    _, events, _, found = decoded(sent(others("mpu"), rows, who=who)[0])
    np.testing.assert_array_equal(found, rows[: len(found)])
    assert len(found) >= 58
    remarks = {event.text for event in events if event.kind == "comment" and "WHO_AM_I" in event.text}
    assert remarks == {f"at 0x68 WHO_AM_I 0x{who:02X}: taken for 0x68"}


# The sketch around the driver.


SKETCH = FIRMWARE / "examples" / "lsm6dsx_to_record" / "lsm6dsx_to_record.ino"


DRIVER = sorted(FIRMWARE.glob("lsm6dsx*.c"))


FLAGS = ["-O0", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover", f"-I{FIRMWARE}", f"-I{TESTS}"]


TICK_US = 25.0


def compiled(compiler, *words):
    run([compiler, *FLAGS, *words], check=True, capture_output=True, text=True)


def sketch(odr_hz, baud, dps=500, g=4):
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
            sources = (FIRMWARE / "src" / "lsm6dsx.c", TESTS / "small_imu.c")
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


def sent_by_driver(program, rows, *, who=0x6B, fine=0, ticks=6.0, answers_s=0.0, spoilt=-1, start_us=0.0):
    """What the board sends while its sensor makes these rows."""
    words = [program, who, fine, ticks, answers_s, spoilt, start_us]
    return run(words, input=as_lines(rows), stdin=None, capture_output=True, check=True).stdout


def place(found, rows):
    """Which row the first sample is."""
    (first,) = np.flatnonzero((rows == found[0, :6]).all(axis=1))
    return int(first)


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
    rows = driver_rows(1000)
    decoder, events, t_us, found = decoded(sent_by_driver(boards(), rows, who=who, fine=fine, ticks=ticks, start_us=start_us))
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
    assert sum(event.kind == "comment" for event in events) == 3  # the header, each four seconds; there was no fault


@needs_gcc
def test_faults_come_by_their_names(boards):
    """Those above 0, as the log of the firmware's frames has them."""
    rows = driver_rows(1000)
    decoder, events, _, found = decoded(sent_by_driver(boards(), rows, spoilt=500))
    assert decoder.lost == 2  # as text has no check, the line before a gap is left out as well
    said = [event.text for event in events if event.kind == "comment" and event.text.startswith("faults")]
    assert said == ["faults parity=1 incomplete=1 lost=1"]
    assert tuple(rows[500]) not in {tuple(row) for row in found[:, :6]}


def test_the_names_are_those_of_the_driver():
    (listed,) = re.findall(r"^enum fault \{(.*?)\n    FAULTS,", (FIRMWARE / "lsm6dsx_fifo.h").read_text(encoding="utf-8"), re.S | re.M)
    faults = [name.lower() for name in re.findall(r"^    FAULT_(\w+),", listed, re.M)]
    assert len(faults) == 16
    (arduino,) = re.findall(r'NAMES\[\] PROGMEM = .*\n  "(.*)";', SKETCH.read_text(encoding="utf-8"))
    assert arduino == f" {' '.join(faults)} "


def driver_rows(count):
    """Below what stands for a sample that has not settled."""
    return rows_of(count, 0x7FFD, 6)


@needs_gcc
def test_a_sensor_that_is_not_there_is_named_once_a_second_and_found_when_it_answers(boards):
    """Nobody drives the line, which is pulled up.  No sample is made up."""
    says = b"# no sensor runs: look at CS, SCK, SDI, SDO, 3.3 V, GND, and its ranges; WHO_AM_I reads 255"
    assert set(sent_by_driver(boards(), driver_rows(10), answers_s=1e9).replace(b"\r", b"").splitlines()) == {says}
    rows = driver_rows(200)
    data = sent_by_driver(boards(), rows, answers_s=1.6)
    assert data.count(b"no sensor runs") == 1
    _, _, t_us, found = decoded(data)
    first = place(found, rows)
    np.testing.assert_array_equal(found[:, :6], rows[first : first + len(found)])
    assert t_us[0] > 1.6e6


# A microcontroller.
