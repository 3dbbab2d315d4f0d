"""``fit`` on every recording beside the checkout: one row each.

../shared/xsens (a real recording), ../shared/closure and ../shared/concealed, where there are any, or the folders given.  Where a
truth.json lies beside a set of recordings, the last column says what is concealed in each; nothing else reads it.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path

from common import in_parallel, markdown

from session.io.errors import CalibrationError
from session.io.folder import read_session
from session.io.units import DEG
from tinygc.closure.build import build_problem
from tinygc.closure.uncertainty import goodness
from tinygc.estimation.choice import closure_figures
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import FitOptions

SHARED = Path(__file__).resolve().parents[2] / "shared"
METHODS = ("raw", "least_squares", "pso", "tinygc")
HEADER = ("", "stills", "segments", "raw", "least squares", "PSO", "TinyGC-Net", "floor", "ratio", "p-value", "concealed")


@dataclass(frozen=True)
class Job:
    folder: Path
    methods: tuple[str, ...]
    folds: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="*", help="session folders (all of ../shared)")
    parser.add_argument("--pso", action="store_true", help="the swarm, too")
    parser.add_argument("--folds", type=int, default=5, help="of the held-out closure (%(default)s)")
    args = parser.parse_args()
    folders = args.folders or sorted(path.parent for path in SHARED.glob("**/session.toml"))
    if not folders:
        parser.exit(2, f"no recordings in {SHARED}; name session folders\n")
    methods = tuple(method for method in METHODS if method != "pso" or args.pso)
    began = time.perf_counter()
    rows = in_parallel(one_recording, [Job(folder, methods, args.folds) for folder in folders], "recording")
    print(f"Tilt closure of the segments, degrees rms: fitted / held out ({args.folds} folds).  Segments: used of found.")
    print("Ratio: least squares fitted to the noise floor; p-value: of least squares' misfit, were there noise alone.\n")
    kept = [i for i, title in enumerate(HEADER) if title != "PSO" or args.pso]
    print(markdown([HEADER[i] for i in kept], [[row[title] for title in (HEADER[i] for i in kept)] for row in rows]))
    print(f"\n{len(rows)} recordings in {time.perf_counter() - began:.0f} s.")


def one_recording(job: Job) -> dict[str, str]:
    """One row, by title; a recording that cannot be fitted says why."""
    row = dict.fromkeys(HEADER, "")
    row[""] = f"{job.folder.parent.name}/{job.folder.name}"
    row["concealed"] = concealed(job.folder)
    try:
        problem = build_problem(read_session(job.folder))
        fits = {method: run_method(method, problem, FitOptions(folds=job.folds)) for method in job.methods}
    except CalibrationError as error:
        return row | {"stills": f"refused: {error}"}
    linear = fits["least_squares"]
    found = goodness(problem.batch, problem.floor, linear.model, problem.wander)
    floor = problem.floor.tilt_rms / DEG
    tilt = {method: [closure_figures(x)["tilt_rms_deg"] for x in (fit.angles, fit.held_out)] for method, fit in fits.items()}
    titles = dict(zip(METHODS, ("raw", "least squares", "PSO", "TinyGC-Net"), strict=True))
    row |= {titles[method]: f"{fitted:.4f} / {held_out:.4f}" for method, (fitted, held_out) in tilt.items() if method != "raw"}
    row |= {
        "raw": f"{tilt['raw'][0]:.2f}",
        "stills": str(len(problem.stills)),
        "segments": f"{len(problem.used)} of {len(problem.segments)}",
        "floor": f"{floor:.4f}",
        "ratio": f"{tilt['least_squares'][0] / floor:.2f}",
        "p-value": f"{found.p_value:.2g}",
    }
    return row


def concealed(folder: Path) -> str:
    """The effects that a bench's truth.json names for a recording."""
    path = folder.parent / "truth.json"
    if not path.exists():
        return ""
    truth = json.loads(path.read_text(encoding="utf-8")).get(folder.name)
    return "" if truth is None else ", ".join(truth["effects"]) or "nothing"


if __name__ == "__main__":
    main()
