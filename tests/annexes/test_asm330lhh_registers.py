"""The register model of the ASM330LHH: the map, the port, the outputs and the clock, by the facts that the page of the sensor states."""

from __future__ import annotations

import numpy as np
import pytest
from asm330lhh_wire import BYTE_S, READY_S, SETTLED, Wire

from tinygc.annexes.emulated.readings import STANDARD_GRAVITY, AtRest, Fault, Oscillator, Sampled, SelfTest, Silicon, to_registers
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort


def wire(motion=None, **how) -> Wire:
    return Wire(Asm330lhh(motion or AtRest(), silicon=SETTLED, **how))


def test_it_says_who_it_is():
    assert wire().read(0x0F) == b"\x6b"


def test_the_sensitivities_are_the_maps():
    for fs_g, mdps in ((2, 4.375), (0, 8.75), (4, 17.5), (8, 35), (12, 70), (1, 140)):
        link = wire(AtRest(rate=tuple(np.radians([100 * mdps / 1000, -200 * mdps / 1000, 0]))))
        link.write(0x11, 5 << 4 | fs_g)
        link.wait(0.02)
        assert list(link.int16(0x22, 3)) == [100, -200, 0]
    for fs_xl, mg in ((0, 0.061), (2, 0.122), (3, 0.244), (1, 0.488)):
        link = wire(AtRest(force=tuple(np.array([300, 0, -1000]) * mg / 1000 * STANDARD_GRAVITY)))
        link.write(0x10, 5 << 4 | fs_xl << 2)
        link.wait(0.02)
        assert list(link.int16(0x28, 3)) == [300, 0, -1000]


def test_temperature_is_256_a_degree_from_25():
    link = wire(AtRest(temp_c=-40.0))
    link.write(0x11, 0x50)
    link.wait(0.1)
    assert link.int16(0x20)[0] == -65 * 256


def test_beyond_the_range_a_register_stays_at_its_end():
    rows = to_registers(np.radians([[600, -600, 0]]), np.array([[100.0, -100.0, 0]]), np.array([25.0]), 4, 2)
    assert list(rows[0]) == [0, 32767, -32768, 0, 32767, -32768, 0]


@pytest.mark.parametrize("code", range(1, 11))
@pytest.mark.parametrize(("ticks", "highest_hz"), [(40000 / 6667, 6667), (6.0, 40000 / 6)])
def test_the_true_data_rate_is_the_formulas(code, ticks, highest_hz):
    """6667 or 6666.67 Hz x (1 + 0.0015 f) / coefficient: counted over many samples, by the flag of new data."""
    fine, coefficient = 35, 2 ** (10 - code)
    sensor = Asm330lhh(AtRest(), Oscillator(7, fine), keep=True, silicon=Silicon(ticks))
    link = Wire(sensor)
    link.write(0x11, code << 4)
    sensor.advance(link.t_s + 300 * coefficient / 6667)
    times = np.array([t_s for t_s, *_ in sensor.kept])
    assert len(times) > 300
    assert 1 / np.diff(times).mean() == pytest.approx(highest_hz * (1 + 0.0015 * fine) / coefficient, rel=1e-9)


def test_the_rates_fine_number_is_another_when_it_is_on():
    link = wire(oscillator=Oscillator(0x1A, 0x1B))
    assert link.read(0x63) == b"\x1a"
    link.write(0x10, 0x50)
    assert link.read(0x63) == b"\x1b"
    link.write(0x10, 0)
    assert link.read(0x63) == b"\x1a"
    assert wire(oscillator=Oscillator(-128)).read(0x63) == b"\x80"


def test_a_sample_is_of_its_own_time():
    """A rate that grows evenly: each sample shows the rate of the moment at which it was made."""
    ramp = Sampled(np.array([0.0, 10.0]), np.array([[0, 0, 0], [1.0, 0, 0]]), np.zeros((2, 3)), np.array([25.0, 25.0]))
    sensor = Asm330lhh(ramp, Oscillator(20, 20), keep=True, silicon=SETTLED)
    link = Wire(sensor)
    link.write(0x11, 0x74)
    sensor.advance(2.0)
    times = np.array([t_s for t_s, *_ in sensor.kept])
    gyro = np.array([np.frombuffer(sample, "<i2")[1] for _, sample, *_ in sensor.kept])
    np.testing.assert_allclose(gyro, np.degrees(times / 10) / 0.0175, atol=0.51)


def test_the_timestamp_counts_its_true_ticks_and_starts_anew():
    link = wire(oscillator=Oscillator(0, 40))
    assert link.read(0x40, 4) == bytes(4)
    link.write(0x10, 0x50)
    link.write(0x19, 0x20)
    began = link.t_s
    link.wait(3.0)
    assert int.from_bytes(link.read(0x40, 4), "little") == pytest.approx((link.t_s - began) * 40000 * (1 + 0.0015 * 40), abs=1.1)
    link.write(0x42, 0xAA)
    assert int.from_bytes(link.read(0x40, 4), "little") <= 1
    link.write(0x42, 0xAB)
    link.wait(0.001)
    assert 40 <= int.from_bytes(link.read(0x40, 4), "little") <= 45


def test_if_inc_makes_the_address_count():
    link = wire()
    link.write(0x10, 0x50, 0x54)
    assert link.read(0x10, 2) == b"\x50\x54"
    link.write(0x12, 0x00)
    assert link.read(0x10, 3) == b"\x50\x50\x50"
    link.write(0x10, 0x30, 0x60)
    assert link.read(0x10) == b"\x60"


def test_a_reset_restores_the_defaults_and_says_so():
    link = wire()
    assert link.read(0x12) == b"\x04"
    for address, value in ((0x10, 0x5C), (0x11, 0x54), (0x12, 0x44), (0x0A, 0x06), (0x07, 20), (0x0D, 0x08)):
        link.write(address, value)
        assert link.read(address) == bytes([value])
    link.write(0x12, 0x05)
    assert link.read(0x12)[0] & 1
    link.wait(1e-4)
    assert link.read(0x12) == b"\x04"
    assert [link.read(address) for address in (0x10, 0x11, 0x0A, 0x07, 0x0D)] == [b"\0"] * 5


def test_boot_takes_its_time():
    link = wire()
    link.write(0x12, 0x84)
    assert link.read(0x12)[0] & 0x80
    link.wait(0.02)
    assert link.read(0x12) == b"\x04"


def test_without_chip_select_nothing_is_heard_or_said():
    sensor = Asm330lhh(AtRest())
    port = SensorPort(sensor)
    assert port.transfer(b"\x8f\0", READY_S, BYTE_S) == b"\xff\xff"
    port.select(True, READY_S)
    assert port.transfer(b"\x8f\0", READY_S, BYTE_S)[1] == 0x6B


def test_status_tells_of_new_data_until_it_is_read():
    link = wire()
    link.write(0x10, 0x50)
    link.write(0x11, 0x30)  # a quarter of the accelerometer's rate
    link.wait(0.006)
    assert link.read(0x1E)[0] & 3 == 1
    link.wait(0.02)
    assert link.read(0x1E)[0] & 3 == 3
    link.read(0x28, 6)
    assert link.read(0x1E)[0] & 3 == 2
    link.read(0x22, 6)
    assert link.read(0x1E)[0] & 3 == 0


@pytest.mark.parametrize("bdu", [True, False])
def test_block_data_update_keeps_both_halves_of_one_sample(bdu):
    """The rate changes from 255 to 256 counts between the two bytes: without the update's guard the host reads 511 or 0."""
    lsb = np.radians(0.0175)
    step = Sampled(
        np.array([0.0, 0.1, 0.1001]), np.array([[255 * lsb] * 3, [255 * lsb] * 3, [256 * lsb] * 3]), np.zeros((3, 3)), np.zeros(3)
    )
    link = wire(step)
    link.write(0x12, 0x44 if bdu else 0x04)
    link.write(0x11, 0x54)
    link.t_s = 0.0999
    low = link.read(0x22)[0]
    link.wait(0.01)
    high = link.read(0x23)[0]
    assert (low, high) == ((255, 0) if bdu else (255, 1))
    link.wait(0.01)
    assert link.int16(0x22, 3).tolist() == [256] * 3


def test_the_self_test_adds_to_every_axis():
    link = wire(self_test=SelfTest(100.0, 200.0))
    link.write(0x10, 0x50)
    link.write(0x11, 0x5C)
    for bits, dps, mg in ((0b0100, 100, 0), (0b1100, -100, 0), (0b0001, 0, 200), (0b0010, 0, -200), (0, 0, 0)):
        link.write(0x14, bits)
        link.wait(0.02)
        np.testing.assert_allclose(link.int16(0x22, 3) * 0.070, dps, atol=0.04)
        np.testing.assert_allclose(link.int16(0x28, 3) * 0.061 - [0, 0, 1000], mg, atol=0.04)


def test_a_gyroscope_that_sleeps_makes_nothing():
    link = wire()
    link.write(0x11, 0x50)
    link.write(0x13, 0x40)
    link.wait(0.1)
    assert link.sensor.samples == 0


def test_what_the_map_forbids_is_objected_to_once():
    link = wire()
    link.write(0x0F, 1)
    link.write(0x0F, 1)
    link.write(0x10, 0x51)
    link.write(0x11, 0x03)
    assert link.read(0x10) == b"\x50"
    assert len(link.sensor.objections) == 3


# Faults of the port


def test_a_stuck_line_reads_the_same_and_passes_what_is_written():
    for kind, value in (("zeros", 0), ("ones", 255)):
        link = wire(faults=[Fault(kind, 1.0, 1.0)])
        link.t_s = 1.5
        assert link.read(0x0F)[0] == value
        link.write(0x10, 0x50)
        link.t_s = 2.5
        assert link.read(0x0F) + link.read(0x10) == b"\x6b\x50"


def test_a_sensor_that_hangs_neither_hears_nor_answers():
    link = wire(faults=[Fault("hang", 1.0, 1.0)])
    link.t_s = 1.5
    link.write(0x10, 0x50)
    assert link.read(0x0F) == b"\xff"
    link.t_s = 2.5
    assert link.read(0x0F) + link.read(0x10) == b"\x6b\0"


def test_a_sensor_that_resets_itself_has_forgotten_everything():
    link = wire(faults=[Fault("reset", 1.0)])
    link.write(0x11, 0x74)
    link.write(0x12, 0x44)
    link.t_s = 0.999
    assert link.read(0x11) == b"\x74"
    link.t_s = 1.005
    assert link.read(0x0F) == b"\0"
    link.t_s = 1.02
    assert link.read(0x0F) + link.read(0x11) + link.read(0x12) == b"\x6b\0\x04"
    assert link.sensor.starts == 2


def test_another_part_has_another_identity():
    assert wire(identity=0x6C).read(0x0F) == b"\x6c"
    link = wire(faults=[Fault("identity", 1.0, 0.5, value=0x70)])
    link.t_s = 1.2
    assert link.read(0x0F) == b"\x70"


def test_a_fault_that_is_none_is_refused():
    with pytest.raises(ValueError, match="no fault 'fire'"):
        Fault("fire", 1.0)
