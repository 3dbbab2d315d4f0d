"""The driver against what silicon may do: one row for each value of each parameter of the sensor's model, and for the bus's clock."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from emulated_driver import Driven, built, nominal_code

from session.bench import frames
from tinygc.annexes.emulated.readings import ACCEL, CHIPS, FIFO_CTRL3, GYRO, JITTERS, TEMPERATURE, TIMESTAMP, Fault, Silicon

HERE = Path(__file__).resolve().parent
BEGIN_S, SETTLED_S = 0.4, 0.6
AT_S = BEGIN_S + SETTLED_S + 1.0  #: what is done to the sensor is done then
FILTERS_OFF = (0xFF, 2)
AS_DESCRIBED = Silicon()
ORDERS = {
    "stamp first": Silicon.order,
    "gyroscope first": (GYRO, ACCEL, TEMPERATURE, TIMESTAMP),
    "stamp between": (ACCEL, TIMESTAMP, GYRO, TEMPERATURE),
}
NEAR_6 = (40000 / 6667, 6.0, 6.0003)  #: ticks of a period
WIDE_OF_6 = (5.9976, 6.0024)  #: 400 ppm off


@dataclass(frozen=True)
class Case:
    """A board with its sensor, and what is done to it.

    filters: FTYPE or 0xFF, and the accelerometer's divisor, commanded where the counting begins; starts: counted from power-up on, without
    a command; spi_divider: of the Makefile's option, 0: its default; drift_ppm_s, held: as ``Driven`` takes them.
    """

    name: str
    odr_hz: float
    silicon: Silicon = AS_DESCRIBED
    faults: tuple[Fault, ...] = ()
    stalls: tuple[tuple[float, float], ...] = ()
    filters: tuple[int, int] | None = None
    starts: bool = False
    seconds: float = 5.0
    spi_divider: int = 0
    drift_ppm_s: float = 0.0
    held: tuple[int, float] | None = None


# The sweeps.


def jitter() -> Iterator[Case]:
    """The FIFO's stamps are off by up to so many ticks: either way, in turn, in blocks, or only late; and a period is so many ticks."""
    for odr_hz in (12.5, 104.0, 833.0, 1667.0, 3333.0, 6667.0):
        for ticks in (0, 1, 2):
            yield Case(f"±{ticks} ticks", odr_hz, Silicon(stamp_jitter_ticks=ticks), seconds=max(4.0, 100 / odr_hz))
    for kind in JITTERS[1:]:
        for odr_hz in (833.0, 3333.0, 6667.0):
            for ticks in (1, 2):
                yield Case(f"{kind}, {ticks} ticks", odr_hz, Silicon(stamp_jitter_ticks=ticks, jitter=kind), seconds=4.0)
    for period in (*NEAR_6[:1], *NEAR_6[2:], *WIDE_OF_6):
        for odr_hz in (833.0, 6667.0):
            yield Case(f"±2 ticks, {period:.4f} a period", odr_hz, Silicon(period, stamp_jitter_ticks=2), seconds=4.0)


def absence() -> Iterator[Case]:
    """The sensor neither hears nor answers for a time, and goes on measuring."""
    for odr_hz in (833.0, 3333.0, 6667.0):
        for ticks in sorted((*NEAR_6, *WIDE_OF_6)):
            for lasts_s in (0.3, 1.6, 4.0, 12.0) if ticks in NEAR_6 else (1.6,):
                faults = (Fault("hang", AT_S, lasts_s),)
                yield Case(f"{lasts_s:g} s, {ticks:.4f} ticks", odr_hz, Silicon(ticks), faults, seconds=lasts_s + 3.0)


def fifo() -> Iterator[Case]:
    """The FIFO holds so many words, and the core is held for 0.15 s."""
    for odr_hz in (1667.0, 3333.0, 6667.0):
        for words in (416, 438, 512):
            yield Case(f"{words} words", odr_hz, Silicon(fifo_words=words), stalls=((AT_S, 0.15),), seconds=3.0)


def settling() -> Iterator[Case]:
    """Filters are set: from the command on, no unsettled sample may come."""
    chips = {
        "settles by the table": Silicon(),
        "mask covers all": Silicon(mask_covers_all=True),
        "half as long again": Silicon(settling=1.5),
        "the mask first": Silicon(mask_first=True),
    }
    for said, silicon in chips.items():
        for odr_hz in (12.5, 208.0, 417.0, 833.0, 6667.0):
            yield Case(f"no filter, {said}", odr_hz, silicon, filters=FILTERS_OFF, seconds=2.0)
        for ftype in (7, 4):
            for odr_hz in (208.0, 417.0, 833.0, 6667.0):
                yield Case(f"FTYPE {ftype}, {said}", odr_hz, silicon, filters=(ftype, 2), seconds=2.0)
        for divisor in (10, 20, 45, 100, 200, 400, 800):
            yield Case(f"ODR/{divisor}, {said}", 833.0, silicon, filters=(0xFF, divisor), seconds=2.0)
        yield Case(f"ODR/800, {said}", 52.0, silicon, filters=(0xFF, 800), seconds=14.0)


def clock() -> Iterator[Case]:
    """The bus's clock; nothing where the Makefile has no SPI_DIVIDER."""
    if "SPI_DIVIDER" not in (HERE.parent / "firmware" / "Makefile").read_text():
        return
    for divider in (16, 32, 64, 128, 256):
        for odr_hz in (833.0, 1667.0, 3333.0, 6667.0):
            yield Case(f"{84 / divider:.3g} MHz", odr_hz, spi_divider=divider, seconds=4.0)


def late() -> Iterator[Case]:
    """The sensor answers for the first time so long after power-up."""
    for at_s in (0.0, 0.05, 0.3, 1.0, 5.0):
        yield Case(f"first answer after {at_s:g} s", 417.0, faults=(Fault("late", at_s),) if at_s else (), starts=True, seconds=at_s + 4.0)


def spoilt() -> Iterator[Case]:
    """Registers that change by themselves, batching at half the rate, and double bit errors in tags."""
    for odr_hz in (104.0, 833.0, 6667.0):
        code = 11 - nominal_code(odr_hz).bit_length()
        flips = {
            "DEC_TS off": {},
            "BDR_GY off": {"mask": code << 4},
            "BDR_XL off": {"mask": code},
            "BDR halved": {"mask": (code ^ code - 1) * 17},
        }
        for name, how in flips.items():
            fault = Fault("register", AT_S, address=FIFO_CTRL3, **how) if how else Fault("register", AT_S)
            yield Case(name, odr_hz, faults=(fault,), seconds=6.0)
        yield Case("batched at half the rate for 2 s", odr_hz, faults=(Fault("rate", AT_S, 2.0),), seconds=6.0)
    for odr_hz in (833.0, 1667.0):
        for spared, word in enumerate(("a stamp", "a gyroscope's word", "an accelerometer's word")):
            pairs = tuple(Fault("tag_pair", AT_S + 0.1 * n, spared=spared) for n in range(28))
            yield Case(f"each pair of bits in the tag of {word}", odr_hz, faults=pairs, seconds=5.0)


def chips() -> Iterator[Case]:
    """Each chip of the family that the model knows."""
    for chip in CHIPS.values():
        for odr_hz in (104.0, 833.0, 6667.0):
            yield Case(chip.name, odr_hz, Silicon(chip=chip))


def order() -> Iterator[Case]:
    """The words of a time slot in another order, a FIFO that loses whole slots or single words, and bursts that wait amid their words."""
    for name, words in ORDERS.items():
        for slots in (False, True):
            silicon = Silicon(order=words, overrun_slots=slots)
            told = f"{name}, {'slots' if slots else 'words'} are lost"
            for odr_hz in (833.0, 6667.0):
                yield Case(f"{told}, core held for 0.3 s", odr_hz, silicon, stalls=((AT_S, 0.3), (AT_S + 0.9, 0.3)), seconds=4.0)
            yield Case(f"{told}, bursts wait", 6667.0, silicon, seconds=8.0, held=(40, AT_S))


def drift() -> Iterator[Case]:
    """The sensor's oscillator drifts, by ppm a second."""
    for ppm_s in (-50.0, -5.0, 5.0, 50.0):
        for odr_hz in (104.0, 6667.0):
            yield Case(f"{ppm_s:+g} ppm/s", odr_hz, seconds=6.0, drift_ppm_s=ppm_s)
        faults = (Fault("hang", AT_S, 4.0),)
        yield Case(f"{ppm_s:+g} ppm/s, away for 4 s", 6667.0, faults=faults, seconds=8.0, drift_ppm_s=ppm_s)


SWEEPS = {sweep.__name__: sweep for sweep in (jitter, absence, fifo, settling, clock, late, spoilt, chips, order, drift)}

# A row of each.

HEAD = (
    "",
    "Hz",
    "made",
    "lost",
    "lost, by the numbers",
    "doubled",
    "falsified",
    "unsettled",
    "the board counts",
    "starts",
    "stamp off, µs",
    "behind restarts, ms",
)


def _at_clock(elf: Path, divider: int) -> Path:
    return elf.parent / f"spi{divider}"


def build_for(cases: list[Case], elf: Path) -> None:
    """Build the further programs that the cases need, in folders beside the first.  RuntimeError where that cannot be done."""
    for divider in {case.spi_divider for case in cases} - {0}:
        built(_at_clock(elf, divider), SPI_DIVIDER=str(divider))


def row(case: Case, elf: Path) -> list:
    """What became of one case, by HEAD; behind it the objections and the CPU time, s."""
    if case.spi_divider:
        elf = _at_clock(elf, case.spi_divider) / elf.name
    began_s = time.process_time()
    driven = Driven(elf, faults=case.faults, stalls=case.stalls, silicon=case.silicon, drift_ppm_s=case.drift_ppm_s, held=case.held)
    said = ""
    try:
        if not case.starts:
            driven.run(BEGIN_S)
            driven.ask(frames.DATA_RATE, case.odr_hz)
            driven.run(SETTLED_S)
            driven.forget()
        before = dict(driven.counts)
        if case.filters:
            driven.ask(frames.FILTERS, *case.filters)
        driven.run(case.seconds)
    except RuntimeError as error:
        before, said = dict(driven.counts), f"{error}; "
    counted = {name: count - before[name] for name, count in driven.counts.items() if count > before[name]}
    said += ", ".join(f"{name} {count}" for name, count in counted.items() if name != "starts")
    tail = [said or "nothing", counted.get("starts", 0)]
    name = [case.name, f"{case.odr_hz:g}"]
    try:
        found = driven.verdict()
    except ValueError as error:
        cells = [*name, "–", "–", "–", "–", "–", "–", f"{error}; {tail[0]}", tail[1], "–", "–"]
    else:
        figures = [found.made, found.missing, found.said_lost, found.doubled, found.falsified, found.unsettled]
        cells = [*name, *figures, *tail, f"{found.off_us:.0f}", f"{found.restart_off_us / 1000:.2f}"]
    return [*cells, driven.objections, time.process_time() - began_s]
