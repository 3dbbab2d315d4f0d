"""One answer: what ``check``, ``fit``, ``explain``, ``report`` and ``verify`` say of each recording beside the checkout, and what
contradicts.

    python benchmarks/verdicts.py [xsens mikov mimu injected closure concealed] [--only NAME …] [--out FILE]

``verify`` holds each recording against the first one of its unit (mimu), or its own.  A pair contradicts where two of them answer one
question in two ways: a test of ``fit`` contradicts the model and ``explain`` finds no mismatch, or the reverse; a mismatch with a p-value
of chance; PASS beside a name or a rest; another verdict in the report of the same calibration; ``verify`` holds what ``fit`` refutes;
*before* of ``explain`` is not ``fit``'s held-out closure.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections import Counter
from pathlib import Path

from common import in_parallel, markdown
from real_recordings import Job, add_choice, chosen_jobs

from session.detect.findings import worst
from session.io.errors import CalibrationError
from session.io.folder import read_session
from tinygc.explanation.claims import LEFT

SETS = ("xsens", "mikov", "mimu", "injected", "closure", "concealed")
#: p-value above which no mismatch can be claimed
CHANCE = 0.05


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_choice(parser, f"of {', '.join(SETS)} (all)")
    parser.add_argument("--out", type=Path, help="JSON with all answers")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        rows = in_parallel(answers, chosen_jobs(parser, args, SETS, Path(made)), "recording")
    if args.out:
        args.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    columns = ("check", "fit", "explain", "named", "report", "verify", "contradicting")
    print(markdown(("recording", *columns), [(row["name"], *(row[name] for name in columns)) for row in rows]))
    found = Counter(pair for row in rows for pair in row["contradicting"].split("; ") if pair)
    print(f"\n{len(rows)} recordings, {sum(bool(row['contradicting']) for row in rows)} with a contradicting pair: {dict(found)}")


def answers(job: Job) -> dict:
    """The five answers on one recording, and which of them contradict."""
    from tinygc.closure.prepared import prepare
    from tinygc.estimation.bias import tilt_rms
    from tinygc.estimation.fit import fit_session
    from tinygc.estimation.model_tests import contradictions
    from tinygc.estimation.options import FitOptions
    from tinygc.explanation.engine import explain_session

    row = dict.fromkeys(("check", "fit", "explain", "named", "report", "verify", "headline", "contradicting"), "")
    row["name"] = f"{job.set_name} {job.folder.name}"
    try:
        prepared = prepare(session := read_session(job.folder))
        row["check"] = worst(prepared.findings)
        options = FitOptions(methods=("raw", "least_squares"))
        fit = fit_session(session, options, prepared=prepared)
        decision = fit.verdict()
        row |= {"fit": decision.answer, "headline": decision.headline}
        e = explain_session(session, prepared=prepared)  # fits by itself, as the command does
        row |= {"explain": e.verdict, "p_value": e.p_value, "named": ", ".join(claim.effect.id for claim in e.claimed)}
        row["report"], is_linear = _report(fit, e)
        row["verify"] = _verified(job, fit)
    except CalibrationError as error:
        return row | {"fit": row["fit"] or "refused", "headline": row["headline"] or str(error)}
    contradicted = bool(contradictions(decision.tests))
    moves = [claim for claim in e.claimed if claim.effect.kind in ("rate", "register")]
    said = {
        "fit contradicted, explain none": contradicted and e.verdict == "no_mismatch",
        "fit agrees, explain unexplained": not contradicted and e.verdict == "unexplained" and not e.findings,
        "mismatch by chance": e.verdict != "no_mismatch" and e.p_value > CHANCE,
        "pass beside what is left": decision.answer == "pass" and e.verdict in LEFT,
        "pass beside a name": decision.answer == "pass" and bool(moves),
        "report differs": is_linear and row["report"] != decision.answer,
        "verify holds": row["verify"] == "holds" and contradicted,
        "held out differs": not math.isclose(tilt_rms(e.proof.before), tilt_rms(fit.linear.held_out), rel_tol=1e-9),
    }
    return row | {"contradicting": "; ".join(pair for pair, is_so in said.items() if is_so)}


def _report(fit, explanation) -> tuple[str, bool]:
    """The report's answer, and whether it is on the linear model."""
    from tinygc.reporting.html.evidence import LINEAR, adopt, decided

    adopted = adopt(fit, explanation)
    return decided(fit, explanation, adopted).answer, adopted.name == LINEAR


def _verified(job: Job, fit) -> str:
    from tinygc import verify
    from tinygc.estimation.fit import fit_session
    from tinygc.estimation.options import FitOptions
    from tinygc.estimation.results import save_models

    first = job.folder.parent / f"e1{job.folder.name[2:]}"
    with tempfile.TemporaryDirectory(prefix="tinygc-") as made:
        if job.set_name == "mimu" and first.is_dir() and first != job.folder:
            fit = fit_session(first, FitOptions(methods=("least_squares",)))
        saved = save_models(fit, Path(made))
        try:
            return verify(saved / "model_least_squares.json", job.folder).answer
        except CalibrationError as error:
            return f"refused: {error}"[:60]


if __name__ == "__main__":
    main()
