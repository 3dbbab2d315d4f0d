"""Discoveries made by hand: laws that are put into small simulated sessions, and what a search would answer of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from session.base.units import DEG, G
from tinygc.effects import Movement
from tinygc.features.discovery import search_state
from tinygc.features.discovery.form import Factor, LawForm
from tinygc.features.discovery.law_effect import as_effect
from tinygc.features.discovery.words import equation, what
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

COUNTS = {"forms": 41234, "distinct": 10987, "chance_promise": 31.4, "best_promise": 812.5}
LEARNABLE = {"rate": 0.011 * DEG, "force": 0.0042 * DEG, "vibration": None}
DECIDED = search_state.HeldOut(0.21 * DEG, 0.0131 * DEG, 0.0117 * DEG, 0.9953, 3.2e-9, 0.4, 13)
OTHER_LOG = search_state.HeldOut(0.24 * DEG, 0.0151 * DEG, 0.0121 * DEG, None, 0.0, 0.2, 12, "log0002.csv")
DRIFT = {"id": "gyro.bias_drift", "parameters": {"dps_over_log": [1.2, 0.4, 0.0]}, "std": {"dps_over_log": [0.1, 0.1, 0.1]}}

#: name -> form and its coefficients, dps
LAWS = {
    "dead zone": (LawForm((Factor("rate", "dead_zone", 0.1),)), [0.9, -0.7, 0.5]),
    "cross": (LawForm((Factor("force", "itself"), Factor("rate", "itself")), "next"), [1.2, -0.9, 1.1]),
    "matrix": (LawForm((Factor("force", "size"),), "full"), [0.1, -0.06, 0.02, 0.05, 0.12, -0.08, -0.03, 0.09, -0.1]),
    "warm": (LawForm((Factor("temperature", "root"),)), [0.06, -0.04, 0.05]),
    "warm rate": (LawForm((Factor("rate", "size"), Factor("temperature", "itself"))), [0.12, -0.09, 0.1]),
    "sense": (LawForm((Factor("sense", "itself"),)), [0.08, -0.05, 0.06]),
    "lag": (LawForm((Factor("force", "square", None, 1.5),)), [0.12, -0.1, 0.07]),
}


def law_of(form: LawForm, dps, **changed):
    """One law as a search would say it; its numbers are the true ones."""
    name = f"discovered.{what(form)}"
    effect = as_effect(form, name, 1.0, equation(form))
    theta = np.array(dps) * DEG
    covariance = np.diag((0.02 * theta) ** 2)
    law = search_state.Law(
        form, effect, theta, covariance, tuple(0.03 * value for value in form.constants), 17.4, 5123.0, 4870.0, 0.0005, (DECIDED,)
    )
    return replace(law, **{"learnable_from": 0.21, **changed})


def runner_up(form: LawForm, worse: float = 4.2, correlation: float = 0.962):
    """A form that was weighed in a law's place."""
    effect = as_effect(form, "discovered.other", 1.0, equation(form))
    effect = replace(effect, discriminating_motion="turn slowly and quickly about the same axis")
    return search_state.RunnerUp(form, effect, worse, correlation)


def found(*laws, verdict: str = "found", beside=()):
    """An answer with laws."""
    return search_state.Discovery(verdict, "", laws, beside, **COUNTS)


NOTHING = search_state.Discovery(
    "none", "the best form does no more than chance does in 34 % of such searches", (), (), **COUNTS, learnable=LEARNABLE
)


def hidden(name: str, folder: Path, **options) -> Path:
    """A small simulated session with one of ``LAWS`` concealed in it, warming up."""
    form, dps = LAWS[name]
    chosen = {"segments": 12, "closure_s": 0.0, "seed": 5, "odr_hz": 62.5, "warm_up_c": 8.0, **options}
    return write_session(SimulationOptions(**chosen), folder, distort=distorting(form, dps))


def distorting(form: LawForm, dps):
    """``distort`` of a simulated session: the rate with the law, and the movement it needs."""

    def distort(t_s, rate, force, temp_c):
        movement = Movement(t_s, float(t_s[1] - t_s[0]), rate, force / G, temp_c, np.zeros(len(t_s)), float(t_s[-1]), 500 * DEG, temp_c[0])
        effect = as_effect(form)
        return rate + effect.columns(effect.shown(movement)) @ (np.array(dps) * DEG)

    return distort
