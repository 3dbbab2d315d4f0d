"""The emulated STM32F405: its serial ports, and what a real board would not do."""

from __future__ import annotations

import pytest
from f405_programs import came_to_its_end, compiled, found, ran, tools_missing, with_board

from tinygc.annexes.emulated.readings import AtRest
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from tinygc.annexes.emulated.machine import Machine

pytestmark = pytest.mark.emulation


def test_bytes_go_out_at_the_lines_speed(tmp_path):
    text = """
    int main(void)
    {
        usart_on();
        cycles_on();
        const uint32_t a = CYCCNT;
        for (int n = 0; n < 100; n++) {
            while (!(USART1(0) & 0x80)) ;
            USART1(4) = (uint8_t)n;
        }
        while (!(USART1(0) & 0x40)) ;
        found[0] = CYCCNT - a;
        return 0;
    }"""
    machine = ran(text, tmp_path, 0.01)
    assert came_to_its_end(machine)
    assert machine.usart1.take() == bytes(range(100))
    assert found(machine)[0] == pytest.approx(100 * 10 * 91 * 2, rel=0.01)
    assert machine.usart1.baud == pytest.approx(921600, rel=0.005)


def test_bytes_come_in_by_interrupt(tmp_path):
    text = """
    void USART1_Handler(void) { if (USART1(0) & 0x20) USART1(4) = (uint8_t)(USART1(4) + 1); }
    int main(void) { usart_on(); USART1(0x0C) |= 0x20; irq(37); for (;;) WFI(); }"""
    machine = Machine(compiled(text, tmp_path))
    machine.run_until(0.001)
    machine.usart1.feed(bytes(range(200)))
    machine.run_until(0.002)
    part = len(machine.usart1.sent)
    machine.run_until(0.01)
    assert part == pytest.approx(92, abs=2)
    assert machine.usart1.take() == bytes(range(1, 201))
    assert (machine.usart1.lost, machine.bus.objections) == (0, {})


def test_bytes_that_nobody_fetches_are_lost(tmp_path):
    machine = Machine(compiled("int main(void) { usart_on(); for (;;) found[0] = USART1(0); }", tmp_path))
    machine.run_until(0.001)
    machine.usart1.feed(b"abc")
    machine.run_until(0.002)
    assert found(machine)[0] & 0x28 == 0x28  # received, overrun
    assert machine.usart1.lost == 2


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


@pytest.mark.parametrize(("baud", "seconds"), [(9600, 8.6), (115200, 0.72), (921600, 0.1), (5250000, 0.02)])
def test_a_full_ring_is_sent_to_its_end_at_any_rate(baud, seconds, tmp_path):
    """8 kB take 711 ms at 115200 baud: as long as that nobody takes DMA for stuck."""
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


def test_the_played_sensors_port_keeps_to_what_it_can(tmp_path):
    """USART2 has half the host's clock: 2.625 Mbaud at most."""
    text = """
    int main(void) { board_start(BAUD); board_write(SENSOR, (const uint8_t *)"abc", 3); for (;;) { board_wait(); board_alive(); } }"""
    for baud, there in (("5250000", 2_625_000), ("2000000", 2_000_000)):
        machine = Machine(with_board(text, tmp_path, BAUD=baud))
        machine.run_until(0.01)
        assert (machine.usart1.baud, machine.usart2.baud) == (int(baud), there)
        assert machine.usart2.take() == b"abc"
        assert machine.bus.objections == {}


def test_a_rate_that_no_port_has_is_not_built(tmp_path):
    with pytest.raises(AssertionError, match="BAUD is beyond what the host's port can"):
        with_board("int main(void) { return 0; }", tmp_path, BAUD="6000000")


# What would not work on a real board


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("SPI(0) = 0x347;", "SPI1 is used while its clock is off"),
        ("spi_on(); GPIOA(0x20) = 0; read_register(0x0F);", "not SPI1's"),
        ("spi_on(); SPI(0) = 0x347 | 0; SPI(0) = (SPI(0) & ~0x38u); read_register(0x0F);", "runs at 42 MHz"),
        ("spi_on(); SPI(0) = SPI(0) & ~2u; read_register(0x0F);", "not in mode 0 or 3"),
        ("spi_on(); CS(0); BYTE(0x4001300C) = 1; CS(1);", "amid|while a byte"),
        ("usart_on(); USART1(4) = 1; USART1(4) = 2; USART1(4) = 3;", "before it was empty"),
        ("usart_on(); GPIOA(0x24) = 0; USART1(4) = 1;", "pins are not its own"),
        ("usart_on(); USART1(8) = 15; USART1(4) = 1;", "divider BRR is 15, below the 16"),
        ("REG(0x40023808) = 0; usart_on(); USART1(4) = 1;", "clock is set to 16 MHz"),
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
    assert any(part in objection for part in said.split("|"))
