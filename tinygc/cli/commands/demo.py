"""``demo``: a simulated session, written and fitted at once, so that a fresh installation has something to try."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import folder_written, option
from tinygc.cli.options import Command, Force
from tinygc.cli.results import output, write_json
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
    console.print(f"{folder} is simulated: all 12 numbers are within {worst:.1f} sigma of the true ones (truth.json)")
    console.print(f"next: {command_line('report', folder)}")
    console.print(f"a log of your own: {command_line('fit', 'LOG.csv')}")
    table = {"schema": "tinygc-demo/1", "folder": str(folder), "parameters": parameters, "fit": result.to_json()}
    write_json(args.json, table)
    return 0 if decision.passed else 1
