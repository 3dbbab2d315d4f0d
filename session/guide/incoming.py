"""What comes from the recorder, as the guide takes it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby

import numpy as np

from session.log.config import Config
from session.log.samples import Samples
from session.recording.decisions import Decision
from session.sensor.registers import accel_mps2_per_lsb, gyro_rps_per_lsb, temperature_c
from session.stream.events import Chunk, Event


def joined_chunks(events: Iterable[Event | Decision]) -> Iterator[Event | Decision]:
    """Neighbouring chunks as one: a busy machine reads many small portions at once."""
    for are_chunks, group in groupby(events, lambda event: isinstance(event, Chunk)):
        if are_chunks:
            chunks = [event for event in group if isinstance(event, Chunk)]
            yield Chunk(np.concatenate([chunk.t_us for chunk in chunks]), np.concatenate([chunk.registers for chunk in chunks]))
        else:
            yield from group


def samples_of(chunk: Chunk, config: Config) -> Samples:
    """Registers as SI, with the accelerometer's pre-calibration."""
    registers = chunk.registers.astype(float)
    return Samples(
        chunk.t_us * 1000,
        registers[:, 0:3] * gyro_rps_per_lsb(config.sensor.gyro_fs_dps),
        config.accelerometer.correct(registers[:, 3:6] * accel_mps2_per_lsb(config.sensor.accel_fs_g)),
        temperature_c(registers[:, 6]),
    )
