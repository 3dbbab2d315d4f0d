#!/usr/bin/env python3
"""Calibrate a MEMS gyroscope on a hand-turned table: the command line.

Parses arguments, calls one function per command, prints.  Heavy imports are inside the commands, so that --help is instant.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
from pathlib import Path

from session.errors import CalibrationError, printable
from tinygc.arguments import parser


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit code (FORMATS, exit codes)."""
    _make_streams_safe()
    try:
        args = parser(COMMANDS).parse_args(arguments)
        code = args.run(args)
        with _standard_output():
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
        _silence(sys.stdout)
        return 0
    except OSError as error:
        try:
            sys.stdout.flush()
        except OSError:
            _silence(sys.stdout)
        print(f"calibrate: {printable(f'{error.filename}: ' if error.filename else '')}{error.strerror or error}", file=sys.stderr)
        return 2


def _make_streams_safe() -> None:
    """Whoever started us may have closed a stream, or may read it in an encoding without our signs: neither is worth a traceback."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _silence(stream) -> None:
    """Let what is still in the stream's buffer go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@contextlib.contextmanager
def _standard_output():
    """Give a failure to write its name, which a stream's errors lack."""
    try:
        yield
    except OSError as error:
        error.filename = "standard output"
        raise


def check(args: argparse.Namespace) -> int:
    """The first look at a session."""
    from session.check import check_folder, worst
    from tinygc.report import findings_table

    findings = check_folder(args.folder)
    _output(args).print(findings_table(findings))
    _write_json(args.json, {"schema": "tinygc-check/1", "findings": [vars(finding) for finding in findings]})
    if worst(findings) == "error":
        return 2
    return 1 if args.strict and worst(findings) == "warning" else 0


def fit(args: argparse.Namespace) -> int:
    """From a session to models and closure figures."""
    from tinygc.console import progress_bar
    from tinygc.fit import fit_session, save_models, to_json
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
        exclude=tuple(dict.fromkeys(args.exclude)),
        physics=None if args.physics is None else tuple(name.strip() for name in args.physics.split(",")),
    )
    _try_destinations(args, "fit")
    with progress_bar(args.quiet) as progress:
        result = fit_session(args.folder, options, progress)
    table = to_json(result)
    # The results first: a terminal that fails must not cost them.
    folder = save_models(result, args.out)
    _output(args).print(fit_report(result))
    _output(args).print(f"models: {folder}", soft_wrap=True)
    _write_json(args.json, table)
    above = [] if args.limit is None else _above(table, args.limit)
    if above:
        print(f"calibrate: above --limit {args.limit:g} deg: {'; '.join(above)}", file=sys.stderr)
    return 1 if above else 0


def _above(table: dict, limit_deg: float) -> list[str]:
    """The figures of a fit that ``--limit`` refuses: the best held-out tilt, and each closure run's best RMSE."""
    tilts = {name: method["holdout"]["tilt_rms_deg"] for name, method in table["methods"].items()}
    figures = [("the best held-out tilt", tilts)]
    for run in table["closure_runs"]:
        figures.append((f"{run['file']}'s best RMSE", {name: run[name]["rmse_deg"] for name in tilts if name in run}))
    said = []
    for what, by_method in figures:
        best = min(by_method, key=by_method.get)
        if not by_method[best] <= limit_deg:
            said.append(f"{what} is {by_method[best]:.4g} deg ({best})")
    return said


def explain(args: argparse.Namespace) -> int:
    """Why recording and simulation differ."""
    from tinygc.console import progress_bar
    from tinygc.explain.explain import explain_session
    from tinygc.explain.pages import explanation_page
    from tinygc.explain.result import save, to_json

    _try_destinations(args, "explain")
    with progress_bar(args.quiet) as progress:
        explanation = explain_session(args.folder, seed=args.seed, use_earth=not args.no_earth, progress=progress)
    folder = save(explanation, args.out, pictures=not args.no_pictures)
    _output(args).print(explanation_page(explanation))
    _output(args).print(f"written: {folder}", soft_wrap=True)
    _write_json(args.json, to_json(explanation))
    return 1 if args.strict and explanation.verdict != "no_mismatch" else 0


def plan(args: argparse.Namespace) -> int:
    """What to record next."""
    from tinygc.plan import propose

    proposals, asked = propose(args.folder, args.count)
    console = _output(args)
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
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.write import write_session

    chosen = {name: value for name, value in vars(args).items() if name in SimulationOptions.__dataclass_fields__ and value is not None}
    folder = write_session(SimulationOptions(**chosen), args.out, force=args.force)
    _output(args).print(f"{folder}: simulated; the truth is in truth.json, which no command reads", soft_wrap=True)
    _write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen})
    return 0


def challenge(args: argparse.Namespace) -> int:
    """The tool's own blind examination."""
    import tempfile

    from tinygc.challenge.examine import examine, to_json, without_sessions
    from tinygc.challenge.table import challenge_tables
    from tinygc.console import progress_bar

    folder = args.out or Path(tempfile.mkdtemp(prefix="tinygc-challenge-"))
    with progress_bar(args.quiet) as progress:
        announce = lambda text: _output(args).print(text, soft_wrap=True)  # noqa: E731
        result = examine(folder, args.cases, args.seed, announce=announce, progress=progress)
    _output(args).print(challenge_tables(result))
    if not args.keep:
        without_sessions(folder, everything=args.out is None)
    if args.keep or args.out:
        _output(args).print(f"written: {folder}", soft_wrap=True)
    _write_json(args.json, to_json(result))
    return 0


def _output(args: argparse.Namespace):
    """Standard output for people; silent when quiet, and where the JSON has standard output to itself."""
    from tinygc.console import output

    return output(args.quiet or str(args.json) == "-")


def _try_destinations(args: argparse.Namespace, default: str) -> None:
    """Refuse before the work, not after it, what cannot be written: make the folder, write there, and take both away again."""
    import tempfile

    if args.out is None and not args.folder.is_dir():
        return  # the reading of the session has more to say
    folder = args.out or args.folder / default
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        if args.json is not None and str(args.json) != "-":
            _try_json(args.json)
    except OSError as error:
        raise CalibrationError(f"{error.filename or folder}: {error.strerror or error}; give --out another folder") from None
    finally:
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()


def _try_json(path: Path) -> None:
    new = not path.exists()
    if new or path.is_file() or path.is_dir():  # a pipe or device is not opened twice
        try:
            path.open("a").close()
        except OSError as error:
            raise _no_json(path, error) from None
    if new:
        path.unlink()


def _no_json(path: Path, error: OSError) -> CalibrationError:
    return CalibrationError(f"{path}: cannot be written ({error.strerror}); give --json another path")


def _write_json(path: Path | None, table: dict) -> None:
    if path is None:
        return
    if str(path) == "-":
        whole = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
        with _standard_output():
            sys.stdout.write(json.dumps(table, indent=1, ensure_ascii=not whole) + "\n")
        return
    try:
        path.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise _no_json(path, error) from None


COMMANDS = {command.__name__: command for command in (check, fit, explain, plan, challenge, simulate)}


if __name__ == "__main__":
    sys.exit(main())
