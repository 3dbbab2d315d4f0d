"""What hangs on each threshold of ``explain``: names found, wrong names and false alarms at half, at once, and at double its value.

    python benchmarks/thresholds.py [mends|naming|strong|truth …] [--only NAME …] [--markdown FILE]

mends: registers and stills of sessions that hide what is found there, or nothing; naming: the names for what is hidden in the rates, and
for nothing; strong: the same where an effect at its full size leaves what its model simplifies; truth:
sessions with a truth file, 30 turns, each with one thing wrong or nothing.  A share above a half is halved and doubled in its distance
from 1, a whole number rounded.  A constant that moves nothing is not critical in these sessions; others may need it.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

from session.io.errors import CalibrationError
from session.io.folder import read_session

PACKAGES = ("tinygc.explanation", "tinygc.noise", "session.detect")
CLIPPED, REPAIR, FAULTY = (f"tinygc.explanation.{name}" for name in ("clipped_turns", "data_repair", "faulty_readings"))
EVIDENCE, SEARCH, DECISION = (f"tinygc.explanation.{name}" for name in ("evidence", "search", "decision"))
WATCHED = {
    "mends": {
        CLIPPED: "FEWEST_WHOLE LEVEL_KNOWN PLATEAU_EXCESS CEILING_EXCESS OUTLIER_SIGMAS VERTICAL CORNER LEAST_CEILING "
        "FLAT NOISES FEWEST SAME SHORTEST_S LEAST WHOLE ALIKE",
        REPAIR: "LONGEST_LOSS_S CERTAIN PASSES OPEN KEPT",
        FAULTY: "JUMP SPIKE FLANK NEIGHBOURHOOD_S NEIGHBOURHOOD START_S ALONE LOSS_IN_ACCEL PER_SECOND "
        "LONGEST SIDE BEYOND CAME_BACK SHARE NOISE_MISSES LEAST_NOISE_LSB",
        "session.detect.bridging": "SIDE AS_FAST FEWEST_TRIALS MOST_TRIALS",
    },
    "naming": {
        "tinygc.noise.candidates": "MOST_TIMES",
        EVIDENCE: "PRIOR_ODDS SCALES FIRST_STEPS MORE_STEPS GUESS_STEPS DRAWS FAMILY_WISE UNSEEN UNSEEN_BESIDE",
        SEARCH: "STAND_IN MOST_EFFECTS MOST_TRIALS WITHIN BEAM NEAR MOST_EXACT LINEAR_SHARE MOST_LOOKALIKES "
        "PLAUSIBLE_RPS LEAST_CHANGE_C LIKE_THE_EARTH ANOTHER_DEG",
        "tinygc.noise.components": "TYPICAL_SPREAD GIVEN_SPREAD LEAST_UNDERSAMPLING FACTOR_SPREAD FILTERED_SPREAD BLOCK UNUSUAL",
        "tinygc.noise.reml": "NOTHING",
        DECISION: "SAID INSTEAD MOST_FINDINGS BORNE_OUT_P",
        "tinygc.noise.refit": "MAX_STEPS ENOUGH GRAVITY_SIGMA KNOWN",
        "tinygc.noise.channels": "LAGS",
        "tinygc.noise.turn_gravity": "ALARMS BLOCK_S FILTERS_PERIODS MOVING",
        "tinygc.noise.whitening": "ACCEL_INSTABILITY_MPS2 PRECALIBRATION_MPS2",
    },
    "strong": {
        EVIDENCE: "PRIOR_ODDS SCALES",
        SEARCH: "WITHIN NEAR LINEAR_SHARE MOST_LOOKALIKES",
        DECISION: "SAID INSTEAD BORNE_OUT_P",
    },
    "truth": {
        "tinygc.explanation.truth_engine": "FRAME_RAD FRAME_SIGMAS FRAME_LEAVES JUMP OPPOSITE",
        "tinygc.explanation.truth_names": "WANDER_S",
        "tinygc.explanation.truth_evidence": "IMPLAUSIBLE FORCE_WINDOW_S",
    },
}
NEAR_ONE = 0.55
TRUTH_TOML = (
    'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 104.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n'
    '[protocol]\nsegment_s = 2.0\nreference = "truth"\ntruth_sigma_deg = 0.02\n'
)


def scaled(value, factor: float):
    """Half or double of it."""
    if isinstance(value, int):
        return max(1, round(value * factor))
    return 1 - (1 - value) / factor if NEAR_ONE <= value < 1 else value * factor


class Changed:
    """One constant at another value, wherever it has been imported to."""

    def __init__(self, module: str, name: str, factor: float):
        own = importlib.import_module(module)
        self.name, self.old, self.new = name, getattr(own, name), scaled(getattr(own, name), factor)
        self.places = [own] + [m for m in _modules() if m is not own and _imports(m, own.__name__, name)]

    def __enter__(self):
        for place in self.places:
            setattr(place, self.name, self.new)

    def __exit__(self, *_):
        for place in self.places:
            setattr(place, self.name, self.old)


@cache
def _modules() -> list:
    packages = [importlib.import_module(name) for name in PACKAGES]
    return [importlib.import_module(each.name) for p in packages for each in pkgutil.iter_modules(p.__path__, p.__name__ + ".")]


@cache
def _imports(module, source: str, name: str) -> bool:
    text = Path(module.__file__).read_text(encoding="utf-8")
    at = text.find(f"from {source} import")
    line = text[at : text.find(")" if text[at:].split("\n")[0].endswith("(") else "\n", at)] if at >= 0 else ""
    return name in line.replace(",", " ").replace("(", " ").split()


def settings(stage: str, only: list[str] | None) -> list[tuple[str, str, float]]:
    """module, constant, factor."""
    watched = [(module, name) for module, names in WATCHED[stage].items() for name in names.split() if not only or name in only]
    return [(module, name, factor) for module, name in watched for factor in (0.5, 2.0)]


def hidden_in(stage: str) -> list:
    """What is looked at: concealed effects with the session's options, or kinds of a wrong truth with their seeds."""
    if stage == "truth":
        return [(kind, seed) for kind in TRUTH_KINDS for seed in (1, 2)]
    from tinygc.simulation.options import SimulationOptions

    def case(ids: tuple[str, ...], strength: float, seed: int) -> tuple[dict[str, float], SimulationOptions]:
        options = SimulationOptions(closure_s=0.0, segments=24, seed=seed, odr_hz=104.0, warm_up_c=6.0 if "thermal" in str(ids) else 2.0)
        return dict.fromkeys(ids, strength), options

    nothing = [case((), 1.0, seed) for seed in range(8 if stage == "mends" else 4)]
    if stage == "mends":
        kinds = ("gyro.saturation", "timing.dropped_samples", "data.glitches", "reference.not_still")
        return nothing + [case((kind,), s, 100 + 10 * i + j) for i, kind in enumerate(kinds) for j, s in enumerate((1.0, 0.5, 0.2, 0.05))]
    if stage == "strong":
        alone = ("gyro.bandwidth", "gyro.scale_nonlinearity", "gyro.angular_acceleration", "gyro.vibration_rectification")
        pairs = (("gyro.bandwidth", "gyro.g_sensitivity"), ("timing.axis_skew", "gyro.scale_nonlinearity"))
        hidden = [*((name,) for name in alone), *pairs]
        return [case(ids, 1.0, 500 + i) for i, ids in enumerate(hidden)]
    ones = (
        *(("gyro.g_sensitivity", 0.2), ("gyro.scale_asymmetry", 0.05), ("gyro.bias_step", 0.2), ("gyro.bandwidth", 0.5)),
        *(("timing.axis_skew", 0.2), ("timing.gyro_accel_offset", 0.5), ("reference.accelerometer", 0.5), ("gyro.thermal_bias", 0.5)),
    )
    two = (("gyro.g_sensitivity", "gyro.bias_step"), ("gyro.angular_acceleration", "gyro.scale_nonlinearity"))
    return (
        nothing + [case((name,), s, 200 + i) for i, (name, s) in enumerate(ones)] + [case(pair, 0.5, 300 + i) for i, pair in enumerate(two)]
    )


def looked_at(job: tuple[str, object, list[tuple[str, str, float]]]) -> dict:
    """(right names, wrong names, alarm) of one session at every setting; None: as it is."""
    stage, case, changes = job
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        hidden, look = (_wrong_truth if stage == "truth" else _concealed)(case, Path(parent) / "session", stage)
        found = {None: _judged(hidden, look)}
        for change in changes:
            with Changed(*change):
                found[change] = _judged(hidden, look)
    return {"hidden": len(hidden), "found": found}


def _judged(hidden: set[str], look: Callable[[], tuple[set[str], bool]]) -> tuple[int, int, bool]:
    try:
        names, alarm = look()
    except (CalibrationError, np.linalg.LinAlgError, ValueError):
        return 0, 0, True
    return len(names & hidden), len(names - hidden), alarm


def _concealed(case, folder: Path, stage: str):
    from tinygc.annexes.challenge.examination import conceal
    from tinygc.closure.build import build_problem
    from tinygc.explanation.claims import offset_claim
    from tinygc.explanation.data_repair import repair
    from tinygc.explanation.decision import decide
    from tinygc.noise.turn_gravity import turn_gravity
    from tinygc.noise.twin import Twin
    from tinygc.simulation.write import write_files

    strengths, options = case
    simulation, toml, _ = conceal(strengths, options, np.random.default_rng(options.seed))
    write_files(simulation, folder, toml)
    problem = build_problem(read_session(folder))

    def mends() -> tuple[set[str], bool]:
        names = set(repair(problem).found)
        return names, bool(names)

    def naming() -> tuple[set[str], bool]:
        twin = Twin(problem)
        decision = decide(twin, 0)
        names = {named.effect.id for named in decision.named}
        names |= {claim.effect.id for claim in offset_claim(turn_gravity(twin, decision.fit), [])}
        return names, bool(names) or decision.refused

    return set(strengths), mends if stage == "mends" else naming


TRUTH_KINDS = {
    "nothing": {},
    "timing.truth_offset": {"late_s": 0.004},
    "gyro.bias_drift": {"drift_dps": (0.1, 0.0, -0.08)},
    "gyro.g_sensitivity": {"dps_per_g": 0.1},
    "reference.truth_frame": {"frame_deg": (1.0, -0.6, 0.3)},
    "reference.truth_jump": {"jump_deg": 0.6},
    "refused": {"dps_per_g": 4.0},
}


def _wrong_truth(case: tuple[str, int], folder: Path, stage: str):
    from tinygc.explanation.truth_engine import explain_truth

    kind, seed = case
    _write_truth(folder, seed, **TRUTH_KINDS[kind])

    def look() -> tuple[set[str], bool]:
        found = explain_truth(folder)
        names = {claim.effect.id for claim in found.claimed} - {"unknown.slow_bias"}
        return names, found.verdict != "no_mismatch"

    return ({kind} & set(TRUTH_KINDS)) - {"nothing", "refused"}, look


def _write_truth(folder: Path, seed: int, *, late_s=0.0, drift_dps=(0.0, 0.0, 0.0), dps_per_g=0.0, frame_deg=(0.0, 0.0, 0.0), jump_deg=0.0):
    """60 s of turns without a rest, a truth every 0.1 s with 0.02 deg of noise of its own, and one thing wrong."""
    from scipy.spatial.transform import Rotation

    rng, rate_hz, deg = np.random.default_rng(seed), 104.0, np.pi / 180
    turns = [Rotation.from_rotvec(rng.uniform(40, 120) * deg * (axis := rng.normal(size=3)) / np.linalg.norm(axis)) for _ in range(30)]
    starts = [Rotation.identity()]
    for turn in turns:
        starts.append(starts[-1] * turn)

    def attitude(t_s: np.ndarray) -> Rotation:
        number = np.clip((t_s / 2).astype(int), 0, 29)
        part = t_s / 2 - number
        done = part - np.sin(2 * np.pi * part) / (2 * np.pi)
        vectors = np.array([turn.as_rotvec() for turn in turns])[number]
        return Rotation.concatenate([starts[n] for n in number]) * Rotation.from_rotvec(done[:, None] * vectors)

    t_s = np.arange(0, 60, 1 / rate_hz)
    number = np.clip((t_s / 2).astype(int), 0, 29)
    rate = np.array([turn.as_rotvec() for turn in turns])[number] * ((1 - np.cos(2 * np.pi * (t_s / 2 - number))) / 2)[:, None]
    force = attitude(t_s).inv().apply([0, 0, -9.80665]) + rng.normal(size=rate.shape) * 4e-3
    noise = rng.normal(size=rate.shape) * 5e-3 * deg * np.sqrt(rate_hz / 2)
    drift = np.multiply(drift_dps, deg) * (t_s / t_s[-1])[:, None]
    gyro = rate + noise + np.multiply((0.5, -0.3, 0.6), deg) + drift + dps_per_g * deg * force[:, [1, 2, 0]] / 9.80665
    moments = np.arange(0.3, 59.7, 0.1)
    truth = attitude(moments - late_s) * Rotation.from_rotvec(rng.normal(size=(len(moments), 3)) * 0.02 * deg)
    truth = truth * Rotation.from_rotvec(np.multiply(frame_deg, deg))
    if jump_deg:  # at two moments that segments of 2 s end at
        rows = [200, 400]
        bent = Rotation.from_rotvec([[jump_deg * deg, 0, 0] if row in rows else [0, 0, 0] for row in range(len(moments))])
        truth = truth * bent
    folder.mkdir(parents=True)
    (folder / "session.toml").write_text(TRUTH_TOML)
    header = "t_s,gx_rps,gy_rps,gz_rps,ax_mps2,ay_mps2,az_mps2"
    np.savetxt(folder / "log0001.csv", np.column_stack([t_s, gyro, force]), fmt="%.10f", delimiter=",", header=header, comments="")
    q = np.column_stack([moments, truth.as_quat(scalar_first=True)])
    np.savetxt(folder / "truth0001.csv", q, fmt="%.10f", delimiter=",", header="t_s,qw,qx,qy,qz", comments="")


def table(stage: str, results: list[dict], changes: list[tuple[str, str, float]]) -> str:
    """A row a constant: its value, and right of hidden, wrong, alarms where nothing is hidden, at half, at once, at double."""
    hidden, quiet = sum(r["hidden"] for r in results), [r for r in results if not r["hidden"]]

    def cell(change) -> str:
        right, wrong = (sum(r["found"][change][i] for r in results) for i in (0, 1))
        return f"{right}, {wrong}, {sum(r['found'][change][2] for r in quiet)}"

    rows = []
    for module, name, factor in changes:
        if factor == 0.5:
            value = getattr(importlib.import_module(module), name)
            label = f"{module.rsplit('.', 1)[1]}.{name}"
            rows.append((label, f"{value:.4g}", cell((module, name, 0.5)), cell(None), cell((module, name, 2.0))))
    head = f"{stage}: right of {hidden}, wrong, alarms of {len(quiet)} without a name"
    return markdown((head, "value", "half", "as it is", "double"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stages", nargs="*", help=f"of {', '.join(WATCHED)} (all)")
    parser.add_argument("--only", nargs="*", metavar="NAME", help="these constants")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="append the tables to it")
    args = parser.parse_args()
    for stage in args.stages or WATCHED:
        changes = settings(stage, args.only)
        results = in_parallel(looked_at, [(stage, case, changes) for case in hidden_in(stage)], f"{stage} session")
        text = table(stage, results, changes)
        print(text + "\n", flush=True)
        if args.markdown:
            with args.markdown.open("a", encoding="utf-8") as file:
                file.write(text + "\n\n")


if __name__ == "__main__":
    main()
