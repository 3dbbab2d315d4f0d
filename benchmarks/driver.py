"""The sensor's driver, its ELF file as it is flashed, on the emulated STM32F405 beside the register model of the ASM330LHH.

start: what it writes, in order; rates: load, rate and stamps at each data rate; million: 10^6 samples, at 6667 Hz or --rate; faults: what
is done to it, what it counts and says, and what that costs; sweeps: what silicon may do, and each sweep by its name (driver_sweeps.py).
Needs the tools of docs/firmware.md and Unicorn.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import driver_sweeps
import numpy as np
from common import in_parallel, markdown, progress
from emulated_driver import NOMINAL_HZ, Driven, built, cycles_per_sample, nominal_code

from session.bench import frames
from session.bench.guided_session import BoardReporter
from tinygc.annexes.emulated import readings
from tinygc.annexes.emulated.readings import CHIPS, FIFO_CTRL3, FIFO_CTRL4, Fault, Silicon

SETTLED_S, TIMES, APART_S = 0.6, 20, 0.5
MILLION = 1.005e6


@dataclass(frozen=True)
class Injected:
    """A fault, so many times: of a kind of the model, or a stall of the core; words in a row; lasts_s; mask: by the code of the rate."""

    name: str
    kind: str
    lasts_s: float = float("inf")
    words: int = 1
    value: int = 31
    times: int = TIMES
    apart_s: float = APART_S
    address: int = FIFO_CTRL4
    mask: Callable[[int], int] = lambda code: 0
    spared: int = 0


def _off(name: str, address: int, mask: Callable[[int], int]) -> Injected:
    return Injected(name, "register", times=5, apart_s=2.0, address=address, mask=mask)


INJECTED = (
    Injected("core held for 0.15 s: FIFO overrun", "stall", 0.15),
    Injected("core and its clock held for 0.6 s", "stall", 0.6, times=5, apart_s=2.0),
    Injected("tag out of order", "tag_count"),
    Injected("unknown tag", "tag_unknown"),
    Injected("six unknown tags in a row", "tag_unknown", words=6),
    Injected("parity", "parity"),
    Injected("ten words with false parity in a row", "parity", words=10),
    Injected("a word is missing", "missing"),
    Injected("two words swapped", "swapped"),
    Injected("bus 0x00 for 20 ms", "zeros", 0.02),
    Injected("bus 0xFF for 20 ms", "ones", 0.02),
    Injected("bus 0xFF for 0.1 ms, at any moment", "ones", 1e-4, times=800, apart_s=0.0123),
    Injected("bus 0x00 for 0.1 ms, at any moment", "zeros", 1e-4, times=800, apart_s=0.0123),
    Injected("sensor hangs for 0.1 ms, at any moment", "hang", 1e-4, times=800, apart_s=0.0123),
    Injected("sensor hangs for 20 ms", "hang", 0.02),
    Injected("sensor hangs for 0.3 s", "hang", 0.3, apart_s=0.8),
    Injected("two bits of a stamp's tag, each pair in turn", "tag_pair", times=28),
    Injected("two bits of a gyroscope's tag", "tag_pair", times=28, spared=1),
    Injected("two bits of an accelerometer's tag", "tag_pair", times=28, spared=2),
    Injected("sensor resets itself", "reset"),
    _off("DEC_TS goes off by itself", FIFO_CTRL4, lambda code: readings.DEC_TS),
    _off("BDR_GY goes off by itself", FIFO_CTRL3, lambda code: code << 4),
    _off("BDR_XL goes off by itself", FIFO_CTRL3, lambda code: code),
    _off("BDR_GY and BDR_XL go to half by themselves", FIFO_CTRL3, lambda code: 17 * (code ^ code - 1)),
    Injected("batched at half the rate for 0.5 s", "rate", 0.5, times=5, apart_s=2.0),
    Injected("another's identity for 20 ms", "identity", 0.02, value=0x6C),
    Injected("INT1 stays low for 0.2 s", "int1", 0.2),
)


@dataclass
class Row:
    """What became of one kind of fault."""

    name: str
    times: int
    counted: dict[str, int]
    said: list[str]
    made: int
    missing: int
    lost: int
    doubled: int
    falsified: int
    unsettled: int
    stamp_off_us: float
    restart_off_us: float
    objections: list[str] = field(default_factory=list)


def at_rate(elf: Path, odr_hz: float, **how) -> Driven:
    """A board that streams at a data rate, settled; nothing of before counts."""
    driven = Driven(elf, **how)
    driven.run(0.4)
    driven.ask(frames.DATA_RATE, odr_hz)
    driven.run(SETTLED_S)
    driven.forget()
    return driven


def start_up(elf: Path, silicon: Silicon) -> Driven:
    """A board that was switched on."""
    driven = Driven(elf, silicon=silicon)
    driven.run(1.5)
    return driven


def rate_row(elf: Path, odr_hz: float, seconds: float, silicon: Silicon) -> dict[str, float]:
    """At one data rate, no fault."""
    began_s = time.process_time()
    driven = at_rate(elf, odr_hz, silicon=silicon)
    sent = driven.bytes
    load = driven.load(seconds)
    found = driven.verdict()
    return {
        "nominal_hz": odr_hz,
        "stated_hz": driven.info.odr_hz,
        "stated_ppm": 1e6 * (driven.info.odr_hz / found.true_hz - 1),
        "stamps_ppm": 1e6 * (found.odr_hz / found.true_hz - 1),
        "off_us": found.off_us,
        "samples": found.streamed,
        "lost": found.missing,
        "doubled": found.doubled,
        "falsified": found.falsified,
        "unsettled": found.unsettled,
        "cpu_s": time.process_time() - began_s,
        "load": load,
        "cycles": cycles_per_sample(load, found.true_hz),
        "bit_s": 10 * (driven.bytes - sent) / seconds,
        "objections": driven.objections,
    }


def fault_row(elf: Path, injected: Injected, odr_hz: float, silicon: Silicon) -> Row:
    """One kind of fault, at seeded moments."""
    rng = np.random.default_rng(len(injected.name))
    begin_s = 0.4 + SETTLED_S + 1.0
    at_s = begin_s + injected.apart_s * (np.arange(injected.times) + 0.4 * rng.random(injected.times))
    faults, stalls = [], []
    if injected.kind == "stall":
        stalls = [(when, injected.lasts_s) for when in at_s]
    else:
        mask = injected.mask(11 - nominal_code(odr_hz).bit_length())
        what = (injected.lasts_s, injected.words, injected.value, injected.address, mask, injected.spared)
        faults = [Fault(injected.kind, float(when), *what) for when in at_s]
    driven = at_rate(elf, odr_hz, faults=faults, stalls=stalls, silicon=silicon)
    words, before = BoardReporter(), len(driven.said)
    for said in driven.said:
        words.hear(said)
    counted = dict(driven.counts)
    driven.run(at_s[-1] + 1.0 - driven.t_s)
    sentences = [sentence for said in driven.said[before:] for sentence in words.hear(said)]
    found = driven.verdict()
    risen = {name: count - counted[name] for name, count in driven.counts.items() if count > counted[name]}
    return Row(
        injected.name,
        injected.times,
        risen,
        sentences,
        found.made,
        found.missing,
        found.said_lost,
        found.doubled,
        found.falsified,
        found.unsettled,
        found.off_us,
        found.restart_off_us,
        driven.objections,
    )


def name_of(address: int) -> str:
    """Of a register that can be written."""
    return next((name for name, value in vars(readings).items() if value == address and address in readings.WRITABLE), f"0x{address:02X}")


def print_start(driven: Driven) -> None:
    print("written: " + ", ".join(f"{name_of(address)} 0x{value:02X}" for address, value in driven.sensor.written))
    print(f"INTERNAL_FREQ_FINE as stated: {driven.board.freq_fine}; objections: {driven.objections or 'none'}")


def print_rates(rows: list[dict]) -> None:
    head = [
        "nominal, Hz",
        "samples",
        "lost",
        "doubled",
        "falsified",
        "unsettled",
        "stated rate, ppm off",
        "stamps' rate, ppm off",
        "stamp off, µs",
        "load",
        "cycles a sample",
        "emulation, s of CPU",
    ]
    table = [
        [
            f"{row['nominal_hz']:g}",
            row["samples"],
            row["lost"],
            row["doubled"],
            row["falsified"],
            row["unsettled"],
            f"{row['stated_ppm']:.2f}",
            f"{row['stamps_ppm']:.2f}",
            f"{row['off_us']:.0f}",
            f"{100 * row['load']:.2f} %",
            f"{row['cycles']:.0f}",
            f"{row['cpu_s']:.0f}",
        ]
        for row in rows
    ]
    print(markdown(head, table))


def print_faults(rows: list[Row]) -> None:
    head = [
        "fault",
        "times",
        "the board counts",
        "`record` says first",
        "not streamed",
        "lost, by the numbers",
        "a fault",
        "doubled",
        "falsified",
        "unsettled",
        "stamp off, µs",
        "behind restarts, ms",
    ]
    table = [
        [
            row.name,
            row.times,
            ", ".join(f"{name} {count}" for name, count in row.counted.items()) or "nothing",
            row.said[0].split(";")[0] if row.said else "nothing",
            row.missing,
            row.lost,
            f"{row.lost / row.times:.2g}",
            row.doubled,
            row.falsified,
            row.unsettled,
            f"{row.stamp_off_us:.0f}",
            f"{row.restart_off_us / 1000:.2f}",
        ]
        for row in rows
    ]
    print(markdown(head, table))


def print_sweep(name: str, rows: list[list]) -> None:
    print(f"\n**{name}**: {driver_sweeps.SWEEPS[name].__doc__}\n")
    print(markdown(driver_sweeps.HEAD, [row[:-2] for row in rows]) if rows else "(the firmware has no such option)")
    if objections := sorted({what for row in rows for what in row[-2]}):
        print(f"\nNot as a real board would have it: {'; '.join(objections)}.")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = ("start", "rates", "million", "faults", "sweeps", *driver_sweeps.SWEEPS)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(parts)} (the first five)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="data rate of the faults (1667) and of the million (6667)")
    parser.add_argument(
        "--seconds",
        type=float,
        help="simulated, at each of the rates (20), for the million as long as it takes (of CPU 3 min at 6667 Hz, 10 at 833, 7 h at 12.5)",
    )
    parser.add_argument("--chip", choices=CHIPS, default="ASM330LHH", help="the sensor (%(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="of the sweeps (%(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="all figures")
    args = parser.parse_args()
    if unknown := set(args.parts) - set(parts):
        parser.error(f"no part {unknown.pop()!r}")
    chosen = args.parts or parts[:5]
    silicon = Silicon(chip=CHIPS[args.chip])
    found, cpu_s = dict[str, object](), 0.0
    with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
        try:
            elf = built(Path(folder))
        except RuntimeError as error:
            sys.exit(f"driver: {error}")
        if "start" in chosen:
            driven = start_up(elf, silicon)
            found["start"] = {"written": driven.sensor.written, "objections": driven.objections}
            print_start(driven)
        if "rates" in chosen:
            found["rates"] = [_told(rate_row, elf, odr_hz, args.seconds or 20.0, silicon) for odr_hz in NOMINAL_HZ]
            print_rates(found["rates"])
        if "million" in chosen:
            odr_hz = args.rate or 6667.0
            found["million"] = _told(rate_row, elf, odr_hz, args.seconds or MILLION / odr_hz, silicon)
            print_rates([found["million"]])
        if "faults" in chosen:
            rows = [_told(fault_row, elf, injected, args.rate or 1667.0, silicon) for injected in INJECTED]
            found["faults"] = [asdict(row) for row in rows]
            print_faults(rows)
        for name, sweep in driver_sweeps.SWEEPS.items():
            if name in chosen or "sweeps" in chosen:
                cases = list(sweep())
                driver_sweeps.build_for(cases, elf)
                found[name] = in_parallel(partial(driver_sweeps.row, elf=elf), cases, name, args.processes)
                print_sweep(name, found[name])
                cpu_s += sum(row[-1] for row in found[name])
        if cpu_s:
            print(f"\nCPU of the sweeps: {cpu_s / 60:.1f} min.")
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")


def _told(work, elf: Path, what, *more):
    progress(getattr(what, "name", f"{what} Hz"))
    row = work(elf, what, *more)
    progress("")
    return row


if __name__ == "__main__":
    main()
