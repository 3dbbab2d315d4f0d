"""The paper's tables, from our own runs: Markdown.

Table 1 and ``explain`` on EuRoC need ../shared/euroc.
"""

from __future__ import annotations

import argparse
import sys
import time

from common import progress

PARTS = ("table1", "table3", "explain")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=PARTS, action="append", help="this part alone (may be given again)")
    parser.add_argument("--sessions", type=int, default=20, help="simulated, of Table 3 (%(default)s)")
    args = parser.parse_args()
    parts = args.only or PARTS
    began = time.perf_counter()
    if {"table1", "explain"} & set(parts):
        from_euroc(parts)
    if "table3" in parts:
        from paper.table3 import table3

        print("## Table 3\n\n" + table3(args.sessions) + "\n", flush=True)
    progress("")
    print(f"{time.perf_counter() - began:.0f} s in all.")


def from_euroc(parts: tuple[str, ...]) -> None:
    """The parts that need the EuRoC recordings."""
    from paper.euroc import EUROC, euroc_folders, read_euroc

    if not EUROC.is_dir():
        print(f"no recordings: {EUROC} is not there; Table 1 and explain on EuRoC are left out", file=sys.stderr)
        return
    with euroc_folders() as parent:
        if "table1" in parts:
            from paper.table1 import table1

            progress("reading EuRoC")
            print("## Table 1: absolute orientation error, degrees\n\n" + table1(read_euroc(parent), progress) + "\n", flush=True)
        if "explain" in parts:
            from paper.explain_euroc import explain_euroc

            print("## What `explain` finds in the EuRoC sequences\n\n" + explain_euroc(parent, progress) + "\n", flush=True)


if __name__ == "__main__":
    main()
