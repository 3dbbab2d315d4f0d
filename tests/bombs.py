"""Files that are made to exhaust whoever reads them, and the commands that read each.

A bomb is small to write (a packed run of zeros, a sparse file, a link to a device) and stands where a session, a model or a raw file is
expected.
"""

from __future__ import annotations

import gzip
import os
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

GB, MB = 1 << 30, 1 << 20
HEADER = "t_us,gx,gy,gz,ax,ay,az,temp\n"
ROW = "{},1,2,3,4,5,-4096,6\n"
TRUTH = "t_us,qw,qx,qy,qz\n"


@dataclass(frozen=True)
class Bomb:
    """place: the file it is put in the place of; ``write`` is given its path; packed: whether its name ends in .gz."""

    name: str
    place: str
    write: Callable[[Path], None]

    def put(self, folder):
        """Into a session folder; the file's path."""
        path = folder / self.place
        for other in (path, folder / f"{self.place}.gz", folder / self.place.removesuffix(".gz")):
            other.unlink(missing_ok=True)
        if path.name.startswith(("truth", "attitudes")):
            config = folder / "session.toml"
            config.write_text(config.read_text().replace('"gravity"', '"truth"' if path.name.startswith("truth") else '"table"'))
        self.write(path)
        return path


def _rows(count, at=0):
    return "".join(ROW.format(4808 * (at + i)) for i in range(count))


def sparse(head, size):
    """Text, and zero bytes behind it up to a size."""

    def write(path):
        path.write_text(head)
        os.truncate(path, size)

    return write


def text(make):
    """Text that is only made when it is written."""
    return lambda path: path.write_text(make(), encoding="utf-8") and None


def packed(head, again, size):
    """gzip of a head and of the same bytes again and again, up to a size: one member a thousand times."""

    def write(path):
        block = again * (16 * MB // len(again))
        member = gzip.compress(block, mtime=0)
        path.write_bytes(gzip.compress(head.encode(), mtime=0) + member * (size // len(block)))

    return write


def endless(path, head, byte, size):
    """A head and then one byte, up to a size."""
    with path.open("wb") as file:
        file.write(head.encode())
        for _ in range(size // (16 * MB)):
            file.write(byte * (16 * MB))


def link(target):
    """A symbolic link."""
    return lambda path: path.symlink_to(target)


def a_socket(path):
    """A socket that nobody serves."""
    with socket.socket(socket.AF_UNIX) as end:
        here = os.open(path.parent, os.O_RDONLY)
        end.bind(f"/proc/self/fd/{here}/{path.name}")
        os.close(here)


def damaged(path):
    """A good packed log whose last part is missing and that has other bytes in its middle."""
    packed(HEADER + _rows(3000), b"\n", MB)(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 40] = bytes(40)
    path.write_bytes(data[:-20])


def _everywhere(place):
    """What no file of any kind may be."""
    yield Bomb("link to /dev/zero", place, link("/dev/zero"))
    yield Bomb("named pipe", place, os.mkfifo)
    yield Bomb("socket", place, a_socket)
    yield Bomb("folder", place, Path.mkdir)


def _deep(depth, opens, shuts):
    return opens * depth + "1" + shuts * depth


TOML = 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 208\ngyro_fs_dps = 500\naccel_fs_g = 4\n[notes]\n'
MODEL = '{"schema": "tinygc-model/1", "kind": "linear", "more": %s}'
BOMBS = [
    Bomb("10 GB of zeros, packed", "log0001.csv.gz", packed(HEADER, b"\0", 10 * GB)),
    Bomb("10 GB of one row, packed", "log0001.csv.gz", packed(HEADER, ROW.format(7).encode(), 10 * GB)),
    Bomb("ends in 1 GB of NULs", "log0001.csv", sparse(HEADER + _rows(20_000), GB)),
    Bomb("a line of 64 MB of digits", "log0001.csv", lambda path: endless(path, HEADER + _rows(1000), b"7", 64 * MB)),
    Bomb("1 TB of NULs", "log0001.csv", sparse("", 1 << 40)),
    Bomb("1 TB of NULs, named .gz", "log0001.csv.gz", sparse("", 1 << 40)),
    Bomb("damaged gzip", "log0001.csv.gz", damaged),
    Bomb("header of 60 000 brackets", "log0001.csv", text(lambda: "(a" * 30_000 + ",b\n" + _rows(100))),
    Bomb("comment of 60 000 letters", "log0001.csv", text(lambda: HEADER + "# " + "a" * 60_000 + "\n" + _rows(100))),
    *_everywhere("log0001.csv"),
    Bomb("10 GB of zeros, packed", "truth0001.csv.gz", packed(TRUTH, b"\0", 10 * GB)),
    Bomb("10 GB of one row, packed", "truth0001.csv.gz", packed(TRUTH, b"1,1,0,0,0\n", 10 * GB)),
    Bomb("1 GB of NULs", "truth0001.csv", sparse(TRUTH, GB)),
    *_everywhere("truth0001.csv"),
    Bomb("1 GB of NULs", "turns.csv", sparse("turn,axis,angle_deg,sigma_deg\n", GB)),
    Bomb("16 million blank lines", "turns.csv", text(lambda: "turn,axis,angle_deg,sigma_deg\n" + "\n" * 16_000_000)),
    Bomb("9 999 turns", "turns.csv", text(lambda: "turn,axis,angle_deg,sigma_deg\n" + "".join(f"{i},x,90,1\n" for i in range(9_999)))),
    *_everywhere("turns.csv"),
    Bomb("1 GB of NULs", "attitudes.csv", sparse("still,roll_deg,pitch_deg,yaw_deg\n", GB)),
    *_everywhere("attitudes.csv"),
    Bomb("1 GB of NULs", "session.toml", sparse(TOML, GB)),
    Bomb("dotted key, 100 000 deep", "session.toml", text(lambda: TOML + "a." * 100_000 + "a = 1\n")),
    Bomb("header, 100 000 deep", "session.toml", text(lambda: TOML + "[" + "a." * 100_000 + "a]\n")),
    Bomb("2000 keys, 200 deep", "session.toml", text(lambda: TOML + "".join("a." * 200 + f"b{i} = 1\n" for i in range(2000)))),
    Bomb("arrays, 100 000 deep", "session.toml", text(lambda: TOML + "a = " + _deep(100_000, "[", "]") + "\n")),
    Bomb("tables, 100 000 deep", "session.toml", text(lambda: TOML + "a = " + _deep(50_000, "{a=", "}") + "\n")),
    Bomb("number of 300 000 hex digits", "session.toml", text(lambda: TOML + "a = 0x" + "f" * 300_000 + "\n")),
    *_everywhere("session.toml"),
    Bomb("2 GB of NULs", "model.json", sparse("{", 2 * GB)),
    Bomb("list, 1 000 000 deep", "model.json", text(lambda: MODEL % _deep(1_000_000, "[", "]"))),
    Bomb("6 million empty lists", "model.json", text(lambda: MODEL % ("[" + "[]," * 6_000_000 + "1]"))),
    *_everywhere("model.json"),
    *_everywhere("raw.bin"),
]


#: place of a bomb, up to its number -> commands that read it; {S} session folder, {B} the bomb, {M} a good model, {L} a good log, {O} new
SESSION_READERS = [
    "check {S}", "fit {S} --methods least_squares", "explain {S}", "report {S} --methods least_squares", "check {S} --plan",
    "fit {S} --accelerometer alone --out {O}", "fleet {S} --out {O} --jobs 1", "board {S} --link {O}", "challenge --on {S} --cases 1",
]  # fmt: skip
READERS = {
    "log": [
        *SESSION_READERS, "import {B} --out {O} --gyro-fs 500 --accel-fs 4", "apply {M} {B} -o {O}", "noise {S} --out {O}",
        "noise {B} --out {O}", "rates {B} --out {O}", "watch {M} {B} --session {S}", "budget {S}",
        "verify {M} {B}",
    ],
    "truth": SESSION_READERS,
    "turns": SESSION_READERS,
    "attitudes": SESSION_READERS,
    "session": [
        *SESSION_READERS, "import {L} --out {S} --add log", "apply {M} {L} --session {S} -o {O}", "history {S} {S} --compare",
        "export {S} --to json",
        "record --port {O} --like {S} --out {O}", "check {S}", "history {S} --out {O}", "noise {S} --out {O}", "table check --table {B}",
    ],
    "model": [
        "apply {B} {L} -o {O}", "noise --curve {B}",
        "report {S} --methods least_squares --certificate {O} --as-found {B}",
        "watch {B} {L}", "verify {B} {L}",
    ],
    "raw": ["import {B} --out {O} --gyro-fs 500 --accel-fs 4 --odr 208"],
}  # fmt: skip


def readers_of(bomb):
    """The commands that read it."""
    return READERS[re.match("[a-z]+", bomb.place)[0]]
