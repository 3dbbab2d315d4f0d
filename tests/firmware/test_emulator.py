"""The test kit's STM32F405: instructions, time, exceptions, watchdog, SPI, DMA and ports, and what a real board would not do."""

from __future__ import annotations

import pytest
from f405_programs import came_to_its_end, compiled, found, tools_missing, with_board

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from emulator.machine import CYCLES_PER_INSTRUCTION, Machine
from emulator.sensor import Asm330lhh, AtRest, SensorPort

pytestmark = pytest.mark.emulation


def ran(text: str, folder, t_s: float = 0.05, **how) -> Machine:
    """A program with a sensor, run to its end: it did nothing that a board would not do."""
    machine = Machine(compiled(text, folder), SensorPort(Asm330lhh(AtRest())), **how)
    machine.run_until(t_s)
    assert machine.bus.objections == {}
    assert came_to_its_end(machine)
    return machine


def test_time_is_instructions_times_the_factor_and_a_millisecond_is_one(tmp_path):
    """A thousand additions between two readings of SysTick's counter; ten milliseconds asleep."""
    text = """
    int main(void)
    {
        systick(0x1000000);
        const uint32_t a = cycles();
        __asm volatile(".rept 1000\\n\\tadds r0, r0, #1\\n\\t.endr" ::: "r0", "cc");
        found[0] = cycles() - a;
        systick(168000);
        while (milliseconds < 10) WFI();
        return 0;
    }"""
    machine = ran(text, tmp_path)
    assert found(machine)[0] == pytest.approx(1001 * CYCLES_PER_INSTRUCTION, abs=15)
    assert machine.slept > 0.99 * machine.clock.now()
    early = Machine(compiled(text, tmp_path))
    early.run_until(0.0099)
    assert not came_to_its_end(early)


def test_a_register_is_read_and_bytes_take_their_time_on_the_line(tmp_path):
    """84 MHz / 16 = 5.25 MHz: 256 cycles a byte.  Without a sensor it reads as ones."""
    text = """
    int main(void)
    {
        systick(168000);
        while (milliseconds < 12) WFI(); /* the sensor starts up */
        spi_on();
        found[0] = read_register(0x0F);
        systick(0x1000000);
        const uint32_t a = cycles();
        for (int n = 0; n < 100; n++) spi_byte(0xFF);
        found[1] = cycles() - a;
        return 0;
    }"""
    identity, taken = found(ran(text, tmp_path), 2)
    assert identity == 0x6B
    assert taken == pytest.approx(100 * 256, rel=0.15)
    alone = Machine(compiled(text, tmp_path))
    alone.run_until(0.05)
    assert found(alone) == [0xFF]


# The firmware's own port

FULL_RING = """
static uint32_t sent;
static void fill(void)
{
    uint8_t frame[64];
    for (;; sent += sizeof frame) {
        for (unsigned n = 0; n < sizeof frame; n++) frame[n] = (uint8_t)((sent + n) * 7 + (sent + n) / 256);
        if (!board_send(frame, sizeof frame)) return;
    }
}
"""


def expected(count: int) -> bytes:
    return bytes((n * 7 + n // 256) & 0xFF for n in range(count))


@pytest.mark.parametrize(("baud", "seconds"), [(9600, 8.6), (921600, 0.1), (5250000, 0.02)])
def test_a_full_ring_is_sent_to_its_end_at_any_rate(baud, seconds, tmp_path):
    """8 kB take 8.5 s at 9600 baud: as long as that nobody takes DMA for stuck."""
    text = FULL_RING + "int main(void) { board_start(BAUD); fill(); found[0] = sent; for (;;) { board_wait(); board_alive(); } }"
    machine = Machine(with_board(text, tmp_path, BAUD=str(baud)))
    machine.run_until(seconds + 0.002)
    (count,) = found(machine)
    assert count >= 8192
    assert machine.usart1.take() == expected(count)
    assert (machine.bus.objections, machine.resets) == ({}, 0)
    assert machine.usart1.baud == pytest.approx(baud, rel=0.01)


def test_another_rate_counts_behind_what_waited_and_nobody_waits(tmp_path):
    """A ring that is full at 115200 baud; the rate changes; more is sent.  Each byte leaves at the rate it was meant for."""
    text = (
        FULL_RING
        + """
    int main(void)
    {
        board_start(115200);
        fill();
        found[0] = sent;
        const uint32_t began = board_microseconds();
        board_send_baud(921600);
        found[1] = board_microseconds() - began;
        for (;;) { fill(); found[2] = sent; board_wait(); board_alive(); }
    }"""
    )
    machine = Machine(with_board(text, tmp_path), lsi_hz=47e3)
    while not machine.usart1.baud or machine.usart1.baud < 200_000:
        machine.run_until(machine.clock.now_s() + 0.0005)
    first, took_us, _ = found(machine, 3)
    assert len(machine.usart1.sent) == first
    assert machine.clock.now_s() == pytest.approx(10 * first / 115200, abs=0.005)
    assert took_us < 10
    machine.run_until(machine.clock.now_s() + 0.2)
    sent = machine.usart1.take()
    assert sent == expected(len(sent))
    assert len(sent) - first == pytest.approx(0.2 * 92160, abs=8192)  # what DMA has in hand is not there yet
    assert (machine.bus.objections, machine.resets) == ({}, 0)


def test_a_rate_that_no_port_has_is_not_built(tmp_path):
    with pytest.raises(AssertionError, match="BAUD is beyond what the host's port can"):
        with_board("int main(void) { return 0; }", tmp_path, BAUD="6000000")


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("SPI(0) = 0x347;", "SPI1 is used while its clock is off"),
        ("spi_on(); GPIOA(0x20) = 0; read_register(0x0F);", "not SPI1's"),
        ("spi_on(); SPI(0) = SPI(0) & ~0x38u; read_register(0x0F);", "runs at 42 MHz"),
        ("spi_on(); SPI(0) = SPI(0) & ~2u; read_register(0x0F);", "no master in mode 0 or 3"),
        ("spi_on(); CS(0); SPI(0x0C) = 1; CS(1);", "while a byte"),
        ("usart_on(); USART1(4) = 1; USART1(4) = 2; USART1(4) = 3;", "before it was empty"),
        ("usart_on(); GPIOA(0x24) = 0; USART1(4) = 1;", "PA9 is not the serial port's"),
        ("usart_on(); USART1(8) = 15; USART1(4) = 1;", "divider BRR below the 16"),
        ("REG(0x40023808) = 0; usart_on(); USART1(4) = 1;", "clock is set to 16 MHz"),
        ("REG(0x40003000) = 0xCCCC; REG(0x40003004) = 3;", "without its key"),
        (
            "usart_on(); USART1(0x14) = 0x80; STREAM(7, 8) = 0x40011004; STREAM(7, 12) = 0x10000000; STREAM(7, 4) = 1;"
            "STREAM(7, 0) = 4u << 25 | 1u << 6 | 1;",
            "cannot reach 0x10000000",
        ),
        (
            "static uint8_t text[100]; usart_on(); USART1(0x14) = 0x80; STREAM(7, 8) = 0x40011004; STREAM(7, 12) = (uint32_t)text;"
            "STREAM(7, 4) = 100; STREAM(7, 0) = 4u << 25 | 1u << 10 | 1u << 6 | 1; text[50] = 1;",
            "was changed before it was sent",
        ),
    ],
)
def test_what_a_board_would_not_do_is_objected_to(program, said, tmp_path):
    machine = Machine(compiled(f"int main(void) {{ {program} return 0; }}", tmp_path), SensorPort(Asm330lhh(AtRest())))
    machine.run_until(0.01)
    assert came_to_its_end(machine)
    (objection,) = machine.bus.objections
    assert said in objection
