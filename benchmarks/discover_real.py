"""``explain --discover`` on every real recording beside the checkout: what is said to be an equation, of sensors that nobody knows all of.

    python benchmarks/discover_real.py [xsens mikov mimu injected euroc] [--only e1u0 …] [--json FILE]

A row for each recording.  The sets are those of ``real_recordings.py`` (docs/real-recordings.md says where they are from); one that is not
there is skipped, and the line above the table says so.  injected is xsens with effects added: what was put in is opened after all have been
searched, for the second column.  Nothing is written beside a recording.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from common import in_parallel, markdown
from real_recordings import SETS, USUAL, Job, add_choice, chosen_jobs
from real_recordings_page import named, shapes, title

from session.base.errors import CalibrationError

HEADER = ("recording", "put in", "names", "search", "equation, or why none", "removed", "p", "noise p")
NOTHING = "–"
TRUTH = Path("injected") / "truth.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_choice(parser, f"of {', '.join(SETS)} (all but euroc)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="all results")
    args = parser.parse_args()
    if wrong := set(args.sets) - set(SETS):
        parser.error(f"no set {', '.join(sorted(wrong))}; expected {', '.join(SETS)}")
    for name in args.sets or USUAL:
        if not (args.shared / name).is_dir():
            print(f"{name} is skipped: there is no {args.shared / name}.\n")
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        results = in_parallel(one_recording, chosen_jobs(parser, args, USUAL, Path(made)), "recording")
    path = args.shared / TRUTH
    truth = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for result in results:
        result["put_in"] = sorted(truth[result["name"]]["effects"]) if result["set"] == "injected" and result["name"] in truth else None
    results.sort(key=title)
    if args.json:
        args.json.write_text(json.dumps({"recordings": results}, indent=1) + "\n", encoding="utf-8")
    print(markdown(HEADER, map(row, results)))
    print("\n" + "\n".join(summary(results)))


def one_recording(job: Job) -> dict[str, Any]:
    """``set``, ``name``, ``explain`` (its JSON), ``discovery`` as that has it, and ``noise_p`` of each law's tests; or why it was
    ``refused``."""
    from session.log.folder import read_session
    from tinygc.features.discovery.engine import discover
    from tinygc.features.discovery.result import to_json
    from tinygc.library.explanations import explain

    result: dict[str, Any] = {"set": job.set_name, "name": job.folder.name, "refused": None}
    try:
        session = read_session(job.folder)
        why = explain(session, discover=session.config.protocol.reference == "truth")  # which is refused
    except CalibrationError as error:
        return result | {"refused": str(error)}
    found = discover(why.explanation)
    noise_p = [test.noise_p for law in found.laws for test in law.held_out]
    return result | {"explain": why.to_json(), "discovery": to_json(found, [None] * len(found.laws)), "noise_p": noise_p}


def row(result: dict) -> tuple[str, ...]:
    """Cells of one recording, or why it is refused; a bar within an equation ends no cell."""
    return tuple(cell.replace("|", "\\|") for cell in _cells(result))


def _cells(result: dict) -> tuple[str, ...]:
    put_in = NOTHING if result["put_in"] is None else ", ".join(result["put_in"]) or "nothing"
    if result["refused"]:
        return (title(result), put_in, f"refused: {result['refused']}", *[NOTHING] * (len(HEADER) - 3))
    discovery = result["discovery"]
    tests = [test for law in discovery["laws"] for test in law["held_out"]]
    return (
        title(result),
        put_in,
        ", ".join([*named(result), *shapes(result)]) or NOTHING,
        discovery["verdict"],
        "; ".join(law["equation"] for law in discovery["laws"]) or discovery["why"],
        ", ".join(NOTHING if test["removed"] is None else f"{100 * test['removed']:.1f} %" for test in tests) or NOTHING,
        ", ".join(f"{test['p_value']:.1g}" for test in tests) or NOTHING,
        ", ".join(f"{p:.1g}" for p in result["noise_p"]) or NOTHING,
    )


def summary(results: list[dict]) -> list[str]:
    """A line for each thing that can be counted."""
    whole = [each for each in results if not each["refused"]]
    count = {verdict: sum(each["discovery"]["verdict"] == verdict for each in whole) for verdict in ("found", "ambiguous", "none")}
    lines = [f"- Of {len(whole)} recordings, {count['found']} have an equation, {count['ambiguous']} several, {count['none']} none."]
    if refused := len(results) - len(whole):
        lines.append(f"- {refused} more are refused.")
    known = [each for each in whole if each["put_in"] is not None]
    inside = [each for each in known if not any(name.startswith("outside.") for name in each["put_in"])]
    if inside:
        said = [each["name"] for each in inside if each["discovery"]["verdict"] != "none"]
        put = "only names of the catalogue were put, or nothing"
        lines.append(f"- Of the {len(inside)} into which {put}, these have an equation: {', '.join(said) or 'none'}.")
    return lines


if __name__ == "__main__":
    main()
