"""A simulated session, felt by the register model, fetched from its FIFO and streamed as frames by a small program of our own: sample by
sample and stamp by stamp it is the session, and so is its closure."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from f405_programs import BURST, SENSOR_ON, compiled, tools_missing

from session.bench.decoder import StreamDecoder
from session.bench.events import Info, SampleChunk
from tinygc import SimulationOptions
from tinygc.annexes.emulated.board import Replayed, oscillator_of, with_its_own_rate
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort
from tinygc.simulation.simulator import simulate_session, unit_of
from tinygc.simulation.virtual_board import BoardSource

if MISSING := tools_missing():
    pytest.skip(MISSING, allow_module_level=True)

from tinygc.annexes.emulated.machine import Machine

pytestmark = pytest.mark.emulation

#: 416 Hz; the stamps are those of INTERNAL_FREQ_FINE
STREAMING = (
    SENSOR_ON.replace("0x09, 0x77", "0x09, 0x66").replace("0x78)", "0x68)").replace("0x74)", "0x64)")
    + BURST
    + (ROOT / "firmware" / "frames.c").read_text().replace('#include "frames.h"', (ROOT / "firmware" / "frames.h").read_text())
    + """
static uint8_t sending[2][1000];
void EXTI4_Handler(void) { EXTI(0x14) = 1u << 4; }
static volatile uint32_t done;
void DMA_Rx_Handler(void) { DMA(0x08) = 0x3D; done = 1; }
static void send(const uint8_t *bytes, unsigned count)
{
    while (STREAM(7, 0) & 1) WFI();
    DMA(0x0C) = 0x3Du << 22;
    STREAM(7, 8) = 0x40011004;
    STREAM(7, 12) = (uint32_t)bytes;
    STREAM(7, 4) = count;
    STREAM(7, 0) = 4u << 25 | 1u << 10 | 1u << 6 | 1;
}
int main(void)
{
    int16_t row[7] = {0};
    uint32_t sample = 0;
    unsigned which = 0;
    spi_on();
    usart_on();
    USART1(0x14) = 0x80;
    REG(0x4001380C) = 2;
    EXTI(0x08) = EXTI(0x00) = 1u << 4;
    irq(10);
    irq(56);
    sensor_on();
    const double step_us = 1e6 * 16 / (40000 / 6.0 * (1 + 0.0015 * (int8_t)read_register(0x63)));
    for (;;) {
        unsigned used = 0;
        while (!(GPIOC(0x10) >> 4 & 1)) WFI();
        done = 0;
        burst_begin(1 + 7 * 32);
        while (!done) WFI();
        burst_end();
        for (const volatile uint8_t *word = in + 1; word < in + 1 + 7 * 32; word += 7) {
            for (int i = 0; i < 3; i++) row[i + (word[0] >> 3 == 2 ? 3 : 0)] = (int16_t)(word[1 + 2 * i] | word[2 + 2 * i] << 8);
            if (word[0] >> 3 != 2) continue;
            struct frame frame;
            frame_begin(&frame, FRAME_SAMPLE, (uint16_t)sample);
            frame_u32(&frame, (uint32_t)(sample * step_us + 0.5));
            for (int i = 0; i < 7; i++) frame_u16(&frame, (uint16_t)row[i]);
            used += frame_end(&frame, sending[which] + used);
            sample++;
        }
        send(sending[which], used);
        which ^= 1;
    }
}"""
)


def test_what_is_streamed_is_the_session(tmp_path):
    options = SimulationOptions(segments=3, closure_s=0.0, odr_hz=416)
    unit = with_its_own_rate(unit_of(options), options.odr_hz)
    log = simulate_session(options, unit=unit).log
    rows = np.column_stack([log.gyro, log.accel, log.temp])
    motion = Replayed(BoardSource(rows, Info(500.0, 4.0, unit.odr_hz, "1", "ASM330LHH")))
    sensor = Asm330lhh(motion, oscillator_of(unit.odr_hz))
    machine = Machine(compiled(STREAMING, tmp_path), SensorPort(sensor))
    decoder, chunks = StreamDecoder(), []
    motion.start(1.0)
    end_s = 1.2 + len(rows) / unit.odr_hz
    for t_s in np.arange(0.5, end_s + 0.5, 0.5):
        machine.run_until(t_s)
        chunks += [chunk for chunk in decoder.feed(machine.usart1.take()) if isinstance(chunk, SampleChunk)]
    assert machine.bus.objections == {}
    assert (decoder.lost, decoder.crc_errors, decoder.garbage) == (0, 0, 0)
    t_us = np.concatenate([chunk.t_us for chunk in chunks])
    got = np.concatenate([chunk.registers for chunk in chunks])
    (begin,) = (k for k in range(380, 430) if np.array_equal(got[k : k + 20, :6], rows[:20, :6]))
    np.testing.assert_array_equal(got[begin : begin + len(rows), :6], rows[:, :6])
    stamps = t_us[begin : begin + len(rows)]
    np.testing.assert_allclose(stamps - stamps[0], log.t_us - log.t_us[0], atol=1.01)  # both are whole microseconds
