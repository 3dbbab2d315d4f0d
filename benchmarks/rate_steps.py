"""``rates`` on simulated curves of each law, on straight lines, and on a public rate table beside the checkout.

python benchmarks/rate_steps.py lines --tables 400      # how often a true straight line is rejected
python benchmarks/rate_steps.py laws --tables 20        # which law is chosen of curves of each
python benchmarks/rate_steps.py ranges --tables 4       # whether the sigmas of a range hold, of laws in the list and out of it
python benchmarks/rate_steps.py terms --tables 100      # whether the sigmas of the terms hold
python benchmarks/rate_steps.py real                    # ../shared/wild/rate_table.csv: residuals, and curves predicted from others
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from pathlib import Path

import numpy as np
from common import markdown

from session.base.texts import measured
from tinygc.features.tables.rates.choice import LINE, Choice, chance, choose
from tinygc.features.tables.rates.curve import fit_curve
from tinygc.features.tables.rates.fitting import fit
from tinygc.features.tables.rates.laws import CURVE, Hypothesis
from tinygc.features.tables.rates.points import Points, points_of, read_points
from tinygc.features.tables.rates.terms import terms
from tinygc.inference.choose import LEVEL

SHARED = Path(__file__).resolve().parents[2] / "shared" / "wild" / "rate_table.csv"
#: V/(°/s), V of rest, V of noise
SCALE, REST, NOISE = 0.02, 0.15, 1e-3
FULL_DPS = 300.0


def _sine(w: np.ndarray) -> np.ndarray:
    return SCALE * 250 * np.sin(w / 250)


#: laws as a person would write them, none of them from the code under test; names that are the same law on these rates
TRUTHS = {
    "line": (lambda w: SCALE * w, {"line"}),
    "clip, two sided": (lambda w: np.clip(SCALE * w, -4.1, 4.3), {"line, clipped below and above"}),
    "clip, above": (lambda w: np.minimum(SCALE * w, 4.2), {"line, clipped above", "pieces"}),
    "tanh": (lambda w: SCALE * 400 * np.tanh(w / 400), {"tanh"}),
    "arctan": (lambda w: SCALE * 300 * np.arctan(w / 300), {"arctan"}),
    "cubic": (lambda w: SCALE * (w - 1e-6 * w**3), {"cubic"}),
    "parabola": (lambda w: SCALE * (w + 5e-5 * w**2), {"quadratic"}),
    "two slopes": (lambda w: SCALE * np.where(w > 0, 1.005, 0.995) * w, {"asymmetry", "line, asymmetry"}),
    "dead band": (lambda w: SCALE * np.sign(w) * np.maximum(np.abs(w) - 4, 0), {"dead_band"}),
    "sine": (_sine, {"sine"}),
    "sine, clipped": (lambda w: np.clip(_sine(w), -4.1, 4.3), {"sine, clipped below and above"}),
    "sine, phase at rest": (lambda w: SCALE * 250 * (np.sin(w / 250 + 0.1) - np.sin(0.1)), {"sine_of_any_phase"}),
    "normalised sine": (lambda w: SCALE * 250 * np.sin(w / 250) / (1 + 0.25 * np.cos(w / 250)), {"normalised_sine"}),
    "overloaded sine": (lambda w: SCALE * 190 * np.sin(w / 190) / (1 + np.abs(np.sin(w / 190) / 1.05) ** 8), {"overloaded_sine"}),
    "two pieces": (lambda w: SCALE * (w - 0.02 * np.maximum(w - 120, 0)), {"pieces"}),
    "hysteresis": (None, {"line, hysteresis"}),
}


def table(law: str, rng: np.random.Generator, count: int = 21, noise: float = NOISE) -> Points:
    """Rates up and down again, with noise."""
    up = np.linspace(-FULL_DPS, FULL_DPS, count)
    rate = np.concatenate([up, up[-2::-1]])
    of = TRUTHS[law][0]
    output = SCALE * rate if of is None else of(rate)
    points = points_of(law, "V", rate, REST + output + noise * rng.normal(size=len(rate)), ["one"] * len(rate))
    if of is None:
        points = points_of(law, "V", rate, points.output + 5e-3 * points.direction / 2, ["one"] * len(rate))
    return points


#: other noise of straight lines on 21 rates up and down: output of rates and of white noise of one
NOISES = {
    "Student's t, 3 degrees of freedom": lambda w, n: (
        SCALE * w + NOISE * n / np.sqrt(np.roll(n, 1) ** 2 + np.roll(n, 2) ** 2 + np.roll(n, 3) ** 2)
    ),
    "noise that grows tenfold with the rate": lambda w, n: SCALE * w + NOISE * (0.1 + np.abs(w) / FULL_DPS) * n,
}


def lines(tables: int) -> None:
    """Rows: design, share of true lines that are given up."""
    print("| true straight lines | tables | rejected |\n| --- | ---: | ---: |")
    up = np.linspace(-FULL_DPS, FULL_DPS, 21)
    rate = np.concatenate([up, up[-2::-1]])
    drawn = {f"{count} rates up and down": (count, lambda rng, count=count: table("line", rng, count)) for count in (7, 11, 21)}
    for name, of in NOISES.items():
        drawn[name] = 4, lambda rng, of=of: points_of("s", "V", rate, of(rate, rng.normal(size=len(rate))), ["one"] * len(rate))
    for name, (seed, draw) in drawn.items():
        rng = np.random.default_rng(seed)
        share = float(np.mean([chance(draw(rng)) <= LEVEL for _ in range(tables)]))
        print(f"| {name} | {tables} | {100 * share:.1f} ± {100 * np.sqrt(max(share * (1 - share), 1 / tables) / tables):.1f} % |")


def laws(tables: int) -> None:
    """Rows: true law, what is chosen, whether the rivals hold the truth."""
    print("| true law | chosen | right | right, or named as a rival |\n| --- | --- | ---: | ---: |")
    for law, (_, same) in TRUTHS.items():
        rng = np.random.default_rng(len(law))
        chosen: Counter[str] = Counter()
        right, named = 0, 0
        for _ in range(tables):
            choice = choose(table(law, rng))
            name = choice.fit.hypothesis.name
            chosen[name] += 1
            right += name in same
            named += name in same or any(rival.hypothesis.name in same for rival, _ in choice.rivals)
        words = ", ".join(f"{name} {count}" for name, count in chosen.most_common(3))
        print(f"| {law} | {words} | {right} of {tables} | {named} of {tables} |", flush=True)


#: smooth departures, u the rate in 300 °/s: output in that of the slope at rest; those of the list, and those that it lacks
LISTED = {
    "tanh": lambda u: 1.4 * np.tanh(u / 1.4),
    "arctan": lambda u: 2 * np.arctan(u / 2),
    "root": lambda u: u / np.sqrt(1 + (u / 2.5) ** 2),
    "sine": lambda u: 1.1 * np.sin(u / 1.1),
    "sine, phase at rest": lambda u: (np.sin(u + 0.1) - np.sin(0.1)) / np.cos(0.1),
    "normalised sine": lambda u: 1.25 * np.sin(u) / (1 + 0.25 * np.cos(u)),
    "cubic": lambda u: u - 0.04 * u**3,
    "parabola": lambda u: u + 0.03 * u**2,
    "third order": lambda u: u + 0.02 * u**2 - 0.03 * u**3,
}
UNLISTED = {
    "w |w|": lambda u: u - 0.03 * u * np.abs(u),
    "square root": lambda u: u - 0.03 * u * np.sqrt(np.abs(u)),
    "power 1.5": lambda u: u - 0.04 * u * np.abs(u) ** 1.5,
    "fifth power": lambda u: u - 0.05 * u**5,
    "asinh": lambda u: 1.5 * np.arcsinh(u / 1.5),
    "logarithm": lambda u: 3 * np.sign(u) * np.log1p(np.abs(u) / 3),
    "slow logarithm": lambda u: u * (1 - 0.05 * np.log1p(np.abs(u) / 0.3)),
    "logarithm of the square": lambda u: u * (1 - 0.03 * np.log1p((u / 0.4) ** 2)),
    "error function": lambda u: u * 0 + 1.3 * np.vectorize(math.erf)(u / 1.3 * np.sqrt(np.pi) / 2),
    "Gudermann": lambda u: 1.5 * np.arctan(np.sinh(u / 1.5)),
    "hyperbola": lambda u: u / (1 + np.abs(u) / 12),
    "fourth root": lambda u: u / (1 + (u / 1.5) ** 4) ** 0.25,
    "rational": lambda u: u / (1 + 0.05 * u**2),
    "bell": lambda u: u * np.exp(-0.04 * u**2),
    "exponential": lambda u: 6 * np.sign(u) * (1 - np.exp(-np.abs(u) / 6)),
    "Langevin": lambda u: 6 * (1 / np.tanh(2 * u + 1e-9) - 1 / (2 * u + 1e-9)) / 4,
    "tangent": lambda u: 2.5 * np.tan(u / 2.5),
    "sinh": lambda u: 2 * np.sinh(u / 2),
    "one sense": lambda u: np.where(u > 0, 1.3 * np.tanh(u / 1.3), u),
    "senses apart": lambda u: np.where(u > 0, 1.3 * np.tanh(u / 1.3), 2.2 * np.tanh(u / 2.2)),
    "fourth power": lambda u: u + 0.04 * u**4,
    "exponential of the rate": lambda u: u + 0.02 * (np.exp(u) - 1 - u),
    "scale that falls off": lambda u: u * (1 - 0.03 * (1 - np.exp(-np.abs(u) / 0.4))),
    "scale that steps": lambda u: u * (1 - 0.02 * (1 + np.tanh((np.abs(u) - 0.6) / 0.15)) / 2),
    "ripple": lambda u: u * (1 + 0.02 * (np.cos(4 * u) - 1)),
    "soft clip": lambda u: u / (1 + (np.abs(u) / 0.95) ** 8) ** 0.125,
}


def ranges(tables: int) -> None:
    """Rows: law; stated linear range, its truth, nonlinearity and its truth within the stated range, of the first table; and how often the
    sigmas hold."""
    print("| law | linear to, °/s | truth | nonlinearity, ppm | truth |\n| --- | ---: | ---: | ---: | ---: |")
    errors: dict[str, list[float]] = {"linear_high": [], "nonlinearity": []}
    grid = np.linspace(0, FULL_DPS, 30_001)[1:]
    for number, (law, of) in enumerate((LISTED | UNLISTED).items()):
        rng = np.random.default_rng([11, number])
        gone = np.abs(of(grid / FULL_DPS) * FULL_DPS - grid) > 0.01 * grid
        end = float(grid[np.argmax(gone)]) if gone.any() else FULL_DPS
        for k in range(tables):
            up = np.linspace(-FULL_DPS, FULL_DPS, 21)
            rate = np.concatenate([up, up[-2::-1]])
            output = SCALE * FULL_DPS * of(rate / FULL_DPS) + NOISE * rng.normal(size=len(rate))
            points = points_of(law, "V", rate, REST + output, ["one"] * len(rate))
            line, curve = fit(points, LINE), fit_curve(points, Hypothesis(CURVE))  # whatever law is chosen, figures are of the curve
            assert line is not None and curve is not None  # noqa: PT018 - of 41 points
            choice = Choice(points, curve, line, 0.0, (), 1.0, ())
            rows = {row.key: row for row in terms(choice)}
            if rows["nonlinearity"].value is None or rows["linear_high"].value is None or rows["linear_low"].value is None:
                if not k:
                    print(f"| {law} | not determined | {end:.0f} | not determined | |", flush=True)
                continue
            within = np.linspace(rows["linear_low"].value, rows["linear_high"].value, 2001)
            true = of(within / FULL_DPS) * FULL_DPS
            bent = np.abs(true - np.polyval(np.polyfit(within, true, 1), within)).max() / np.abs(within).max() * 1e6
            truths = {"linear_high": end, "nonlinearity": float(bent)}
            for key, truth in truths.items():
                row = rows[key]
                if row.value is not None and row.sigma:
                    errors[key].append((row.value - truth) / row.sigma)
            if not k:
                cells = [f"{measured(rows[key].value or 0.0, rows[key].sigma or 0.0)} | {truth:.0f}" for key, truth in truths.items()]
                print(f"| {law} | {' | '.join(cells)} |", flush=True)
    for key, all_ in errors.items():
        far = np.abs(all_)
        within = ", ".join(f"within {k} σ {100 * np.mean(far < k):.0f} %" for k in (1, 2))
        print(f"{key}: {len(far)} stated, {within}, largest {far.max():.1f} σ")


#: laws whose terms are asked for; of the others a straight line's
GIVEN = {
    "two slopes": Hypothesis("asymmetry"),
    "dead band": Hypothesis("dead_band"),
    "clip, two sided": Hypothesis("line", True, True),
    "hysteresis": Hypothesis("line", extras=("hysteresis",)),
}


#: law and term -> its true size
SIZES = {
    ("two slopes", "asymmetry"): 1e4,
    ("two slopes", "scale"): SCALE,
    ("dead band", "dead_band"): 4.0,
    ("clip, two sided", "linear_high"): 4.3 / SCALE,
    ("clip, two sided", "saturation_low"): -4.1 + REST,
    ("hysteresis", "hysteresis"): 5e-3 / SCALE,
    ("line", "scale"): SCALE,
    ("line", "offset"): REST,
}


def coverage(tables: int) -> None:
    """Rows: a term of a known size, the law given; how often its sigma holds."""
    print("| law | term | truth | within 1 σ | within 2 σ |\n| --- | --- | ---: | ---: | ---: |")
    for (law, key), truth in SIZES.items():
        rng, errors = np.random.default_rng(5), []
        for _ in range(tables):
            points = table(law, rng)
            line, given = fit(points, LINE), fit(points, GIVEN.get(law, LINE))
            assert line is not None and given is not None  # noqa: PT018 - of 41 points
            (row,) = (row for row in terms(Choice(points, given, line, 0.0, (), 1.0, ())) if row.key == key)
            if row.value is not None and row.sigma:
                errors.append(abs(row.value - truth) / row.sigma)
        within = " | ".join(f"{100 * np.mean(np.array(errors) < k):.0f} %" for k in (1, 2))
        print(f"| {law} | {key} | {truth:g} | {within} |")


def real() -> None:
    """Rows: sensor, residual of a line and of the chosen law, and whether its repeats accept the law."""
    if not SHARED.exists():
        print(f"{SHARED}: not there")
        return
    rows = []
    for points in read_points(SHARED)[0]:
        choice = choose(points)
        rows.append([points.sensor, f"{1e3 * choice.line.rms:.0f}", choice.fit.hypothesis.name, f"{1e3 * choice.fit.rms:.2f}"])
    print(markdown(["sensor", "a straight line, mV", "chosen law", "residual, mV"], rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("lines", "laws", "ranges", "terms", "real"))
    parser.add_argument("--tables", type=int, default=100)
    args = parser.parse_args()
    real() if args.what == "real" else {"lines": lines, "laws": laws, "ranges": ranges, "terms": coverage}[args.what](args.tables)


if __name__ == "__main__":
    main()
