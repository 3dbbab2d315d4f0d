"""Does a report's "±" hold?  How often the truth lies within the expanded uncertainty (k = 2) that a report states.

Simulated sessions go through the whole of ``calibrate.py report``; what is compared are its numbers, in its own words and units, with the
truth put into the same words by other code.  With --hide each session conceals a g-sensitivity and a scale-factor asymmetry as well.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from common import in_parallel, markdown, simulated
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from session.io.registers import gyro_rps_per_lsb
from session.io.units import DEG, G
from tinygc.estimation.options import FitOptions
from tinygc.reporting.html.evidence import gather
from tinygc.simulation.options import SimulatedUnit, SimulationOptions
from tinygc.simulation.simulator import simulate_session

#: one sigma of what --hide conceals
HIDDEN_DPS_PER_G, HIDDEN_HALF_DIFFERENCE = 0.05, 0.002


@dataclass(frozen=True)
class Job:
    seed: int
    segments: int
    hide: bool
    explain: bool


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=120, help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=7000, help="of the first session (%(default)s)")
    parser.add_argument("--segments", type=int, default=40, help="per session (%(default)s)")
    parser.add_argument("--hide", action="store_true", help="conceal a g-sensitivity and an asymmetry in each")
    parser.add_argument("--no-explain", action="store_true", help="as the report's --no-explain: faster")
    args = parser.parse_args()
    jobs = [Job(args.seed + i, args.segments, args.hide, not args.no_explain) for i in range(args.sessions)]
    results = in_parallel(one_session, jobs, "session")
    hidden = ", a g-sensitivity and an asymmetry concealed in each" if args.hide else ""
    print(f"{len(results)} reports of simulated sessions of {args.segments} segments{hidden}: share of the truth within the stated ±.\n")
    words = list(dict.fromkeys(word for result in results for word, _, _ in result["z"]))
    rows = [_row(word, [[z for w, _, z in result["z"] if w == word] for result in results]) for word in words]
    rows.append(_row("**all**", [[z for _, _, z in result["z"]] for result in results]))
    print(markdown(["parameter", "values", "within ± (k = 2)", "within ½ ± (k = 1)", "error rms / σ"], rows))
    verdicts = [result["verdict"] for result in results]
    said = ", ".join(f"{verdict} {verdicts.count(verdict)}" for verdict in dict.fromkeys(verdicts))
    physics = sum(result["calibration"] == "physics" for result in results)
    print(f"\nWhat explain said: {said}; {physics} reports state the model with physics. Not observable, and so said: {_absent(results)}.")
    print(f"Passed (no limit given): {np.mean([result['passed'] for result in results]):.1%}.")


def one_session(job: Job) -> dict:
    """Errors of each stated value in its own sigmas: (word, component, z), half the ± being one sigma."""
    options = SimulationOptions(seed=job.seed, segments=job.segments, closure_s=58.0)
    unit = simulate_session(SimulationOptions(seed=job.seed, segments=1, closure_s=0.0)).unit
    rng = np.random.default_rng(job.seed)
    K = rng.standard_normal((3, 3)) * HIDDEN_DPS_PER_G * job.hide
    half = rng.standard_normal(3) * HIDDEN_HALF_DIFFERENCE * job.hide

    def distort(t_s, rate, force, temp_c):
        return rate + force / G @ K.T * DEG + half * np.abs(rate)

    with simulated(options, distort if job.hide else None) as folder:
        evidence = gather(folder, FitOptions(methods=("least_squares",), seed=job.seed), explain=job.explain)
    truth = in_words(unit, options, evidence.problem.logs[0].samples.period_s) | hidden_in_words(K, half)
    z = [(q.word, q.component, (q.value - truth[q.word, q.component]) / q.sigma) for q in evidence.quantities if q.observed]
    return {
        "z": z,
        "absent": [q.word for q in evidence.quantities if not q.observed],
        "verdict": evidence.explanation.verdict if evidence.explanation is not None else "not asked",
        "calibration": evidence.adopted.name,
        "passed": evidence.decision.passed,
    }


def in_words(unit: SimulatedUnit, options: SimulationOptions, period_s: float) -> dict[tuple[str, str], float]:
    """The unit's true errors as a report says them: ppm, mrad, dps, °/√h, °/h."""
    M = np.linalg.inv(unit.E)
    gain = np.sqrt(np.sum(M**2, axis=1))
    axes = M / gain[:, None]
    triad, _ = polar(axes.T)  # columns: the right-angled triad nearest to the input axes
    turn = Rotation.from_matrix(triad).as_rotvec()
    words = {}
    for i, a in enumerate("xyz"):
        words["scale factor error", a] = 1e6 * (gain[i] - 1)
        words["triad rotation", a] = 1e3 * turn[i]
        words["bias", a] = -(M @ unit.B)[i] / DEG
        for j, b in enumerate("xyz"):
            if i != j:
                words["misalignment", f"{a} to {b}"] = 1e3 * np.arctan(axes[i, j] / axes[i, i])
    for pair, (i, j) in {"xy": (0, 1), "yz": (1, 2), "zx": (2, 0)}.items():
        words["nonorthogonality", pair] = 1e3 * (np.pi / 2 - np.arccos(axes[i] @ axes[j]))
    # The register's rounding is white noise as well, over the band up to half the data rate.
    rounding = (gyro_rps_per_lsb(options.gyro_fs_dps) / DEG) ** 2 / 12 * 2 * period_s
    for a in "xyz":
        words["angle random walk", a] = 60 * np.sqrt((options.gyro_noise_dps_rthz**2 + rounding) / 2)
        words["bias instability", a] = options.bias_instability_dph
    return words


def hidden_in_words(K: np.ndarray, half: np.ndarray) -> dict[tuple[str, str], float]:
    words = {("g-sensitivity", f"{a} per g on {b}"): K[i, j] for i, a in enumerate("xyz") for j, b in enumerate("xyz")}
    # Gains 1 + k and 1 - k: their difference over their mean.
    return words | {("scale factor asymmetry", a): 1e6 * 2 * half[i] for i, a in enumerate("xyz")}


def _row(word: str, by_session: list[list[float]]) -> list[str]:
    z = np.concatenate([np.array(part) for part in by_session if part])
    shares = np.array([np.mean(np.abs(part) < 2) for part in by_session if part])
    known = 100 * shares.std(ddof=1) / np.sqrt(len(shares))
    inside = 100 * np.mean(np.abs(z) < 2)
    return [word, str(len(z)), f"{inside:.1f} ± {known:.1f} %", f"{100 * np.mean(np.abs(z) < 1):.1f} %", f"{np.sqrt(np.mean(z**2)):.2f}"]


def _absent(results: list[dict]) -> str:
    words = [word for result in results for word in result["absent"]]
    return ", ".join(f"{word} ({words.count(word)})" for word in dict.fromkeys(words)) or "nothing"


if __name__ == "__main__":
    main()
