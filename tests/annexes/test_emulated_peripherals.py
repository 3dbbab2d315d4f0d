"""The emulated STM32F405: SPI, DMA, pins, interrupts and ports, with the register model of the sensor at the other end."""

from __future__ import annotations

import numpy as np
import pytest
from asm330lhh_wire import counting
from f405_programs import BURST, SENSOR_ON, came_to_its_end, compiled, found, ran, tools_missing

from tinygc.annexes.emulated.sensor import Asm330lhh

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from tinygc.annexes.emulated.machine import Machine

pytestmark = pytest.mark.emulation


def numbers(kept) -> np.ndarray:
    return np.array([np.frombuffer(sample, "<i2") for _, sample, *_ in kept])


def test_registers_over_polled_spi(tmp_path):
    text = """
    int main(void)
    {
        spi_on();
        systick(168000);
        while (milliseconds < 12) WFI();
        found[0] = read_register(0x0F);
        write_register(0x10, 0x5C);
        found[1] = read_register(0x10);
        found[2] = read_register(0x12);
        return 0;
    }"""
    machine = ran(text, tmp_path, 0.02)
    assert came_to_its_end(machine)
    assert found(machine, 3) == [0x6B, 0x5C, 0x04]
    assert machine.device.sensor.objections == {}


def test_a_polled_byte_takes_its_time_on_the_line(tmp_path):
    """84 MHz / 16 = 5.25 MHz: 256 cycles a byte, back to back where the data register is kept full."""
    text = """
    int main(void)
    {
        spi_on();
        cycles_on();
        CS(0);
        const uint32_t a = CYCCNT;
        BYTE(0x4001300C) = 0x8F;
        for (int n = 0; n < 100; n++) {
            while (!(SPI(8) & 2)) ;
            BYTE(0x4001300C) = 0;
            while (!(SPI(8) & 1)) ;
            (void)BYTE(0x4001300C);
        }
        spi_wait();
        found[0] = CYCCNT - a;
        CS(1);
        return 0;
    }"""
    machine = ran(text, tmp_path, 0.01)
    assert came_to_its_end(machine)
    assert found(machine)[0] == pytest.approx(101 * 256, abs=120)


FIFO_BY_INTERRUPT = (
    SENSOR_ON
    + BURST
    + """
static int16_t rows[1000][6];
static volatile uint32_t edges, bursts, words, state;
void EXTI4_Handler(void) { EXTI(0x14) = 1u << 4; edges++; }
void DMA_Rx_Handler(void) { DMA(0x08) = 0x3D; state = 2; }
int main(void)
{
    uint32_t gyros = 0, accels = 0;
    spi_on();
    REG(0x4001380C) = 2; /* EXTI4: port C */
    EXTI(0x08) = EXTI(0x00) = 1u << 4;
    irq(10);
    irq(56);
    sensor_on();
    while (gyros < 1000) {
        if (state == 0 && (GPIOC(0x10) >> 4 & 1)) {
            burst_begin(1 + 7 * 32);
            state = 1;
            bursts++;
        } else if (state == 2) {
            burst_end();
            state = 0;
            for (const volatile uint8_t *word = in + 1; word < in + 1 + 7 * 32; word += 7) {
                uint8_t *to = word[0] >> 3 == 1 && gyros < 1000 ? (uint8_t *)rows[gyros++]
                            : word[0] >> 3 == 2 && accels < 1000 ? (uint8_t *)(rows[accels++] + 3) : 0;
                for (int i = 0; to && i < 6; i++) to[i] = word[1 + i];
            }
        } else {
            WFI();
        }
    }
    found[0] = (uint32_t)rows;
    found[1] = edges;
    found[2] = bursts;
    return 0;
}"""
)


def test_the_fifo_by_dma_and_the_watermarks_interrupt(tmp_path):
    """A thousand samples, bursts of 16 of both sensors: none lost, none twice, asleep for nearly all of the time."""
    sensor = Asm330lhh(counting, keep=True)
    machine = ran(FIFO_BY_INTERRUPT, tmp_path, 1.25, sensor)
    assert came_to_its_end(machine)
    place, edges, bursts = found(machine, 3)
    rows = np.frombuffer(machine.cpu.memory(place, 12000), "<i2").reshape(1000, 6)
    np.testing.assert_array_equal(rows, numbers(sensor.kept)[:1000, 1:])
    assert bursts == 63
    assert edges == pytest.approx(bursts, abs=1)
    assert sensor.fifo.lost == 0
    assert machine.load < 0.05


def test_a_wait_for_the_pin_ends_with_its_edge(tmp_path):
    """Polled without sleep: it rises with the 32nd word, 16 samples after the sensor was switched on, and few turns are run."""
    text = (
        SENSOR_ON
        + """
    int main(void)
    {
        spi_on();
        cycles_on();
        sensor_on();
        const uint32_t a = CYCCNT;
        while (!(GPIOC(0x10) >> 4 & 1)) ;
        found[0] = CYCCNT - a;
        return 0;
    }"""
    )
    machine = ran(text, tmp_path, 0.05)
    assert came_to_its_end(machine)
    # both sensors share the divider that began with the accelerometer, a few bytes before the gyroscope
    assert found(machine)[0] / 168e6 == pytest.approx(16 / (40000 / 48), abs=2e-5)
    assert machine.cpu.instructions < 200_000


def test_work_between_two_looks_is_not_skipped(tmp_path):
    """A loop that does something else in each turn gets as many turns as time has room for."""
    text = (
        SENSOR_ON
        + """
    int main(void)
    {
        uint32_t turns = 0;
        spi_on();
        sensor_on();
        cycles_on();
        const uint32_t a = CYCCNT;
        while (!(GPIOC(0x10) >> 4 & 1)) {
            for (volatile int i = 0; i < 30; i++) ;
            turns++;
        }
        found[0] = (CYCCNT - a) / turns;
        return 0;
    }"""
    )
    machine = ran(text, tmp_path, 0.05)
    assert came_to_its_end(machine)
    assert 30 * 3 * 1.5 < found(machine)[0] < 30 * 8 * 1.5


def test_a_dma_burst_takes_the_time_of_its_bytes(tmp_path):
    text = (
        BURST
        + """
    int main(void)
    {
        spi_on();
        cycles_on();
        const uint32_t a = CYCCNT;
        burst_begin(200);
        while (!(DMA(0) & 1u << 5)) ;
        found[0] = CYCCNT - a;
        found[1] = DMA(0) >> 5 & 1;
        found[2] = STREAM(0, 4);
        burst_end();
        return 0;
    }"""
    )
    machine = ran(text, tmp_path, 0.01)
    assert came_to_its_end(machine)
    cycles, complete, left = found(machine, 3)
    assert cycles == pytest.approx(200 * 256, abs=150)
    assert (complete, left) == (1, 0)


def test_a_transfer_that_never_ends_is_not_made_shorter(tmp_path):
    """A receiving stream without a sending one: a bound of turns is so many turns."""
    text = (
        BURST
        + """
    int main(void)
    {
        uint32_t turns = 0;
        spi_on();
        systick(168000);
        cycles_on();
        STREAM(0, 8) = 0x4001300C;
        STREAM(0, 12) = (uint32_t)in;
        STREAM(0, 4) = 10;
        STREAM(0, 0) = 3u << 25 | 1u << 10;
        SPI(4) = 1;
        const uint32_t a = CYCCNT;
        while (!(SPI(8) & 1) && turns < 20000) turns++;
        found[0] = turns;
        found[1] = CYCCNT - a;
        return 0;
    }"""
    )
    machine = ran(text, tmp_path, 0.01)
    assert came_to_its_end(machine)
    turns, cycles = found(machine, 2)
    assert turns == 20000
    assert cycles < 20000 * 20


def test_a_sensor_that_is_not_there_reads_as_ones(tmp_path):
    machine = Machine(compiled("int main(void) { spi_on(); found[0] = read_register(0x0F); return 0; }", tmp_path))
    machine.run_until(0.001)
    assert found(machine) == [0xFF]
