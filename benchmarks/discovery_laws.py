"""The examination of discovery: the laws of ``hidden_laws.py``, each at 3 and at 10 times the floor, judged by the rate on new movement.

    python benchmarks/discovery_laws.py [--half development|examination] [--only NAME …] [--times 3 10] [--clean N] [--seed N] --json FILE

Each law is hidden in a session, which ``explain --discover`` searches.  A second session of the same unit and law, with other movement, is
drawn and never shown: the stated law with its stated numbers must explain 95 % of the variance of the true law's rate there, beyond a
calibration (a bias and a matrix of the rate) and beyond what is stated as not observed.  ``strictly`` counts that, too.  *Right* is a law
that is stated as found and does; *wrong* one that is stated as found and does not.  Names of the catalogue alone that do are ``named``.
``fit --physics auto --effects`` is run where files were written, and its closure run must not have a worse yaw than without them.

The floor is what noise does to the closure of a turn: white noise of the rate over the turn, and of gravity at both ends.  Once the
floor is a law whose turns miss by as much, rms of roll and pitch, beyond what a calibration takes up.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import markdown, progress
from hidden_laws import DEG, DEVELOPMENT, EXAMINATION, LAWS, WARM, WARM_C, Scene
from scipy.spatial.transform import Rotation

from session.base.units import G
from session.log.samples import Samples
from tinygc.effects import Conditions, Movement, catalogue, movement_of, using
from tinygc.simulation import sensor, simulator
from tinygc.simulation.movement import motion_of
from tinygc.simulation.options import GYRO_LPF2_HZ, SimulationOptions
from tinygc.simulation.write import write_session

SEGMENTS, ODR_HZ, TIMES = 40, 104.0, (3.0, 10.0)
#: least share of the variance of the true rate
ENOUGH = 0.95
#: deg: by so much a yaw may change without being worse: noise of two fits
YAW_DEG = 0.05


def options_of(name: str, seed: int, second: bool) -> SimulationOptions:
    """Of a session; the second is of the same unit, begins a degree warmer, and moves otherwise."""
    return SimulationOptions(
        segments=SEGMENTS,
        closure_s=0.0 if second else 58.0,
        seed=seed + 5000 * second,
        unit_seed=seed,
        odr_hz=ODR_HZ,
        warm_up_c=WARM_C if name in WARM else 1.5,
        temperature_start_c=26.0 if second else 25.0,
    )


def factors(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Three and nine factors of about one, of either sign."""
    rng = np.random.default_rng([seed, 1])
    k, K = (rng.uniform(0.6, 1.4, size) * rng.choice((-1.0, 1.0), size) for size in (3, 9))
    return k, K.reshape(3, 3)


def law_of(name: str, seed: int):
    """distort(t, rate, force, temp) of a law of unit size: what it adds."""
    k, K = factors(seed)

    def added(t, rate, force, temp):
        scene = Scene(t, rate, force / G, np.asarray(temp), 500 * DEG, k, K)
        return np.broadcast_to(LAWS[name](scene), rate.shape)

    return added


def unit_closure(options: SimulationOptions, added) -> tuple[float, float]:
    """rad rms of roll and pitch by which the turns miss through the law, beyond a calibration; and through noise."""
    plan, unit = simulator.plan_of(options), simulator.unit_of(options)
    t = np.arange(int(plan.log_s * ODR_HZ)) / ODR_HZ
    rate, force, temp = motion_of(options, unit, plan)(t)
    columns = [added(t, rate, force, temp)]
    for axis in range(3):
        columns += [np.eye(3)[axis] * x[:, None] for x in (np.ones(len(t)), *rate.T)]
    missed, noise = [], []
    for start_s, stop_s in plan.turns:
        rows = slice(int((start_s - 0.5) * ODR_HZ), int((stop_s + 0.5) * ODR_HZ) + 1)
        steps = Rotation.from_rotvec(rate[rows] / ODR_HZ)
        now, turned = Rotation.identity(), []
        for step in steps:
            turned.append(now.as_matrix())
            now = now * step
        down = -force[rows][0] / np.linalg.norm(force[rows][0])
        level = np.linalg.svd(down[None])[2][1:]
        missed.append([level @ np.einsum("nij,nj->i", turned, column[rows]) / ODR_HZ for column in columns])
        seconds = stop_s - start_s + 1.0
        noise.append((options.gyro_noise_dps_rthz * DEG) ** 2 / 2 * seconds + 2 * (options.accel_noise_ug_rthz * 1e-6) ** 2 / 2)
    law, *known = np.array(missed).transpose(1, 0, 2).reshape(len(columns), -1)
    design = np.array(known).T
    left = law - design @ np.linalg.lstsq(design, law, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2))), float(np.sqrt(np.mean(noise)))


def signals_of(options: SimulationOptions, added, size: float) -> tuple[Movement, np.ndarray]:
    """Movement without noise, as the chip's low-pass shows it, and the law's rate (N, 3) behind the same low-pass."""
    plan, unit = simulator.plan_of(options), simulator.unit_of(options)
    factor, run_up = sensor.oversampling(unit.odr_hz), simulator.run_up_samples(unit.odr_hz)
    t = sensor.fine_times(unit.odr_hz, -run_up, int(np.ceil(plan.log_s * unit.odr_hz)))
    rate, force, temp = motion_of(options, unit, plan)(t)

    def sampled(values: np.ndarray, hz: float) -> np.ndarray:
        return sensor.LowPass(hz, 0.0, unit.odr_hz, np.random.default_rng(0))(values)[run_up:]

    hz = GYRO_LPF2_HZ[options.odr_hz]
    law, shown = sampled(size * added(t, rate, force, temp), hz), sampled(rate, hz)
    felt = sampled(force, sensor.ACCEL_BANDWIDTH_ODR * unit.odr_hz)
    samples = Samples(np.rint(1e9 * t[run_up * factor :: factor]).astype(np.int64), shown, felt, temp[run_up * factor :: factor])
    return movement_of(samples, shown, Conditions(plan.log_s, options.gyro_fs_dps * DEG, options.temperature_start_c)), law


def stated(laws: list[dict], beside: list[dict], folder: Path, movement: Movement) -> np.ndarray:
    """Rate of the stated laws and names together with their stated numbers, (N, 3) rad/s."""
    found = np.zeros_like(movement.rate)
    with using([str(folder / "effects")] if laws else []):
        for each in [*laws, *beside]:
            effect, told = catalogue()[each["id"]], dict(each["parameters"])
            told |= {name: constant["value"] for name, constant in each.get("constants", {}).items()}
            if effect.kind != "rate":
                continue
            if effect.scan is not None and effect.scan.name in told:
                effect = effect.at(float(told[effect.scan.name]) * effect.scan.si)
            forms = [form for form in (effect, effect.of_readings, effect.wider) if form is not None]
            form = next(form for form in forms if form.parameter.name in told and np.size(told[form.parameter.name]) == form.parameter.size)
            theta = np.ravel(told[form.parameter.name]) * form.parameter.si
            found += form.distort(movement, theta) - movement.rate
    return found


def explained_share(movement: Movement, true: np.ndarray, said: np.ndarray, unseen: list[np.ndarray]) -> float:
    """Share of the variance of the true rate, beyond a bias, a matrix of the rate, and some directions, that the stated one explains."""
    known = np.column_stack([np.ones(len(true)), movement.rate])
    q = np.linalg.qr(known)[0]
    left = [values - q @ (q.T @ values) for values in (true, true - said, *unseen)]
    if unseen:
        u = np.linalg.qr(np.stack([values.ravel() for values in left[2:]], axis=1))[0]
        left = [values.ravel() - u @ (u.T @ values.ravel()) for values in left[:2]]
    return 1 - float(np.sum(left[1] ** 2) / max(np.sum(left[0] ** 2), 1e-30))


def one(name: str, times: float, seed: int) -> dict:
    """What came of one law at one size; name "" hides nothing."""
    import tinygc

    result: dict = {"law": name, "times": times, "seed": seed}
    first, second = options_of(name, seed, False), options_of(name, seed, True)
    distort, added, size = None, None, 0.0
    if name:
        added = law_of(name, seed)
        missed, floor = unit_closure(first, added)
        size = times * floor / missed
        distort = lambda t, rate, force, temp: rate + size * added(t, rate, force, temp)  # noqa: E731
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        folder = write_session(first, Path(parent) / "first", distort=distort)
        begun, cpu = time.perf_counter(), time.process_time()
        why = tinygc.explain(folder)
        between = time.process_time()
        why = _discovery(why)
        result |= {"explain_s": between - cpu, "discover_s": time.process_time() - between, "wall_s": time.perf_counter() - begun}
        why.save(pictures=False)
        table = why.to_json()
        said = table["discovery"]
        laws = said["laws"]
        result |= {
            "verdict": said["verdict"],
            "why": said["why"],
            "named": [each["id"] for each in table["effects"]],
            "equations": [each["equation"] for each in laws],
            "others": [[other["equation"] for other in each["runners_up"]] for each in laws],
            "near": [[(other["worse_by"], other["correlation"]) for other in each["runners_up"]] for each in laws],
            "not_observed": [direction["in_words"] for each in laws for direction in each["not_observed"]],
            "work": said.get("work"),
        }
        if name:
            movement, true = signals_of(second, added, size)
            beside = said["catalogue_effects"] if laws else table["effects"]
            rate, unseen = stated(laws, beside, folder / "explain", movement), _unseen(why.beyond.laws, first, movement)
            result["strict_share"] = explained_share(movement, true, rate, [])
            result["share"] = explained_share(movement, true, rate, unseen)
        if laws:
            result |= _yaw(folder)
    result["outcome"] = _outcome(result)
    return result


def _unseen(laws, first: SimulationOptions, movement: Movement) -> list[np.ndarray]:
    """Rates (N, 3) of the combinations of coefficients that are stated as not observed; temperatures count from the first session's."""
    from tinygc.features.discovery.law_effect import columns_of

    there = replace(movement, first_temp_c=first.temperature_start_c)
    return [columns_of(law.form, there) @ direction for law in laws for direction in law.unobserved]


def _discovery(why):
    from tinygc.features.discovery.engine import discover
    from tinygc.features.discovery.report import DiscoveryReport

    return DiscoveryReport(why.explanation, discover(why.explanation))


def _yaw(folder: Path) -> dict:
    """Yaw of the closure run, deg, by the linear model and by ``fit --physics auto --effects``; the ids that the latter takes, and whether
    the fit recommends it."""
    import tinygc

    without = tinygc.fit(folder, methods=("least_squares",))
    with using([str(folder / "explain" / "effects")]):
        fit = tinygc.fit(folder, methods=("least_squares",), physics=("auto",))
    (before,), (after,) = without.closure_runs.values(), fit.closure_runs.values()
    return {
        "yaw_without_deg": before["least_squares"]["yaw_deg"],
        "yaw_with_deg": after["physics"]["yaw_deg"],
        "taken": [claim.effect.id for claim in fit.result.methods["physics"].model.undone],
        "recommended": fit.to_json()["use"]["method"] == "physics",
    }


def _outcome(result: dict) -> str:
    if not result["law"]:
        return {"none": "silent", "ambiguous": "candidate", "found": "invented"}[result["verdict"]]
    good = result["share"] >= ENOUGH
    if result["verdict"] == "found":
        return "right" if good else "wrong"
    if result["verdict"] == "ambiguous":
        return "candidate, right" if good else "candidate"
    return "named" if good and result["named"] else "none"


def row(r: dict) -> tuple:
    share = "–" if "share" not in r else f"{100 * r['share']:.1f} %"
    yaw = "–" if "yaw_with_deg" not in r else f"{r['yaw_without_deg']:.2f} → {r['yaw_with_deg']:.2f}"
    said = "; ".join(each.split(", ")[0] for each in r["equations"]) or r["why"] or ", ".join(r["named"])
    half = "d" if r["law"] in DEVELOPMENT else "e"
    return (
        f"{r['law'] or 'nothing'} ({half})",
        f"{r['times']:g}",
        r["outcome"],
        share,
        yaw,
        f"{r['discover_s']:.0f}",
        said[:110].replace("|", "\\|"),
    )


HEADER = ("law", "times the floor", "outcome", "rate explained", "yaw, °", "s", "stated, or why none")


def summary(results: list[dict]) -> list[str]:
    lines = []
    hidden = [r for r in results if r["law"]]
    for half, names in (("development", DEVELOPMENT), ("examination", EXAMINATION), ("both", tuple(LAWS))):
        for times in sorted({r["times"] for r in hidden}):
            own = [r for r in hidden if r["times"] == times and r["law"] in names]
            if own:
                right, wrong = (sum(r["outcome"] == what for r in own) for what in ("right", "wrong"))
                named, candidates = sum(r["outcome"] == "named" for r in own), sum(r["outcome"] == "candidate, right" for r in own)
                lines.append(
                    f"{half}, {times:g} times: {right} of {len(own)} right ({100 * right / len(own):.0f} %), {wrong} wrong, "
                    f"{named} right by names of the catalogue, {candidates} right and stated as candidates"
                )
    recommended = [r for r in results if r.get("recommended") and any(each.startswith("discovered.") for each in r["taken"])]
    worse = [r["law"] for r in recommended if abs(r["yaw_with_deg"]) > abs(r["yaw_without_deg"]) + YAW_DEG]
    lines.append(f"closure run's yaw worse with a recommended law: {len(worse)} of {len(recommended)} {worse}")
    strictly = [r for r in hidden if r["verdict"] == "found" and r["strict_share"] < ENOUGH]
    lines.append(f"found, below {100 * ENOUGH:.0f} % with what is not observed: {len(strictly)} {[r['law'] for r in strictly]}")
    seconds = [r["discover_s"] for r in results]
    lines.append(f"seconds of the search, CPU: median {np.median(seconds):.0f}, most {max(seconds):.0f}")
    if clean := [r for r in results if not r["law"]]:
        lines.append(f"nothing hidden: {sum(r['outcome'] != 'silent' for r in clean)} of {len(clean)} with an equation")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", choices=("development", "examination"))
    parser.add_argument("--only", nargs="*", metavar="NAME", help="laws; nothing after it: none")
    parser.add_argument("--times", nargs="+", type=float, default=list(TIMES))
    parser.add_argument("--clean", type=int, default=0, help="sessions that hide nothing, beside")
    parser.add_argument("--seed", type=int, default=4100)
    parser.add_argument("--json", type=Path, required=True, help="all results, written after each")
    parser.add_argument("--show", action="store_true", help="the tables of a file of results")
    args = parser.parse_args()
    if not args.show:
        halves = {"development": DEVELOPMENT, "examination": EXAMINATION}
        names = halves.get(args.half, EXAMINATION + DEVELOPMENT) if args.only is None else args.only
        jobs = [(name, times) for name in names for times in args.times] + [("", 0.0)] * args.clean
        results = []
        for number, (name, times) in enumerate(jobs):
            progress(f"{name or 'nothing'}, {number + 1} of {len(jobs)}")
            place = 10 * list(LAWS).index(name) + int(times == TIMES[0]) if name else 1000 + number
            results.append(one(name, times, args.seed + place))
            args.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    results = json.loads(args.json.read_text(encoding="utf-8"))
    print(markdown(HEADER, map(row, results)))
    print("\n" + "\n".join(summary(results)))


if __name__ == "__main__":
    main()
