"""All that a report rests on: the fit, the explanation, and what is measured besides."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from session.common.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR
from session.log.hashes import file_key, hash_of_log, input_hashes
from tinygc.closure.allan import AllanCurve, allan_curve, angle_random_walk, bias_instability
from tinygc.explanation.noise.session_noise import known_whitener
from tinygc.explanation.truth.explain import explain_truth
from tinygc.explanation.truth.truth_explanation import TruthExplanation
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.verdict.explain import Explanation, explain_session
from tinygc.fitting.result import FitResult
from tinygc.fitting.session import fit_session
from tinygc.fitting.versions import versions
from tinygc.methods.options import FitOptions
from tinygc.models.field_parameters import COVERAGE_FACTOR, Quantity
from tinygc.problem.build import build_problem
from tinygc.problem.prepared import prepare
from tinygc.problem.problem import Problem
from tinygc.report.beyond_linear import beyond_linear
from tinygc.report.html.adopted import Adopted, adopt
from tinygc.report.html.decision import Decision, decide
from tinygc.report.html.searched import Searched, searched

#: an Allan deviation wants pieces of at least so many samples
SHORTEST_PIECE = 16


@dataclass(frozen=True, eq=False)
class Evidence:
    """fit; explanation, or against_truth where the reference is a truth file, or neither;
    adopted: the calibration that is reported; decision; quantities: every number of the parameter
    tables, in the field's words; allan or None; hashes of the session's files; versions; made: when; limit_deg or None; reused: the
    methods that were taken from what ``fit`` had saved; searched: what an earlier ``explain --discover`` found, or None."""

    fit: FitResult
    explanation: Explanation | None
    against_truth: TruthExplanation | None
    adopted: Adopted
    decision: Decision
    quantities: list[Quantity]
    allan: AllanCurve | None
    hashes: dict[str, str]
    versions: dict[str, str]
    made: str
    limit_deg: float | None
    reused: tuple[str, ...] = ()
    searched: Searched | None = None

    @property
    def problem(self) -> Problem:
        """That the fit was made of."""
        return self.fit.problem

    @property
    def verdict(self) -> str | None:
        """Of ``explain``; None where it was not asked."""
        found = self.explanation or self.against_truth
        return None if found is None else found.verdict


def gather(
    folder: Path,
    options: FitOptions,
    *,
    explain: bool = True,
    limit_deg: float | None = None,
    fit_folder: Path | None = None,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Evidence:
    """Run fit, and explain; fit_folder: where ``fit`` may have saved the same already (the session's ``fit``).

    The session is read, checked and made a problem once, for both.  Raises what ``fit_session`` and ``explain_session`` raise.
    """
    prepared = prepare(
        folder,
        use_earth=options.earth,
        exclude=options.exclude,
        accelerometer=options.accelerometer,
        progress=lambda what: progress(what, 0, 1),
    )
    logs = {file_key(log.path): hash_of_log(log) for log in prepared.session.logs} if explain else {}
    beyond_catalogue = searched(folder, logs) if explain else None
    fit = fit_session(folder, options, progress, saved=fit_folder or folder / "fit", prepared=prepared)
    truth = fit.session.config.protocol.reference == "truth"
    if options.exclude and explain:  # what a fit leaves out is looked at all the same
        prepared = prepared.as_given()
        problem = build_problem(prepared.session, use_earth=options.earth, found=prepared.problem.found)
        prepared = replace(prepared, problem=problem)
    how: dict[str, Any] = {"seed": options.seed, "use_earth": options.earth, "progress": progress, "prepared": prepared}
    explanation = explain_session(folder, **how) if explain and not truth else None
    against_truth = explain_truth(folder, **how) if explain and truth else None
    progress("what the session shows besides", 0, 1)
    adopted = adopt(fit, explanation)
    allan = stillness(fit.problem)
    # The twin rests on stills, which a session with a truth file need not have.
    beyond = [] if truth else _beyond(fit, explanation, adopted)
    quantities = [*adopted.quantities, *beyond, *_noise(allan)]
    return Evidence(
        fit=fit,
        explanation=explanation,
        against_truth=against_truth,
        adopted=adopted,
        decision=decide(adopted, [run.file for run in fit.runs], limit_deg, fit.against_raw, fit.accelerometer),
        quantities=quantities,
        allan=allan,
        hashes=input_hashes(fit.session),
        versions=versions(),
        made=_now(),
        limit_deg=limit_deg,
        reused=fit.reused,
        searched=beyond_catalogue,
    )


def stillness(problem: Problem) -> AllanCurve | None:
    """The Allan deviation of all undisturbed stills, first calibration applied; None where they are too short for one."""
    period_s = problem.logs[0].samples.period_s
    pieces = [
        problem.first(log.samples.gyro[still.start : still.stop])
        for log in problem.logs
        if abs(log.samples.period_s / period_s - 1) < 0.01
        for still in log.stills
        if still.problem is None and still.bumps == 0 and still.stop - still.start >= SHORTEST_PIECE
    ]
    return allan_curve(pieces, period_s) if pieces else None


def _beyond(fit: FitResult, explanation: Explanation | None, adopted: Adopted) -> list[Quantity]:
    if explanation is not None and adopted.claims:
        return beyond_linear(explanation.twin, explanation.whiten, explanation.naming.fit.state)
    twin = explanation.twin if explanation is not None else Twin(fit.problem)
    whiten = explanation.whiten if explanation is not None else known_whitener(twin)
    return beyond_linear(twin, whiten)


def _noise(curve: AllanCurve | None) -> list[Quantity]:
    """Angle random walk and bias instability of each axis."""
    if curve is None:
        return []
    found = []
    for number, axis in enumerate("xyz"):
        walk = angle_random_walk(curve, number)
        value, sigma = walk.value / DEG_PER_SQRT_HOUR, walk.sigma / DEG_PER_SQRT_HOUR
        found.append(Quantity("angle random walk", axis, "°/√h", value, COVERAGE_FACTOR * sigma, walk.observed))
    for number, axis in enumerate("xyz"):
        floor = bias_instability(curve, number)
        value, sigma, most = (x / DEG_PER_HOUR for x in (floor.value, floor.sigma, floor.at_most))
        found.append(Quantity("bias instability", axis, "°/h", value, COVERAGE_FACTOR * sigma, floor.observed, most))
    return found


def _now() -> str:
    """UTC, or the moment that SOURCE_DATE_EPOCH names: the same report twice is then the same bytes."""
    asked = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = datetime.fromtimestamp(int(asked), UTC) if asked.isdigit() else datetime.now(UTC)
    return moment.strftime("%Y-%m-%d %H:%M UTC")
