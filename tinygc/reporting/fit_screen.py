"""The first screen of a fit: verdict, closure of each method, sensor errors, the numbers to copy, what to do next.

It fits 80 columns and 32 lines; ``fit --verbose`` and the report have the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from session.base.texts import command_line
from session.detect.stamp_errors import STAMPS
from tinygc.fitting.results import FitResult
from tinygc.inference.decide import KINDS
from tinygc.reporting.facts import screen
from tinygc.reporting.fit_text import TITLES, closure_table, parameters_table
from tinygc.reporting.terminal import Group, Text, one_line
from tinygc.verdict.acceptance import Acceptance
from tinygc.verdict.model_tests import contradictions

#: columns of the screen
COLUMNS = 80


def fit_screen(result: FitResult, decision: Acceptance) -> Group:
    """Verdict, closure, sensor errors and the correction of a fit."""
    return screen(
        [*verdict_lines(decision), closure_table(result, brief=True), parameters_table(result), _correction(result), *_remarks(result)]
    )


def verdict_lines(decision: Acceptance, reasons: bool = False) -> list[Text]:
    """The verdict, and in small print the rule, what it risks and what is in doubt; reasons: with each figure, and whether it meets the
    rule."""
    met = {True: "met", False: "not met", None: "not decided"}
    more = [f"  {met[each]}: {reason}" for each, reason in decision.reasons] if reasons else []
    more += [*decision.risks, *(f"in doubt: {doubt}" for doubt in decision.doubts if reasons or doubt not in decision.headline)]
    return [one_line(decision.headline, KINDS[decision.answer].style), *(one_line(line, "dim") for line in (decision.rule, *more))]


def _correction(result: FitResult) -> Text:
    """E and B of least squares, to copy."""
    model = result.linear.linear
    rows = ["[" + ", ".join(f"{value:.7f}" for value in row) + "]" for row in model.E]
    text = Text(f"omega = E m + B, rad/s\n  E = [{rows[0]},\n       {rows[1]},\n       {rows[2]}]\n")
    return text.append(f"  B = [{', '.join(f'{value:.7f}' for value in model.B)}]")


def _remarks(result: FitResult) -> list[Text]:
    """What costs accuracy, in one line; ``--verbose`` has it in full."""
    warned = [w for w in result.warnings if w.level == "warning"]
    said = list(dict.fromkeys(f"{w.where}: {w.what}" for w in warned if w.what not in STAMPS))
    said += [f"{TITLES[name]}: {why}" for name, why in result.not_run.items()]
    if left_out := sum(not segment.accepted for segment in result.problem.segments):
        said.append(f"{left_out} segment{'s' * (left_out > 1)} left out")
    lines = [one_line(w.line, "yellow") for w in warned if w.what in STAMPS]
    lines += [one_line(f"see --verbose: {'; '.join(said)}", "yellow")] if said else []
    if words := result.session.config.sensor.clock_words:
        lines.append(one_line(f"{words}, which is in every scale's sigma; `fit --clock arrivals` takes it out", "yellow"))
    if result.prior is not None:
        lines.append(one_line(result.prior.words, "" if result.prior.used == "yes" else "yellow"))
    return lines


def files_line(result: FitResult, folder: Path, decision: Acceptance) -> Text:
    """Name the model's file, and whether to use it."""
    if result.file_to_use is None:
        return one_line(f"files: {folder}; use none of the models: {result.use.why}", "bold red")
    if missing := missing_of(result):
        return one_line(f"files: {folder} (the best so far: {result.file_to_use}; an effect is probably missing: {missing})", "bold yellow")
    if decision.answer in ("pass", "doubtful pass"):
        return one_line(f"use {folder / result.file_to_use}", "bold green")
    return one_line(f"files: {folder} (the best model: {result.file_to_use})")


def next_line(result: FitResult, decision: Acceptance, effects: Sequence[Path] = ()) -> Text:
    """Suggest what to run next; effects: folders of effects given to the fit, which the next command needs, too."""
    folder = result.session.folder
    if result.file_to_use is None:
        return Text("next: record more turns, to more attitudes; look for errors with\n").append(
            one_line(f"  {command_line('check', folder)}")
        )
    if missing_of(result):
        return Text("next:\n").append(one_line(f"  {command_line('fit', folder, '--physics', 'auto', *_given(effects))}"))
    unexplained = bool(contradictions(result.tests)) or not decision.passed
    return Text("next:\n").append(one_line(f"  {command_line('explain' if unexplained else 'report', folder, *_given(effects))}"))


def missing_of(result: FitResult) -> str:
    """Name the effects that the model probably lacks, such as ``gyro.bandwidth or timing.axis_skew``; empty without one, or where named
    physics were fitted."""
    return "" if result.allowed is None or result.physics is not None else " or ".join(result.allowed.suspected)


def _given(effects: Sequence[Path]) -> list[str | Path]:
    return [word for path in effects for word in ("--effects", path)]
