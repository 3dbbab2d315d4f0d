"""The paper's tables and its training time, from our own runs: Markdown.

Table 1, the training time and ``explain`` on EuRoC need ../shared/euroc; Table 3 uses ../shared/closure where it is there.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one thread is what the training time is of; said before NumPy is there

from common import progress

PARTS = ("table1", "time", "table3", "explain")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=PARTS, action="append", help="this part alone (may be given again)")
    parser.add_argument("--epochs", type=int, default=2000, help="of AdamW (%(default)s)")
    parser.add_argument("--sessions", type=int, default=20, help="simulated, of Table 3 (%(default)s)")
    args = parser.parse_args()
    parts = args.only or PARTS
    began = time.perf_counter()
    if {"table1", "time", "explain"} & set(parts):
        from_euroc(parts, args.epochs)
    if "table3" in parts:
        from paper.table3 import table3

        print("## Table 3\n\n" + table3(args.sessions) + "\n", flush=True)
    progress("")
    print(f"{time.perf_counter() - began:.0f} s in all.")


def from_euroc(parts: tuple[str, ...], epochs: int) -> None:
    """The parts that need the EuRoC recordings."""
    from paper.euroc import EUROC, euroc_folders, read_euroc

    if not EUROC.is_dir():
        print(f"no recordings: {EUROC} is not there; Table 1, the training time and explain on EuRoC are left out", file=sys.stderr)
        return
    with euroc_folders() as parent:
        if {"table1", "time"} & set(parts):
            progress("reading EuRoC")
            euroc = read_euroc(parent)
            if "table1" in parts:
                from paper.table1 import table1

                print("## Table 1: absolute orientation error, degrees\n\n" + table1(euroc, progress, epochs=epochs) + "\n", flush=True)
            if "time" in parts:
                from paper.training_time import training_time

                print("## Training time\n\n" + training_time(euroc, epochs) + "\n", flush=True)
        if "explain" in parts:
            from paper.explain_euroc import explain_euroc

            print("## What `explain` finds in the EuRoC sequences\n\n" + explain_euroc(parent, progress) + "\n", flush=True)


if __name__ == "__main__":
    main()
