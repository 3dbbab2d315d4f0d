"""``rates --discover``: the equation of a curve is found, and none is invented of a straight line."""

import numpy as np
import pytest
from conftest import broad

from tinygc.annexes.rates.choice import LINE, Choice, choose
from tinygc.annexes.rates.discovery import discover
from tinygc.annexes.rates.fitting import fit
from tinygc.annexes.rates.points import points_of

RATE = np.concatenate([np.linspace(-300.0, 300.0, 21), np.linspace(300.0, -300.0, 21)])
SCALE = 0.02


def found(of, seed=1):
    rng = np.random.default_rng(seed)
    points = points_of("s", "V", RATE, 0.15 + of(RATE) + 1e-3 * rng.normal(size=len(RATE)), ["one"] * len(RATE))
    return discover(choose(points))


@pytest.mark.parametrize(
    ("functions", "of"),
    [
        (("cube",), lambda w: SCALE * (w - 1e-6 * w**3)),
        broad(("size",), lambda w: SCALE * np.where(w > 0, 1.005, 0.995) * w),
        broad(("square",), lambda w: SCALE * (w + 5e-5 * w**2)),
        broad(("wave",), lambda w: 5 * np.sin(w / 250)),
        broad(("hinge",), lambda w: SCALE * (w - 0.02 * np.maximum(w - 120, 0))),
        broad(("wave",), lambda w: np.clip(5 * np.sin(w / 250), -4.1, 4.3)),
    ],
)
def test_the_equation_of_a_curve(functions, of):
    discovery = found(of)
    assert tuple(name for name, _ in discovery.equation.functions) == functions
    assert discovery.untouched < 0.1


def test_a_straight_line_gives_no_equation():
    discovery = found(lambda w: SCALE * w)
    assert discovery.equation is None
    assert "straight line" in discovery.lines[0]
    assert discovery.to_json()["equation"] is None


def test_an_equation_must_predict_the_points_that_were_kept_from_the_search():
    """A step that every third rate lacks, and these are kept."""
    rate = np.linspace(-300.0, 300.0, 21)
    step = 0.02 * np.sign(rate) * (np.abs(rate) > 150) * (np.arange(21) % 3 != 1)
    points = points_of("s", "V", rate, SCALE * rate + step + 1e-3 * np.random.default_rng(0).normal(size=21), ["one"] * 21)
    line = fit(points, LINE)
    discovery = discover(Choice(points, line, line, 0.0, (), 1.0, ()))
    assert discovery.best.functions
    assert discovery.untouched > 1
    assert discovery.equation is None
    assert "no equation predicts the points" in discovery.lines[0]


def test_a_clipped_line_is_a_line_within_its_limits():
    discovery = found(lambda w: np.clip(SCALE * w, -4.1, 4.3))
    assert discovery.equation.functions == ()
    assert discovery.text.startswith("V = clip(0.1")
    assert discovery.text.endswith(", 4.45)") or "4.4" in discovery.text


def test_the_equation_can_be_worked_out_by_hand():
    """The text, as Python, gives the outputs."""
    discovery = found(lambda w: SCALE * (w - 1e-6 * w**3))
    text = discovery.text.removeprefix("V = ").replace("−", "-").replace("×10^", "e").replace("w³", "* w**3").replace(" w", " * w", 1)
    values = eval(text.replace("* * ", "* "), {"w": RATE})
    assert values == pytest.approx(0.15 + SCALE * (RATE - 1e-6 * RATE**3), abs=3e-3)
