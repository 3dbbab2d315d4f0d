"""Whether two versions give the same numbers: ``python benchmarks/frozen.py --against REF``.

Both versions run the same commands on the same twelve recordings, each in processes of its own.  Every file that they write, every JSON and
every screen is compared: numbers to a relative 1e-9, texts to the letter.  What is listed:

- *changed*: a number that both have and that differs, or a command that ends with another exit code;
- *gone*, *new*: keys of a JSON, and files, that one version alone has;
- *refused*: a command that both refuse, so that nothing of it is compared;
- *texts*: lines of a screen, a page or a file whose words differ, each once.

Exit code 1 where a number changed or both refuse a command.  Times, dates, versions, paths of the checkout and hashes are left out
(``VOLATILE``).  Pictures are left out: they are drawn from numbers that are compared.
"""

from __future__ import annotations

import argparse
import difflib
import gzip
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared"

#: relative difference up to which two numbers are the same
SAME = 1e-9
#: keys of a JSON whose values differ from run to run or from version to version
VOLATILE = re.compile(r"(^|\.)(\w*seconds|created|\w*version\w*|git|commit|dirty|python|platform|\w*sha256|\w*hash\w*|computed|made)(\.|$)")
#: the same in texts: hashes, which are no numbers, dates, and versions
VOLATILE_TEXT = re.compile(r"\b(?=\d*[a-f])(?=[a-f]*\d)[0-9a-f]{7,64}\b|\b\d{4}-\d\d-\d\d(T[\d:.]+(Z|[+-]\d\d:\d\d)?)?\b|\b\d+\.\d+\.\d+\b")
NUMBER = re.compile(r"(?<![\w.])[-+−]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w])")
PICTURES = {".png", ".pdf", ".svg"}

EXPORTS = ("json", "kalibr", "openvins", "vins", "gtsam", "ros", "xio", "px4", "ardupilot", "c")


# The recordings.


@dataclass(frozen=True)
class Recording:
    """Arguments of the commands that are run on a recording, in their order, in the folder above its folder ``NAME``; source: a folder
    that is copied, or what ``_made`` makes of it."""

    name: str
    source: Path | tuple[str, ...]
    commands: tuple[str, ...]


def _commands(name: str, *, exports: tuple[str, ...] = ("json", "c"), unit: bool = True) -> tuple[str, ...]:
    """Those of a session of one sensor; unit: with its noise, its verification and its budget."""
    whole = [
        f"check {name} --all --json {name}/check.json",
        f"fit {name} --verbose --json {name}/fit_out.json",
        f"explain {name} --no-pictures --json {name}/explain_out.json",
        f"report {name} --json {name}/report.json",
        f"apply {name}/fit/model_least_squares.json {name}/log0001.csv.gz -o {name}/applied.csv",
        *(f"export {name} --anyway --to {form} --out {name}/export/{form}" for form in exports),
    ]
    if unit:
        whole += [
            f"noise {name} --no-pictures --json {name}/noise.json --out {name}/noise",
            f"verify {name} {name} --json {name}/verify.json",
            f"budget {name} --json {name}/budget.json --out {name}/budget",
        ]
    return tuple(whole)


def _array_commands(name: str) -> tuple[str, ...]:
    return (
        f"check {name} --json {name}/check.json",
        f"fit {name} --json {name}/fit_out.json",
        f"explain {name} --no-pictures --json {name}/explain_out.json",
        f"apply {name}/fit/model_array.json {name} -o {name}/applied.csv",
        f"export {name}/fit/model_array.json --to json --out {name}/export",
    )


def _rest_commands(name: str, *, temperature: bool) -> tuple[str, ...]:
    noise = (f"check {name} --json {name}/check.json", f"noise {name} --no-pictures --json {name}/noise.json --out {name}/noise")
    if not temperature:
        return (*noise, *(f"export {name}/noise/noise.json --to {form} --out {name}/export/{form}" for form in ("kalibr", "openvins")))
    forms = ("px4", "ardupilot", "c", "json")
    return (
        *noise,
        f"temperature {name} --json {name}/fit_out.json",
        *(f"export {name} --to {form} --out {name}/export/{form}" for form in forms),
    )


RECORDINGS = (
    Recording("session1", ROOT / "data/session1", _commands("session1", exports=EXPORTS)),
    Recording("concealed1", SHARED / "concealed/case001", _commands("concealed1")),
    Recording("concealed14", SHARED / "concealed/case014", _commands("concealed14", unit=False)),
    Recording("concealed27", SHARED / "concealed/case027", _commands("concealed27", unit=False)),
    Recording("closure", SHARED / "closure/case001", _commands("closure", unit=False)),
    Recording("xsens", SHARED / "xsens", _commands("xsens")),
    Recording("mikov", SHARED / "mikov/imu0", _commands("mikov", unit=False)),
    Recording("mimu", ("public", "mimu", "mimu/exp_1.npz"), _commands("mimu", unit=False)),
    Recording("array", ("public", "mimu", "mimu/exp_1.npz", "--array"), _array_commands("array")),
    Recording("euroc", ("windows",), (f"check {'euroc'} --json euroc/check.json", *_commands("euroc", exports=(), unit=False)[1:3])),
    Recording(
        "sweep",
        ("simulate", "--rest-cycles", "2", "--rest-cycle-s", "900", "--odr-hz", "104", "--rest-lag-s", "40", "--seed", "5"),
        _rest_commands("sweep", temperature=True),
    ),
    Recording("adis16405", ("public", "adis16405", "wild/adis16405_imu1.npz"), _rest_commands("adis16405", temperature=False)),
    Recording(
        "turns",
        ("simulate", "--segments", "24", "--closure", "0", "--stop-sigma-deg", "0.05", "--accel-fs-g", "2", "--seed", "3"),
        _commands("turns", unit=False),
    ),
)


def _make(recording: Recording, folder: Path) -> None:
    """Write the recording's folder ``folder/NAME``: both versions are given copies of it."""
    out, python = folder / recording.name, [sys.executable, "-B"]
    if isinstance(recording.source, Path):
        shutil.copytree(recording.source, out, ignore=shutil.ignore_patterns("fit", "explain", "report.html"))
        for path in (out, *out.rglob("*")):
            path.chmod(0o755 if path.is_dir() else 0o644)
        return
    kind, *rest = recording.source
    with tempfile.TemporaryDirectory() as scratch:
        if kind == "simulate":
            command = [*python, str(ROOT / "calibrate.py"), "simulate", "--out", str(out), *rest]
        elif kind == "windows":
            words = f"write_training_windows(Path({str(SHARED / 'euroc')!r}), Path({str(out)!r}))"
            command = [*python, "-c", f"from pathlib import Path; from benchmarks.public.euroc import write_training_windows; {words}"]
        else:
            name, file, *more = rest
            shutil.copy(SHARED / file, scratch)
            command = [*python, "-m", "benchmarks.public", name, scratch, "--out", f"{scratch}/sessions", *more]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        if kind == "public":
            first = sorted(path.parent for path in Path(scratch, "sessions").rglob("session.toml"))[0]
            array = sorted(path.parent for path in Path(scratch, "sessions").rglob("array.toml"))
            shutil.copytree(array[0] if array else first, out)


def _is_there(recording: Recording) -> bool:
    source = recording.source
    return source[0] == "simulate" or SHARED.exists() if isinstance(source, tuple) else source.exists()


def _run(checkout: Path, recording: Recording, folder: Path) -> float:
    """Run its commands with one version; screens and exit codes go to files as well.  Returns the seconds that it took."""
    environment = os.environ | {"TINYGC_DEFAULTS": "", "COLUMNS": "120", "PYTHONPATH": str(checkout), "SOURCE_DATE_EPOCH": "1764288000"}
    environment["GIT_DIR"] = os.devnull  # a report states its commit
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    start = time.monotonic()
    for number, command in enumerate(recording.commands):
        done = subprocess.run(
            [sys.executable, str(checkout / "calibrate.py"), *command.split()], cwd=folder, env=environment, capture_output=True, text=True
        )
        screen = f"$ {command}\nexit code {done.returncode}\n{done.stdout}{done.stderr}"
        (folder / recording.name / f"screen{number:02d}_{command.split()[0]}.txt").write_text(screen, encoding="utf-8")
    return time.monotonic() - start


# What is compared.


@dataclass
class Difference:
    """Of one recording: how much is the same, and what is not; seconds: what each version's methods took, as tables print it."""

    seconds: tuple[frozenset[str], ...] = (frozenset(), frozenset())
    numbers: int = 0
    changed: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)
    new: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    texts: Counter[str] = field(default_factory=Counter)

    def number(self, where: str, before: float, after: float) -> None:
        self.numbers += 1
        if before == after or (math.isnan(before) and math.isnan(after)):
            return
        if not abs(after - before) <= SAME * max(abs(before), abs(after)):
            self.changed.append(f"{where}: {before!r} -> {after!r}")

    def text(self, before: str, after: str) -> None:
        self.texts[f"- {before.strip()}\n  + {after.strip()}"] += 1


def compare(before: Path, after: Path, checkouts: tuple[Path, ...]) -> Difference:
    """Every file of two folders; checkouts: whose paths are no difference."""
    found = Difference(tuple(map(_seconds, (before, after))))
    names = [{str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} for folder in (before, after)]
    found.gone += [f"file {name}" for name in sorted(names[0] - names[1])]
    found.new += [f"file {name}" for name in sorted(names[1] - names[0])]
    for name in sorted(names[0] & names[1]):
        if Path(name).suffix in PICTURES:
            continue
        one, other = (
            _text(folder / name).replace(str(checkout), "CHECKOUT") for folder, checkout in zip((before, after), checkouts, strict=True)
        )
        if all("\nexit code 2\n" in text for text in (one, other)):
            found.refused.append(one.splitlines()[0])
        if name.endswith(".json"):
            _compare_values(found, name, json.loads(one), json.loads(other))
        else:
            _compare_lines(found, name, one, other)
    return found


def _seconds(folder: Path) -> frozenset[str]:
    """Seconds of every method as a table prints them; the JSON has a digit more, rounded, too."""
    files = folder.rglob("fit_out.json")
    taken = [value for path in files for key, value in _leaves(json.loads(path.read_text())) if key.endswith(".seconds")]
    return frozenset(f"{value + rounded:.2f}" for value in taken for rounded in (-6e-4, 0.0, 6e-4))


def _text(path: Path) -> str:
    data = path.read_bytes()
    return (gzip.decompress(data) if path.suffix == ".gz" else data).decode(errors="replace")


def _leaves(value: object, where: str = "") -> Iterator[tuple[str, object]]:
    """Each key of a JSON by its path, with its value; names of list items are their numbers."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if items is None:
        yield where, value
        return
    yield where, type(value).__name__
    for key, part in items:
        yield from _leaves(part, f"{where}.{key}" if where else str(key))


def _compare_values(found: Difference, name: str, before: object, after: object) -> None:
    one, other = ({key: value for key, value in _leaves(part) if not VOLATILE.search(key)} for part in (before, after))
    found.gone += [f"{name}: {key}" for key in one.keys() - other.keys()]
    found.new += [f"{name}: {key}" for key in other.keys() - one.keys()]
    for key in one.keys() & other.keys():
        values = one[key], other[key]
        if all(isinstance(value, (int, float)) for value in values):
            found.number(f"{name}: {key}", float(values[0]), float(values[1]))
        elif all(isinstance(value, str) for value in values):
            _compare_lines(found, f"{name}: {key}", *values)
        elif values[0] != values[1]:
            found.changed.append(f"{name}: {key}: {values[0]!r} -> {values[1]!r}")


def _compare_lines(found: Difference, name: str, before: str, after: str) -> None:
    """Numbers of lines whose words are the same; other lines as texts."""
    if before == after:
        found.numbers += len(NUMBER.findall(before))
        return
    cut = (lambda text: text.replace(">", ">\n")) if name.endswith(".html") else str
    lines = [[" ".join(line.split()) for line in VOLATILE_TEXT.sub("~", cut(text)).splitlines()] for text in (before, after)]
    shapes = [[NUMBER.sub("#", line) for line in part] for part in lines]
    if shapes[0] == shapes[1]:
        pairs = list(zip(*lines, strict=True))
    else:
        pairs = []
        for tag, a, b, c, d in difflib.SequenceMatcher(None, *shapes, autojunk=len(shapes[0]) > 5000).get_opcodes():
            if tag == "equal":
                pairs += zip(lines[0][a:b], lines[1][c:d], strict=True)
            else:
                found.text(" / ".join(lines[0][a:b]), " / ".join(lines[1][c:d]))
    for one, other in pairs:
        if one == other:
            found.numbers += len(NUMBER.findall(one))
            continue
        for values in zip(*(NUMBER.findall(line) for line in (one, other)), strict=True):
            if not all(value in known for value, known in zip(values, found.seconds, strict=True)):
                found.number(f"{name}: {one[:80]}", *(float(value.replace("−", "-")) for value in values))


# Both versions, side by side.


def _checkout(reference: str, folder: Path) -> Path:
    archive = subprocess.run(["git", "archive", "--format=tar", reference], cwd=ROOT, check=True, capture_output=True).stdout
    folder.mkdir()
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive, check=True)
    return folder


def main() -> int:
    """Print the table and what differs; 1 where a number changed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", metavar="REF", required=True, help="the version before: a commit, tag or branch")
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        default=[],
        choices=[one.name for one in RECORDINGS],
        help=f"some of {', '.join(one.name for one in RECORDINGS)}",
    )
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep what both wrote, in DIR/before and DIR/after")
    parser.add_argument("--most", type=int, default=40, help="lines listed of each kind and recording (%(default)s)")
    args = parser.parse_args()
    chosen = [one for one in RECORDINGS if (not args.only or one.name in args.only) and _is_there(one)]
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.keep or Path(scratch)
        sides = {"before": _checkout(args.against, Path(scratch) / "checkout"), "after": ROOT}
        for side in sides:
            (folder / side).mkdir(parents=True)
        differences = _differences(chosen, sides, folder)
    print(f"against {args.against}\n")
    print(f"| recording | s before | s after | numbers | changed | gone | new | refused | texts |\n| --- {'| ---: ' * 8}|")
    for name, (seconds, found) in differences.items():
        counts = (found.numbers, len(found.changed), len(found.gone), len(found.new), len(found.refused), len(found.texts))
        print(f"| {name} | {seconds['before']:.0f} | {seconds['after']:.0f} | {' | '.join(map(str, counts))} |")
    for kind in ("changed", "gone", "new", "refused", "texts"):
        for name, (_, found) in differences.items():
            lines = list(getattr(found, kind))
            if lines:
                print(f"\n{kind}, {name}:")
                print("\n".join(f"  {line}" for line in sorted(lines)[: args.most]))
                print(f"  … {len(lines) - args.most} more" if len(lines) > args.most else "", end="\n" if len(lines) > args.most else "")
    missing = [one.name for one in RECORDINGS if not _is_there(one)]
    if missing:
        print(f"\nnot there: {', '.join(missing)} (../shared)")
    return int(any(found.changed or found.refused for _, found in differences.values()))


def _differences(chosen: list[Recording], sides: dict[str, Path], folder: Path) -> dict[str, tuple[dict[str, float], Difference]]:
    """Of each recording: seconds by version, and what differs; two processes at a time, both versions of a recording together."""

    def whole(recording: Recording) -> tuple[dict[str, float], Difference]:
        _make(recording, folder / "before")
        shutil.copytree(folder / "before" / recording.name, folder / "after" / recording.name)
        seconds = {side: _run(checkout, recording, folder / side) for side, checkout in sides.items()}
        return seconds, compare(*(folder / side / recording.name for side in sides), tuple(sides.values()))

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        return dict(zip((one.name for one in chosen), pool.map(whole, chosen), strict=True))


if __name__ == "__main__":
    sys.exit(main())
