"""What ``fit`` and ``explain`` have left, with odd values in it: read by ``compare``, ``export``, ``plan`` and the bias of another day."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path

from fuzz_targets.json_edits import edited
from fuzz_targets.rules import choose
from session.io.folder import read_session
from tinygc.deploy.exports import FORMATS, exporter
from tinygc.deploy.exports._context import read_context
from tinygc.estimation import bias_of_day
from tinygc.estimation.bias_of_day import origin_of
from tinygc.estimation.compare import compare, read_calibrated, to_json
from tinygc.library.fits import fit
from tinygc.library.sessions import simulate
from tinygc.planning.proposals import requested_by_explain
from tinygc.reporting.tables import comparison_page
from tinygc.reporting.terminal import as_text

MODEL = "fit/model_least_squares.json"
FILES = (MODEL, "fit/fit.json", "fit/fitted.json", "fit/rebiased.json")
MODES = ("compare", *(f"export {name}" for name in FORMATS), "origin")


@cache
def fitted() -> tuple[Path, Path]:
    """Two folders of one simulated unit, fitted."""
    work = Path(tempfile.mkdtemp(prefix="tinygc-fuzz-fitted-"))
    atexit.register(shutil.rmtree, work, ignore_errors=True)
    found = []
    for seed in (1, 2):
        simulate(segments=8, closure_s=0.0, odr_hz=62.5, seed=seed).save(work / f"session{seed}")
        fit(work / f"session{seed}", methods=("least_squares",)).save()
        found.append(work / f"session{seed}")
    return found[0], found[1]


def seeds() -> list[bytes]:
    """Each reader with good files, and with one odd value in the model or the fit."""
    modes = range(len(MODES))
    return [bytes([mode]) for mode in modes] + [bytes([mode, mode % 2, 0, 20 * mode, 7 * mode]) for mode in modes]


def run(data: bytes, folder: Path) -> None:
    """Refused in a line, or read."""
    mode, data = choose(data, MODES)
    name, program = choose(data, FILES)
    good, other = fitted()
    session = folder / good.name
    shutil.copytree(good, session, copy_function=shutil.copyfile)
    table = json.loads((good / name).read_text()) if (good / name).exists() else json.loads((good / "fit" / "fit.json").read_text())
    (session / name).unlink(missing_ok=True)
    (session / name).write_text(edited(table, program), encoding="utf-8")
    if mode == "compare":
        found = compare([read_calibrated(session), read_calibrated(other)])
        json.dumps(to_json(found), allow_nan=False)
        assert as_text(comparison_page(found))
    elif mode == "origin":
        assert origin_of(session / name, read_session(session)).says
        requested_by_explain(session)
    else:
        if name == "fit/rebiased.json":
            shutil.copy(session / MODEL, session / "fit" / bias_of_day.MODEL)
            model, context = read_context(session, str(session / "fit" / bias_of_day.MODEL))
        else:
            model, context = read_context(session)
        files = exporter(mode.removeprefix("export ")).export(model, context)
        assert all(text for text in files.values())
