"""The stream decoder: what becomes of damaged frames that pass their CRC."""

from __future__ import annotations

import argparse
import os
import time

import numpy as np
from common import markdown, progress

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import SampleChunk
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session
from tinygc.simulation.virtual_board import flipped

RATE_HZ = 1667
BLOCK_FRAMES = 20_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_200_000, help="that are sent in each case of damage")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rows = hand_turned()
    print(f"Damaged frames, {args.frames} sent in each case\n")
    header = ("damage", "frames damaged", "pass the CRC", "of them left out", "enter the log", "good ones left out", "× real time")
    print(markdown(header, (damage(name, spoil, rows, args) for name, spoil in DAMAGE.items())))


def hand_turned() -> np.ndarray:
    """Registers (n, 7) int16 of simulated turns at 1667 Hz."""
    log = simulate_session(SimulationOptions(segments=8, closure_s=0, odr_hz=RATE_HZ)).log
    return np.column_stack([log.gyro, log.accel, log.temp])


def stream_of(rows: np.ndarray, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Device times (count,) and registers (count, 7) of samples ``first`` …: there and back through the rows, without a jump."""
    index = np.arange(first, first + count)
    place = index % (2 * len(rows))
    return index * 600, rows[np.where(place < len(rows), place, 2 * len(rows) - 1 - place)]


def bit_flips(coded: np.ndarray, rng: np.random.Generator) -> bytes:
    """1 % of all bits, delimiters too."""
    return flipped(coded.tobytes(), 0.01, rng)


def random_frames(coded: np.ndarray, rng: np.random.Generator) -> bytes:
    """Nine frames in ten replaced by random bytes between their delimiters."""
    hit = rng.random(len(coded)) < 0.9
    coded[hit, :-1] = rng.integers(1, 256, (np.count_nonzero(hit), coded.shape[1] - 1))
    return coded.tobytes()


def registers_only(coded: np.ndarray, rng: np.random.Generator) -> bytes:
    """Nine frames in ten with other random bytes from the registers on: number and stamp stay right."""
    hit = np.flatnonzero(rng.random(len(coded)) < 0.9)
    bodies, _ = frames.decode_blocks(coded[hit, :-1])
    bodies[:, 7:] = rng.integers(0, 256, (len(hit), 14))
    spoilt = frames.encode_blocks(bodies)
    spoilt[:, -3:-1] = rng.integers(1, 256, (len(hit), 2))  # any CRC but, mostly, the right one
    coded[hit] = spoilt
    return coded.tobytes()


def four_bits(coded: np.ndarray, rng: np.random.Generator) -> bytes:
    """Four bits of each second frame, anywhere in it: the fewest that a CRC of this kind can miss in a frame of this length."""
    hit = np.flatnonzero(rng.random(len(coded)) < 0.5)
    for _ in range(4):
        coded[hit, rng.integers(0, coded.shape[1] - 1, len(hit))] ^= (1 << rng.integers(0, 8, len(hit))).astype(np.uint8)
    return coded.tobytes()


DAMAGE = {"1 % of the bits": bit_flips, "random bytes": random_frames, "random registers": registers_only, "four bits": four_bits}


def damage(name: str, spoil, rows: np.ndarray, args: argparse.Namespace) -> tuple:
    """One line of the table: what was sent is known, so what arrives is compared with it."""
    rng, decoder = np.random.default_rng(args.seed), StreamDecoder()
    damaged = passed = wrong = whole = 0
    seconds = 0.0
    for first in range(0, args.frames, BLOCK_FRAMES):
        progress(f"{name}: {first} of {args.frames}")
        t_us, registers = stream_of(rows, first, min(BLOCK_FRAMES, args.frames - first))
        coded = frames.encode_samples(np.arange(first, first + len(t_us)), t_us, registers)
        clean = coded.copy()
        data = spoil(coded, rng)
        arrived = np.frombuffer(data, np.uint8).reshape(clean.shape)
        hit = (arrived != clean).any(axis=1)
        damaged += int(hit.sum())
        passed += passing(data, clean)
        whole += int((~hit).sum())
        began = time.process_time()
        events = decoder.feed(data)
        seconds += time.process_time() - began
        wrong += wrong_samples(events, rows)
    wrong += wrong_samples(decoder.finish(), rows)
    progress("")
    good_lost = whole - (decoder.samples - wrong)
    return name, damaged, passed, passed - wrong, wrong, good_lost, f"{args.frames / seconds / RATE_HZ:.0f}"


def passing(data: bytes, clean: np.ndarray) -> int:
    """Sample frames with a good CRC that were not sent: between zero bytes, or at the end of what stands between them."""
    codes = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(codes == 0)
    lengths = np.diff(ends, prepend=-1) - 1
    ends = ends[lengths >= frames.SAMPLE_BYTES]
    blocks = codes[ends[:, None] + np.arange(-frames.SAMPLE_BYTES, 0)]
    bodies, good = frames.decode_blocks(blocks)
    sent = {row.tobytes() for row in clean[:, :-1]}
    return sum(block.tobytes() not in sent for block, body in zip(blocks[good], bodies[good], strict=True) if body[0] == frames.SAMPLE_TYPE)


def wrong_samples(events: list, rows: np.ndarray) -> int:
    """Samples that were not sent."""
    count = 0
    for chunk in (event for event in events if isinstance(event, SampleChunk)):
        index = chunk.t_us // 600
        place = index % (2 * len(rows))
        sent = rows[np.where(place < len(rows), place, 2 * len(rows) - 1 - place)]
        count += int(((sent != chunk.registers).any(axis=1) | (chunk.t_us % 600 != 0)).sum())
    return count


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
