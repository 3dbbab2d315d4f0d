"""Which model a fit says to use: the simplest that no other betters by more than chance, on segments that neither has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.estimation.choice import AgainstRaw, model_to_use

SEGMENTS = 40


@dataclass
class Fitted:
    """What is asked of a method's fit."""

    held_out: np.ndarray
    parameters: int


def errors(rng, size=1.0, count=SEGMENTS):
    return size * rng.normal(0, 2e-4, (count, 2))


def used(fits, raw_deg=5.0, numbers=None, segments=SEGMENTS):
    tilts = {name: float(np.degrees(np.sqrt(np.mean(np.sum(f.held_out**2, axis=1))))) for name, f in fits.items()}
    numbers = numbers or {name: list(range(len(f.held_out))) for name, f in fits.items()}
    return model_to_use(fits, AgainstRaw("raw", raw_deg, tilts, segments), numbers)


def test_chance_takes_another_than_the_simplest_as_seldom_as_it_says():
    """Of 300 pairs without a difference, at most as many as a level of 5 % explains (3 sigmas)."""
    rng = np.random.default_rng(2)
    counts = {"least_squares": 12, "tinygc": 27, "tinygc_denoised": 195}
    taken = [used({name: Fitted(errors(rng), count) for name, count in counts.items()}).method for _ in range(300)]
    wrong = sum(name != "least_squares" for name in taken)
    assert wrong <= 0.05 * 300 + 3 * np.sqrt(300 * 0.05 * 0.95)
    assert taken.count("least_squares") > 250


def test_a_real_difference_is_found_among_scatter():
    rng = np.random.default_rng(3)
    found = [used({"least_squares": Fitted(errors(rng, 2.0), 12), "tinygc": Fitted(errors(rng), 27)}).method for _ in range(50)]
    assert found.count("tinygc") > 40
