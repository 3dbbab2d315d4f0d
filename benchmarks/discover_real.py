"""``explain --discover`` on every real recording beside the checkout: what is said to be an equation, of sensors that nobody knows all of.

    python benchmarks/discover_real.py [xsens mikov mimu injected euroc] [--only e1u0 …] [--seeds 1 2 3 4] [--short] [--json FILE]

A row for each recording.  The sets are those of ``real_recordings.py`` (docs/real-recordings.md says where they are from); one that is not
there is skipped, and the line above the table says so.  injected is xsens with effects added: what was put in is opened after all have been
searched, for the last column.  With ``--seeds`` each recording is searched again with other turns put away; the column says how many of
these searches have the same answer, laws included.  Seconds are CPU seconds of the search alone, on one thread.  Nothing is written beside
a recording.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common import in_parallel, markdown
from real_recordings import SETS, USUAL, add_choice, chosen_jobs
from real_recordings_page import named, shapes, title

from session.io.errors import CalibrationError

HEADER = (
    "recording",
    "explain",
    "names",
    "search",
    "equation, or why none",
    "removed",
    "p",
    "noise p",
    "could else be",
    "s",
    "seeds",
    "put in",
)
#: of docs/discover.md
SHORT = ("recording", "put in", "names", "search", "equation, or why none", "removed", "p", "noise p")
NOTHING = "–"
TRUTH = Path("injected") / "truth.json"


@dataclass(frozen=True)
class Searching:
    """One recording, and the seeds of what is put away; the first one's answer is told in full."""

    set_name: str
    folder: Path
    seeds: tuple[int, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_choice(parser, f"of {', '.join(SETS)} (all but euroc)")
    parser.add_argument("--seeds", type=int, nargs="*", default=[], help="more seeds of what is put away, beside 0")
    parser.add_argument("--short", action="store_true", help="the table as docs/discover.md has it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="all results")
    args = parser.parse_args()
    if wrong := set(args.sets) - set(SETS):
        parser.error(f"no set {', '.join(sorted(wrong))}; expected {', '.join(SETS)}")
    for name in args.sets or USUAL:
        if not (args.shared / name).is_dir():
            print(f"{name} is skipped: there is no {args.shared / name}.\n")
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        jobs = chosen_jobs(parser, args, USUAL, Path(made))
        searches = [Searching(job.set_name, job.folder, (0, *args.seeds)) for job in jobs]
        results = in_parallel(one_recording, searches, "recording")
    path = args.shared / TRUTH
    truth = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for result in results:
        result["put_in"] = sorted(truth[result["name"]]["effects"]) if result["set"] == "injected" and result["name"] in truth else None
    results.sort(key=title)
    if args.json:
        args.json.write_text(json.dumps({"recordings": results}, indent=1) + "\n", encoding="utf-8")
    shown = [HEADER.index(column) for column in (SHORT if args.short else HEADER)]
    print(markdown([HEADER[i] for i in shown], [[cells[i] for i in shown] for cells in map(row, results)]))
    print("\n" + "\n".join(summary(results)))


def one_recording(job: Searching) -> dict[str, Any]:
    """``set``, ``name``, ``explain`` (its JSON) and ``searches``, one of each seed; or why it was ``refused``."""
    from session.io.folder import read_session
    from tinygc.library.explanations import explain

    result: dict[str, Any] = {"set": job.set_name, "name": job.folder.name, "explain": None, "searches": [], "refused": None}
    try:
        session = read_session(job.folder)
        why = explain(session, discover=session.config.protocol.reference == "truth")  # which is refused
    except CalibrationError as error:
        return result | {"refused": str(error)}
    return result | {"explain": why.to_json(), "searches": [searched(why.explanation, seed) for seed in job.seeds]}


def searched(explanation: Any, seed: int) -> dict[str, Any]:
    """``seed``, ``seconds``, ``discovery`` as the JSON of ``explain`` has it, and ``noise_p`` of each law's tests."""
    from tinygc.annexes.discovery.engine import discover
    from tinygc.annexes.discovery.result import to_json

    began = time.process_time()
    found = discover(explanation, seed=seed)
    seconds = time.process_time() - began
    noise_p = [[test.noise_p for test in law.held_out] for law in found.laws]
    return {"seed": seed, "seconds": seconds, "discovery": to_json(found, [None] * len(found.laws)), "noise_p": noise_p}


def row(result: dict) -> tuple[str, ...]:
    """Cells of one recording, or why it is refused; a bar within an equation ends no cell."""
    return tuple(cell.replace("|", "\\|") for cell in _cells(result))


def _cells(result: dict) -> tuple[str, ...]:
    if result["refused"]:
        return (title(result), f"refused: {result['refused']}", *[NOTHING] * (len(HEADER) - 2))
    first = result["searches"][0]
    discovery = first["discovery"]
    laws = discovery["laws"]
    tests = [test for law in laws for test in law["held_out"]]
    others = [f"{each['equation']} (+{each['worse_by']:.1f})" for law in laws for each in law["runners_up"]]
    return (
        title(result),
        result["explain"]["verdict"],
        ", ".join([*named(result), *shapes(result)]) or NOTHING,
        discovery["verdict"],
        "; ".join(law["equation"] for law in laws) or discovery["why"],
        ", ".join(NOTHING if test["removed"] is None else f"{100 * test['removed']:.1f} %" for test in tests) or NOTHING,
        ", ".join(f"{test['p_value']:.1g}" for test in tests) or NOTHING,
        ", ".join(f"{p:.1g}" for each in first["noise_p"] for p in each) or NOTHING,
        "; ".join(others) or NOTHING,
        f"{first['seconds']:.0f}",
        _agreeing(result["searches"]),
        NOTHING if result["put_in"] is None else ", ".join(result["put_in"]) or "nothing",
    )


def _agreeing(searches: list[dict]) -> str:
    """``3 of 4`` searches with other seeds have the same answer as the first."""
    own, *others = (answer(each) for each in searches)
    return f"{sum(other == own for other in others)} of {len(others)}" if others else NOTHING


def answer(search: dict) -> tuple:
    """Verdict, and the laws without their constants, which any other part of a recording gives a little otherwise."""
    discovery = search["discovery"]
    return discovery["verdict"], tuple(sorted(law["id"] for law in discovery["laws"]))


def summary(results: list[dict]) -> list[str]:
    """A line for each thing that can be counted."""
    whole = [each for each in results if not each["refused"]]
    count = {verdict: sum(answer(each["searches"][0])[0] == verdict for each in whole) for verdict in ("found", "ambiguous", "none")}
    lines = [f"- Of {len(whole)} recordings, {count['found']} have an equation, {count['ambiguous']} several, {count['none']} none."]
    if refused := len(results) - len(whole):
        lines.append(f"- {refused} more are refused.")
    known = [each for each in whole if each["put_in"] is not None]
    inside = [each for each in known if not any(name.startswith("outside.") for name in each["put_in"])]
    if inside:
        said = [each["name"] for each in inside if answer(each["searches"][0])[0] != "none"]
        put = "only names of the catalogue were put, or nothing"
        lines.append(f"- Of the {len(inside)} into which {put}, these have an equation: {', '.join(said) or 'none'}.")
    return lines


if __name__ == "__main__":
    main()
