"""Serial ports of this machine, and what is known of each."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from serial.tools import list_ports

from session.common.errors import DeviceError
from session.recording.lock import is_locked

if TYPE_CHECKING:
    from serial.tools.list_ports_common import ListPortInfo

ST_VENDOR = 0x0483
#: USB ids -> what they are; ST's product ids from its usb.ids entries
ST_PRODUCTS = {
    0x3744: "ST-LINK/V1",
    0x3748: "ST-LINK/V2",
    0x374A: "ST-LINK/V2-1",
    0x374B: "ST-LINK/V2-1",
    0x374D: "ST-LINK/V3 loader",
    0x374E: "ST-LINK/V3",
    0x374F: "ST-LINK/V3",
    0x3752: "ST-LINK/V2-1",
    0x3753: "ST-LINK/V3",
    0x3754: "ST-LINK/V3",
    0x5740: "STM32 virtual COM port",
    0xDF11: "STM32 in its boot loader: no stream comes from it",
}
#: links of this project's virtual boards, in the temporary folder
VIRTUAL_STEM = "tinygc-board"


@dataclass(frozen=True)
class KnownPort:
    """name: what ``--port`` takes; is_candidate: whether a board may be behind it; usb: (vendor, product), serial number: or None."""

    name: str
    what: str
    is_candidate: bool
    usb: tuple[int, int] | None = None
    serial_number: str | None = None


def known_ports() -> list[KnownPort]:
    """Ports of this machine, candidates first, ST's boards before others."""
    ports = [_known(port) for port in list_ports.comports()] + [_virtual(path) for path in virtual_boards()]
    return sorted(ports, key=lambda port: (not port.is_candidate, port.usb is None or port.usb[0] != ST_VENDOR, port.name))


def virtual_boards() -> list[Path]:
    """Links of the virtual boards that run on this machine (``calibrate.py board``); none where the system has no such thing."""
    return sorted(path for path in Path(tempfile.gettempdir()).glob(f"{VIRTUAL_STEM}*") if path.is_symlink() and is_locked(lock_of(path)))


def lock_of(link: Path) -> Path:
    """The file that a running board holds locked: a link that a killed one left may lead to somebody's terminal by now."""
    return link.with_name(link.name + ".lock")


def is_virtual(name: str) -> bool:
    """Whether a virtual board that runs now is behind a port's name: its time is its own."""
    link = Path(name)
    return link.is_symlink() and lock_of(link).exists() and is_locked(lock_of(link))


def is_left_behind(name: str) -> bool:
    """Whether a port's name is the link of a virtual board that does not run any more.

    Links of other programs (``socat``) have no lock, and are what they are.
    """
    link = Path(name)
    if not link.is_symlink():
        return False
    usual = link.name.startswith(VIRTUAL_STEM) and link.parent.resolve() == Path(tempfile.gettempdir()).resolve()
    return (usual or lock_of(link).exists()) and not is_locked(lock_of(link))


def only_candidate() -> KnownPort:
    """The one port that a board may be behind; DeviceError lists the candidates where there is none or more than one."""
    candidates = [port for port in known_ports() if port.is_candidate]
    if not candidates:
        raise DeviceError("no serial port with a board; plug it in (calibrate.py ports lists what there is), or give --port")
    boards = [port for port in candidates if port.usb and port.usb[0] == ST_VENDOR] or candidates
    if len(boards) > 1:
        raise DeviceError(f"more than one port may be the board: {', '.join(port.name for port in candidates)}; choose with --port")
    return boards[0]


def identity_of(name: str) -> tuple | None:
    """What a USB device keeps when it comes back under another name: vendor, product, serial number; None where it has none."""
    port = next((port for port in list_ports.comports() if port.device == name), None)
    return (port.vid, port.pid, port.serial_number) if port and port.serial_number else None


def name_of(identity: tuple | None) -> str | None:
    """The port that a USB device has now, or None."""
    if identity is None:
        return None
    return next((port.device for port in list_ports.comports() if (port.vid, port.pid, port.serial_number) == identity), None)


def _known(port: ListPortInfo) -> KnownPort:
    if port.vid is None:
        what = port.description if port.description not in (None, "n/a") else "no USB device"
        return KnownPort(port.device, what, False)
    said = " ".join(filter(None, (port.manufacturer, port.product))) or port.description
    what = f"ST board: {ST_PRODUCTS.get(port.pid, said or 'unknown product')}" if port.vid == ST_VENDOR else said
    is_candidate = (port.vid, port.pid) != (ST_VENDOR, 0xDF11)
    return KnownPort(port.device, what, is_candidate, (port.vid, port.pid), port.serial_number)


def _virtual(path: Path) -> KnownPort:
    return KnownPort(str(path), "virtual board (calibrate.py board)", True)
