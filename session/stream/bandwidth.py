"""What a board's stream needs of its port: bytes of each frame, bits a second, and which ports carry them (docs/firmware.md)."""

from __future__ import annotations

from session.stream.commands import least_baud

#: on the wire, with CRC, COBS and delimiter; once for each sample, and once a second
SAMPLE_BYTES, INFO_BYTES, BOARD_BYTES, FAULTS_BYTES = 25, 19, 32, 71
#: start bit, eight, stop bit
BITS_A_BYTE = 10
BAUDS = (115_200, 230_400, 460_800, 921_600, 2_000_000)
#: INTERNAL_FREQ_FINE reaches 127 steps of 0.15 %
HIGHEST_FACTOR = 1 + 127 * 0.0015


def bits_per_second(true_odr_hz: float) -> float:
    """Of a stream without faults, at a true data rate."""
    return BITS_A_BYTE * (SAMPLE_BYTES * true_odr_hz + INFO_BYTES + BOARD_BYTES + FAULTS_BYTES)


def share(nominal_odr_hz: float, baud: int) -> float | None:
    """The part of a port that it takes at the nominal rate; None where the quickest unit of that nominal rate is refused by the board."""
    if least_baud(HIGHEST_FACTOR * nominal_odr_hz) > baud:
        return None
    return bits_per_second(nominal_odr_hz) / baud


def table(rates_hz: tuple[float, ...]) -> str:
    """In Markdown: a line for each nominal rate."""
    lines = ["| data rate, Hz | kbit/s | at most | " + " | ".join(map(str, BAUDS)) + " |", "| ---: " * (3 + len(BAUDS)) + "|"]
    for rate_hz in rates_hz:
        bits, most = bits_per_second(rate_hz), bits_per_second(HIGHEST_FACTOR * rate_hz)
        parts = [share(rate_hz, baud) for baud in BAUDS]
        cells = ["–" if part is None else f"{100 * part:.1f} %" for part in parts]
        lines.append(f"| {rate_hz:g} | {bits / 1000:.1f} | {most / 1000:.1f} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
