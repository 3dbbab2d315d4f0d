"""Hold the firmware's C against MISRA C:2012: Cppcheck's addon checks it, and misra.toml is the record of deviations.

The record has a reason for each rule that is not followed, and the number of places in each file.  What has no entry, more or fewer places
than the record, and a rule without a reason are errors: exit code 1.  ``--write`` takes over the numbers, and keeps the reasons.  Another
version of Cppcheck counts otherwise: then a rule without a reason alone is an error.

Checked are the driver, the board, the program, and a model as ``calibrate.py export --to c`` writes it; not the glue for other platforms.
The addon does not know every rule.  What Cppcheck finds by itself is treated as a rule of its own.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from session.io.errors import CalibrationError, FormatError
from session.io.toml import read_toml
from tinygc.deploy.embedded.program import Registers, program
from tinygc.deploy.embedded.source import source_files
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.nets import CalibrationNet

HERE = Path(__file__).resolve().parent
RECORD = HERE / "misra.toml"
ADDON, PREFIX = "misra", "misra-c2012-"
COMMAND = ("cppcheck", f"--addon={ADDON}", "--std=c11", "--platform=unix32", "--enable=style", "--quiet")
SAID_CHARS = 300  #: of what Cppcheck says where it fails
SEEN = "{file}|{line}|{column}|{id}"
HEAD = """\
# Deviations from MISRA C:2012: why a rule is not followed, and in how many places of which file.
# `python firmware/misra_check.py` compares this with the code; `--write` takes over the numbers, and keeps the reasons.
# Rules are named by their numbers, since their text is MISRA's.  A name without numbers is a finding of Cppcheck itself.
# The addon does not know every rule: one that is not named here is not thereby followed.  Not checked: the glue, arduino/ and zephyr/.

checker = {checker}
"""

Places = Counter[tuple[str, str]]  # (rule, file) -> places


@dataclass(frozen=True)
class Record:
    """checker: the version whose findings these are; reasons: rule -> reason; places: (rule, file) -> number."""

    checker: str
    reasons: dict[str, str]
    places: Places


def checker() -> str:
    """Name and version of Cppcheck, or an empty string where it, or its addon, is not installed."""
    if shutil.which(COMMAND[0]) is None:
        return ""
    version = subprocess.run([COMMAND[0], "--version"], capture_output=True, text=True, check=True).stdout.strip()
    with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
        empty = Path(folder) / "empty.c"
        empty.write_text("/* Nothing. */\n")
        command = [*COMMAND, "--error-exitcode=1", empty.name]
        works = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return version if works.returncode == 0 else ""


def write_model(folder: Path) -> None:
    """The C of a small model with a denoiser."""
    rng = np.random.default_rng(0)
    net = CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.01 * rng.normal(size=27))
    model = DenoisedNet(net, Denoiser.from_vector(np.abs(rng.normal(size=(3, 56)))).normalised(), 208.0)
    for name, text in source_files(program(model), Registers(), "Checked by Cppcheck.", {}).items():
        (folder / name).write_text(text)


def findings(folder: Path) -> Places:
    """What Cppcheck finds in the C of a folder, headers included, each place once.

    Raises CalibrationError where it does not run, or passes over a file because its addon ends with an error: it says so on standard
    output, with exit code 0.
    """
    command = [*COMMAND, f"--template={SEEN}", "-I.", *sorted(path.name for path in folder.glob("*.c"))]
    ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    lines = set(ran.stderr.splitlines())
    odd = [line for line in lines if line.count("|") != 3 or line.endswith("internalError")]
    if ran.returncode or odd or ran.stdout.strip():
        said = [*odd, *ran.stdout.splitlines(), f"exit code {ran.returncode}"]
        raise CalibrationError(f"cppcheck: {next(line for line in said if line.strip())[:SAID_CHARS]}")
    return Counter((found.removeprefix(PREFIX), file) for file, _, _, found in (line.split("|") for line in lines))


def all_findings() -> Places:
    """Of the firmware and a model, copied, because Cppcheck writes beside what it reads."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as name:
        folder = Path(name)
        for path in (*HERE.glob("*.c"), *HERE.glob("*.h")):
            shutil.copy(path, folder)
        write_model(folder)
        return findings(folder)


def read_record(path: Path) -> Record:
    """The deviation record.  Raises FormatError for one that is none."""
    table = read_toml(path)
    expected = "expected checker, and for each rule a table with reason and places (python firmware/misra_check.py --write)"
    rules = table.get("rule", {})
    if not isinstance(table.get("checker"), str) or not isinstance(rules, dict):
        raise FormatError(f"{path}: is no deviation record; {expected}")
    places: Places = Counter()
    for rule, entry in rules.items():
        if not isinstance(entry, dict) or not isinstance(entry.get("reason"), str) or not isinstance(entry.get("places"), dict):
            raise FormatError(f"{path}: rule {rule} is incomplete; {expected}")
        for file, number in entry["places"].items():
            if not isinstance(number, int) or number < 1:
                raise FormatError(f"{path}: rule {rule}, {file}: {number!r} is no number of places; {expected}")
            places[rule, file] = number
    return Record(table["checker"], {rule: entry["reason"] for rule, entry in rules.items()}, places)


def differences(found: Places, record: Record, version: str) -> list[str]:
    """A line for each entry that the code does not bear out, and for each finding that has no entry.

    Where the version of the checker is not the record's: for each rule without a reason.
    """
    lines = []
    counted = found.keys() | record.places.keys() if version == record.checker else ()
    for rule, file in sorted(counted, key=lambda key: (_order(key[0]), key[1])):
        have, allowed = found[rule, file], record.places[rule, file]
        if have > allowed:
            lines.append(
                f"{file}: rule {rule} is violated in {have} places, {allowed} of them recorded; mend them, or record them (--write)"
            )
        elif have < allowed:
            lines.append(f"{file}: rule {rule} is violated in {have} places, {allowed} are recorded; bring the record up to date (--write)")
    rules = sorted({rule for rule, _ in found} | record.reasons.keys(), key=_order)
    return lines + [f"rule {rule} has no reason in the record" for rule in rules if not record.reasons.get(rule, "").strip()]


def _order(rule: str) -> tuple[list[int], str]:
    """By the numbers of a rule; names behind them."""
    parts = rule.split(".")
    return ([int(part) for part in parts], "") if all(part.isdigit() for part in parts) else ([1000], rule)


def record_text(found: Places, version: str, reasons: dict[str, str]) -> str:
    """The record as TOML: these numbers, with the reasons that are known; empty ones for other rules."""
    parts = [HEAD.format(checker=json.dumps(version))]
    for rule in sorted({rule for rule, _ in found}, key=_order):
        files = {file: number for (name, file), number in sorted(found.items()) if name == rule}
        lines = [f'[rule."{rule}"]', f"reason = {json.dumps(reasons.get(rule, ''), ensure_ascii=False)}"]
        lines += [f'[rule."{rule}".places]', *(f'"{file}" = {number}' for file, number in files.items())]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the numbers of now to misra.toml, with the reasons that it has")
    args = parser.parse_args()
    version = checker()
    if not version:
        print("misra_check: not installed: cppcheck with its addon misra (sudo apt-get install cppcheck)", file=sys.stderr)
        return 2
    try:
        record = read_record(RECORD) if RECORD.exists() else Record(version, {}, Counter())
        found = all_findings()
        if args.write:
            RECORD.write_text(record_text(found, version, record.reasons), encoding="utf-8")
            record = read_record(RECORD)
    except CalibrationError as error:
        print(f"misra_check: {error}", file=sys.stderr)
        return error.exit_code
    if version != record.checker:
        print(f"misra_check: this is {version}, the record is that of {record.checker}: places are not compared", file=sys.stderr)
    lines = differences(found, record, version)
    for line in lines:
        print(line)
    places, rules = found.total(), len({rule for rule, _ in found})
    print(f"{version}: {places} deviations from {rules} rules, {record.places.total()} of them recorded")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
