"""``explain`` on every real recording beside the checkout: verdict, names, held-out closure before and after, and what is said wrongly.

    python benchmarks/real_recordings.py [xsens mikov mimu injected euroc] [--out FILE]

The accelerometers of mikov and mimu are calibrated from each recording's own stills.  injected is xsens with effects added to its readings;
its truth.json is opened after all have been explained, to count wrong names.  docs/real-recordings.md says where the recordings are from.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from common import in_parallel, markdown

from session.accelerometer.from_stills import from_stills
from session.common.errors import CalibrationError
from session.log.folder import Session, read_session
from session.public import euroc_folders, mimu

SHARED = Path(__file__).resolve().parents[2] / "shared"
SETS = ("xsens", "mikov", "mimu", "injected", "euroc")
USUAL = SETS[:-1]
UNCALIBRATED = ("mikov", "mimu")
#: the recording that the effects were injected into has it by itself
OWN = "gyro.g_sensitivity"
#: faults of a log that are not expected in these sets: every frame of mimu has a right checksum and none is missing
NO_FAULTS = ("data.glitches", "timing.dropped_samples")
HEADER = ("recording", "verdict", "names", "before → after, °", "floor, °", "said wrongly", "s")


@dataclass(frozen=True)
class Job:
    set_name: str
    folder: Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", metavar="SET", help=f"of {', '.join(SETS)} (all but euroc)")
    parser.add_argument("--shared", type=Path, default=SHARED, help="folder of the recordings (../shared)")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only recordings of these names, such as e1u0")
    parser.add_argument("--out", type=Path, help="JSON with all results")
    args = parser.parse_args()
    if wrong := set(args.sets) - set(SETS):
        parser.error(f"no set {', '.join(sorted(wrong))}; expected {', '.join(SETS)}")
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        jobs = [job for name in args.sets or USUAL for job in jobs_of(name, args.shared, Path(made))]
        jobs = [job for job in jobs if not args.only or job.folder.name in args.only]
        if not jobs:
            parser.exit(2, f"no recordings in {args.shared}\n")
        results = in_parallel(one_recording, jobs, "recording")
    path = args.shared / "injected" / "truth.json"
    truth = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for result in results:
        result |= {"said_wrongly": said_wrongly(result, truth), "missed": missed(result, truth)}
    if args.out:
        args.out.write_text(json.dumps({"recordings": results}, indent=1) + "\n", encoding="utf-8")
    print(markdown(HEADER, map(row, results)))
    print("\n" + "\n".join(summary(results)))
    print(f"- {len(results)} recordings in {time.perf_counter() - began:.0f} s.")


def jobs_of(name: str, shared: Path, made: Path) -> Iterator[Job]:
    """The recordings of a set, session folders made of what is none; nothing where the set is not there."""
    source = shared / name
    if not source.is_dir():
        return
    folders = sorted(path.parent for path in source.glob("**/session.toml"))
    if not folders:
        folders = {"mimu": mimu.write, "euroc": euroc_folders.write}[name](source, made / name)
    yield from (Job(name, folder) for folder in folders)


def calibrated(session: Session) -> Session:
    """The same session with the accelerometer that its own stills give."""
    config = session.config
    found = from_stills([log.samples for log in session.logs], config.site.expected_gravity_mps2, config.protocol.still_s)
    return replace(session, config=replace(config, accelerometer=found))


def one_recording(job: Job) -> dict:
    """``set``, ``name``, ``seconds``, and ``explain``'s JSON or why it was ``refused``."""
    from tinygc.explanation.verdict.explain import explain_session
    from tinygc.explanation.verdict.result import to_json

    began = time.perf_counter()
    result: dict = {"set": job.set_name, "name": job.folder.name, "explain": None, "refused": None}
    try:
        session = read_session(job.folder)
        result["explain"] = to_json(explain_session(calibrated(session) if job.set_name in UNCALIBRATED else session))
    except CalibrationError as error:
        result["refused"] = str(error)
    return result | {"seconds": time.perf_counter() - began}


def named(result: dict) -> dict[str, dict]:
    """Claimed effects by id; what is only called unknown is no name."""
    effects = result["explain"]["effects"] if result["explain"] else []
    return {effect["id"]: effect for effect in effects if not effect["id"].startswith("unknown.")}


def said_wrongly(result: dict, truth: dict) -> list[str]:
    """Wrong names by the truth of what was injected; of uncalibrated sets, faults that are not expected; nothing where nobody knows."""
    found = named(result)
    if result["set"] in UNCALIBRATED:
        return [name for name in found if name in NO_FAULTS]
    if result["set"] != "injected" or result["name"] not in truth:
        return []
    true = {OWN, *truth[result["name"]]["effects"]}
    return [name for name, effect in found.items() if name not in true and not true & set(effect["equivalent"])]


def missed(result: dict, truth: dict) -> list[str]:
    """What was injected and has a name, and is neither claimed nor among what cannot be told from a claim."""
    if result["set"] != "injected":
        return []
    said = {name for effect in named(result).values() for name in (effect["id"], *effect["equivalent"])}
    return [name for name in truth.get(result["name"], {"effects": {}})["effects"] if name not in said and not name.startswith("outside.")]


def row(result: dict) -> tuple[str, ...]:
    title = result["set"] if result["name"] == result["set"] else f"{result['set']}/{result['name']}"
    if not result["explain"]:
        return (title, f"refused: {result['refused']}", "", "", "", "", f"{result['seconds']:.0f}")
    closure = result["explain"]["fit"]["holdout_closure_rms_deg"]
    claims = [effect["id"] + "".join(f" = {name}" for name in effect["equivalent"]) for effect in result["explain"]["effects"]]
    return (
        title,
        result["explain"]["verdict"].replace("_", " "),
        ", ".join(claims) or "–",
        f"{closure['before']:.3f} → {closure['after']:.3f}",
        f"{closure['floor']:.3f}",
        ", ".join(result["said_wrongly"]) or "–",
        f"{result['seconds']:.0f}",
    )


def summary(results: list[dict]) -> list[str]:
    """A line for each set and each thing that can be counted."""
    lines = []
    for name in dict.fromkeys(result["set"] for result in results):
        of_set = [result for result in results if result["set"] == name]
        whole = [result for result in of_set if result["explain"]]
        closures = [result["explain"]["fit"]["holdout_closure_rms_deg"] for result in whole]
        no_worse = sum(closure["after"] <= closure["before"] for closure in closures)
        said = f"- {name}: {len(of_set)} recordings, {len(of_set) - len(whole)} refused; after ≤ before in {no_worse} of {len(whole)}"
        count = sum(len(result["said_wrongly"]) for result in whole)
        if name == "injected":
            said += f"; wrong names: {count}; injected and not named: {sum(len(result['missed']) for result in whole)}"
        elif name in UNCALIBRATED:
            said += f"; glitches or dropped samples claimed: {count}"
        lines.append(said + ".")
    return lines


if __name__ == "__main__":
    main()
