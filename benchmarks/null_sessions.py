"""False alarms of ``explain``: sessions in which nothing is concealed, each with its own noise, length, vigour, rate and warm-up.

    python benchmarks/null_sessions.py [--sessions 200] [--noise-factor 1.3] [--seed 0]

Prints the share of sessions whose verdict is not ``no_mismatch``, the Kolmogorov-Smirnov test of the detection p-values against a
uniform law, what was named, and the alarms by data rate and by bias instability.  --noise-factor: all noise, the bias instability too,
that much larger.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np
from common import in_parallel, markdown, simulated
from scipy import stats

from session.base.errors import CalibrationError
from tinygc.noise.channels import channel_p_values
from tinygc.simulation.options import SimulationOptions

RATES_HZ = (62.5, 104.0, 208.0, 416.0, 833.0)
MOST_INSTABILITY_DPH = 10.0


def drawn(seed: int, noise_factor: float) -> SimulationOptions:
    """Options of one null session; white noise 3 to 10 mdps/sqrt(Hz), whose datasheet says 5; bias instability 0 to 10 deg/h."""
    rng = np.random.default_rng([seed, 20260])
    return SimulationOptions(
        seed=seed,
        closure_s=0.0,
        segments=int(rng.integers(20, 61)),
        vigour=float(rng.uniform(0.5, 1.5)),
        odr_hz=float(rng.choice(RATES_HZ)),
        warm_up_c=float(rng.uniform(0, 8)),
        gyro_noise_dps_rthz=float(rng.uniform(0.003, 0.010)) * noise_factor,
        accel_noise_ug_rthz=60.0 * noise_factor,
        bias_instability_dph=float(rng.uniform(0, MOST_INSTABILITY_DPH)) * noise_factor,
    )


def explained(job: tuple[int, float]) -> dict:
    """What ``explain`` says of one null session."""
    from tinygc.explanation.engine import explain_session

    options = drawn(*job)
    began = time.perf_counter()
    with simulated(options) as folder:
        try:
            result = explain_session(folder)
        except CalibrationError as error:
            return {"seed": options.seed, "refused": str(error)}
    return {
        "seed": options.seed,
        "segments": options.segments,
        "odr_hz": options.odr_hz,
        "gyro_noise_dps_rthz": options.gyro_noise_dps_rthz,
        "bias_instability_dph": options.bias_instability_dph,
        "verdict": result.verdict,
        "p_value": result.p_value,
        "first_p": result.naming.first_p,
        "channel_p": channel_p_values(result.twin, result.whiten, result.naming.first.r, result.naming.first.J),
        "named": [claim.effect.id for claim in result.claimed],
        "findings": [finding.effect.id for finding in result.findings],
        "seconds": time.perf_counter() - began,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first session")
    parser.add_argument("--noise-factor", type=float, default=1.0, help="all noise so many times the datasheet's")
    args = parser.parse_args()
    results = in_parallel(explained, [(args.seed + i, args.noise_factor) for i in range(args.sessions)], "null sessions")
    refused = [result for result in results if "refused" in result]
    results = [result for result in results if "refused" not in result]
    count, alarms = len(results), [result for result in results if result["verdict"] != "no_mismatch"]
    share = len(alarms) / count
    names = Counter(name for result in alarms for name in result["named"] or ["(no name)"])
    rows = [
        ("sessions", f"{count}" + (f" ({len(refused)} refused)" if refused else "")),
        ("false alarms", f"{100 * share:.1f} % ± {100 * np.sqrt(max(share, 1 / count) * (1 - share) / count):.1f} %"),
        ("detection p-values: KS p", f"{_uniform([result['p_value'] for result in results]):.3g}"),
        ("of the selection alone", f"{_uniform([result['first_p'] for result in results]):.3g}"),
    ]
    for channel in results[0]["channel_p"]:
        rows.append((f"of the {channel} channel alone", f"{_uniform([result['channel_p'][channel] for result in results]):.3g}"))
    deciles = np.histogram([result["p_value"] for result in results], bins=10, range=(0, 1))[0]
    rows.append(("detection p-values by tenths", " ".join(map(str, deciles))))
    rows.append(("alarms by Hz", _alarms(results, alarms, "odr_hz", RATES_HZ)))
    thirds = tuple(np.linspace(0, MOST_INSTABILITY_DPH * args.noise_factor, 4).round(1)[1:])
    rows.append(("alarms up to a bias instability, °/h", _alarms(results, alarms, "bias_instability_dph", thirds)))
    rows.append(("falsely named", ", ".join(f"{name} {times}" for name, times in names.most_common()) or "nothing"))
    rows.append(("median seconds a session", f"{np.median([result['seconds'] for result in results]):.1f}"))
    print(markdown(("null sessions", f"noise × {args.noise_factor:g}"), rows))
    for result in refused:
        print(f"seed {result['seed']} refused: {result['refused']}")


def _alarms(results: list[dict], alarms: list[dict], name: str, edges: tuple[float, ...]) -> str:
    """``edge: alarms of sessions``, of those whose value lies up to each edge."""
    groups = zip((-np.inf, *edges[:-1]), edges, strict=True)
    count = lambda among, low, high: sum(low < each[name] <= high for each in among)  # noqa: E731
    return ", ".join(f"{high:g}: {count(alarms, low, high)} of {count(results, low, high)}" for low, high in groups)


def _uniform(p_values: list[float]) -> float:
    """p-value of the Kolmogorov-Smirnov test against the uniform law."""
    return float(stats.kstest(p_values, "uniform").pvalue)


if __name__ == "__main__":
    main()
