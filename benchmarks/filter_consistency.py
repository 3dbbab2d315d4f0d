"""Whether a filter's covariance holds: with N and K alone, with ten times these, and with the densities that ``inflation`` states.

A small error-state filter integrates the calibrated rate with a white density and a bias walk, and is corrected by an attitude at
intervals.  Its squared error over what it states, per degree of freedom, is 1 for a filter that is consistent (NEES; of the innovations
where the truth is the correction, NIS).  ``simulated``: units with what calibration leaves, over many seeds; the truth is exact.
``broad``, ``euroc``: real recordings with a truth, inflated on one and judged on another; the truth's own error, as found on the first, is
in the covariance of the correction.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from common import in_parallel, markdown, simulated
from public.broad import RATE, read_hdf5
from scipy.linalg import block_diag

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from truth_inflation import Wander, end_differences, truth_inflation

from session.io.errors import DataError
from session.io.units import DEG, DEG_PER_HOUR, NS
from tinygc.annexes.noise.inflation import Inflation, inflations
from tinygc.attitude import rotation
from tinygc.closure.floor import allan_curve
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import Batch
from tinygc.estimation.fit import fit_session
from tinygc.estimation.options import FitOptions
from tinygc.models.linear import LinearModel
from tinygc.noise.figures import TERMS, AxisNoise, NoiseFigures, SensorNoise, Term
from tinygc.simulation import movement
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import Distort, simulate_session

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"
#: time over which the filter's covariance is carried at once, s
CHUNK_S = 0.25


def figures_of(N: np.ndarray, K: np.ndarray, instability: float = 0.0) -> NoiseFigures:
    """Noise figures of a gyroscope whose N, K (3,) and bias instability are known."""

    def axis(n: float, k: float) -> AxisNoise:
        values = {"N": n, "K": k, "B": instability}
        return AxisNoise({t: Term(v := values.get(t, 0.0), 0.0 if v else None, float(v > 0)) for t in TERMS})

    x, y, z = (axis(float(n), float(k)) for n, k in zip(N, K, strict=True))
    return NoiseFigures(SensorNoise((x, y, z)), None, 100.0, 3600.0, 360_000)


# The filter.


@dataclass(frozen=True)
class Reference:
    """Error of the attitudes that correct a filter: sigma_rad (3,) of each alone, and what wanders."""

    sigma_rad: np.ndarray
    wanders: tuple[Wander, ...] = ()

    @property
    def states(self) -> int:
        """How many numbers the wanders have: three each, and three rates where one is smooth."""
        return sum(3 + 3 * each.smooth for each in self.wanders)

    def step(self, span_s: float) -> tuple[np.ndarray, np.ndarray]:
        """F (W, W) over a span, and the stationary covariance P (W, W): the wanders one after the other, rates behind the angles."""
        F, P = [], []
        for each in self.wanders:
            fade, slope = np.exp(-span_s / each.time_s), 1 / each.time_s
            square = np.diag(each.sigma_rad**2)
            if not each.smooth:
                F.append(fade * np.eye(3))
                P.append(square)
                continue
            x = span_s * slope
            F.append(fade * np.kron([[1 + x, span_s], [-x * slope, 1 - x]], np.eye(3)))
            P.append(np.kron(np.diag([1.0, slope**2]), square))
        return block_diag(*F), block_diag(*P)

    @property
    def shown(self) -> np.ndarray:
        """(3, W): the wanders' part of an attitude."""
        parts = [np.hstack([np.eye(3), np.zeros((3, 3))]) if each.smooth else np.eye(3) for each in self.wanders]
        return np.hstack(parts) if parts else np.zeros((3, 0))


class AttitudeFilter:
    """Attitude, bias of the gyroscope, and the reference's wander: an error-state Kalman filter in body axes.

    q: attitude q_wb (4,); bias (3,) rad/s; P (6 + W, 6 + W) of the attitude's error (rad, body), of the bias and of the wanders.
    """

    def __init__(self, q: np.ndarray, white: np.ndarray, walk: np.ndarray, reference: Reference, sigma_rad: np.ndarray, bias_rps: float):
        self.q, self.bias, self._wander = q, np.zeros(3), np.zeros(reference.states)
        self.white2, self.walk2, self._reference = white**2, walk**2, reference
        self.P = np.zeros((6 + reference.states, 6 + reference.states))
        self.P[:6, :6] = np.diag(np.concatenate([sigma_rad**2, np.full(3, bias_rps**2)]))
        if reference.states:
            self.P[6:, 6:] = reference.step(0.0)[1]

    def turn(self, rate: np.ndarray, dt: np.ndarray) -> None:
        """Integrate calibrated rates (M, 3) rad/s over steps dt (M-1,) s."""
        size = max(1, round(CHUNK_S / float(np.median(dt))))
        for first in range(0, len(dt), size):
            self._chunk(rate[first : first + size + 1], dt[first : first + size])

    def _chunk(self, rate: np.ndarray, dt: np.ndarray) -> None:
        turned = rotation.accumulate(rotation.steps(rate - self.bias, dt))
        self.q = rotation.multiply(self.q, turned[-1])
        to_end = rotation.matrix(rotation.multiply(rotation.conjugate(turned[-1]), turned))
        span = float(dt.sum())
        F, Q = np.eye(len(self.P)), np.zeros(self.P.shape)
        F[:3, :3] = rotation.matrix(turned[-1]).T
        F[:3, 3:6] = -np.einsum("tij,t->ij", to_end, dt)
        Q[:3, :3] = np.einsum("tij,j,tkj,t->ik", to_end, self.white2, to_end, dt) + np.diag(self.walk2) * span**3 / 3
        Q[:3, 3:6] = Q[3:6, :3] = -np.diag(self.walk2) * span**2 / 2
        Q[3:6, 3:6] = np.diag(self.walk2) * span
        if self._reference.states:
            F[6:, 6:], stationary = self._reference.step(span)
            Q[6:, 6:] = stationary - F[6:, 6:] @ stationary @ F[6:, 6:].T
            self._wander = F[6:, 6:] @ self._wander
        self.P = F @ self.P @ F.T + Q

    def error(self, q_wb: np.ndarray) -> np.ndarray:
        """(3,) rad: rotation vector from the estimate to an attitude, body axes."""
        return rotation.log(rotation.multiply(rotation.conjugate(self.q), q_wb))

    def correct(self, q_wb: np.ndarray) -> float:
        """Correct by an attitude; returns the innovation's square over its covariance, per degree of freedom."""
        H = np.hstack([np.eye(3), np.zeros((3, 3)), self._reference.shown])
        innovation = self.error(q_wb) - self._reference.shown @ self._wander
        S = H @ self.P @ H.T + np.diag(self._reference.sigma_rad**2)
        gain = np.linalg.solve(S, H @ self.P).T
        change = gain @ innovation
        self.q = rotation.multiply(self.q, rotation.exp(change[:3]))
        self.bias = self.bias + change[3:6]
        self._wander = self._wander + change[6:]
        keep = np.eye(len(self.P)) - gain @ H
        self.P = keep @ self.P @ keep.T + gain @ np.diag(self._reference.sigma_rad**2) @ gain.T
        return float(innovation @ np.linalg.solve(S, innovation)) / 3


def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    """Squared error over its covariance, per degree of freedom."""
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


#: densities: those of the figures; with the walk that all slow terms need; ten times the first; inflated
FILTERS = ("N and K", "N, walk", "× 10", "inflated")


def choices(figures: NoiseFigures, found: Inflation) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Densities of the filters: name -> white (3,), walk (3,)."""
    N, K = figures.gyro.values("N"), figures.gyro.values("K")
    assert found.white_density is not None
    assert found.walk_density is not None
    return dict(zip(FILTERS, ((N, K), (N, found.walk_density), (10 * N, 10 * K), (found.white_density, found.walk_density)), strict=True))


# Simulated units: fitted on one day, judged on another.

#: the unit: white noise and bias instability of the simulation's defaults, as a long rest would show them
OPTIONS = SimulationOptions(segments=40, closure_s=58.0)
#: sigma of the attitude that corrects the filter in each still, and of the bias that it begins with
STOP_RAD, BIAS_RPS = 0.003 * DEG, 10 * DEG_PER_HOUR
#: inflated to the upper limit
AT_MOST = "at most"
#: what the linear calibration leaves, by kind
KINDS = ("noise alone", "g-sensitivity", "scale not linear", "scale changed by 300 ppm since")


def left_by(kind: str, seed: int, day: int) -> Distort | None:
    """What one unit does beyond the linear model on a day; the same on every day, but for the last kind."""
    rng = np.random.default_rng([seed, 77])
    gravity, bend, shift = 0.005 * DEG / 9.8 * rng.standard_normal((3, 3)), 3e-4 * rng.standard_normal(3), 3e-4 * rng.standard_normal(3)
    if kind == "g-sensitivity":
        return lambda t_s, rate, force, temp_c: rate + force @ gravity.T
    if kind == "scale not linear":
        return lambda t_s, rate, force, temp_c: rate * (1 + bend * np.abs(rate) / (100 * DEG))
    if kind.startswith("scale changed") and day:
        return lambda t_s, rate, force, temp_c: rate * (1 + shift)
    return None


def judged(job: tuple[str, int]) -> dict[str, dict[str, list[float]]]:
    """NEES of one unit by name of the filter: of the attitude after each turn and after the closure run, and of the bias at its end;
    also the inflation on turns."""
    kind, seed = job
    with simulated(replace(OPTIONS, seed=1000 + seed, unit_seed=seed), left_by(kind, seed, 0)) as folder:
        fit = fit_session(folder, FitOptions(methods=("least_squares",)))
        model = fit.linear.model
        N = np.full(3, OPTIONS.gyro_noise_dps_rthz * DEG / np.sqrt(2))
        figures = figures_of(N, np.zeros(3), OPTIONS.bias_instability_dph * DEG_PER_HOUR)
        _, turns, _, both = inflations(fit, figures)
    assert isinstance(model, LinearModel)
    options = replace(OPTIONS, seed=2000 + seed, unit_seed=seed)
    simulation = simulate_session(options, left_by(kind, seed, 1))
    units, rng = options.register_units, np.random.default_rng([seed, 5])
    logs = [log for log in (simulation.log, simulation.closure) if log is not None]
    t_s = np.concatenate([log.t_us for log in logs]) * 1e-6
    motion = movement.move(simulation.plan, t_s)
    truth = rotation.from_euler(motion.angles[2], motion.angles[1], motion.angles[0])
    earth_t = movement.earth_rate_table(options.latitude_deg * DEG, simulation.unit.heading_deg * DEG)
    # The Earth's rate is known, and subtracted.
    rate = model(np.concatenate([log.gyro for log in logs]) * units.gyro_rps) - movement.table_to_body(motion.angles, earth_t)
    dt = np.diff(t_s)
    plan = simulation.plan
    assert plan.closure is not None
    rests_s = [start - 0.4 for start, _ in plan.turns] + [plan.closure[0] - 0.4, plan.closure[1] + 0.4]
    rows = np.searchsorted(t_s, rests_s)
    stop = rotation.exp(STOP_RAD * rng.standard_normal((len(rows), 3)))
    reference = Reference(np.full(3, STOP_RAD))
    found: dict[str, dict[str, list[float]]] = {"factor": {"turns": [float(np.sqrt(np.mean(turns.white**2)))]}}
    assert turns.at_most is not None
    assert turns.walk_density is not None
    for name, (white, walk) in (choices(figures, turns) | {AT_MOST: (turns.at_most * N, turns.walk_density)}).items():
        flight = AttitudeFilter(truth[rows[0]], white, walk, reference, np.full(3, STOP_RAD), BIAS_RPS)
        after = []
        for i, (first, last) in enumerate(pairwise(rows[:-1])):
            flight.turn(rate[first : last + 1], dt[first:last])
            after.append(nees(flight.error(truth[last]), flight.P[:3, :3]))
            flight.correct(rotation.multiply(truth[last], stop[i]))
        # The mean over a second of rest is the bias now, but for white noise of N.
        rest = rate[rows[-2] : rows[-2] + round(0.4 / np.median(dt))]
        own = np.full(3, np.square(N[0]) / (len(rest) * float(np.median(dt))))
        bias = nees(rest.mean(axis=0) - flight.bias, flight.P[3:6, 3:6] + np.diag(own))
        if name == "inflated":
            assert both.white_density is not None
            assert both.walk_density is not None
            flight.white2, flight.walk2 = both.white_density**2, both.walk_density**2
        flight.turn(rate[rows[-2] : rows[-1] + 1], dt[rows[-2] : rows[-1]])
        end = nees(flight.error(truth[rows[-1]]), flight.P[:3, :3])
        found[name] = {"turns": after[3:], "closure run": [end], "bias": [bias]}
    return found


def simulated_table(seeds: int) -> str:
    """NEES by kind of what is left: mean over the units, its sigma, and the median."""
    jobs = [(kind, seed) for kind in KINDS for seed in range(seeds)]
    results = in_parallel(judged, jobs, "unit")
    rows = []
    for kind in KINDS:
        mine = [result for (own, _), result in zip(jobs, results, strict=True) if own == kind]
        factor = [result["factor"]["turns"][0] for result in mine]
        for where in ("turns", "closure run", "bias"):
            means = [
                f"{np.mean(each):.2f} ± {np.std(each) / np.sqrt(len(each)):.2f} ({np.median(each):.2f})"
                for name in (*FILTERS, AT_MOST)
                for each in [[np.mean(result[name][where]) for result in mine]]
            ]
            rows.append([kind, where, f"{np.median(factor):.2f}" if where == "turns" else "", *means])
    return markdown(["what calibration leaves", "judged", "factor", *FILTERS, AT_MOST], rows)


# Real recordings with a truth.


@dataclass(frozen=True, eq=False)
class Flight:
    """rate (N, 3) rad/s as measured; dt (N-1,) s; truth (N, 4) q_wb; known (N,) bool; figures at rest."""

    name: str
    rate: np.ndarray
    dt: np.ndarray
    truth: np.ndarray
    known: np.ndarray
    figures: NoiseFigures


#: offset of BROAD's truth against its gyroscope: the truth is this early
BROAD_EARLY_S = 4.165e-3
#: stretches of rest in BROAD: seconds whose scatter is below this many times the quietest ones'
QUIET = 2.0
#: published of EuRoC's ADIS16448: rad/s/sqrt(Hz), rad/s/sqrt(s)
EUROC_N, EUROC_K = 1.6968e-4, 1.9393e-5
#: windows of the inflation, s
WINDOWS_S = np.geomspace(0.02, 32.0, 18)
#: intervals at which the truth corrects the filter, s
GAPS_S = (1.0, 5.0, 10.0)
#: innovations that a mean is stated of
LEAST = 5


def broad(trial: str) -> Flight:
    """A trial of BROAD, from its first movement to its last, with the rests between; N and K of its rests."""
    (path,) = (SHARED / "wild" / "broad").glob(f"{trial}_*.hdf5")
    arrays = read_hdf5(path, ("imu_gyr", "opt_quat", "movement"), (RATE,))
    rate, truth, rate_hz = arrays["imu_gyr"], arrays["opt_quat"], float(arrays[RATE])
    size = round(rate_hz)
    seconds = rate[: len(rate) // size * size].reshape(-1, size, 3)
    scatter = seconds.std(axis=1).max(axis=1)
    still = scatter < QUIET * np.median(np.sort(scatter)[:10])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    pieces = [rate[a * size : b * size] for a, b in edges.reshape(-1, 2) if b - a >= 5]
    curve = allan_curve(pieces, 1 / rate_hz)
    columns = np.column_stack([1 / curve.tau_s, curve.tau_s / 3])
    squares = []
    for axis in range(3):
        weight = np.sqrt(curve.freedom / 2) / curve.deviation[:, axis] ** 2
        squares.append(np.linalg.lstsq(columns * weight[:, None], curve.deviation[:, axis] ** 2 * weight, rcond=None)[0])
    N, K = np.sqrt(np.maximum(np.array(squares), 0)).T
    moves = np.flatnonzero(arrays["movement"])
    rows = np.arange(moves[0], moves[-1] + 1)
    known = np.isfinite(truth).all(axis=1)
    seen = np.flatnonzero(known)
    filled = truth[seen[np.clip(np.searchsorted(seen, np.arange(len(truth))), 0, len(seen) - 1)]]
    # A row of the truth belongs to a moment this much later than its own: take it from between two earlier rows.
    whole, part = divmod(BROAD_EARLY_S * rate_hz, 1)
    before, after = filled[rows - int(whole) - 1], filled[rows - int(whole)]
    back = rotation.log(rotation.multiply(rotation.conjugate(after), before))
    moved = rotation.multiply(after, rotation.exp(part * back))
    known = known[rows - int(whole)] & known[rows - int(whole) - 1]
    return Flight(f"BROAD {trial}", rate[rows], np.full(len(rows) - 1, 1 / rate_hz), moved, known, figures_of(N, K))


def euroc(sequence: str) -> Flight:
    """A sequence of EuRoC with the published N and K."""
    with np.load(SHARED / "euroc" / f"euroc_{sequence}.npz") as file:
        t_ns, gyro, truth_ns, truth = (file[name] for name in ("t_ns", "gyro", "gt_t_ns", "gt_q_wxyz"))
    rows = np.clip(np.searchsorted(t_ns, truth_ns - 1_000_000), 0, len(t_ns) - 1)
    known = np.abs(t_ns[rows] - truth_ns) < 1_000_000
    return Flight(
        f"EuRoC {sequence}", gyro[rows], np.diff(t_ns[rows]) * NS, truth, known, figures_of(np.full(3, EUROC_N), np.full(3, EUROC_K))
    )


def calibrated(flight: Flight, window_s: float = 2.0) -> LinearModel:
    """Least squares over windows of a truth."""
    size = round(window_s / float(np.median(flight.dt)))
    begin = np.arange(0, len(flight.dt) - size, size)
    begin = begin[[flight.known[i : i + size + 1].all() for i in begin]]
    rate = np.stack([flight.rate[i : i + size + 1] for i in begin])
    dt = np.stack([flight.dt[i : i + size] for i in begin])
    batch = Batch(rate, dt, np.zeros_like(rate), flight.truth[begin], flight.truth[begin + size], True)
    start = LinearModel(np.eye(3), -np.median(flight.rate, axis=0))
    return fit_least_squares(batch, np.full(len(batch), 3e-3), start).model


def innovations(flight: Flight, model: LinearModel, white: np.ndarray, walk: np.ndarray, reference: Reference, gap_s: float) -> list[float]:
    """NIS of a filter that the truth corrects every ``gap_s`` seconds, after it has learnt its bias."""
    rate, size = model(flight.rate), round(gap_s / float(np.median(flight.dt)))
    rows = np.arange(0, len(rate), size)
    rows = rows[flight.known[rows]]
    total = np.sqrt(reference.sigma_rad**2 + sum((each.sigma_rad**2 for each in reference.wanders), np.zeros(3)))
    filtered = AttitudeFilter(flight.truth[rows[0]], white, walk, reference, total, 0.5 * DEG)
    found = []
    for first, last in pairwise(rows):
        filtered.turn(rate[first : last + 1], flight.dt[first:last])
        found.append(filtered.correct(flight.truth[last]))
    return found[max(2, len(found) // 10) :]


def truth_rows(trained: Flight, others: list[Flight], left: bool) -> list[list[str]]:
    """NIS on other recordings of the same unit; left: with the calibration of the first one, else as measured but for the bias."""
    own = calibrated(trained)
    own = own if left else replace(own, E=np.eye(3))
    windows = np.unique(np.round(WINDOWS_S / np.median(trained.dt)).astype(int))
    name = f"{trained.name}, {'calibrated' if left else 'as measured'}"
    try:
        found, densities = truth_inflation(own(trained.rate), trained.dt, trained.truth, trained.figures, windows, name, trained.known)
    except DataError as error:
        return [[name, str(error).partition(": ")[2], "", "", *[""] * len(FILTERS)]]
    reference = Reference(densities.truth_rad, densities.wanders)
    rows = []
    for other in others:
        for gap_s in GAPS_S:
            cells = []
            for white, walk in choices(trained.figures, found).values():
                each = innovations(other, own, white, walk, reference, gap_s)
                cells.append(f"{np.mean(each):.2f} ± {np.std(each) / np.sqrt(len(each)):.2f}" if len(each) >= LEAST else "–")
            factor = " ".join(f"{white:.1f}" for white in found.white)
            rows.append([name, other.name, factor, f"{gap_s:g}", *cells])
    return rows


TRUTH_HEADER = ["inflated on", "judged on", "factor x y z", "corrected every, s", *FILTERS]


def broad_table() -> str:
    """Each trial of BROAD judged by the other, and each half of one by its other half, which is the same kind of motion."""
    trials = [broad("05"), broad("09")]
    rows = [row for a, b in ((0, 1), (1, 0)) for left in (True, False) for row in truth_rows(trials[a], [trials[b]], left)]
    for trial in trials:
        first, second = halves(trial)
        rows += truth_rows(first, [second], True) + truth_rows(second, [first], True)
    return markdown(TRUTH_HEADER, rows)


def halves(whole: Flight) -> list[Flight]:
    """Its first and its second half."""
    middle = len(whole.rate) // 2
    t_s = np.concatenate([[0.0], np.cumsum(whole.dt)])
    parts = (("first half", slice(0, middle)), ("second half", slice(middle, len(whole.rate))))
    return [
        Flight(f"{whole.name} {name}", whole.rate[own], np.diff(t_s[own]), whole.truth[own], whole.known[own], whole.figures)
        for name, own in parts
    ]


def euroc_table() -> str:
    """Sequences of EuRoC judged by others of the same room."""
    pairs = {
        "V1_02_medium": ("V1_03_difficult", "V2_02_medium"),
        "V1_03_difficult": ("V1_02_medium", "V2_02_medium"),
        "MH_03_medium": ("MH_05_difficult",),
    }
    rows = [row for one, others in pairs.items() for row in truth_rows(euroc(one), [euroc(other) for other in others], True)]
    return markdown(TRUTH_HEADER, rows)


def windows_table() -> str:
    """Allan deviation of the calibrated rate's error against the truth, times the root of tau, over N: x, y, z."""
    columns, taus_s = [], np.array([0.02, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0])
    flights = [broad("05"), broad("09"), euroc("V1_02_medium"), euroc("MH_03_medium")]
    for flight in flights:
        rate, period_s, N = calibrated(flight)(flight.rate), float(np.median(flight.dt)), flight.figures.gyro.values("N")
        cells = []
        for tau_s in taus_s:
            difference = end_differences(rate, flight.dt, flight.truth, round(tau_s / period_s), flight.known)
            cells.append(" ".join(f"{size:.2g}" for size in np.sqrt(np.mean(difference**2, axis=0) / 2 / tau_s) / N))
        columns.append(cells)
    return markdown(
        ["tau, s", *(flight.name for flight in flights)],
        [[f"{t:g}", *row] for t, row in zip(taus_s, zip(*columns, strict=True), strict=True)],
    )


#: of real recordings
REAL = {"broad": broad_table, "windows": windows_table, "euroc": euroc_table}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="*", choices=[[], "simulated", *REAL], help="some of the tables")
    parser.add_argument("--seeds", type=int, default=20, help="simulated units of each kind")
    args = parser.parse_args()
    for part, table in ({"simulated": partial(simulated_table, args.seeds)} | REAL).items():
        if args.parts and part not in args.parts:
            continue
        if part != "simulated" and not SHARED.exists():
            print(f"{part}: ../shared is missing", file=sys.stderr)
            continue
        print(f"{part}\n\n{table()}\n")


if __name__ == "__main__":
    main()
