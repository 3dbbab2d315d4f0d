"""The stream decoder's CPU seconds for each megabyte: of ordinary streams, and of those that are made to cost it dear."""

from __future__ import annotations

import argparse
import time

from adversarial_streams import ADVERSARIAL, ORDINARY, Stream
from common import markdown, progress

from session.bench.decoder import StreamDecoder

RUNS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bytes", type=int, default=1_000_000, help="of each stream")
    parser.add_argument("--at-once", type=int, nargs="*", default=[512, 4096, 65536], help="bytes that arrive together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="streams whose name holds this")
    args = parser.parse_args()
    worst: dict[str, list[float]] = {}
    for title, streams in (("ordinary", ORDINARY), ("adversarial", ADVERSARIAL)):
        rows = []
        for name, make in streams.items():
            if args.only not in name:
                continue
            progress(name)
            rows.append((name, *(seconds_per_megabyte(make, args.bytes, args.seed, size) for size in args.at_once)))
        progress("")
        print(markdown((title, *(f"{size} B" for size in args.at_once)), [(row[0], *(f"{cell:.3f}" for cell in row[1:])) for row in rows]))
        if not rows:
            continue
        worst[title] = [max(row[k] for row in rows) for k in range(1, 1 + len(args.at_once))]
        print("worst", *(f"{seconds:.3f}" for seconds in worst[title]), "\n")
    if len(worst) == 2:
        print("times the worst ordinary one", *(f"{bad / usual:.2f}" for usual, bad in zip(*worst.values(), strict=True)))


def seconds_per_megabyte(make: Stream, size: int, seed: int, at_once: int) -> float:
    """CPU seconds of the decoder alone; the least of some runs, since other programs cost caches."""
    data, seconds = make(size, seed), []
    for _ in range(RUNS):
        decoder, began = StreamDecoder(), time.process_time()
        for start in range(0, len(data), at_once):
            decoder.feed(data[start : start + at_once])
        decoder.finish()
        seconds.append(time.process_time() - began)
    return min(seconds) / len(data) * 1e6


if __name__ == "__main__":
    main()
