"""Sessions of one unit for the tests: drawn ones with a known truth, and fitted folders whose bias was moved."""

from __future__ import annotations

import json
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from session.io.units import DEG
from tinygc.annexes.history.sessions import NUMBERS, ZERO, UnitSession
from tinygc.estimation.session_times import YEAR_S, Moment

FIRST = datetime(2024, 1, 1, tzinfo=UTC)
OWN = np.array([{"ppm": 25.0, "mrad": 0.03, "dps": 0.001, "mg": 0.01}[number.unit] * number.si for number in NUMBERS])


def drawn(at, seed=0, scatter=0.0, drift=0.0, steps=None, own=1.0, dated=True):
    """Sessions at years ``at``; scatter and drift (21,) SI or a number; steps: session after which -> (21,) change."""
    rng = np.random.default_rng(seed)
    sessions = []
    for j, when in enumerate(at):
        moved = sum((size for before, size in (steps or {}).items() if j > before), np.zeros(len(NUMBERS)))
        values = drift * when + moved + scatter * rng.normal(size=len(NUMBERS)) + own * OWN * rng.normal(size=len(NUMBERS))
        covariance = np.diag((own * OWN) ** 2)
        moment = Moment(FIRST + timedelta(seconds=float(when) * YEAR_S), "notes") if dated else None
        vector = np.concatenate([np.eye(3).ravel(), -values[ZERO]])
        sessions.append(
            UnitSession(f"s{j + 1}", "ASM330LHH", "7", moment, values, covariance, -values[ZERO], covariance[ZERO, ZERO], vector)
        )
    return sessions


def of(name, size):
    """(21,) SI: a size, in the number's unit, in all numbers of a name, or in one component."""
    return np.array([size * number.si * (name in (number.name, number.words)) for number in NUMBERS])


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
