"""The method ``least_squares``: Gauss-Newton on the closure, 12 parameters (``tinygc/closure/least_squares.py``)."""

from __future__ import annotations

from typing import cast

from session.base.progress import Steps
from tinygc.closure.least_squares import FORESEEN, Rows, fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.estimation.held_out import FitInput, held_out
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.models.linear import LinearModel

#: in sigmas of the residuals: a fold's search ends where the next step would change none by more than this
ENOUGH = 1e-3


def run(problem: Problem, options: FitOptions, progress: Steps, before: dict[str, MethodFit]) -> MethodFit:
    """Fit E and B.  Raises FitError where the search does not converge."""
    near = before.get("least_squares")
    begin = near.model if near is not None and isinstance(near.model, LinearModel) else None
    return held_out("least_squares", _LeastSquaresFits(begin), problem, options, progress)


class _LeastSquaresFits:
    """The fit to all segments, from a nearby model if there is one, then to folds of them, each of which begins at its rows: their
    sensitivity is already computed."""

    def __init__(self, near: LinearModel | None):
        self.near = near
        self.rows: Rows | None = None

    def __call__(self, seen: FitInput) -> tuple[LinearModel, dict]:
        begin: LinearModel | Rows | None = self.near if seen.whole is None else cast(LinearModel, seen.whole)
        if self.rows is not None and seen.among is not None:
            if seen.same:
                begin = self.rows.pick(seen.among)
            elif self.rows.ends is not None:  # the references differ, but the rates do not: their rotations are already computed
                begin = self.rows.ends.rows(seen.batch, seen.among)
        fit = fit_least_squares(
            seen.batch,
            seen.sigma,
            seen.start,
            rest_rps=seen.rest_rps,
            begin=begin,
            prior=seen.prior,
            settled=FORESEEN if seen.whole is None else ENOUGH * float(seen.sigma.min()),
        )
        if seen.whole is None:
            self.rows = fit.rows
        return fit.model, {"unobserved": list(fit.unobserved)}
