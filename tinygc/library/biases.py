"""``tinygc.rebias``: the bias of the day."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError
from session.base.options import records
from session.base.progress import Progress, untold
from session.log.folder import Session
from tinygc.deploy.calibration import Calibration
from tinygc.estimation.choice import ClosureFigures, closure_figures
from tinygc.estimation.options import Earth, Exclude
from tinygc.fitting.bias_of_day import Rebiased, rebias_session, rebias_to_json, rebiased_table, save_rebiased
from tinygc.library.applied import stored_model
from tinygc.library.arguments import public, session_or_folder
from tinygc.library.records import Estimate, Named, Shown
from tinygc.reporting.fit_text import rebias_report
from tinygc.reporting.terminal import Group


@dataclass(frozen=True, eq=False, repr=False)
class Rebias(Shown):
    """Result of ``tinygc.rebias``."""

    result: Rebiased

    def __repr__(self) -> str:
        moved = ", ".join(f"{estimate.value:+.3g}" for estimate in self.change.values())
        return f"<Rebias from {self.result.source}: B moves by {moved} rad/s>"

    @cached_property
    def model(self) -> Calibration:
        """The stored calibration with the new bias."""
        return Calibration(self.result.model, 1 / self.result.problem.logs[0].samples.period_s, rebiased_table(self.result))

    @property
    def change(self) -> Named[Estimate]:
        """The change of B by axis, ``B_x`` …, in rad/s, with its sigma, NaN where the bias was given."""
        change, sigma = self.result.changes[self.result.source]
        sigmas = np.full(3, np.nan) if sigma is None else sigma
        axes = zip("xyz", change, sigmas, strict=True)
        return Named((f"B_{axis}", Estimate(f"B_{axis}", float(value), float(spread), "rad/s")) for axis, value, spread in axes)

    @property
    def closure(self) -> Named[ClosureFigures]:
        """Closure of the session's segments with the stored bias and with that of each source, degrees rms, as ``Fit.closure``."""
        return Named((name, closure_figures(angles)) for name, angles in self.result.angles.items())

    @property
    def page(self) -> Group:
        """The command's output as a rich renderable."""
        return rebias_report(self.result)

    def to_json(self) -> dict:
        """``tinygc-fit/2`` of a bias of the day (docs/formats.md)."""
        return rebias_to_json(self.result)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the model and its figures into a folder (``fit`` in the session's folder by default); returns it."""
        return save_rebiased(self.result, None if folder is None else Path(folder))


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
    """Take the bias of a stored calibration anew from another session: the bias of the day.

    Parameters
    ----------
    session : Session, str or Path
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
    given = None if bias_dps is None else np.asarray(bias_dps, dtype=float)
    found = rebias_session(
        session_or_folder(session),
        path,
        source,
        given,
        table=table,
        use_earth=earth.earth,
        exclude=closed.exclude,
        progress=progress or untold,
    )
    return Rebias(found)
