"""``tinygc.fit_array``, and ``fit``, ``explain`` and ``apply`` of an array's folder."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rich.console import Group

from session.annexes.arrays.recording import ArraySession, read_array
from session.io.errors import CalibrationError
from session.io.texts import shell_word
from tinygc.annexes.arrays.explanation import ArrayExplanation, explain_array, explained_to_json, save_array_explanation
from tinygc.annexes.arrays.fit import ArrayFit, array_to_json, fit_array, save_array
from tinygc.annexes.arrays.text import array_explain_page, array_page
from tinygc.cli.arguments import STANDARD
from tinygc.cli.options import answers_of, given
from tinygc.cli.results import Done, beside_log, complain, output, try_destinations, verdict, write_json
from tinygc.library.sessions import as_html, as_text

# ``tinygc.fit_array``: several units on one rigid body, estimated together.

#: told what is being done, and how many steps of how many are done
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, repr=False)
class FittedArray:
    """What ``tinygc.annexes.arrays.command.fit`` gives; ``result`` holds everything that was found, in SI."""

    result: ArrayFit

    def __repr__(self) -> str:
        return repr(self.result)

    @property
    def page(self) -> Group:
        """What the command prints, for rich."""
        return array_page(self.result)

    def summary(self) -> str:
        """The same as plain text."""
        return as_text(self.page)

    def _repr_html_(self) -> str:
        return as_html(self.page)

    def to_json(self) -> dict:
        """``tinygc-array-fit/1`` (docs/formats.md)."""
        return array_to_json(self.result)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write figures, and each unit's model, into a folder (``fit`` in the array's); returns it."""
        return save_array(self.result, None if folder is None else Path(folder))


def fit(
    array: ArraySession | Path | str,
    *,
    bias: str = "auto",
    accelerometer: str = "auto",
    use_earth: bool = True,
    progress: Progress = lambda what, done, of: None,
) -> FittedArray:
    """Fit an array, or an array's folder.  Raises CalibrationError, in one line, for what cannot be read or fitted."""
    read = array if isinstance(array, ArraySession) else read_array(array, lambda name: progress(f"reading {name}", 0, 1))
    told = fit_array(read, bias=bias, accelerometer=accelerometer, use_earth=use_earth, progress=lambda what: progress(what, 0, 1))
    return FittedArray(told)


@dataclass(frozen=True, eq=False, repr=False)
class ExplainedArray:
    """What ``explain`` of an array gives; ``result`` holds everything that was found, in SI."""

    result: ArrayExplanation

    def __repr__(self) -> str:
        return f"<ExplainedArray {self.result.fit.array.name}: {self.result.verdict}>"

    @property
    def page(self) -> Group:
        """What the command prints, for rich."""
        return array_explain_page(self.result)

    def summary(self) -> str:
        """The same as plain text."""
        return as_text(self.page)

    def to_json(self) -> dict:
        """``tinygc-array-explain/1`` (docs/formats.md)."""
        return explained_to_json(self.result)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the result, and each unit's, into a folder (``explain`` in the array's); returns it."""
        return save_array_explanation(self.result, None if folder is None else Path(folder))


def explain(
    array: ArraySession | Path | str, *, seed: int = 0, use_earth: bool = True, progress: Progress = lambda what, done, of: None
) -> ExplainedArray:
    """Explain an array, or an array's folder.  Raises CalibrationError, in one line, for what cannot be read or fitted."""
    read = array if isinstance(array, ArraySession) else read_array(array, lambda name: progress(f"reading {name}", 0, 1))
    return ExplainedArray(explain_array(read, seed=seed, use_earth=use_earth, progress=progress))


# ``fit`` and ``explain`` of an array's folder: several units on one rigid body.

#: of a fit's options, those that an array's heeds
HONOURED = ("bias", "accelerometer", "no_earth")
SAID = ("model", "bias_dps", "physics", "resume", "temperature")


def fit_array_folder(args: argparse.Namespace) -> Done:
    """All units of one folder, estimated together."""
    idle = [*given(args, HONOURED), *(f"--{name.replace('_', '-')}" for name in SAID if getattr(args, name, None))]
    if idle := list(dict.fromkeys(idle)):
        raise CalibrationError(
            f"{', '.join(idle)}: of no use with {args.folder}, an array, whose units are all fitted by least squares together; "
            f"leave {'it' if len(idle) == 1 else 'them'} out, or give one unit a folder of its own"
        )
    from tinygc.cli.console import progress_bar

    if args.bias not in (None, "auto", "ends", "stills"):
        raise CalibrationError(f"--bias {args.bias}: a bias of the day is one unit's; an array takes --bias auto, ends or stills")
    try_destinations(args, "fit")
    with progress_bar(args.quiet) as progress:
        found = fit(args.folder, bias=args.bias or "auto", accelerometer=args.accelerometer, use_earth=not args.no_earth, progress=progress)
    table = found.to_json()
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"models: {folder}", soft_wrap=True)
    output(args).print(f"next: calibrate.py explain {shell_word(args.folder)}", soft_wrap=True, markup=False)
    closure = {unit["number"]: unit["closure"]["alone_rms_deg"] for unit in table["units"]}
    above = [] if args.limit is None else [number for number, rms in closure.items() if not rms <= args.limit]
    for number in above:
        complain(f"above --limit: unit {number}'s closure is {closure[number]:.4g} deg")
    return Done(1 if above else 0, table, f"{len(table['units'])} units")


def explain_array_folder(args: argparse.Namespace) -> int:
    """Each unit by itself, and what the others say of it."""
    if args.lot is not None:
        raise CalibrationError(f"--lot: of no use with {args.folder}, an array; leave it out, or give one unit a folder of its own")
    if args.discover:
        raise CalibrationError(
            f"--discover: of no use with {args.folder}, an array; leave it out, or give one unit a folder of its own and search there"
        )
    from tinygc.annexes.arrays.text import array_verdict_line
    from tinygc.cli.console import progress_bar

    try_destinations(args, "explain")
    with progress_bar(args.quiet) as progress:
        found = explain(args.folder, seed=args.seed, use_earth=not args.no_earth, progress=progress)
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"written: {folder}", soft_wrap=True)
    verdict(args, array_verdict_line(found.result))
    write_json(args.json, found.to_json())
    return 1 if args.strict and found.result.verdict != "no_mismatch" else 0


# ``apply`` of an array's model: units fused, and what the vote said.


def fuse(args: argparse.Namespace, out: Path) -> int:
    """An array's folder as one log."""
    from session.io.errors import CalibrationError
    from session.io.units import DEG
    from tinygc.annexes.arrays.apply import apply_array
    from tinygc.cli.console import progress_bar

    if args.session is not None:
        raise CalibrationError("--session is for one sensor's model; an array's model says what each unit is")
    if not args.log.is_dir():
        raise CalibrationError(f"{args.log}: no folder; an array's model takes the array's folder")
    with progress_bar(args.quiet) as progress:
        done = apply_array(args.model, args.log, out, answers_of(args), args.which, args.unit, progress)
    density = ", ".join(f"{1e3 * value / DEG:.3g}" for value in done.noise_density)
    said = [f"{done.out}: {done.rows} samples of {len(done.used)} units fused ({density} mdps/rtHz while all are in)"]
    for at_s, event in done.events:
        who = "the two units left" if event.unit is None else f"unit {event.unit}"
        size = "" if math.isnan(event.size_rps) else f": {event.size_rps / DEG:.3g} dps, bar {event.bar_rps / DEG:.3g} dps"
        said.append(f"  {at_s:.3f} s: {who} {event.what}{f' ({event.reason}{size})' if event.reason else ''}")
    said += [f"  {note}" for note in done.notes]
    beside_log(args, said, str(out) == STANDARD)
    write_json(
        args.json,
        {
            "schema": "tinygc-apply/1",
            "out": str(done.out),
            "rows": done.rows,
            "kind": "array",
            "delay_s": 0.0,
            "accelerometer": "model" if done.force else "none",
            "notes": list(done.notes),
            "log": done.which,
            "clocks": done.clocks,
            "left_out": done.left_out,
            "at_end": done.at_end,
            "units": [{"number": number, "used_share": share} for number, share in done.used.items()],
            "events": [
                {
                    "t_s": at_s,
                    "unit": event.unit,
                    "what": event.what,
                    "reason": event.reason,
                    "size_dps": event.size_rps / DEG,
                    "bar_dps": event.bar_rps / DEG,
                }
                for at_s, event in done.events
            ],
        },
    )
    return 0
