"""Which model a fit says to use: the simplest that no other betters by more than chance, on segments that neither has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

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


def test_equals_give_the_simplest_and_a_better_one_is_taken():
    rng = np.random.default_rng(1)
    linear = errors(rng)
    same = used({"tinygc": Fitted(linear * (1 - 1e-9), 27), "least_squares": Fitted(linear, 12)})
    assert (same.method, same.best, same.p_value) == ("least_squares", "tinygc", None)  # always less, and by nothing
    assert "within 1 % of the best" in same.why
    better = used({"least_squares": Fitted(linear, 12), "tinygc": Fitted(0.5 * linear, 27)})
    assert (better.method, better.best) == ("tinygc", "tinygc")
    assert better.p_value < 1e-6
    assert "significantly better" in better.why


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


def test_what_is_worse_than_raw_is_never_used():
    rng = np.random.default_rng(4)
    fits = {"raw": Fitted(errors(rng), 0), "least_squares": Fitted(errors(rng), 12)}
    none = used(fits, raw_deg=1e-4)
    assert (none.method, none.best) == (None, "least_squares")
    assert none.why == "nothing that was fitted closes held-out turns better than the raw rates"
    assert "5 turns do not decide" in used(fits, raw_deg=1e-4, segments=5).why
    assert used({"raw": fits["raw"]}).why == "nothing was fitted"
    one = used({"least_squares": fits["least_squares"], "tinygc": Fitted(errors(rng, 1e4), 27)})
    assert one.method == "least_squares"
    assert "the only one that is better than the raw rates" in one.why


def test_segments_are_compared_by_their_numbers():
    """Physics may have mended away a segment: the same errors, one row less, are no difference."""
    linear = np.abs(errors(np.random.default_rng(5)))
    physics = Fitted(0.5 * linear[1:], 15)
    numbers = {"least_squares": list(range(SEGMENTS)), "physics": list(range(1, SEGMENTS))}
    found = used({"least_squares": Fitted(linear, 12), "physics": physics}, numbers=numbers)
    assert found.method == "physics"
    assert found.p_value == pytest.approx(2.0 ** -(SEGMENTS - 1))  # every sign the same
