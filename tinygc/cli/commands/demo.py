"""``demo``: a simulated session, written and fitted at once, so that a fresh installation has something to try."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import folder_written, option
from tinygc.cli.options import Command, Force
from tinygc.cli.results import output, print_commands, write_json
from tinygc.estimation.options import Seed

#: the session of data/session1; ``--seed`` counts on from it
SEGMENTS, CLOSURE_S, FIRST_SEED = 40, 58.0, 1


@dataclass(frozen=True)
class Options(Command, Force, Seed):
    """Options of ``demo``."""

    out: Path = option(Path("tinygc-demo"), "session folder to write (./tinygc-demo)", metavar="DIR", read=folder_written)


def run(args: Options) -> int:
    """Simulate, save, fit by all methods, and hold the fitted parameters against the true ones."""
    import numpy as np

    from session.base.texts import command_line
    from tinygc.library.fits import fit
    from tinygc.library.simulations import simulate
    from tinygc.reporting.fit_screen import files_line, fit_screen
    from tinygc.reporting.terminal import progress_bar
    from tinygc.simulation.write import check_folder

    check_folder(args.out, args.force)  # before the work
    simulated = simulate(segments=SEGMENTS, closure_s=CLOSURE_S, seed=FIRST_SEED + args.seed)
    folder = simulated.save(args.out, force=args.force)
    console = output(args)
    console.print(f"{folder}: a simulated session, fitted as a recorded one")
    with progress_bar(args.quiet) as progress:
        result = fit(folder, progress=progress)
    decision = result.verdict()
    saved = result.save()

    true = np.append(np.ravel(simulated.truth["E"]), np.radians(simulated.truth["B_dps"]))
    parameters = [
        {"name": each.name, "unit": each.unit, "value": each.value, "sigma": each.sigma, "truth": float(truth)}
        for each, truth in zip(result.parameters.values(), true, strict=True)
    ]
    worst = max(abs(each.value - truth) / each.sigma for each, truth in zip(result.parameters.values(), true, strict=True))
    console.print(fit_screen(result.result, decision))
    console.print(files_line(result.result, saved, decision))
    console.print(f"truth: the twelve numbers of E and B are within {worst:.1f} sigma of those that were simulated (truth.json)")
    log, model = next(folder.glob("closure*")), saved / "model_least_squares.json"
    print_commands(
        args,
        "next:",
        command_line("report", folder),
        command_line("explain", folder),
        command_line("apply", model, log, "-o", "calibrated.csv"),
        command_line("import", "LOG.csv", "--out", "mine") + "  # a log of your own",
    )
    table = {"schema": "tinygc-demo/1", "folder": str(folder), "parameters": parameters, "fit": result.to_json()}
    write_json(args.json, table)
    return 0 if decision.passed else 1
