"""``explain`` on every real recording beside the checkout; prints what docs/real-recordings.md has below its mark ``<!-- table -->``.

    python benchmarks/real_recordings.py [xsens mikov mimu injected euroc] [--out FILE]

The accelerometers of mikov and mimu are calibrated from each recording's own stills.  injected is xsens with effects added to its readings;
its truth.json is opened after all have been explained, to count wrong names.  euroc is compared with its truth files.
docs/real-recordings.md says where the recordings are from.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from common import in_parallel
from public import euroc, mimu
from real_recordings_page import missed, page, said_wrongly

from session.base.errors import CalibrationError
from session.log.folder import read_session

SHARED = Path(__file__).resolve().parents[2] / "shared"
SETS = ("xsens", "mikov", "mimu", "injected", "euroc")
USUAL = SETS[:-1]


@dataclass(frozen=True)
class Job:
    set_name: str
    folder: Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_choice(parser, f"of {', '.join(SETS)} (all but euroc)")
    parser.add_argument("--out", type=Path, help="JSON with all results")
    args = parser.parse_args()
    if wrong := set(args.sets) - set(SETS):
        parser.error(f"no set {', '.join(sorted(wrong))}; expected {', '.join(SETS)}")
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        results = in_parallel(one_recording, chosen_jobs(parser, args, USUAL, Path(made)), "recording")
    path = args.shared / "injected" / "truth.json"
    truth = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for result in results:
        result |= {"said_wrongly": said_wrongly(result, truth), "missed": missed(result, truth)}
    if args.out:
        args.out.write_text(json.dumps({"recordings": results}, indent=1) + "\n", encoding="utf-8")
    print(page(results, truth))
    print(f"{len(results)} recordings in {time.perf_counter() - began:.0f} s", file=sys.stderr)


def add_choice(parser: argparse.ArgumentParser, sets: str) -> None:
    """Which recordings; sets: which there are."""
    parser.add_argument("sets", nargs="*", metavar="SET", default=[], help=sets)
    parser.add_argument("--shared", type=Path, default=SHARED, help="folder of the recordings (../shared)")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only recordings of these names, such as e1u0")


def chosen_jobs(parser: argparse.ArgumentParser, args: argparse.Namespace, usual: Sequence[str], made: Path) -> list[Job]:
    """Those that ``add_choice`` asked for; the program ends where there is none."""
    jobs = [job for name in args.sets or usual for job in jobs_of(name, args.shared, made)]
    jobs = [job for job in jobs if not args.only or job.folder.name in args.only]
    if not jobs:
        parser.exit(2, f"no recordings in {args.shared}\n")
    return jobs


def jobs_of(name: str, shared: Path, made: Path) -> Iterator[Job]:
    """The recordings of a set, session folders made of what is none; nothing where the set is not there."""
    source = shared / name
    if not source.is_dir():
        return
    folders = sorted(path.parent for path in source.glob("**/session.toml"))
    if not folders:
        folders = {"mimu": mimu.write, "euroc": euroc.write}[name](source, made / name)
    yield from (Job(name, folder) for folder in folders)


def one_recording(job: Job) -> dict:
    """``set``, ``name``, ``seconds``, and ``explain``'s JSON or why it was ``refused``."""
    from tinygc.library.explanations import explain

    began = time.perf_counter()
    result: dict = {"set": job.set_name, "name": job.folder.name, "explain": None, "refused": None}
    try:
        session = read_session(job.folder)
        result["explain"] = explain(session).to_json()
    except CalibrationError as error:
        result["refused"] = str(error)
    return result | {"seconds": time.perf_counter() - began}


if __name__ == "__main__":
    main()
