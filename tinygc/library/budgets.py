"""``tinygc.budget``: the uncertainty of a calibration by source, of a feature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from session.base.features import need
from session.log.folder import Session
from tinygc.estimation.options import FitOptions
from tinygc.library.arguments import Progress, chosen, is_fit, nothing, public, session_or_folder


@public(FitOptions)
def budget(
    session: Session | Path | str,
    *,
    of: Sequence[str] = (),
    motion: Any = None,
    seconds: float = 60.0,
    elapsed_s: float | None = None,
    warmer_k: Any = None,
    monte_carlo: int = 0,
    seed: int = 0,
    progress: Progress | None = None,
    **choices: Any,
) -> Any:
    """Split the uncertainty of a calibration by source: of each parameter, and of the attitude after a motion.

    Parameters
    ----------
    session : Session, str, Path or Fit
        The recording, its folder, or its fit.
    of : sequence of str, optional
        Names of the quantities that are asked for; all of the overview where none is given.
    motion : str or Path, optional
        The motion of the use: ``"rest"``, a session folder, or a log; the session's own beginning where it is left out.
    seconds : float, optional
        Length of the motion, s.
    elapsed_s : float, optional
        Time since the session, s, where the sensor was not switched off since; left out, the use is another switch-on.
    warmer_k : float, optional
        How much warmer the sensor is in use than in the session, K.
    monte_carlo : int, optional
        Draws that check the budget, at most; 0: none.
    seed : int, optional
        Seed of the draws.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.
    **choices
        Single fields of ``FitOptions``, of a session that is to be fitted: ``still_rates=True``.

    Returns
    -------
    UncertaintyBudget
        ``parameters``, ``sensor_errors`` and ``attitude``: a ``Budget`` of each quantity with ``rows``, ``u``, ``freedom``, ``k``,
        ``expanded``, ``beside``; ``drawn``; ``summary()``, ``html()``, ``to_json()``, ``save(folder)``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted, a name that is none, and if the budget feature was removed; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> found = tinygc.budget(session, motion="rest")
    >>> bias = found.parameters[9]
    >>> bias.name, bias.largest[0].source
    ('B_x', 'drift of the bias')

    """
    feature = need("uncertainty budgets")
    use = feature.Use(motion, seconds, elapsed_s, warmer_k)
    report = progress or nothing
    if is_fit(session):
        return feature.budget_of_fit(session.result, use, tuple(of), monte_carlo, seed, report)  # type: ignore[union-attr]
    options = chosen(FitOptions, FitOptions(methods=("least_squares",)), choices)
    return feature.budget_of_folder(session_or_folder(session), options, use, tuple(of), report, monte_carlo, seed)
