"""``tinygc.rebias``: the bias of the day."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError, SegmentError
from session.base.files import result_folder
from session.base.options import records
from session.base.progress import Progress, no_report
from session.base.records import write_whole
from session.base.units import DEG
from session.log.folder import Session, input_hashes
from tinygc import models
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem
from tinygc.closure.residual import closure_angles
from tinygc.deploy.calibration import Calibration
from tinygc.estimation.choice import ClosureFigures, closure_figures
from tinygc.estimation.options import Earth, Exclude
from tinygc.estimation.spread import ZERO
from tinygc.fitting.bias_of_day import (
    DISAGREE_SIGMAS,
    LEAST_SIGMA_RPS,
    at_rest,
    false_stills,
    from_gravity,
    from_start,
)
from tinygc.fitting.unit_state import UnitState, read_state, spread_of
from tinygc.library.applied import stored_model
from tinygc.library.arguments import public
from tinygc.library.records import Estimate, Named
from tinygc.library.sources import session_or_folder
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.model import Model


@dataclass(frozen=True, eq=False, repr=False)
class Rebias:
    """Result of ``tinygc.rebias``: a stored calibration, ``state``, in a new session.

    problem of that session; changes (3,) rad/s to the calibrated rate by source, with sigma (3,) or None; the requested source; error
    angles (S, d) rad by "stored" and source.
    """

    problem: Problem
    state: UnitState
    changes: dict[str, tuple[np.ndarray, np.ndarray | None]]
    source: str
    angles: dict[str, np.ndarray]

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
        """What speaks against the figures."""
        notes = []
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

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the model as ``model_rebiased.json`` into a folder (``fit`` in the session's folder by default); returns it."""
        folder = self.problem.session.own_folder("fit") if folder is None else Path(folder)
        with result_folder(folder):
            write_whole(folder / "model_rebiased.json", self.table)
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
        ``model``, ``change`` of B, ``closure``, ``remarks``, ``save(folder)``.

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
    return Rebias(problem, state, changes, source, {name: _closure(problem, model) for name, model in all_models.items()})


def _closure(problem: Problem, model: Model) -> np.ndarray:
    """Return error angles (S, d) rad as in ``fit``: a denoiser's delay is corrected."""
    if isinstance(model, DenoisedNet):
        from tinygc.methods.denoiser import denoised_angles, of_problem

        return denoised_angles(of_problem(problem), model)
    return closure_angles(problem.batch, model)
