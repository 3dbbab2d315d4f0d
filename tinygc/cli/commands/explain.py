"""``explain``: why recording and simulation differ."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tinygc.cli.commands._results import output, try_destinations, write_json

SUMMARY = "say why the recording differs from the simulation, and prove it"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")
    command.add_argument("--no-pictures", action="store_true", help="write no picture")
    command.add_argument("--out", type=Path, metavar="DIR", help="where the result goes (explain/ in the session folder)")
    command.add_argument("--strict", action="store_true", help="exit 1 if there is a mismatch")


def run(args: argparse.Namespace) -> int:
    """Why recording and simulation differ."""
    if _has_truth(args.folder):
        return _against_truth(args)
    from tinygc.cli.console import progress_bar
    from tinygc.explain.verdict.explain import explain_session
    from tinygc.explain.verdict.pages import explanation_page
    from tinygc.explain.verdict.result import save, to_json

    try_destinations(args, "explain")
    with progress_bar(args.quiet) as progress:
        explanation = explain_session(args.folder, seed=args.seed, use_earth=not args.no_earth, progress=progress)
    folder = save(explanation, args.out, pictures=_with_pictures(args))
    output(args).print(explanation_page(explanation))
    output(args).print(f"written: {folder}", soft_wrap=True)
    write_json(args.json, to_json(explanation))
    return 1 if args.strict and explanation.verdict != "no_mismatch" else 0


def _with_pictures(args: argparse.Namespace) -> bool:
    """Whether they are wanted and can be drawn; says so where they cannot."""
    from tinygc.explain.pictures.canvas import can_draw

    if not args.no_pictures and not can_draw():
        print("calibrate: no picture: that needs matplotlib (python -m pip install 'tinygc[plot]')", file=sys.stderr)
        return False
    return not args.no_pictures


def _has_truth(folder: Path) -> bool:
    """Whether the session's reference is a truth file; what cannot be read is said later."""
    from session.common.errors import CalibrationError
    from session.log.config import read_config

    try:
        return read_config(folder / "session.toml").protocol.reference == "truth"
    except CalibrationError:
        return False


def _against_truth(args: argparse.Namespace) -> int:
    """What is wrong with the sensor, what with the truth, what with their clocks."""
    from tinygc.cli.console import progress_bar
    from tinygc.explain.truth.explain import explain_truth
    from tinygc.explain.truth.result import save_truth, truth_page, truth_to_json

    try_destinations(args, "explain")
    with progress_bar(args.quiet) as progress:
        explanation = explain_truth(args.folder, seed=args.seed, use_earth=not args.no_earth, progress=progress)
    folder = save_truth(explanation, args.out, pictures=_with_pictures(args))
    output(args).print(truth_page(explanation))
    output(args).print(f"written: {folder}", soft_wrap=True)
    write_json(args.json, truth_to_json(explanation))
    return 1 if args.strict and explanation.verdict != "no_mismatch" else 0
