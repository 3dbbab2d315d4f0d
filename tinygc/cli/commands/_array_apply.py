"""``apply`` of an array's model: units fused, and what the vote said."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from tinygc.cli.commands._log_options import answers_of
from tinygc.cli.commands._results import beside_log, write_json
from tinygc.cli.paths import STANDARD


def fuse(args: argparse.Namespace, out: Path) -> int:
    """An array's folder as one log."""
    from session.common.errors import CalibrationError
    from session.common.units import DEG
    from tinygc.cli.console import progress_bar
    from tinygc.deploy.array.apply import apply_array

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
