"""The Arduino sketch for somebody else's board: compiled for this machine, with a sensor whose registers are known, and recorded.

``arduino_board/`` is an Arduino in simulated time: the bus and the port take the time of their bits, and whoever prints too much waits.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from processes import PIPE, run, started

from session.bench.decoder import StreamDecoder
from session.bench.events import Comment, Info, SampleChunk

if shutil.which("g++") is None:
    pytest.skip("not installed: g++", allow_module_level=True)

SKETCH = ROOT / "firmware" / "examples" / "imu_to_record" / "imu_to_record.ino"
BOARD = Path(__file__).with_name("arduino_board")
PAGE = (ROOT / "docs" / "boards.md").read_text(encoding="utf-8")
SETTINGS = re.compile(r"const char INFO\[\].*?const bool HIGH_FIRST = \w+;", re.S)
LOOP = re.compile(r"^void loop\(\) \{.*?^\}", re.S | re.M)
PERIOD_US = 9_913.7  #: of a sensor that calls itself 100 Hz


def block_of_page(containing: str) -> str:
    (block,) = (block for block in re.findall(r"```cpp\n(.*?)```", PAGE, re.S) if containing in block)
    return block.strip()


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """``boards(kind)``: the program of the sketch as it stands (mpu), with the page's block for ST's sensors (st), with its floats."""
    made = {}
    flags = ["-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{BOARD}"]
    rest = [tmp_path_factory.mktemp("board") / f"{name}.o" for name in ("board", "wire_sensor")]
    for made_of in rest:
        run(["g++", *flags, "-c", BOARD / f"{made_of.stem}.cpp", "-o", made_of], check=True)

    def make(kind):
        if kind not in made:
            folder = tmp_path_factory.mktemp(kind)
            text = SKETCH.read_text(encoding="utf-8")
            if kind == "st":
                text = SETTINGS.sub(lambda _: block_of_page("CHIP = 0x6A"), text)
            if kind == "floats":
                text = LOOP.sub(lambda _: block_of_page("void loop()"), text)
            assert (text == SKETCH.read_text(encoding="utf-8")) == (kind in ("mpu", "slow"))
            text = text.replace("Serial.begin(115200)", "Serial.begin(38400)") if kind == "slow" else text
            (folder / "sketch.cpp").write_text(f'#include "Arduino.h"\n{text}', encoding="utf-8")
            run(["g++", *flags, folder / "sketch.cpp", *rest, "-o", folder / "board"], check=True)
            made[kind] = folder / "board"
        return made[kind]

    return make


def sent(
    program: Path, rows: np.ndarray, family: str = "mpu", start_us: float = 0, fail_each: int = 0, who: int = 0
) -> tuple[bytes, list[int]]:
    """What the board sends while its sensor makes these rows; the sensor's registers behind the set-up."""
    given = "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()
    ran = run([program, family, PERIOD_US, start_us, fail_each, who], input=given, stdin=None, capture_output=True, check=True)
    return ran.stdout, [int(word) for word in ran.stderr.split()[1:]]


def decoded(data: bytes) -> tuple[StreamDecoder, list, np.ndarray, np.ndarray]:
    decoder = StreamDecoder()
    events = [*decoder.feed(data), *decoder.finish()]
    chunks = [event for event in events if isinstance(event, SampleChunk)]
    return decoder, events, *(np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("t_us", "registers"))


def random_rows(count: int) -> np.ndarray:
    return np.random.default_rng(2).integers(-32768, 32768, (count, 7))


def test_the_sketch_has_fifty_lines():
    assert SKETCH.read_text(encoding="utf-8").count("\n") <= 50


@pytest.mark.parametrize(
    ("family", "says", "registers"),
    [
        ("mpu", Info(500.0, 4.0, 100.0, "bench-1", "MPU-6050"), {0x6B: 1, 0x19: 9, 0x1B: 1 << 3, 0x1C: 1 << 3}),
        ("st", Info(500.0, 4.0, 104.0, "bench-2", "ASM330LHH"), {0x12: 0x44, 0x10: 4 << 4 | 2 << 2, 0x11: 4 << 4 | 4}),
    ],
)
def test_every_sample_arrives_as_the_sensor_made_it(boards, family, says, registers):
    """Whatever the numbers are, in the order of the log, and the sensor is set as the line says that it is."""
    rows = random_rows(3000)
    data, written = sent(boards(family), rows, family)
    decoder, events, t_us, found = decoded(data)
    assert (decoder.lost, decoder.implausible, decoder.resets, decoder.garbage) == (0, 0, 0, 0)
    assert len(found) >= 2998  # the last has no follower
    np.testing.assert_array_equal(found, rows[: len(found)])
    assert np.abs(np.diff(t_us) - PERIOD_US).max() < 700  # as often as the status is asked for
    assert (t_us[-1] - t_us[0]) / (len(t_us) - 1) == pytest.approx(PERIOD_US, rel=1e-4)
    assert decoder.info == says
    assert {address: written[address] for address in registers} == registers
    assert sum(isinstance(event, Comment) for event in events) == 8  # each four seconds


def test_a_bus_that_fails_costs_the_sample_and_no_other(boards):
    rows = random_rows(1000)
    decoder, _, _, found = decoded(sent(boards("mpu"), rows, fail_each=100)[0])
    assert decoder.lost >= 9
    kept = {tuple(row) for row in rows.tolist()}
    assert {tuple(row) for row in found.tolist()} <= kept
    assert len(found) >= 1000 - 10 - 12  # text: a line before a gap is left out


def test_a_port_that_is_too_slow_loses_samples_and_makes_none_false(boards):
    """62 bytes at most and 100 Hz are 62 kbit/s: 38400 baud do not carry them.  The numbers that come are true all the same."""
    rows = random_rows(1000)
    _, _, t_us, found = decoded(sent(boards("slow"), rows)[0])
    assert len(found) < 800
    assert {tuple(row) for row in found.tolist()} <= {tuple(row) for row in rows.tolist()}
    assert np.diff(t_us).mean() > 1.2 * PERIOD_US


def test_nothing_is_sent_of_a_sensor_that_is_another(boards):
    """It says what it read, or that nothing answers, once a second, and no sample."""
    with started([boards("mpu"), "st", PERIOD_US, 0, 0, 0], stdout=PIPE, stderr=PIPE) as process:
        said = {process.stdout.readline() for _ in range(3)}
    assert said == {b"# nothing answers at 0x68: look at SDA, SCL, 3.3 V, GND, AD0, CHIP\r\n"}
    said = sent(boards("mpu"), random_rows(300), who=0x6B)[0].splitlines()
    assert set(said) == {b"# WHO_AM_I at 0x68 reads 0x6B, not 0x68: another sensor, see NAMES"}
    assert len(said) == 3


@pytest.mark.parametrize("who", [0x98, 0x70, 0x72, 0x75])
def test_kin_of_the_sensor_is_taken_with_a_remark(boards, who):
    rows = random_rows(1000)
    decoder, events, _, found = decoded(sent(boards("mpu"), rows, who=who)[0])
    np.testing.assert_array_equal(found, rows[: len(found)])
    assert len(found) >= 998
    assert decoder.info.sensor == "MPU-6050"
    remarks = {event.text for event in events if isinstance(event, Comment) and "WHO_AM_I" in event.text}
    assert remarks == {f"at 0x68 WHO_AM_I 0x{who:02X}: taken for 0x68"}


def test_a_librarys_floats_come_in_their_units(boards):
    rows = random_rows(500)
    decoder, events, _, found = decoded(sent(boards("floats"), rows)[0])
    assert next(event for event in events if isinstance(event, SampleChunk)).form.units == ("dps", "g")
    assert (decoder.implausible, decoder.resets) == (0, 0)
    scales = np.array([65.5] * 3 + [8192.0] * 3 + [340.0])
    expected = rows / scales + np.array([0] * 6 + [36.53])
    matched = [np.abs(expected - row).max(axis=1).argmin() for row in found]
    assert np.all(np.diff(matched) > 0)
    np.testing.assert_allclose(found, expected[matched], atol=0.51e-5)
