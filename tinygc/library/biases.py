"""``tinygc.rebias``: the bias of the day, from gravity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.base.files import result_folder
from session.base.options import records
from session.base.progress import Progress, no_report
from session.base.records import write_whole
from session.log.folder import Session, input_hashes
from tinygc import models
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem
from tinygc.closure.residual import closure_angles
from tinygc.deploy.calibration import Calibration
from tinygc.estimation.choice import ClosureFigures, closure_figures
from tinygc.estimation.options import Earth, Exclude
from tinygc.estimation.spread import ZERO
from tinygc.fitting.bias_of_day import LEAST_SIGMA_RPS, from_gravity
from tinygc.fitting.unit_state import UnitState, read_state, spread_of
from tinygc.library.applied import stored_model
from tinygc.library.arguments import public
from tinygc.library.records import Estimate, Named
from tinygc.library.sources import session_or_folder
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.model import Model


@dataclass(frozen=True, eq=False, repr=False)
class Rebias:
    """Result of ``tinygc.rebias``: a stored calibration, ``state``, in a new session, ``problem``.

    shift, sigma (3,) rad/s: the change of the calibrated rate, and its sigma.
    """

    problem: Problem
    state: UnitState
    shift: np.ndarray
    sigma: np.ndarray

    def __repr__(self) -> str:
        moved = ", ".join(f"{estimate.value:+.3g}" for estimate in self.change.values())
        return f"<Rebias: B moves by {moved} rad/s>"

    @cached_property
    def model(self) -> Calibration:
        """The stored calibration with the new bias."""
        return Calibration(self.state.with_bias_moved(self.shift), 1 / self.problem.logs[0].samples.period_s, self.table)

    @property
    def table(self) -> dict:
        """It as ``tinygc-model/1``."""
        session = self.problem.session
        return self.state.table_with_bias(self.shift, "stored, bias gravity", session.name, sha256=input_hashes(session))

    @property
    def change(self) -> Named[Estimate]:
        """The change of B by axis, ``B_x`` …, in rad/s, with its sigma."""
        axes = zip("xyz", self.shift, self.sigma, strict=True)
        return Named((f"B_{axis}", Estimate(f"B_{axis}", float(value), float(spread), "rad/s")) for axis, value, spread in axes)

    @property
    def closure(self) -> Named[ClosureFigures]:
        """Closure of the session's segments with the ``stored`` bias and with that of ``gravity``, degrees rms, as ``Fit.closure``."""
        models = {"stored": self.state.model, "gravity": self.state.with_bias_moved(self.shift)}
        return Named((name, closure_figures(_closure(self.problem, model))) for name, model in models.items())

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the model as ``model_rebiased.json`` into a folder (``fit`` in the session's folder by default); returns it."""
        folder = self.problem.session.own_folder("fit") if folder is None else Path(folder)
        with result_folder(folder):
            write_whole(folder / "model_rebiased.json", self.table)
        return folder


@public(Earth, Exclude)
def rebias(
    session: Session | Path | str,
    model: Any,
    *,
    progress: Progress | None = None,
    **choices: Any,
) -> Rebias:
    """Estimate the bias of a stored calibration again from gravity over another session, which may move without a rest.

    Parameters
    ----------
    session : Session, table, str or Path
        The new recording, or its folder.
    model : Calibration, Fit, str or Path
        The stored calibration, or its file; of a fit, least squares.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    Rebias
        ``model``, ``change`` of B, ``closure``, ``save(folder)``.

    Raises
    ------
    CalibrationError
        For data that cannot be read, a session without a specific force, and a wrong argument.

    Examples
    --------
    >>> import tinygc
    >>> first, second = (tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=s, unit_seed=1).session for s in (1, 2))
    >>> found = tinygc.rebias(second, tinygc.fit(first, methods=("least_squares",)))
    >>> found.change["B_x"].unit
    'rad/s'

    """
    earth, closed = records(choices, Earth, Exclude)
    path, table = stored_model(model)
    state = read_state(path) if table is None else UnitState(path, models.from_dict(table, str(path)), table)
    stored, step = state.model, progress or no_report
    stored.with_bias_moved(np.zeros(3))  # fail early for a model whose bias cannot be changed
    where = session_or_folder(session)
    problem = prepare(where, use_earth=earth.earth, exclude=closed.exclude, progress=lambda what: step(what, 0, 3)).problem
    step("bias from gravity", 2, 3)
    found = from_gravity(problem, stored, np.maximum(spread_of(None, state.table).at(ZERO).sigma, LEAST_SIGMA_RPS))
    return Rebias(problem, state, found.change, found.sigma)


def _closure(problem: Problem, model: Model) -> np.ndarray:
    """Return error angles (S, d) rad as in ``fit``: a denoiser's delay is corrected."""
    if isinstance(model, DenoisedNet):
        from tinygc.methods.denoiser import denoised_angles, of_problem

        return denoised_angles(of_problem(problem), model)
    return closure_angles(problem.batch, model)
