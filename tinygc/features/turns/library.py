"""From a folder of a gyroscope alone to its calibration: ``tinygc.fit_turns``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.base.errors import FitError
from session.log.folder import Session, input_hashes
from tinygc.features.turns.angles import LogOfTurns, RestNoise, TurnAngle, measured_turns  # noqa: F401  # types of TurnFit's fields
from tinygc.features.turns.estimate import TurnsEstimate, estimate  # noqa: F401
from tinygc.features.turns.folder import read_turn_session
from tinygc.features.turns.names import TURNS
from tinygc.features.turns.output import save_turns, to_json, turns_report
from tinygc.features.turns.result import RestBias, TurnsResult
from tinygc.library.arguments import Progress, nothing, public
from tinygc.reporting.terminal import Group, as_html, as_text


@dataclass(frozen=True, eq=False, repr=False)
class TurnFit(TurnsResult):
    """What ``tinygc.fit_turns`` returns: ``scales``, ``axis_scales``, ``asymmetry``, ``bias``, ``model``; text, JSON and files."""

    def __repr__(self) -> str:
        found = ", ".join(f"{'xyz'[s.axis]}{' +-'[s.sense]} {100 * s.value:.3f} ± {100 * s.sigma:.3f} %" for s in self.scales)
        return f"<TurnFit of {self.session.name}: {found}>"

    @property
    def page(self) -> Group:
        """What ``fit`` prints, as a rich renderable."""
        return turns_report(self)

    def summary(self) -> str:
        """What ``fit`` prints."""
        return as_text(self.page)

    def _repr_html_(self) -> str:
        return as_html(self.page)

    def to_json(self) -> dict:
        """``tinygc-turns/1`` (docs/features/turns/turns-format.md)."""
        return to_json(self)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write model and figures into a folder (``fit`` in the session's by default); returns it.  StorageError where that fails."""
        return save_turns(self, self.session.own_folder("fit") if folder is None else Path(folder))


@public()
def fit_turns(session: Session | Path | str, *, progress: Progress | None = None) -> TurnFit:
    """Fit a gyroscope alone, without an accelerometer, to turns of known angle.

    Parameters
    ----------
    session : Session, str or Path
        A session with ``reference = "turns"``, or its folder, which holds ``turns.csv``.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    TurnFit
        ``scales`` of each axis and sense that was turned, ``asymmetry``, ``bias``, ``model``, ``angles`` of the turns, ``estimate`` with
        the table's play and the turns that are lost; ``summary()``, ``to_json()``, ``save()``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> turned = tinygc.fit_turns("phone")  # doctest: +SKIP
    >>> turned.scales[0].value, turned.scales[0].sigma  # doctest: +SKIP

    """
    progress = progress or nothing
    if not isinstance(session, Session):
        session = read_turn_session(session)
    elif session.config.protocol.reference != TURNS:
        raise FitError(f'{session.name}: protocol.reference is "{session.config.protocol.reference}"; tinygc.fit takes it')
    progress("measuring the turns", 0, 1)
    angles, logs, noise = measured_turns(session)
    if all(angle.problem for angle in angles):
        first = angles[0]
        raise FitError(f"{session.name}: none of {len(angles)} stated turns can be used; {first.turn.name}: {first.problem}")
    found = estimate(angles)
    rests = [(log, rest) for log in logs for rest in log.rests]
    means = np.array([rest.mean for _, rest in rests])
    weights = np.array([rest.count * log.times.period_s for log, rest in rests])
    share = weights / weights.sum()
    mean = share @ means
    many = 1 / np.sum(share**2)  # of rests of one length their number
    scatter = share @ (means - mean) ** 2 * (many / (many - 1) if many > 1 else 1)
    rounding = np.mean([rest.rounding for _, rest in rests], axis=0)
    sigma = np.sqrt(np.maximum(scatter / many, noise.white / weights.sum()) + rounding)
    return TurnFit(
        session, input_hashes(session), tuple(angles), tuple(logs), noise, found, RestBias(mean, sigma, np.sqrt(scatter), len(rests))
    )
