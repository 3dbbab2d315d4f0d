#!/usr/bin/env python3
"""Calibrate a MEMS gyroscope on a hand-turned table: the command line.

Parses arguments, calls one function per command, prints.  Heavy imports are inside the commands, so that --help is instant.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from session.errors import CalibrationError

METHODS = "raw,raw_bias_removed,least_squares,pso,tinygc"  # as in tinygc.methods, which imports too much for --help


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit code (FORMATS, exit codes)."""
    args = _parser().parse_args(arguments)
    try:
        code = args.run(args)
        sys.stdout.flush()
        return code
    except CalibrationError as error:
        print(f"calibrate: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("calibrate: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Whoever read our output has gone; nothing is left to say to them.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        print(f"calibrate: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        return 2


def check(args: argparse.Namespace) -> int:
    """The first look at a session."""
    from session.check import check_folder, worst
    from tinygc.console import output
    from tinygc.report import findings_table

    findings = check_folder(args.folder)
    output(args.quiet).print(findings_table(findings))
    _write_json(args.json, {"schema": "tinygc-check/1", "findings": [vars(finding) for finding in findings]})
    if worst(findings) == "error":
        return 2
    return 1 if args.strict and worst(findings) == "warning" else 0


def fit(args: argparse.Namespace) -> int:
    """From a session to models and closure figures."""
    from tinygc.console import output, progress_bar
    from tinygc.fit import fit_session, holdout_above, save_models, to_json
    from tinygc.methods import FitOptions
    from tinygc.report import fit_report

    options = FitOptions(
        methods=tuple(args.methods),
        folds=args.folds,
        seed=args.seed,
        still_rates=args.still_rates,
        integrator=args.integrator,
        optimizer=args.optimizer,
        epochs=args.epochs,
        earth=not args.no_earth,
        exclude=tuple(args.exclude),
        physics=None if args.physics is None else tuple(name.strip() for name in args.physics.split(",")),
    )
    with progress_bar(args.quiet) as progress:
        result = fit_session(args.folder, options, progress)
    output(args.quiet).print(fit_report(result))
    folder = save_models(result, args.out)
    output(args.quiet).print(f"models: {folder}", soft_wrap=True)
    _write_json(args.json, to_json(result))
    return 1 if args.limit is not None and holdout_above(result, args.limit) else 0


def explain(args: argparse.Namespace) -> int:
    """Why recording and simulation differ."""
    from tinygc.console import output, progress_bar
    from tinygc.explain.explain import explain_session
    from tinygc.explain.pages import explanation_page
    from tinygc.explain.result import save, to_json

    with progress_bar(args.quiet) as progress:
        explanation = explain_session(args.folder, seed=args.seed, use_earth=not args.no_earth, progress=progress)
    output(args.quiet).print(explanation_page(explanation))
    folder = save(explanation, args.out, pictures=not args.no_pictures)
    output(args.quiet).print(f"written: {folder}", soft_wrap=True)
    _write_json(args.json, to_json(explanation))
    return 1 if args.strict and explanation.verdict != "no_mismatch" else 0


def plan(args: argparse.Namespace) -> int:
    """What to record next."""
    from tinygc.console import output
    from tinygc.plan import propose

    proposals, asked = propose(args.folder, args.count)
    console = output(args.quiet)
    if asked:
        console.print(f"explain asks: {asked}")
    for number, proposal in enumerate(proposals, start=1):
        console.print(
            f"{number}. {proposal.words}: {proposal.parameter}, {proposal.now:.1f} -> {proposal.after:.1f} times its target sigma"
        )
    if not proposals:
        console.print("every parameter has reached its target sigma (50 ppm, 0.05 mrad, 2 mdps): nothing more is needed")
    _write_json(args.json, {"schema": "tinygc-plan/1", "asked": asked, "proposals": [vars(proposal) for proposal in proposals]})
    return 0


def simulate(args: argparse.Namespace) -> int:
    """A session that the rest of the tool cannot tell from a recorded one."""
    from tinygc.console import output
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.write import write_session

    chosen = {name: value for name, value in vars(args).items() if name in SimulationOptions.__dataclass_fields__ and value is not None}
    folder = write_session(SimulationOptions(**chosen), args.out, force=args.force)
    output(args.quiet).print(f"{folder}: simulated; the truth is in truth.json, which no command reads", soft_wrap=True)
    _write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen})
    return 0


def _write_json(path: Path | None, table: dict) -> None:
    if path is None:
        return
    text = json.dumps(table, indent=1, ensure_ascii=False) + "\n"
    if str(path) == "-":
        sys.stdout.write(text)
        return
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written ({error.strerror}); give --json another path") from None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="calibrate.py", description="Calibrate a MEMS gyroscope on a hand-turned table.")
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    command = _command(commands, "check", check, "a first look at a session: units, scales, rates, gaps, axes, stills")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--strict", action="store_true", help="exit 1 on warnings")

    command = _command(commands, "fit", fit, "fit the calibration, compare the methods, print the closure errors")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--methods", type=_methods, default=METHODS.split(","), metavar="A,B", help=f"among {METHODS} (all)")
    command.add_argument("--folds", type=_count(2), default=5, help="folds of the held-out closure (%(default)s)")
    command.add_argument("--still-rates", action="store_true", help="use the mean rate in each still as data, too")
    command.add_argument("--integrator", choices=("exact", "first-order"), default="exact", help="first-order: the paper's")
    command.add_argument("--optimizer", choices=("second-order", "adamw"), default="second-order", help="of TinyGC-Net; adamw: the paper's")
    command.add_argument("--epochs", type=_count(1), default=2000, help="of adamw (%(default)s)")
    command.add_argument("--physics", metavar="auto|IDS", help="fit what explain names as well (auto), or effects by id, with commas")
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")
    command.add_argument("--exclude", type=_count(0), nargs="*", default=[], metavar="N", help="numbers of segments to leave out")
    command.add_argument("--out", type=Path, metavar="DIR", help="where the models go (fit/ in the session folder)")
    command.add_argument("--limit", type=_positive, metavar="DEG", help="exit 1 if the best held-out tilt is above this")

    command = _command(commands, "explain", explain, "say why the recording differs from the simulation, and prove it")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")
    command.add_argument("--no-pictures", action="store_true", help="write no picture")
    command.add_argument("--out", type=Path, metavar="DIR", help="where the result goes (explain/ in the session folder)")
    command.add_argument("--strict", action="store_true", help="exit 1 if there is a mismatch")

    command = _command(commands, "plan", plan, "say which movements to record next")
    command.add_argument("folder", type=Path, help="session folder")
    command.add_argument("--count", type=_count(1), default=5, help="movements at most (%(default)s)")

    command = _command(commands, "simulate", simulate, "write a simulated session")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    command.add_argument("--force", action="store_true", help="replace an earlier simulation there")
    _add_simulation_options(command)
    return parser


def _command(commands, name: str, run, summary: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
    command.set_defaults(run=run)
    command.add_argument("--json", type=Path, metavar="FILE", help="write the result as JSON (- for standard output)")
    command.add_argument("--seed", type=_count(0), default=0, help="of every random draw (%(default)s)")
    command.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return command


def _add_simulation_options(command: argparse.ArgumentParser) -> None:
    """One flag for each field of ``SimulationOptions``; its comments say what they mean."""
    from tinygc.simulation.options import SimulationOptions, flag

    for name, field in SimulationOptions.__dataclass_fields__.items():
        if name == "seed":
            continue
        help_text = field.metadata["help"].replace("%", "%%") + ("" if field.default in (None, False) else f" ({field.default})")
        if isinstance(field.default, bool):
            command.add_argument(flag(name), dest=name, action="store_true", default=None, help=help_text)
        elif isinstance(field.default, tuple):
            command.add_argument(flag(name), dest=name, type=float, nargs=len(field.default), default=None, help=help_text)
        else:
            kind = int if isinstance(field.default, int) else float
            command.add_argument(flag(name), dest=name, type=kind, default=None, metavar=kind.__name__.upper(), help=help_text)


def _methods(text: str) -> list[str]:
    known, chosen = METHODS.split(","), [name.strip() for name in text.split(",") if name.strip()]
    for name in chosen:
        if name not in known:
            raise argparse.ArgumentTypeError(f"{name!r} is no method; choose among {METHODS}")
    if not chosen:
        raise argparse.ArgumentTypeError(f"name at least one of {METHODS}")
    return list(dict.fromkeys(chosen))


def _count(least: int):
    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{value} is less than {least}")
        return value

    parse.__name__ = "whole number"
    return parse


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no positive number")
    return value


def _version() -> str:
    from tinygc import __version__

    return f"TinyGC {__version__}"


if __name__ == "__main__":
    sys.exit(main())
