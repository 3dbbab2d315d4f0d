"""``rates`` on simulated curves of each law, on straight lines, and on a public rate table beside the checkout.

python benchmarks/rate_steps.py lines --tables 400      # how often a true straight line is called crooked
python benchmarks/rate_steps.py laws --tables 20        # which law is chosen of curves of each; what --discover writes
python benchmarks/rate_steps.py terms --tables 100      # whether the sigmas of the terms hold
python benchmarks/rate_steps.py real                    # ../shared/wild/rate_table.csv: residuals, and curves predicted from others
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from tinygc.annexes.rates.choice import FALSE_ALARM, LINE, Choice, chance, choose
from tinygc.annexes.rates.discovery import discover
from tinygc.annexes.rates.fitting import fit
from tinygc.annexes.rates.laws import Hypothesis
from tinygc.annexes.rates.points import Points, points_of, read_points
from tinygc.annexes.rates.terms import terms

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
    print("| true straight lines | tables | called crooked |\n| --- | ---: | ---: |")
    up = np.linspace(-FULL_DPS, FULL_DPS, 21)
    rate = np.concatenate([up, up[-2::-1]])
    drawn = {f"{count} rates up and down": (count, lambda rng, count=count: table("line", rng, count)) for count in (7, 11, 21)}
    for name, of in NOISES.items():
        drawn[name] = 4, lambda rng, of=of: points_of("s", "V", rate, of(rate, rng.normal(size=len(rate))), ["one"] * len(rate))
    for name, (seed, draw) in drawn.items():
        rng = np.random.default_rng(seed)
        share = float(np.mean([chance(draw(rng)) <= FALSE_ALARM for _ in range(tables)]))
        print(f"| {name} | {tables} | {100 * share:.1f} ± {100 * np.sqrt(max(share * (1 - share), 1 / tables) / tables):.1f} % |")


def laws(tables: int) -> None:
    """Rows: true law, what is chosen, whether the rivals hold the truth, what --discover writes."""
    print("| true law | chosen | right | right, or named as a rival | --discover |\n| --- | --- | ---: | ---: | --- |")
    for law, (_, same) in TRUTHS.items():
        rng = np.random.default_rng(len(law))
        chosen: Counter[str] = Counter()
        written: Counter[str] = Counter()
        right, named = 0, 0
        for number in range(tables):
            choice = choose(table(law, rng))
            name = choice.fit.hypothesis.name
            chosen[name] += 1
            right += name in same
            named += name in same or any(rival.hypothesis.name in same for rival, _ in choice.rivals)
            if number < 5:
                found = discover(choice)
                written[" + ".join(kind for kind, _ in found.equation.functions) if found.equation else "none"] += 1  # "" is a line
        words = ", ".join(f"{name} {count}" for name, count in chosen.most_common(3))
        print(
            f"| {law} | {words} | {right} of {tables} | {named} of {tables} | {', '.join(f'{n} {c}' for n, c in written.most_common(3))} |",
            flush=True,
        )


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
    """Rows: sensor, residual of a line and of the chosen law; of each curve predicted from the others."""
    if not SHARED.exists():
        print(f"{SHARED}: not there")
        return
    for points in read_points(SHARED)[0]:
        choice = choose(points)
        print(f"\n{points.sensor}: {choice.fit.hypothesis.name}: {1e3 * choice.fit.rms:.2f} mV, a line {1e3 * choice.line.rms:.0f} mV")
        for one in choice.held_out:
            print(f"| {one.hypothesis} | {one.curve[-10:]} | {1e3 * one.within_rms:.2f} | {1e3 * one.rms:.2f} | {one.beyond} beyond |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("lines", "laws", "terms", "real"))
    parser.add_argument("--tables", type=int, default=100)
    args = parser.parse_args()
    real() if args.what == "real" else {"lines": lines, "laws": laws, "terms": coverage}[args.what](args.tables)


if __name__ == "__main__":
    main()
