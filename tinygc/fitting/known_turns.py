"""What a fit leaves of turns whose angle is known beforehand."""

from __future__ import annotations

from session.common.units import DEG
from tinygc.fitting.result import FitResult


def known_turns_json(result: FitResult) -> list[dict]:
    """``known_turns`` of ``tinygc-fit/1``: every row of turns.csv; errors of least squares, predicted less stated."""
    problem, found = result.problem, []
    row = {segment.number: i for i, segment in enumerate(problem.used)}
    for turn in problem.known_turns:
        i = row.get(turn.segment.number) if turn.problem is None and turn.segment is not None else None
        third = None if i is None else (result.linear.angles[i, 2], result.linear.held_out[i, 2])
        found.append(
            {
                "turn": turn.known.turn,
                "log": turn.known.log,
                "segment": None if turn.segment is None else turn.segment.number,
                "axis": turn.known.axis.tolist(),
                "angle_deg": turn.known.angle_rad / DEG,
                "sigma_deg": turn.known.sigma_rad / DEG,
                "gyro_deg": None if turn.reads is None else turn.along_rad / DEG,
                "used": i is not None,
                "why_not": turn.problem,
                "error_deg": None if third is None else float(third[0]) / DEG,
                "holdout_error_deg": None if third is None else float(third[1]) / DEG,
            }
        )
    return found


def known_turns_words(result: FitResult) -> str:
    """One line for the terminal; empty where no turn has a known angle."""
    turns = known_turns_json(result)
    if not turns:
        return ""
    used = [turn for turn in turns if turn["used"]]
    unused = f"; {len(turns) - len(used)} of {len(turns)} not used" if len(used) < len(turns) else ""
    if not used:
        return f"turns.csv: none of {len(turns)} turns of known angle is used, see the first look"
    each = ", ".join(f"{t['segment']} ({t['angle_deg']:g}° ± {t['sigma_deg']:g}°, left {t['error_deg']:+.3f}°)" for t in used)
    return f"turns of known angle: segment{'s' * (len(used) != 1)} {each}{unused}"
