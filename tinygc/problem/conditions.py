"""What effects refer to, of a whole session."""

from __future__ import annotations

from session.common.units import DEG
from tinygc.effects import Conditions
from tinygc.problem.problem import Problem


def conditions(problem: Problem) -> Conditions:
    """Of a session."""
    first = problem.logs[0].samples
    return Conditions(
        duration_s=float(problem.began_s[-1]),
        fs_rps=problem.session.config.sensor.gyro_fs_dps * DEG,
        first_temp_c=float("nan") if first.temp_c is None else float(first.temp_c[: max(1, round(1 / first.period_s))].mean()),
    )
