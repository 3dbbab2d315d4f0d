"""What ``check``, ``fit``, ``explain`` and ``report`` say of every real recording beside the checkout, and whether they agree.

    python benchmarks/verdicts_of_recordings.py [xsens mikov …] [--only e1u0 …] [--processes 2] [--json OUT]

Sets are those of ``SETS``; recordings of several units are tried unit by unit and as arrays.  ``fit`` and ``report`` fit raw rates and
least squares.  Prints a row a recording: verdicts with exit codes, held-out closure of ``fit`` and of ``explain`` side by side, and what
does not agree.
"""

from __future__ import annotations

import argparse
import io
import json
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
from check_and_fit import sessions_of, write_sundevil
from common import in_parallel, markdown
from public import broad, euroc, mikov, mimu, repoimu
from real_recordings import SHARED

from tinygc.estimation.choice import SAME

ROOT = Path(__file__).resolve().parents[1]
HEADER = (
    "recording",
    "check",
    "fit",
    "explain",
    "report",
    "held out, fit",
    "explain before",
    "after",
    "floor",
    "p",
    "what does not agree",
)


# The recordings, as session folders.


def sundevil_doubled(shared: Path, made: Path) -> Iterator[Path]:
    """The rocket's board with ±500 dps in place of its authors' ±250: their rates are half of the truth."""
    for path in sorted((shared / "wild" / "sundevil").glob("rev2/IMU*.txt")):
        yield write_sundevil(path, made / path.stem, factor=2.0)


def of_set(name: str) -> Callable[[Path, Path], Iterator[Path]]:
    """Sessions that ``check_and_fit.py`` makes as well."""
    return lambda shared, made: (job.folder for job in sessions_of(name, shared, made))


SETS: dict[str, Callable[[Path, Path], Iterator[Path]]] = {
    "xsens": of_set("xsens"),
    "mikov": of_set("mikov"),
    "mimu": of_set("mimu"),
    "wild/mimu": of_set("wild/mimu"),
    "wild/sundevil": of_set("wild/sundevil"),
    "wild/sundevil doubled": sundevil_doubled,
    "wild/broad": lambda shared, made: broad.write(shared / "wild" / "broad", made),
    "wild/repoimu": lambda shared, made: repoimu.write(shared / "wild" / "repoimu", made),
    "euroc windows": lambda shared, made: iter([euroc.write_training_windows(shared / "euroc", made / "training")]),
    "euroc": of_set("euroc"),
    "mikov array": lambda shared, made: mikov.write_array(shared / "mikov", made),
    "mimu array": lambda shared, made: mimu.write_array(shared / "mimu", made),
    "wild/mimu array": lambda shared, made: mimu.write_array(shared / "wild" / "mimu", made),
}


# What each command says.


def said(command: str, *arguments: str) -> tuple[int, dict, str]:
    """Exit code, JSON and first line of a command, run in this process; a traceback is exit code −1."""
    import calibrate

    with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
        table, out, err = Path(folder) / "said.json", io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            try:
                code = calibrate.main([command, *arguments, "--quiet", "--json", str(table)])
            except SystemExit as end:
                code = int(end.code or 0)
            except Exception as error:  # a traceback is a finding of its own
                return -1, {}, f"{type(error).__name__}: {error}"
        words = next((line for line in (err.getvalue() + out.getvalue()).splitlines() if line.strip()), "")
        return code, json.loads(table.read_text(encoding="utf-8")) if table.exists() else {}, words


def one_recording(job: tuple[str, str, str, bool]) -> dict:
    """Exit codes, verdicts and figures of a session's or an array's folder."""
    label, folder, out, array = job
    began, result, quick = time.perf_counter(), {"recording": label, "array": array}, ["--methods", "raw,least_squares"]
    code, table, words = said("check", folder)
    levels = Counter(finding["level"] for finding in table.get("findings", []))
    errors = [finding for finding in table.get("findings", []) if finding["level"] == "error"]
    result["check"] = (code, "error" if errors else "warning" if levels["warning"] else "pass")
    result["said"] = {"check": errors[0]["what"] + ": " + errors[0]["description"] if errors else ""}
    for command, more in (("fit", [] if array else quick), ("explain", ["--no-pictures"]), ("report", quick)):
        if array and command == "report":  # an array has none
            continue
        place = Path(out) / (command + ".html" if command == "report" else command)
        code, table, words = said(command, folder, "--out", str(place), *more)
        result[command], result["said"][command] = (code, verdict_of(command, code, table)), words
        result |= figures_of(command, table)
    return result | {"seconds": time.perf_counter() - began}


def verdict_of(command: str, code: int, table: dict) -> str:
    """A command's verdict in a word: its own, or what ``fit`` of a version without one says to use."""
    if code not in (0, 1):
        return "refused" if code == 2 else "crashed"
    word = table.get("answer", table.get("verdict"))
    if word is None and command == "fit" and "use" in table:
        word = "use " + (table["use"]["method"] or "none").replace("_", " ")
    if word is None and "split" in table:
        word = "used"
    return str((word.get("answer") if isinstance(word, dict) else word) or "–").replace("_", " ")


def figures_of(command: str, table: dict) -> dict:
    """Held-out closure, floor and p-value that a command states, degrees."""
    if command == "fit" and "methods" in table:
        floor, p = table["noise"]["closure_floor_rms_deg"], table["goodness"]["p_value"]
        return {"held_out": table["methods"]["least_squares"]["holdout"]["tilt_rms_deg"], "floor": floor, "p": p}
    if command == "fit" and "units" in table:
        median = lambda key: float(np.median([unit["closure"][key] for unit in table["units"]]))  # noqa: E731
        return {"held_out": median("alone_rms_deg"), "floor": median("floor_rms_deg"), "p": table["split"]["common_p_value"]}
    if command == "explain" and "fit" in table:
        closure = table["fit"]["holdout_closure_rms_deg"]
        return {"before": closure["before"], "after": closure["after"]}
    if command == "report" and "closure" in table:
        return {"reported": table["closure"]["holdout_tilt_rms_deg"]}
    return {}


def apart(result: dict) -> list[str]:
    """What the commands contradict each other in."""
    found = []
    words = {command: result[command] for command in ("check", "fit", "explain", "report") if command in result}
    refused = [command for command, (code, _) in words.items() if code == 2]
    if refused and len(refused) < len(words):
        found.append(f"{', '.join(refused)} refused")
    found += [f"{command} crashed" for command, (code, _) in words.items() if code not in (0, 1, 2)]
    fit, report = (words.get(command, (2, ""))[1] for command in ("fit", "report"))
    if "refused" not in (fit, report) and report:
        if fit.startswith("use "):
            if report != "pass" and not fit.endswith("none"):
                found.append(f"fit says {fit}, report {report}")
        elif fit != report:
            found.append(f"fit says {fit}, report {report}")
        if words["fit"][0] != words["report"][0]:
            found.append(f"exit codes {words['fit'][0]} and {words['report'][0]}")
    held, before, after = (result.get(key) for key in ("held_out", "before", "after"))
    if held and before and abs(before / held - 1) > SAME:
        found.append("explain's before is not fit's")
    if held and after and after > (1 + SAME) * held:
        found.append("explain's after is worse than fit")
    return found


# The table.


def row_of(result: dict) -> list[str]:
    """One line."""
    cells = []
    for command in HEADER[1:5]:
        code, word = result.get(command, (0, "–"))
        cells.append(f"{word}, {code}" if command in result else word)
    figures = [f"{result[key]:.4f}" if result.get(key) is not None else "" for key in ("held_out", "before", "after", "floor")]
    p = "" if result.get("p") is None else f"{result['p']:.2g}"
    return [result["recording"], *cells, *figures, p, "; ".join(apart(result))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", metavar="SET", help=f"of {', '.join(SETS)} (all)")
    parser.add_argument("--shared", type=Path, default=SHARED, help="folder of the recordings (../shared)")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only recordings of these names, such as e1u0")
    parser.add_argument("--processes", type=int, default=2, help="(%(default)s)")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write every result")
    args = parser.parse_args()
    if wrong := set(args.sets) - set(SETS):
        parser.error(f"no set {', '.join(sorted(wrong))}; expected {', '.join(SETS)}")
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        made, jobs = Path(parent), []
        for name in args.sets or SETS:
            if (args.shared / name.split(" ")[0]).is_dir():
                folders = SETS[name](args.shared, made / name.replace("/", "-"))
                for folder in folders:
                    if not args.only or folder.name in args.only:
                        jobs.append((f"{name} {folder.name}", str(folder), str(made / f"out{len(jobs)}"), "array" in name))
        if not jobs:
            parser.exit(2, f"no recordings in {args.shared}\n")
        results = in_parallel(one_recording, jobs, "recording", args.processes)
    if args.json:
        args.json.write_text(json.dumps(results, indent=1), encoding="utf-8")
    print("Verdict, exit code.  Held-out closure in degrees rms; of an array, the median over its units, fitted.\n")
    print(markdown(HEADER, [row_of(result) for result in results]))
    kinds = Counter(kind for result in results for kind in apart(result))
    print(f"\n{len(results)} recordings; {sum(not apart(result) for result in results)} on which all commands agree.")
    print("".join(f"\n- {times} times: {kind}" for kind, times in kinds.most_common()))
    for result in results:
        refusals = {words: command for command, words in result["said"].items() if result[command][0] not in (0, 1)}
        print("".join(f"\n- {result['recording']}, {command}: {words}" for words, command in refusals.items()), end="")
    print()


if __name__ == "__main__":
    main()
