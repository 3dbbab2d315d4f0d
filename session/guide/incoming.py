"""What comes from the recorder, as the guide takes it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby

import numpy as np

from session.dialects.units import WORDS
from session.log.config import Config
from session.log.samples import Samples
from session.recording.decisions import Decision
from session.stream.events import Chunk, Event


def joined_chunks(events: Iterable[Event | Decision]) -> Iterator[Event | Decision]:
    """Neighbouring chunks as one: a busy machine reads many small portions at once."""
    for are_chunks, group in groupby(events, lambda event: isinstance(event, Chunk)):
        if are_chunks:
            chunks = [event for event in group if isinstance(event, Chunk)]
            t_us, registers = (np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("t_us", "registers"))
            yield Chunk(t_us, registers, chunks[0].form)
        else:
            yield from group


def samples_of(chunk: Chunk, config: Config) -> Samples:
    """Registers or physical units as SI, with the accelerometer's pre-calibration."""
    registers, units = chunk.registers.astype(float), config.sensor.register_units
    if chunk.form.physical:
        gyro, accel = (WORDS[kind][word] for kind, word in zip(("gyro", "accel"), chunk.form.units, strict=True))
        temp_c = registers[:, 6] if chunk.form.has_temperature else None
        return Samples(chunk.t_us * 1000, registers[:, 0:3] * gyro, config.accelerometer.correct(registers[:, 3:6] * accel), temp_c)
    return Samples(
        chunk.t_us * 1000,
        registers[:, 0:3] * units.gyro_rps,
        config.accelerometer.correct(registers[:, 3:6] * units.accel_mps2),
        units.temperature_c(registers[:, 6]),
    )
