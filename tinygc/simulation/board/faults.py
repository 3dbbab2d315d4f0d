"""What goes wrong between a sensor and its host, drawn from a seed."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from session.common.errors import CalibrationError


@dataclass(frozen=True)
class Faults:
    """lost, torn: probability that a message is left out, or cut off somewhere; flip: that a bit is flipped; garbage: random bytes
    whenever the board starts; reset, unplug: s of device time from one to the next, 0 never."""

    lost: float = 0.0
    flip: float = 0.0
    torn: float = 0.0
    garbage: float = 0.0
    reset: float = 0.0
    unplug: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Faults:
        """``lost=0.05,flip=0.01``; CalibrationError says which word is wrong."""
        known = [field.name for field in fields(cls)]
        chosen = {}
        for word in filter(None, text.split(",")):
            name, _, number = (part.strip() for part in word.partition("="))
            try:
                chosen[name] = float(number)
            except ValueError:
                raise CalibrationError(f"--faults {word!r}: expected NAME=NUMBER") from None
            most = 1.0 if name in known[:3] else 1e9
            if name not in known or not 0 <= chosen[name] <= most:
                raise CalibrationError(f"--faults {word!r}: expected one of {', '.join(known)}, from 0 to {most:g}")
        return cls(**chosen)


def spoil(messages: list[bytes], faults: Faults, rng: np.random.Generator) -> bytes:
    """What arrives of these messages."""
    if faults.lost:
        messages = [message for message, luck in zip(messages, rng.random(len(messages)), strict=True) if luck >= faults.lost]
    if faults.torn:
        torn = rng.random(len(messages)) < faults.torn
        messages = [message[: rng.integers(len(message))] if cut else message for message, cut in zip(messages, torn, strict=True)]
    data = b"".join(messages)
    return flipped(data, faults.flip, rng) if faults.flip else data


def flipped(data: bytes, probability: float, rng: np.random.Generator) -> bytes:
    """Each bit turned over with this probability."""
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    return np.packbits(bits ^ (rng.random(len(bits)) < probability)).tobytes()
