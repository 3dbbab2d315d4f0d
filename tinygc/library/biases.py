"""``tinygc.rebias``: the bias of the day."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, SegmentError
from session.base.files import result_folder
from session.base.options import records
from session.base.progress import Progress, no_report
from session.base.records import plain, write_whole
from session.base.units import DEG, G
from session.log.folder import Session, input_hashes
from tinygc import models
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem
from tinygc.closure.residual import closure_angles
from tinygc.closure.runs import ClosureRun, read_closure_runs
from tinygc.deploy.calibration import Calibration
from tinygc.estimation.choice import ClosureFigures, closure_figures, run_figures
from tinygc.estimation.options import Earth, Exclude
from tinygc.estimation.spread import ZERO
from tinygc.fitting.bias_of_day import (
    DISAGREE_SIGMAS,
    FIGURES,
    LEAST_SIGMA_RPS,
    MODEL,
    at_rest,
    false_stills,
    from_gravity,
    from_start,
    origin_of,
)
from tinygc.fitting.fit_file import SCHEMA, segments_table
from tinygc.fitting.unit_state import UnitState, read_state, spread_of
from tinygc.library.applied import stored_model
from tinygc.library.arguments import public
from tinygc.library.records import Estimate, Named, Shown
from tinygc.library.sources import session_or_folder
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.model import Model
from tinygc.reporting.facts import Table, screen
from tinygc.reporting.fit_text import degrees_text
from tinygc.reporting.terminal import Group, one_line


@dataclass(frozen=True, eq=False, repr=False)
class Rebias(Shown):
    """Result of ``tinygc.rebias``: a stored calibration, ``state``, in a new session.

    problem and runs of that session; changes (3,) rad/s to the calibrated rate by source, with sigma (3,) or None; the requested source;
    error angles (S, d) rad and run errors by "stored" and source.
    """

    problem: Problem
    runs: list[ClosureRun]
    state: UnitState
    changes: dict[str, tuple[np.ndarray, np.ndarray | None]]
    source: str
    angles: dict[str, np.ndarray]
    run_errors: list[dict[str, np.ndarray]]

    def __repr__(self) -> str:
        moved = ", ".join(f"{estimate.value:+.3g}" for estimate in self.change.values())
        return f"<Rebias from {self.source}: B moves by {moved} rad/s>"

    @cached_property
    def model(self) -> Calibration:
        """The stored calibration with the new bias."""
        moved = self.state.with_bias_moved(self.changes[self.source][0])
        return Calibration(moved, 1 / self.problem.logs[0].samples.period_s, self.table)

    @property
    def table(self) -> dict:
        """It as ``tinygc-model/1``."""
        session, words = self.problem.session, f"stored, bias {self.source}"
        return self.state.table_with_bias(self.changes[self.source][0], words, session.name, sha256=input_hashes(session))

    @property
    def change(self) -> Named[Estimate]:
        """The change of B by axis, ``B_x`` …, in rad/s, with its sigma, NaN where the bias was given."""
        change, sigma = self.changes[self.source]
        sigmas = np.full(3, np.nan) if sigma is None else sigma
        axes = zip("xyz", change, sigmas, strict=True)
        return Named((f"B_{axis}", Estimate(f"B_{axis}", float(value), float(spread), "rad/s")) for axis, value, spread in axes)

    @property
    def closure(self) -> Named[ClosureFigures]:
        """Closure of the session's segments with the stored bias and with that of each source, degrees rms, as ``Fit.closure``."""
        return Named((name, closure_figures(angles)) for name, angles in self.angles.items())

    @property
    def origin(self) -> tuple[bool | None, str]:
        """Whether it was fitted to this very session, None where that is not known; and the same in words."""
        return origin_of(self.state.table, self.problem.session)

    @property
    def disagreement(self) -> float:
        """The largest difference over the axes, in sigmas, of the first still's bias and gravity's; 0 without both."""
        if not {"start", "gravity"} <= set(self.changes):
            return 0.0
        (start, one), (gravity, other) = self.changes["start"], self.changes["gravity"]
        assert one is not None
        assert other is not None
        return float(np.max(np.abs(start - gravity) / np.hypot(one, other)))

    @property
    def remarks(self) -> list[str]:
        """On the figures."""
        notes = [f"{self.origin[1]}; start and gravity take the bias from this session itself, from its first still and its accelerometer"]
        if false := false_stills(self.problem, self.state.model):
            stills = "the first still is" if len(false) == 1 else f"the first {len(false)} stills are"
            notes.append(
                f"{stills} passed over: {'it reads' if len(false) == 1 else 'they read'} {max(false) / DEG:.3g} dps otherwise than the "
                f"other {len(self.problem.still_rates.rate) - len(false)}; was the table turning about the vertical?"
            )
        if self.disagreement > DISAGREE_SIGMAS:
            notes.append(
                f"start and gravity differ by {self.disagreement:.0f} sigmas: E is not this sensor's (an uncalibrated model?), or its zero "
                "moves between rest and motion; one of the two sigmas does not hold"
            )
        return notes

    @property
    def page(self) -> Group:
        """The command's output as a rich renderable: change of B and closure, by the source of the bias."""
        header = ("", "change of B, dps: x", "y", "z", "closure, degrees rms: tilt", "yaw", *(f"{run.file} RMSE" for run in self.runs))
        rows = []
        for name, own in self.closure.items():
            change, sigma = self.changes.get(name, (np.zeros(3), None))
            moved = zip(change / DEG, np.zeros(3) if sigma is None else sigma / DEG, strict=True)
            rmse = [degrees_text(run_figures(errors[name])["rmse_deg"]) for errors in self.run_errors]
            title = "stored bias" if name == "stored" else f"bias {name}"
            rows.append([title, *moved, degrees_text(own["tilt_rms_deg"]), degrees_text(own["yaw_rms_deg"]), *rmse])
        bold = {[*self.angles].index(self.source): "bold"}
        table = Table(f"{self.state.path.name} in {self.problem.session.name}", header, rows, "bold is what is saved", styles=bold)
        first, *warnings = (f"{each[0].upper()}{each[1:]}." for each in self.remarks)
        return screen([table, first, *(one_line(each, "yellow") for each in warnings)])

    def to_json(self) -> dict:
        """``tinygc-fit/2`` with the stored calibration, and that with the bias of each source, as methods (docs/formats.md).

        No E was fitted here: all is held out, unless ``bias.fitted_here`` states that the stored model was fitted to this session.
        """
        problem, own = self.problem, {"parameters": self.state.model.parameters, "seconds": 0.0}

        def by_name(found: Mapping[str, Any]) -> dict[str, Any]:
            return {name if name == "stored" else f"stored_{name}": each for name, each in found.items()}

        held_out = {name: own | {"train": dict.fromkeys(each), "holdout": each} for name, each in self.closure.items()}
        return plain(
            {
                "schema": SCHEMA,
                "session": problem.session.name,
                "stills": len(problem.stills),
                "segments": segments_table(problem),
                "noise": {
                    "gyro_dps_rthz": problem.noise.gyro / DEG,
                    "accel_g_rthz": problem.noise.accel / G,
                    **problem.instability.to_json(),
                    "closure_floor_rms_deg": problem.floor.tilt_rms / DEG,
                },
                "methods": by_name(held_out),
                "bias": {
                    "model": str(self.state.path),
                    "source": self.source,
                    "fitted_here": self.origin[0],
                    "remarks": self.remarks,
                    "change_dps": {name: change / DEG for name, (change, _) in self.changes.items()},
                    "sigma_dps": {name: None if sigma is None else sigma / DEG for name, (_, sigma) in self.changes.items()},
                },
                "closure_runs": [
                    {"file": run.file, "duration_s": run.duration_s} | by_name({name: run_figures(error) for name, error in errors.items()})
                    for run, errors in zip(self.runs, self.run_errors, strict=True)
                ],
                "version": VERSION,
            }
        )

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the model and its figures into a folder (``fit`` in the session's folder by default); returns it.

        ``fit.json`` belongs to the models that were fitted there, and stays.
        """
        folder = self.problem.session.own_folder("fit") if folder is None else Path(folder)
        with result_folder(folder):
            write_whole(folder / MODEL, self.table)
            write_whole(folder / FIGURES, self.to_json())
        return folder


#: of a bias of the day
SOURCES = ("start", "gravity", "given")


@public(Earth, Exclude)
def rebias(
    session: Session | Path | str,
    model: Any,
    source: str = "start",
    *,
    bias_dps: Sequence[float] | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Rebias:
    """Estimate the bias of a stored calibration again from another session: the bias of the day.

    Parameters
    ----------
    session : Session, table, str or Path
        The new recording, or its folder.
    model : Calibration, Fit, str or Path
        The stored calibration, or its file; of a fit, least squares.
    source : {"start", "gravity", "given"}, optional
        From the first still, from gravity over the run, or ``bias_dps``.
    bias_dps : sequence of float, optional
        What the sensor reads at rest, (3,) dps, for ``given``.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    Rebias
        ``model``, ``change`` of B, ``closure``, ``summary()``, ``save(folder)``, ``to_json()``.

    Raises
    ------
    CalibrationError
        For data that cannot be read, a session without the still that the source needs, and a wrong argument.

    Examples
    --------
    >>> import tinygc
    >>> first, second = (tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=s, unit_seed=1).session for s in (1, 2))
    >>> found = tinygc.rebias(second, tinygc.fit(first, methods=("least_squares",)))
    >>> found.change["B_x"].unit
    'rad/s'

    """
    if source not in SOURCES or (source == "given") != (bias_dps is not None):
        raise CalibrationError(f"source is {source!r}, expected start or gravity, or given with bias_dps=(x, y, z)")
    if bias_dps is not None and len(bias_dps) != 3:
        raise CalibrationError(f"bias_dps is {bias_dps!r:.60}, expected three numbers, dps")
    earth, closed = records(choices, Earth, Exclude)
    path, table = stored_model(model)
    state = read_state(path) if table is None else UnitState(path, models.from_dict(table, str(path)), table)
    stored, step = state.model, progress or no_report
    stored.with_bias_moved(np.zeros(3))  # fail early for a model whose bias cannot be changed
    where = session_or_folder(session)
    problem = prepare(where, use_earth=earth.earth, exclude=closed.exclude, progress=lambda what: step(what, 0, 3)).problem
    changes: dict[str, tuple[np.ndarray, np.ndarray | None]] = {}
    if (start := from_start(problem, stored)) is not None:
        changes["start"] = start
    step("bias from gravity", 2, 3)
    found = from_gravity(problem, stored, np.maximum(spread_of(None, state.table).at(ZERO).sigma, LEAST_SIGMA_RPS))
    changes["gravity"] = (found.change, found.sigma)
    if bias_dps is not None:
        changes["given"] = (-at_rest(stored, np.asarray(bias_dps, dtype=float) * DEG), None)
    if source not in changes:
        folder = problem.session.folder
        raise SegmentError(f"{folder}: no still and no rest to take the bias from; use source gravity, or given with bias_dps")
    all_models = {"stored": stored} | {name: stored.with_bias_moved(change) for name, (change, _) in changes.items()}
    runs = read_closure_runs(problem)
    errors = [{name: run.errors(model) for name, model in all_models.items()} for run in runs]
    return Rebias(problem, runs, state, changes, source, {name: _closure(problem, model) for name, model in all_models.items()}, errors)


def _closure(problem: Problem, model: Model) -> np.ndarray:
    """Return error angles (S, d) rad as in ``fit``: a denoiser's delay is corrected."""
    if isinstance(model, DenoisedNet):
        from tinygc.methods.denoiser import denoised_angles, of_problem

        return denoised_angles(of_problem(problem), model)
    return closure_angles(problem.batch, model)
