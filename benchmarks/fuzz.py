"""Coverage-guided fuzzing of a reader with Atheris (libFuzzer): ``python -m pip install -e '.[fuzz]'``, then
``python benchmarks/fuzz.py logs --minutes 30``.

The readers are the targets of ``tests/fuzz_targets``.  Inputs that reach new lines are gathered in ``build/fuzz/READER/corpus``, the
smallest input of each finding in ``build/fuzz/READER/findings``: a run goes on behind a finding.  ``--keep 30`` fuzzes nothing, but takes
from that corpus the few small inputs that together reach the most lines, and puts them into ``tests/corpus/READER``.

Under Atheris, and not without it, the process grows with the arrays that a reader compares, by 0.2 MB an input of the decoder: run that
one for ten minutes at a time, which go on from the same corpus.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path
from types import CodeType, FrameType, ModuleType

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

MEMORY = Path("/dev/shm")
SAY_EVERY_S = 5.0
#: longest input that is kept in tests/corpus
SMALL_BYTES = 1200


class Session:
    """One run of the fuzzer: what it has counted and found."""

    def __init__(self, reader: str, target: ModuleType, work: Path, folder: Path):
        self.reader, self.target, self.work, self.folder = reader, target, work, folder
        self.runs = self.accepted = 0
        self.findings: dict[str, tuple[str, int]] = {}
        self._began_s, self._said_s, self._pid = time.monotonic(), 0.0, os.getpid()
        (work / "findings").mkdir(parents=True, exist_ok=True)

    def one(self, data: bytes) -> None:
        """libFuzzer's entry: an input, and what became of it."""
        from fuzz_targets.rules import Finding, attempt

        self.runs += 1
        try:
            self.accepted += attempt(self.target, data, self.folder)
        except Finding as finding:
            self._keep(finding.place, str(finding), data)
        if time.monotonic() - self._said_s > SAY_EVERY_S:
            self._said_s = time.monotonic()
            self.say()

    def _keep(self, place: str, what: str, data: bytes) -> None:
        """The smallest input of each cause."""
        if place in self.findings and self.findings[place][1] <= len(data):
            return
        if place not in self.findings:
            print(f"FINDING {self.reader} {place}: {what[:300]!r}", file=sys.stderr, flush=True)
        self.findings[place] = what, len(data)
        stem = hashlib.sha256(place.encode()).hexdigest()[:8]
        (self.work / "findings" / stem).write_bytes(data)
        (self.work / "findings" / f"{stem}.txt").write_text(f"{place}\n{what}\n", encoding="utf-8", errors="backslashreplace")

    def say(self) -> None:
        """What was done so far, as a line of JSON in the work folder: libFuzzer ends the process without a word to Python."""
        usage = resource.getrusage(resource.RUSAGE_SELF)
        figures = {
            "reader": self.reader,
            "wall_min": round((time.monotonic() - self._began_s) / 60, 2),
            "cpu_min": round((usage.ru_utime + usage.ru_stime) / 60, 2),
            "runs": self.runs,
            "accepted": self.accepted,
            "findings": len(self.findings),
        }
        (self.work / f"figures-{self._pid}.json").write_text(json.dumps(figures) + "\n", encoding="utf-8")


def main() -> int:
    """Fuzz one reader, or keep a small corpus."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("reader", help="a target of tests/fuzz_targets")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=int, default=4096, help="bytes of an input (%(default)s)")
    parser.add_argument("--work", type=Path, help="folder of corpus and findings (build/fuzz/READER)")
    parser.add_argument("--keep", type=int, help="fuzz nothing: take so many inputs at most into tests/corpus")
    args = parser.parse_args()
    work = args.work or ROOT / "build" / "fuzz" / args.reader
    folder = Path(tempfile.mkdtemp(prefix="tinygc-fuzz-", dir=MEMORY if MEMORY.is_dir() else None)) / "one"
    try:
        return keep(args.reader, work, folder, args.keep) if args.keep else fuzz(args, work, folder)
    finally:
        shutil.rmtree(folder.parent, ignore_errors=True)


def fuzz(args: argparse.Namespace, work: Path, folder: Path) -> int:
    """Does not return: libFuzzer ends the process."""
    import atheris

    with atheris.instrument_imports(include=["session", "tinygc"]):
        from fuzz_targets import target

        module = target(args.reader)
    session = Session(args.reader, module, work, folder)
    for name in ("corpus", "seeds"):
        (work / name).mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(module.seeds()):
        (work / "seeds" / f"{number:03d}").write_bytes(seed)
    words = work / "words.dict"
    words.write_text("".join(f'"{_escaped(word)}"\n' for word in dict.fromkeys(module.TOKENS)), encoding="ascii")
    kept = ROOT / "tests" / "corpus" / args.reader
    options = [f"-seed={args.seed}", f"-max_len={args.longest}", f"-max_total_time={round(args.minutes * 60)}"]
    options += [f"-dict={words}"] if module.TOKENS else []
    options += [
        f"-artifact_prefix={work}/",
        "-report_slow_units=600",
        "-timeout=60",
        "-rss_limit_mb=6000",
        "-print_final_stats=1",
        "-verbosity=1",
    ]
    folders = [str(work / "corpus"), str(work / "seeds"), *([str(kept)] if kept.is_dir() else [])]
    atheris.Setup([sys.argv[0], *options, *folders], session.one)
    atheris.Fuzz()
    return 0


def _escaped(word: str) -> str:
    return "".join(chr(b) if 32 <= b < 127 and chr(b) not in '"\\' else f"\\x{b:02x}" for b in word.encode())


def keep(reader: str, work: Path, folder: Path, most: int) -> int:
    """The inputs that together reach the most lines that no seed reaches, greedily; written under their hashes.

    Those that were kept before and that fell once, which have names, stay.
    """
    from fuzz_targets import target

    module = target(reader)
    for seed in module.seeds():
        _lines_of(module, seed, folder)  # imports what is imported late
    reached = set().union(*(_lines_of(module, seed, folder) for seed in module.seeds()))
    inputs = [path.read_bytes() for path in (work / "corpus").glob("*") if path.stat().st_size <= SMALL_BYTES]
    fresh = {data: _lines_of(module, data, folder) - reached for data in sorted(inputs, key=lambda data: (len(data), data))}
    chosen = []
    while fresh and len(chosen) < most:
        best = max(fresh, key=lambda data: len(fresh[data]) - len(data) / SMALL_BYTES)
        if not fresh[best]:
            break
        chosen.append(best)
        gained = fresh.pop(best)
        reached |= gained
        fresh = {data: lines - gained for data, lines in fresh.items()}
    out = ROOT / "tests" / "corpus" / reader
    out.mkdir(parents=True, exist_ok=True)
    for data in chosen:
        (out / hashlib.sha256(data).hexdigest()[:12]).write_bytes(data)
    print(f"{reader}: {len(chosen)} of {len(inputs)} inputs, {sum(map(len, chosen))} bytes, {len(reached)} lines reached")
    return 0


def _lines_of(module: ModuleType, data: bytes, folder: Path) -> set[tuple[CodeType, int]]:
    """Lines of our own code that an input reaches."""
    from fuzz_targets.rules import Finding, attempt

    reached: set[tuple[CodeType, int]] = set()
    ours = (str(ROOT / "session"), str(ROOT / "tinygc"))

    def line(frame: FrameType, event: str, _: object) -> object:
        if event == "line":
            reached.add((frame.f_code, frame.f_lineno))
        return line

    def call(frame: FrameType, event: str, _: object) -> object:
        return line if frame.f_code.co_filename.startswith(ours) else None

    sys.settrace(call)
    try:
        attempt(module, data, folder)
    except Finding:
        pass
    finally:
        sys.settrace(None)
    return reached


if __name__ == "__main__":
    sys.exit(main())
