"""A recorder that is killed, unplugged, stopped, and runs out of disk, again and again; and a day of samples that never ends.

Rounds: a process records from a pseudo-terminal; at a random moment it is killed, its cable is pulled, its disk is full, or it is
stopped; the next one resumes.  What left the terminal is compared byte by byte with raw.bin.  Hours: the recorder and the decoder in
this process, with a clock that is simulated: no second of it is waited for.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import pty
import shutil
import signal
import tempfile
import time
import tty
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from adversarial_streams import sample_frames, sample_lines
from common import markdown, progress
from full_disk import FullDisk
from soak_day import day

from session.bench import rawfile
from session.bench.decoder import StreamDecoder
from session.bench.logwriter import LogWriter
from session.bench.recorder import Recorder, stream
from session.io.errors import DeviceError, StorageError

ENDS = ("killed", "unplugged", "disk full", "stopped")
IN_A_FOLDER = 25  #: rounds that go on with each other: each resumes what all before it left
READ_IN_HAND = 4096  #: bytes: the most that a pseudo-terminal gives at once
LONGEST_S = 0.06  #: of sending, per round
PATIENCE_S = 60.0
LAST_WORD = b"\xff that was all \xff"
FULL_DISK, TAKEN = 2, 3  #: exit codes of a child whose disk was full, or whose terminal somebody else had opened


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--hours", type=float, default=24.0, help="simulated, of frames")
    parser.add_argument("--text-hours", type=float, default=2.0, help="simulated, of text")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="where to record to (a temporary one); a day of frames needs 1 GB, of text as much")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tinygc-soak-", dir=args.folder) as parent:
        stopped: list[int] = []
        stop = lambda: bool(stopped)  # noqa: E731
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, _: stopped.append(number))
        if args.rounds:
            print(markdown(HEADER, rounds(args.rounds, args.seed, Path(parent), stop)), "\n", flush=True)
        for form, hours in (("frames", args.hours), ("text", args.text_hours)):
            if hours and not stopped:
                print(markdown(("a day", ""), day(form, hours, args.seed, Path(parent), stop)), "\n", flush=True)


HEADER = (
    "ended by",
    "rounds",
    "bytes received",
    "kept",
    "lost",
    "most at once",
    "beyond a read in hand",
    "foreign",
    "samples",
    "logs made again",
)


@dataclass
class Sum:
    """Of the rounds that ended alike."""

    rounds: int = 0
    received: int = 0
    kept: int = 0
    most_lost: int = 0
    beyond: int = 0
    foreign: int = 0


@dataclass
class Soak:
    """What the rounds were."""

    sums: dict[str, Sum] = field(default_factory=lambda: {end: Sum() for end in ENDS})
    samples: int = 0
    wrong_samples: int = 0
    logs: Counter = field(default_factory=Counter)


def rounds(count: int, seed: int, parent: Path, stop: Callable[[], bool] = lambda: False) -> list[tuple]:
    """The table of so many rounds, or of those until somebody wants to stop."""
    rng, soak = np.random.default_rng(seed), Soak()
    for first in range(0, count, IN_A_FOLDER):
        if stop():
            break
        folder, form = parent / f"rounds{first}", ("frames", "text")[first // IN_A_FOLDER % 2]
        for number in range(first, min(count, first + IN_A_FOLDER)):
            progress(f"round {number} of {count}")
            one_round(folder, form, ENDS[int(rng.integers(len(ENDS)))], rng, soak)
        logs_again(folder, soak)
        shutil.rmtree(folder)
    progress("")
    rows = [
        (end, each.rounds, each.received, each.kept, each.received - each.kept, each.most_lost, each.beyond, each.foreign, "", "")
        for end, each in soak.sums.items()
    ]
    total = [sum(int(row[k]) for row in rows) for k in (1, 2, 3, 4)]
    again = ", ".join(f"{number} {what}" for what, number in soak.logs.items())
    most, beyond, foreign = max(int(row[5]) for row in rows), sum(int(row[6]) for row in rows), sum(int(row[7]) for row in rows)
    return [*rows, ("all", *total, most, beyond, foreign, soak.samples, again)]


def one_round(folder: Path, form: str, end: str, rng: np.random.Generator, soak: Soak) -> None:
    """Record for a moment, end it, and compare."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    raw = folder / rawfile.RAW
    before = raw.stat().st_size if raw.exists() else 0
    opened = (folder / rawfile.TIMES).stat().st_size if (folder / rawfile.TIMES).exists() else 0
    room = int(rng.integers(1, 60_000)) if end == "disk full" else -1
    child = multiprocessing.get_context("fork").Process(target=record, args=(folder, os.ttyname(slave), (master, slave), room), daemon=True)
    child.start()
    wait_for(
        lambda: ((folder / rawfile.TIMES).exists() and (folder / rawfile.TIMES).stat().st_size > max(opened, 25)) or not child.is_alive()
    )
    if child.exitcode == TAKEN:
        os.close(master)
        os.close(slave)
        return one_round(folder, form, end, rng, soak)
    data = what_is_sent(form, int(rng.integers(1 << 16)))
    written = send(master, data, PATIENCE_S if end == "disk full" else float(rng.uniform(0.0, LONGEST_S)), rng, child)
    if end == "unplugged":
        # What lies in the terminal when the cable goes was never received, and nobody can count it: all of it has to arrive first.
        wait_for(lambda: raw.exists() and raw.stat().st_size - before >= written)
        os.close(slave)
        os.close(master)
        wait_for(lambda: (folder / rawfile.TIMES).read_text().splitlines()[-1].partition(",")[2].partition(",")[2].startswith("close"))
        os.kill(child.pid, signal.SIGKILL)
        left = 0
    else:
        if end in ("killed", "stopped") and child.is_alive():
            os.kill(child.pid, signal.SIGKILL if end == "killed" else signal.SIGTERM)
        child.join(PATIENCE_S)
        left = len(rest_of(master, slave))
        os.close(slave)
        os.close(master)
    child.join(PATIENCE_S)
    assert not child.is_alive(), f"{end}: the recorder does not end"
    with raw.open("rb") as file:
        file.seek(before)
        kept = file.read()
    each = soak.sums[end]
    each.rounds += 1
    received = written - left
    each.received += received
    each.kept += len(kept)
    each.most_lost = max(each.most_lost, received - len(kept))
    each.beyond += max(0, received - len(kept) - READ_IN_HAND)
    each.foreign += sum(a != b for a, b in zip(kept, data, strict=False)) if kept != data[: len(kept)] else 0


def what_is_sent(form: str, seed: int) -> bytes:
    """Some seconds of a board's samples, from its start."""
    return sample_frames(12_000, seed).tobytes() if form == "frames" else b"".join(sample_lines(8_000, seed))


def send(master: int, data: bytes, seconds: float, rng: np.random.Generator, child: multiprocessing.process.BaseProcess) -> int:
    """Write in portions for so long, or until the reader is gone; how many bytes went out."""
    os.set_blocking(master, False)
    written, deadline = 0, time.monotonic() + seconds
    while time.monotonic() < deadline and written < len(data) and child.is_alive():
        try:
            written += os.write(master, data[written : written + int(rng.integers(1, 2000))])
        except BlockingIOError:
            time.sleep(0.001)
    return written


def record(folder: Path, name: str, others: tuple[int, int], room: int) -> None:
    """In a child: until something ends it."""
    for file in others:  # the parent's: a terminal whose other end somebody holds is not unplugged
        os.close(file)
    stop = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    if room >= 0:
        rawfile.os = FullDisk(room)
    try:
        recorder = Recorder(folder, name)
        for _ in recorder.catch_up():
            pass
        while not stop:
            recorder.poll(0.01)
        recorder.close()
    except StorageError:
        os._exit(FULL_DISK)
    except DeviceError:  # a reader of another program was waiting for a terminal of this name
        os._exit(TAKEN)
    os._exit(0)


def logs_again(folder: Path, soak: Soak) -> None:
    """The logs of a folder whose last recorder was ended somehow, made again twice: beside what is there, and elsewhere."""
    before = {path.name: path.read_bytes() for path in folder.glob("log*.csv")}
    made = []
    for target in (folder, folder / "again"):
        target.mkdir(exist_ok=True)
        decoder, logs = StreamDecoder(), LogWriter(target)
        for _ in stream(folder / rawfile.RAW, decoder, logs):
            pass
        logs.write(decoder.finish())
        logs.close()
        made.append([path.read_bytes() for path in logs.paths])
        soak.logs["put aside"] += len(logs.put_aside)
    soak.samples += decoder.samples
    soak.logs["the same"] += sum(a == b for a, b in zip(*made, strict=True))
    soak.logs["different"] += sum(a != b for a, b in zip(*made, strict=True))
    soak.logs["shorter than before"] += sum(not (folder / name).read_bytes().startswith(data) for name, data in before.items())


def wait_for(condition) -> None:
    """Until it is so; an assertion where it is not within the patience."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def rest_of(master: int, slave: int) -> bytes:
    """What nobody has read: all before a last word, which is sent for it."""
    for file in (master, slave):
        os.set_blocking(file, False)
    rest, word = b"", LAST_WORD
    deadline = time.monotonic() + PATIENCE_S
    while not rest.endswith(LAST_WORD):
        assert time.monotonic() < deadline, "waited in vain"
        with contextlib.suppress(BlockingIOError):
            word = word[os.write(master, word) :] if word else word
        try:
            rest += os.read(slave, 65536)
        except BlockingIOError:
            time.sleep(0.001)
    return rest.removesuffix(LAST_WORD)


if __name__ == "__main__":
    main()
