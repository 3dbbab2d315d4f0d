"""``tinygc.compare``: do the calibrations of one sensor agree?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from tinygc.fitting.compare import DIFFERS_P, Comparison, Moved, calibrated_of, read_calibrated
from tinygc.fitting.compare import compare as compare_calibrated
from tinygc.fitting.compare import to_json as comparison_to_json
from tinygc.library.arguments import is_fit, is_path, public
from tinygc.library.records import Listed, Shown
from tinygc.reporting.comparison_text import comparison_page, comparison_verdict_line
from tinygc.reporting.terminal import Group, Text


@dataclass(frozen=True, eq=False, repr=False)
class Compared(Shown):
    """Result of ``tinygc.compare``."""

    result: Comparison

    def __repr__(self) -> str:
        return f"<Compared {len(self.result.sessions)} sessions: {'agree' if self.agree else 'differ'}, p = {self.p_value:.2g}>"

    @property
    def p_value(self) -> float:
        """Probability of at least this difference where nothing has changed."""
        return self.result.verdict.p_value

    @property
    def agree(self) -> bool:
        """Whether they agree: p is at least 0.01."""
        return self.p_value >= DIFFERS_P

    @property
    def moved(self) -> Listed[Moved]:
        """What differs in one session from the rest, the largest first: ``session``, ``name``, ``by``, ``unit``, ``sigmas``."""
        return Listed(self.result.moved)

    @property
    def page(self) -> Group:
        """The command's output as a rich renderable."""
        return comparison_page(self.result)

    @property
    def verdict_line(self) -> Text:
        """Whether the calibrations agree, for rich."""
        return comparison_verdict_line(self.result)

    def to_json(self) -> dict:
        """``tinygc-compare/2`` (docs/formats.md)."""
        return comparison_to_json(self.result)


@public()
def compare(sessions: Any, *, bias: bool = False) -> Compared:
    """Say whether the calibrations of several sessions of one sensor agree.

    Parameters
    ----------
    sessions : sequence of Fit, str or Path
        Two or more fits, or folders of fitted sessions.
    bias : bool, optional
        The bias counts, too: the sensor was never switched off in between.

    Returns
    -------
    Compared
        ``agree``, ``p_value``, ``moved``, ``summary()``, ``to_json()``; ``result`` holds everything.

    Raises
    ------
    CalibrationError
        For fewer than two sessions, for the same recording twice, and for a session without a fit.

    Examples
    --------
    >>> import tinygc
    >>> simulated = [tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=seed, unit_seed=1) for seed in (1, 2)]
    >>> tinygc.compare([tinygc.fit(each.session, methods=("least_squares",)) for each in simulated]).agree
    True

    """
    given: list[Any] = list(sessions) if isinstance(sessions, list | tuple) else [sessions]
    for each in given:
        if not is_fit(each) and not is_path(each):
            raise CalibrationError(f"sessions holds {each!r:.60}, expected a Fit or the path of a fitted session")
    if len(given) < 2:
        raise CalibrationError("compare needs two sessions or more")
    read = [calibrated_of(each.result, each.config) if is_fit(each) else read_calibrated(Path(each)) for each in given]
    return Compared(compare_calibrated(read, bias))
