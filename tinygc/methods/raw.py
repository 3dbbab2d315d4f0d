"""The methods that fit nothing: the measured rates, and the measured rates less the first still's mean.

Every other method must be better than the first.  Many programs do the second at switch-on.
"""

from __future__ import annotations

from session.base.progress import Steps
from tinygc.closure.problem import Problem
from tinygc.estimation.held_out import held_out
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.models.linear import bias_only


def run(problem: Problem, options: FitOptions, progress: Steps, before: dict[str, MethodFit]) -> MethodFit:
    """Run the method ``raw``."""
    return held_out("raw", lambda seen: (bias_only(), {}), problem, options, progress)


def run_bias_removed(problem: Problem, options: FitOptions, progress: Steps, before: dict[str, MethodFit]) -> MethodFit:
    """Run the method ``raw_bias_removed``: three numbers, from the first still alone."""
    return held_out("raw_bias_removed", lambda seen: (seen.start, {}), problem, options, progress)
