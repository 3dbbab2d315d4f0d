"""Sessions of one unit for the tests: drawn ones with a known truth, and fitted folders whose bias was moved."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

from session.io.units import DEG


def moved_copies(folder: Path, parent: Path, biases_dps, dates=None) -> list[Path]:
    """Copies of a fitted folder as other sessions of its unit: another bias in the fit, another log by a remark at its end."""
    made = []
    for number, moved in enumerate(biases_dps):
        at = parent / f"day{number + 1}"
        shutil.copytree(folder, at)
        log = at / "log0001.csv"
        log.write_text(f"{log.read_text()}# {number}\n")
        if dates is not None:
            (at / "session.toml").write_text(f'{(at / "session.toml").read_text()}\n[notes]\ndate = "{dates[number]}"\n')
        path = at / "fit" / "model_least_squares.json"
        table = json.loads(path.read_text())
        table["sha256"] = {name: f"{number}" * 64 for name in table["sha256"]}
        table["weights"]["B"] = (np.array(table["weights"]["B"]) + moved * DEG).tolist()
        path.write_text(json.dumps(table))
        made.append(at)
    return made
