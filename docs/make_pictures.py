"""Make the pictures of the README again: python docs/make_pictures.py

Conceals a thermal bias in a simulated session, lets `explain` look at it, and keeps its page; conceals a law that no catalogue has, and
keeps what `explain --discover` draws of it; and the page of the Xsens recording, where
it is next to the checkout.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from session.base.units import DEG, G
from tinygc.explanation.engine import explain_session
from tinygc.library.explanations import Why, explain
from tinygc.reporting.terminal import output
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

SHARED = Path(__file__).resolve().parents[2] / "shared"
XSENS = SHARED / "xsens"
CONCEALED_DPS_PER_C = np.array([0.014, -0.037, 0.018])
CONCEALED_PER_G = np.array([0.002, -0.0015, 0.0018])


def leaning(t_s, rate, force, temp_c):
    """The sensitivity of an axis follows the specific force along it (discover.md)."""
    return rate + CONCEALED_PER_G * rate * force / G


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    options = SimulationOptions(seed=11, closure_s=0.0, warm_up_c=9.0)

    def warm(t_s, rate, force, temp_c):
        return rate + CONCEALED_DPS_PER_C * DEG * (temp_c - options.temperature_start_c)[:, None]

    with tempfile.TemporaryDirectory() as parent:
        folder = write_session(options, Path(parent) / "warm", distort=warm)
        explanation = explain_session(folder)
        output().print(Why(explanation).page)
        shutil.copy(Why(explanation).save() / "explain.svg", Path(__file__).parent / "explain.svg")
        options = SimulationOptions(seed=5, segments=40, closure_s=0.0)
        folder = write_session(options, Path(parent) / "hidden", distort=leaning)
        why = explain(folder, discover=True)
        output().print(why.page)
        shutil.copy(why.save() / "discover.svg", Path(__file__).parent / "features" / "discovery" / "discover.svg")
        if XSENS.is_dir():
            there = Why(explain_session(XSENS)).save(Path(parent) / "xsens")
            shutil.copy(there / "explain.svg", Path(__file__).parent / "explain-xsens.svg")


if __name__ == "__main__":
    main()
