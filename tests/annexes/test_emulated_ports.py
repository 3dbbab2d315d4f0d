"""The emulated STM32F405: its serial ports, and what a real board would not do."""

from __future__ import annotations

import pytest
from f405_programs import came_to_its_end, compiled, found, ran, tools_missing

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
