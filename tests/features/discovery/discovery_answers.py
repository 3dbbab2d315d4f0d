"""Discoveries made by hand: laws that are put into small simulated sessions, and what a search would answer of them."""

from dataclasses import replace

import numpy as np

from session.base.rotation import unit_vectors
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


def law_of(form, dps, **changed):
    """One law as a search would say it; its numbers are the true ones."""
    name = f"discovered.{what(form)}"
    effect = as_effect(form, name, 1.0, equation(form))
    theta = np.array(dps) * DEG
    covariance = np.diag((0.02 * theta) ** 2)
    law = search_state.Law(
        form, effect, theta, covariance, tuple(0.03 * value for value in form.constants), 5123.0, 4870.0, 0.0005, (DECIDED,)
    )
    return replace(law, **{"learnable_from": 0.21, **changed})


def runner_up(form, worse=4.2, correlation=0.962):
    """A form that was weighed in a law's place."""
    effect = as_effect(form, "discovered.other", 1.0, equation(form))
    effect = replace(effect, discriminating_motion="turn slowly and quickly about the same axis")
    return search_state.Rival(form, effect, worse, correlation)


def found(*laws, verdict="found", beside=()):
    """An answer with laws."""
    return search_state.Discovery(verdict, "", laws, beside, **COUNTS)


NOTHING = search_state.Discovery(
    "none", "the best form does no more than chance does in 34 % of such searches", (), (), **COUNTS, learnable=LEARNABLE
)


def hidden(name, folder, **options):
    """A small simulated session with one of ``LAWS`` concealed in it, warming up."""
    form, dps = LAWS[name]
    chosen = {"segments": 12, "closure_s": 0.0, "seed": 5, "odr_hz": 62.5, "warm_up_c": 8.0, **options}
    return write_session(SimulationOptions(**chosen), folder, distort=distorting(form, dps))


def distorting(form, dps):
    """``distort`` of a simulated session: the rate with the law, and the movement it needs."""

    def distort(t_s, rate, force, temp_c):
        movement = Movement(t_s, float(t_s[1] - t_s[0]), rate, force / G, temp_c, np.zeros(len(t_s)), float(t_s[-1]), 500 * DEG, temp_c[0])
        effect = as_effect(form)
        return rate + effect.columns(effect.shown(movement)) @ (np.array(dps) * DEG)

    return distort


# A simulated movement.
#
# Every quantity takes values over its whole range and of both signs, independent of the others, so that steps at neighbouring thresholds
# differ in a few samples.

SAMPLES, RATE_HZ, FULL_SCALE = 2400, 10.0, 500 * DEG
#: jitter of samples in sampling periods, so that no time is a multiple of it; samples of the shortest and the longest turn or rest
STRAY, SHORTEST, LONGEST = 0.2, 10, 240
#: share of a turn's size: 1 to 10 dps is slower than what ends a rest, and above noise
CREEP = 0.015


def some_movement(seed):
    """Four minutes of turns, rests and creeps of many lengths, with warming, cooling and vibration."""
    rng = np.random.default_rng(seed)
    t_s = (np.arange(SAMPLES) + rng.uniform(0, STRAY, SAMPLES)) / RATE_HZ
    force = _wandering(rng, 3)
    return Movement(
        t_s=rng.uniform(0.1, 0.5) + t_s,
        dt_s=1 / RATE_HZ,
        rate=0.8 * FULL_SCALE * _turning(rng)[:, None] * _wandering(rng, 3),
        force_g=unit_vectors(force) * rng.uniform(0.8, 1.2, (SAMPLES, 1)),
        temp_c=25 + 10 * _wandering(rng, 1)[:, 0],
        vibration_g2=rng.uniform(0.0, 0.2, SAMPLES),
        duration_s=SAMPLES / RATE_HZ + 1.0,
        fs_rps=FULL_SCALE,
        first_temp_c=25.0,
    )


def _turning(rng):
    """(SAMPLES,) a swell up to 1 in turns and to ``CREEP`` in every other rest, 0 in the others.

    It begins with a short turn and the longest rest, so that settling with time is not yet complete there.
    """
    found, first, number = np.zeros(SAMPLES), 0, 0
    while first < SAMPLES:
        length = (SHORTEST, LONGEST)[number] if number < 2 else int(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
        phase = (np.arange(length) + 0.5) / length
        swell = np.cos(np.pi / 2 * phase) if number == 0 else np.sin(np.pi * phase)
        found[first : first + length] = ((1.0, 0.0, 1.0, CREEP)[number % 4] * swell)[: SAMPLES - first]
        first, number = first + length, number + 1
    return found


def _wandering(rng, axes):
    """(SAMPLES, axes) smooth over about a second, uniform over −1 to 1."""
    noise = rng.standard_normal((SAMPLES + 20, axes))
    smooth = np.stack([np.convolve(column, np.hanning(22)[1:], mode="valid") for column in noise.T], axis=1)
    return 2 * np.argsort(np.argsort(smooth, axis=0), axis=0) / (SAMPLES - 1) - 1
