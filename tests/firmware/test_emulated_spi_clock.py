"""The sensor's SPI at each clock that ``make`` offers: what it carries loses nothing of the quickest unit, what it does not is refused."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT, broad
from f405_programs import tools_missing

from session.bench import frames

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from emulator.build import build
from emulator.driven import NOMINAL_HZ, Driven

pytestmark = pytest.mark.emulation

DIVIDERS = (16, 32, 64, 128, 256)
QUICKEST = 127  #: INTERNAL_FREQ_FINE at its end: 19 % above the nominal rate
WORD_BITS, POLLS_HZ, BURSTS_HZ, PROOF_BYTES = 56, 1000, 300, 21
SHARE = 0.8  #: of the clock


def carried_bits(odr_hz: float) -> float:
    """Bits a second on the bus: words, looks at the level, addresses and registers behind a burst."""
    return 3 * WORD_BITS * odr_hz + 13 * WORD_BITS + 3 * 8 * POLLS_HZ + 8 * PROOF_BYTES * BURSTS_HZ


def least_mhz(odr_hz: float) -> float:
    """The clock that carries the quickest unit of a nominal rate."""
    return carried_bits(1.19 * odr_hz) / SHARE / 1e6


def most_hz(divider: int) -> float:
    """The quickest nominal rate that a divider carries."""
    return max(hz for hz in NOMINAL_HZ if least_mhz(hz) <= 84 / divider)


def test_the_table_of_the_boards_page_is_that_of_the_formula():
    page = (ROOT / "docs" / "boards.md").read_text()
    rows = re.findall(r"^\| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| (\d+) \|$", page.split("## The sensor's bus")[1], re.M)
    assert [float(row[0]) for row in rows] == list(NOMINAL_HZ)
    for hz, kbit, least, divider in rows:
        assert float(kbit) == pytest.approx(carried_bits(float(hz)) / 1e3, abs=0.5)
        assert float(least) == pytest.approx(least_mhz(float(hz)), abs=0.005)
        assert int(divider) == max(d for d in DIVIDERS if 84 / d >= least_mhz(float(hz)))


@pytest.mark.parametrize("divider", [*map(broad, (16, 32, 128, 256)), 64])
def test_what_a_clock_carries_of_the_quickest_unit_loses_nothing(divider, tmp_path):
    elf = build("recorder.elf", tmp_path, tmp_path, SPI_DIVIDER=str(divider), BAUD="3000000")
    driven = Driven(elf, fine=QUICKEST)
    driven.run(0.5)
    driven.ask(frames.DATA_RATE, most_hz(divider))
    driven.run(0.4)
    driven.forget()
    driven.run(2.0)
    found = driven.verdict()
    assert found.streamed > 1.9 * 1.19 * most_hz(divider)
    assert (found.missing, found.said_lost, found.falsified) == (0, 0, 0)
    assert driven.objections == []
    quicker = [hz for hz in NOMINAL_HZ if hz > most_hz(divider)]
    if quicker:
        with pytest.raises(RuntimeError, match=f"result {frames.TOO_QUICK}"):
            driven.ask(frames.DATA_RATE, quicker[0])


@pytest.mark.parametrize(("divider", "odr_hz"), [(64, 6667), *map(lambda row: broad(*row), ((128, 3333), (256, 1667)))])
def test_what_a_clock_does_not_carry_is_not_built(divider, odr_hz, tmp_path):
    with pytest.raises(RuntimeError, match="the SPI does not carry this data rate: make SPI_DIVIDER=16"):
        build("recorder.elf", tmp_path, tmp_path, SPI_DIVIDER=str(divider), ODR_HZ=str(odr_hz), BAUD="3000000")


@pytest.mark.parametrize("divider", [8, 24, 512])
def test_a_divider_that_the_part_does_not_have_is_not_built(divider, tmp_path):
    with pytest.raises(RuntimeError, match="SPI_DIVIDER is one of 16, 32, 64, 128, 256"):
        build("recorder.elf", tmp_path, tmp_path, SPI_DIVIDER=str(divider))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"ODR_HZ": "500"}, "ODR_HZ is one of 12.5 (or 12), 26, 52, 104, 208, 417, 833, 1667, 3333, 6667"),
        ({"ODR_HZ": "12.6"}, "ODR_HZ is one of"),
        ({"GYRO_FS_DPS": "300"}, "GYRO_FS_DPS is one of 125, 250, 500, 1000, 2000, 4000"),
        ({"ACCEL_FS_G": "3"}, "ACCEL_FS_G is one of 2, 4, 8, 16"),
    ],
)
def test_a_rate_or_range_that_no_sensor_has_is_not_built(options, said, tmp_path):
    with pytest.raises(RuntimeError, match=re.escape(said)):
        build("recorder.elf", tmp_path, tmp_path, **options)


@pytest.mark.parametrize("odr_hz", ["12.5", "12"])
def test_a_recorder_begins_with_the_rate_and_the_ranges_that_make_was_given(odr_hz, tmp_path):
    driven = Driven(build("recorder.elf", tmp_path, tmp_path, ODR_HZ=odr_hz, GYRO_FS_DPS="250", ACCEL_FS_G="2"))
    driven.run(1.0)
    assert driven.info.odr_hz == pytest.approx(6667 * (1 + 0.0015 * 7) / 512)
    assert (driven.info.gyro_fs_dps, driven.info.accel_fs_g) == (250.0, 2.0)
