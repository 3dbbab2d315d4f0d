"""From a folder of a gyroscope alone to its calibration: ``tinygc.fit_turns``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.base.errors import FitError
from session.base.progress import Progress, no_report
from session.log.folder import Session, input_hashes
from tinygc.features.turns import TURNS
from tinygc.features.turns.angles import measured_turns
from tinygc.features.turns.estimate import estimate
from tinygc.features.turns.folder import read_turn_session
from tinygc.features.turns.result import RestBias, TurnFit
from tinygc.library.arguments import public


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
    progress = progress or no_report
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
