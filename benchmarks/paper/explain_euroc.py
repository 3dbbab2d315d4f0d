"""``explain`` on the EuRoC sequences, alone and in pairs: what is wrong with the sensor, what with the truth, what with their clocks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from common import markdown
from public.euroc import write_sequences, write_training_windows

from paper.euroc import EUROC
from paper.levelled import level_days
from session.base.units import DEG, MG
from session.log.folder import read_session
from tinygc.closure.build import build_problem
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation, explain_session

SEQUENCES = ("MH_01", "MH_02", "MH_03", "MH_04", "MH_05", "V1_01", "V1_02", "V1_03", "V2_01", "V2_02", "V2_03")
PAIRS = (
    *(("MH_01", "MH_02"), ("MH_02", "MH_03"), ("MH_03", "MH_04"), ("MH_04", "MH_05"), ("V1_01", "V1_02"), ("V1_02", "V1_03")),
    *(("V2_01", "V2_02"), ("V2_02", "V2_03"), ("MH_05", "V1_01"), ("V1_03", "V2_01"), ("MH_02", "V2_02")),
)
SEGMENT_S = 2.0
COLUMNS = (
    "",
    "verdict: claims",
    "held-out tilt of 2 s, °",
    "closure of 0.5 s, gyro's noise, °",
    "neighbours",
    "truth's clock, ms",
    "gyro to truth, °",
    "accelerometer, mg",
    "rest less motion, dps",
)


def explain_euroc(parent: Path, progress: Callable[[str], None] = lambda what: None) -> str:
    """Markdown: a row for each sequence, a row for each pair, and the mislabelled windows."""
    rows = []
    for name in SEQUENCES:
        progress(f"explain {name}")
        rows.append(_row(name, explain_session(write_sequences(EUROC, [name], parent / f"explain_{name}", SEGMENT_S))))
    pairs = []
    for both in PAIRS:
        name = " + ".join(both)
        progress(f"explain {name}")
        e = explain_session(write_sequences(EUROC, both, parent / f"explain_{'_'.join(both)}", SEGMENT_S))
        offsets = level_days(e.problem).offsets / DEG
        pairs.append((name, _claims(e), _triple(offsets[1] - offsets[0], 3)))
    progress("mislabelled windows")
    return "\n\n".join(
        [
            markdown(COLUMNS, rows),
            markdown(("pairs", "verdict: claims", "change of bias from the one to the other, dps"), pairs),
            _mislabelled(parent),
        ]
    )


def _row(name: str, e: Explanation) -> tuple[str, ...]:
    truth = e.shown
    turned, clock = truth.alignment.turned, truth.alignment
    short = np.sqrt(np.mean(truth.closure_rad[0] ** 2)) / DEG if len(truth.lengths_s) else float("nan")
    own = truth.gyro_rad / DEG * np.sqrt(truth.lengths_s[0]) if truth.independent is not None else float("nan")
    return (
        name,
        _claims(e),
        f"{tilt_rms(e.proof.before) / DEG:.3f} → {tilt_rms(e.proof.after) / DEG:.3f}",
        f"{short:.4f}, {own:.4f}".replace("nan", "–"),
        f"{truth.neighbours[0]:+.2f} → {truth.neighbours[1]:+.2f}".replace("+nan", "–"),
        f"{1e3 * clock.offset_s:+.2f} ± {1e3 * clock.offset_sigma_s:.2f}".replace("+nan ± nan", "–"),
        "–" if np.isnan(turned).any() else f"{_triple(turned / DEG)} ± {clock.turned_sigma.max() / DEG:.2f}",
        "–" if truth.force is None else f"{_triple(truth.force.bias / MG, 0)} ± {truth.force.sigma.max() / MG:.0f}",
        "–" if truth.rests is None else f"{_triple(truth.rests.difference / DEG, 3)} ({truth.rests.seconds:.0f} s)",
    )


def _claims(e: Explanation) -> str:
    claims = ", ".join(f"{claim.effect.id} ({_size(claim)}{_share(claim)})" for claim in (*e.claimed, *e.findings))
    refused = ", ".join(f"{claim.effect.id} ({_size(claim)})" for claim in e.naming.refused)
    return (
        e.verdict.replace("_", " ")
        + (f": {claims}" if claims else f" (p = {e.p_value:.2g})")
        + (f"; refused: {refused}" if refused else "")
    )


def _share(claim: Claim) -> str:
    return "" if claim.share is None else f", {100 * claim.share:.0f} %"


def _size(claim: Claim) -> str:
    parameter = claim.effect.parameter
    values = np.ravel(claim.parameters[parameter.name])
    return f"{len(values)} moments" if claim.std[parameter.name] is None else f"{np.abs(values).max():.2g} {parameter.unit}"


def _triple(values: np.ndarray, digits: int = 2) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _mislabelled(parent: Path) -> str:
    """The 18 windows have no error of their own; what gives them away is another day's bias."""
    problem = build_problem(read_session(write_training_windows(EUROC, parent / "explain_all", mislabelled=True)))
    offsets = level_days(problem).offsets / DEG
    names = [log.path.name.removeprefix("log_").removesuffix(".csv") for log in problem.session.logs]
    rows = [(name, _triple(offset, 3)) for name, offset in zip(names, offsets, strict=True)]
    return markdown(("the 261 training windows by their label", "bias less the median's, dps"), rows)
