"""A stored calibration in a new session: E is kept, the bias is taken from the first still, from gravity, or from the user."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.common.errors import SegmentError
from session.common.units import DEG, G
from session.common.version import VERSION
from session.detect.rests import find_rests
from session.detect.truth_segments import moments_inside
from session.files.results import read_json, write_whole
from session.files.writing import result_folder
from session.log import hashes
from session.log.folder import Session
from tinygc import models
from tinygc.closure.residual import closure_angles
from tinygc.fitting.bias import FIGURES, MODEL
from tinygc.fitting.bias.of_day import DAY_SIGMA_RPS, BiasOfDay, bias_from_gravity
from tinygc.fitting.bias.origin import Origin, origin_of
from tinygc.fitting.figures import closure_figures, run_figures
from tinygc.fitting.fit_json import SCHEMA
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.model import Model
from tinygc.problem.closure_run import ClosureRun, read_closure_runs
from tinygc.problem.prepared import prepare
from tinygc.problem.problem import Problem
from tinygc.problem.still_set import StillSet

if TYPE_CHECKING:
    from rich.console import Group

#: the first still and gravity that differ by so many sigmas do not speak of the same bias: for normal errors once in 600 000 (3 axes)
DISAGREE_SIGMAS = 5.0


@dataclass(frozen=True, eq=False)
class Rebiased:
    """problem, runs of the new session; stored model; changes (3,) rad/s to its calibrated rate by source, with sigma (3,) or None;
    source that was asked for; angles (S, d) rad that each leaves, and run errors, by "stored" and source; path of the stored model, and
    its origin."""

    problem: Problem
    runs: list[ClosureRun]
    stored: Model
    changes: dict[str, tuple[np.ndarray, np.ndarray | None]]
    source: str
    angles: dict[str, np.ndarray]
    run_errors: list[dict[str, np.ndarray]]
    path: Path
    origin: Origin

    @property
    def model(self) -> Model:
        """The stored calibration with the bias that was asked for."""
        return self.stored.with_bias_moved(self.changes[self.source][0])

    @property
    def disagreement(self) -> float:
        """Sigmas between the first still's bias and gravity's, on the axis where it is most; 0 without both."""
        if not {"start", "gravity"} <= set(self.changes):
            return 0.0
        (start, one), (gravity, other) = self.changes["start"], self.changes["gravity"]
        assert one is not None
        assert other is not None
        return float(np.max(np.abs(start - gravity) / np.hypot(one, other)))


def rebias_session(
    folder: Path,
    path: Path,
    source: str,
    given_dps: np.ndarray | None = None,
    *,
    use_earth: bool = True,
    exclude: tuple[int, ...] = (),
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Rebiased:
    """Take the bias from ``source``, and from the others for comparison where they can be had.

    given_dps (3,): what the sensor reads at rest; exclude: numbers of segments that the closure is not judged by.
    Raises SegmentError where ``source`` needs a still or a rest and there is none.
    """
    stored = models.load(path)
    stored.with_bias_moved(np.zeros(3))  # a kind whose bias cannot be moved is refused before the work
    problem = prepare(folder, use_earth=use_earth, exclude=exclude, progress=lambda what: progress(what, 0, 3)).problem
    session = problem.session
    changes: dict[str, tuple[np.ndarray, np.ndarray | None]] = {}
    if (start := from_start(problem, stored)) is not None:
        changes["start"] = start
    progress("bias from gravity", 2, 3)
    found = from_gravity(problem, stored, _day_sigma(path))
    changes["gravity"] = (found.change, found.sigma)
    if given_dps is not None:
        changes["given"] = (-_at_rest(stored, np.asarray(given_dps) * DEG), None)
    if source not in changes:
        raise SegmentError(f"{folder}: no still and no rest to take the bias from; use --bias gravity, or --bias given --bias-dps X,Y,Z")
    all_models = {"stored": stored} | {name: stored.with_bias_moved(change) for name, (change, _) in changes.items()}
    runs = read_closure_runs(problem)
    angles = {name: _closure(problem, model) for name, model in all_models.items()}
    errors = [{name: run.errors(model) for name, model in all_models.items()} for run in runs]
    return Rebiased(problem, runs, stored, changes, source, angles, errors, path, origin_of(path, session))


def _closure(problem: Problem, model: Model) -> np.ndarray:
    """Error angles (S, d) rad, as ``fit`` judges the same model: a denoiser's delay is allowed for."""
    if isinstance(model, DenoisedNet):
        from tinygc.methods.denoising.material import of_problem
        from tinygc.methods.denoising.run import denoised_angles

        return denoised_angles(of_problem(problem), model)
    return closure_angles(problem.batch, model)


def from_start(problem: Problem, model: Model) -> tuple[np.ndarray, np.ndarray] | None:
    """The change that makes the first still's mean rate the Earth's, with its sigma; the first rest's, where nothing is still."""
    rates = problem.still_rates
    if len(rates.rate):
        return rates.earth[0] - _at_rest(model, rates.rate[0]), rates.sigma[0]
    for log in problem.logs:
        for rest in find_rests(log.samples)[:1]:
            duration_s = (rest.stop - rest.start) * log.samples.period_s
            return -_at_rest(model, rest.gyro_mean), log.noise.angle_random_walk / np.sqrt(duration_s)
    return None


def from_gravity(problem: Problem, model: Model, prior: np.ndarray | float = DAY_SIGMA_RPS) -> BiasOfDay:
    """From all logs of a session, one after the other: what one has found is the next one's prior."""
    # A denoised rate comes late, and beside the accelerometer that passes for a bias; the denoiser itself has none.
    model = model.without_denoiser()
    change, sigma, found, excess = np.zeros(3), prior, None, 1.0
    g = problem.session.config.site.expected_gravity_mps2
    for number, log in enumerate(problem.logs):
        row, q_first, earth_n = _first_attitude(problem, number)
        samples = log.samples.between(row, len(log.samples))
        rate = np.asarray(model(samples.gyro)) + change
        found = bias_from_gravity(
            samples, rate, q_first, prior=sigma, rest=_rest_change(log, model, change), earth_n=earth_n, gravity_mps2=g
        )
        change, sigma, excess = change + found.change, found.sigma, max(excess, found.excess)
    assert found is not None  # a session has a log
    # A wrong E turns each turn into a bias of its own: they scatter by far more than a bias walks, and so does their mean.
    return replace(found, change=change, sigma=found.sigma * excess, direction_sigma=found.direction_sigma * excess)


def _first_attitude(problem: Problem, number: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Row of a log from which its attitude is known, q (4,) there, and the Earth's rate (3,) in that frame."""
    session, log = problem.session, problem.logs[number]
    if session.truths is not None:
        rows, q = moments_inside(log.samples, session.truths[number])
        return int(rows[0]), q[0], problem.earth.rate_t
    first = next((i for i, still in enumerate(log.stills) if still.problem is None), None)
    if first is None:
        raise SegmentError(f"{session.folder}: a log without a still: from where should its attitude be carried?")
    still = log.stills[first]
    return still.middle, log.q_tb[first], problem.earths[int(log.group[first])].rate_t


def _rest_change(log: StillSet, model: Model, change: np.ndarray) -> np.ndarray | None:
    """(3,): what a log's rests ask for; their median, since a hand that moves slowly may pass for a rest."""
    good = [(still, q) for still, q in zip(log.stills, log.q_tb, strict=True) if still.problem is None]
    rates = [still.gyro_mean for still, _ in good] or [rest.gyro_mean for rest in find_rests(log.samples)]
    if not rates:
        return None
    return -np.median([_at_rest(model, rate) for rate in rates], axis=0) - change


def _at_rest(model: Model, rate: np.ndarray) -> np.ndarray:
    """(3,): a constant rate, calibrated.  A model with a memory is given it for long enough."""
    model = model.without_denoiser()
    return np.asarray(model(np.asarray(rate, dtype=float)[None]))[0]


def _day_sigma(path: Path) -> np.ndarray | float:
    """(3,) rad/s from the model's own file, where the fit has seen several days; else what is usual."""
    found = read_json(path).get("bias_sigma_rps")
    return DAY_SIGMA_RPS if found is None else np.maximum(np.asarray(found, dtype=float), 1e-6)


def rebias_to_json(result: Rebiased) -> dict:
    """``tinygc-fit/1``: the stored calibration, and it with the bias of each source, as methods.  No E was fitted here: all is held out,
    unless ``bias.fitted_here`` says that the stored model is this session's own."""
    session: Session = result.problem.session

    def figures(name: str) -> dict:
        own = {"parameters": result.stored.parameters, "seconds": 0.0}
        held_out = closure_figures(result.angles[name])
        return own | {"train": dict.fromkeys(held_out), "holdout": held_out}

    return {
        "schema": SCHEMA,
        "session": session.name,
        "stills": len(result.problem.stills),
        "segments": {
            "found": len(result.problem.segments),
            "used": len(result.problem.used),
            "rejected": [{"segment": s.number, "why": s.problem} for s in result.problem.segments if not s.accepted],
            "notes": [{"segment": s.number, "note": s.note} for s in result.problem.segments if s.accepted and s.note],
        },
        "noise": {
            "gyro_dps_rthz": (result.problem.noise.gyro / DEG).tolist(),
            "accel_g_rthz": (result.problem.noise.accel / G).tolist(),
            **result.problem.instability.to_json(),
            "closure_floor_rms_deg": result.problem.floor.tilt_rms / DEG,
        },
        "methods": {name if name == "stored" else f"stored_{name}": figures(name) for name in result.angles},
        "bias": {
            "model": str(result.path),
            "source": result.source,
            "fitted_here": result.origin.here,
            "remarks": remarks(result),
            "change_dps": {name: (change / DEG).tolist() for name, (change, _) in result.changes.items()},
            "sigma_dps": {name: None if sigma is None else (sigma / DEG).tolist() for name, (_, sigma) in result.changes.items()},
        },
        "closure_runs": [
            {"file": run.file, "duration_s": run.duration_s}
            | {name if name == "stored" else f"stored_{name}": run_figures(error) for name, error in errors.items()}
            for run, errors in zip(result.runs, result.run_errors, strict=True)
        ],
        "version": VERSION,
    }


def save_rebiased(result: Rebiased, folder: Path | None = None) -> Path:
    """Write ``model_rebiased.json`` and ``rebiased.json`` into a folder, the session's ``fit`` by default; returns that folder.

    ``fit.json`` belongs to the models that were fitted there, and stays.
    """
    session = result.problem.session
    folder = folder or session.folder / "fit"
    table = read_json(result.path)
    before = table["stored"] if isinstance(table.get("stored"), dict) else table
    more = {
        "method": f"stored, bias {result.source}",
        "session": session.name,
        "sha256": hashes.input_hashes(session),
        "stored": {name: before.get(name) for name in ("method", "session", "sha256")},
        "version": VERSION,
        **{name: table[name] for name in ("sensor", "accelerometer") if name in table},  # E is in that one's body frame
    }
    with result_folder(folder):
        write_whole(folder / MODEL, models.to_dict(result.model, **more))
        write_whole(folder / FIGURES, rebias_to_json(result))
    return folder


def remarks(result: Rebiased) -> list[str]:
    """What to know about the figures."""
    said = [f"{result.origin.says}; start and gravity take the bias from this session itself, from its first still and its accelerometer"]
    if result.disagreement > DISAGREE_SIGMAS:
        said.append(
            f"start and gravity differ by {result.disagreement:.0f} sigmas: E is not this sensor's (an uncalibrated model?), or its zero "
            "moves between rest and motion; one of the two sigmas does not hold"
        )
    return said


def rebias_report(result: Rebiased) -> Group:
    """A table for the terminal."""
    from rich.console import Group
    from rich.table import Table

    from session.common.console import one_line

    titles = {"stored": "stored bias", "start": "bias start", "gravity": "bias gravity", "given": "bias given"}
    table = Table(title=f"{result.path.name} in {result.problem.session.name}", title_justify="left", title_style="bold", box=None)
    for column in ("", "change of B, dps: x", "y", "z", "closure, degrees rms: tilt", "yaw", *(f"{run.file} RMSE" for run in result.runs)):
        table.add_column(column, justify="left" if not column else "right")
    for name, angles in result.angles.items():
        change, sigma = result.changes.get(name, (np.zeros(3), None))
        own = closure_figures(angles)
        cells = [
            f"{c / DEG:+.4f}" + ("" if sigma is None else f" ± {s / DEG:.4f}")
            for c, s in zip(change, np.zeros(3) if sigma is None else sigma, strict=True)
        ]
        yaw = "–" if own["yaw_rms_deg"] is None else f"{own['yaw_rms_deg']:.4f}"
        rmse = [f"{run_figures(errors[name])['rmse_deg']:.4f}" for errors in result.run_errors]
        table.add_row(titles[name], *cells, f"{own['tilt_rms_deg']:.4f}", yaw, *rmse, style="bold" if name == result.source else "")
    table.caption, table.caption_justify = "bold is what is saved", "left"
    first, *warnings = (f"{each[0].upper()}{each[1:]}." for each in remarks(result))
    return Group(table, one_line(first), *(one_line(each, "yellow") for each in warnings))
