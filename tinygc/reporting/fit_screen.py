"""The first screen of a fit: verdict, closure of each method, sensor errors, what to do next; ``--verbose`` has the rest."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from session.base.texts import command_line, given_effects, significant
from session.detect.stills import BY_HAND
from tinygc.fitting.results import FitResult
from tinygc.inference.decide import KINDS
from tinygc.reporting.facts import Table, screen
from tinygc.reporting.fit_text import TITLES, closure_table, parameters_table
from tinygc.reporting.terminal import Group, Text, one_line
from tinygc.verdict.acceptance import GIVEN, Acceptance
from tinygc.verdict.model_tests import EARTH_ROTATION, contradictions


def fit_screen(result: FitResult, decision: Acceptance) -> Group:
    """Verdict, closure, sensor errors and what costs accuracy."""
    required = [] if decision.limit_from == GIVEN else decision.conformities
    rows = [[each.measured.name.partition(",")[0], each.measured.stated, each.limit_words, each.answer.upper()] for each in required]
    limits = [Table("Values ± U (95 %) and their limits", ("", "", "", ""), rows, left=(0, 3))] if rows else []
    tables = [*limits, closure_table(result, brief=True), parameters_table(result, brief=True)]
    return screen([*verdict_lines(decision), *tables, *_remarks(result)])


def verdict_lines(decision: Acceptance, reasons: bool = False) -> list[Text]:
    """The verdict with its reasons, and in small print the rule and what it risks; reasons: with each figure, whether it meets the rule."""
    style = KINDS[decision.answer].style
    lines = [one_line(decision.headline, style), *(one_line(text, style) for text in decision.further)]
    small = decision.rule.split("\n")
    if reasons:
        small += decision.risks
        met = {True: "met", False: "not met", None: "not decided"}
        small += [f"  {met[each]}: {reason}" for each, reason in decision.reasons]
        small += [f"  in doubt: {doubt}" for doubt in decision.doubts if doubt not in (decision.headline, *decision.further)]
        small += [f"  limit {significant(decision.limit_deg, 2)}°: {decision.limit_from}"] if decision.limit_deg is not None else []
    return [*lines, *(one_line(line, "dim") for line in small)]


def correction(result: FitResult) -> Text:
    """E and B of least squares, to copy."""
    model = result.linear.linear
    rows = ["[" + ", ".join(f"{value:.7f}" for value in row) + "]" for row in model.E]
    text = Text(f"omega = E m + B, rad/s\n  E = [{rows[0]},\n       {rows[1]},\n       {rows[2]}]\n")
    return text.append(f"  B = [{', '.join(f'{value:.7f}' for value in model.B)}]")


def _remarks(result: FitResult) -> list[Text]:
    """What costs accuracy."""
    warned = [f"{w.where}: {w.description}" for w in result.warnings if w.level == "warning"]
    found = [*dict.fromkeys(warned), *(f"{TITLES[name]}: {why}" for name, why in result.not_run.items())]
    if left_out := sum(segment.problem not in (None, f"it {BY_HAND}") for segment in result.problem.segments):
        found.append(f"{left_out} turn{'s' * (left_out > 1)} left out")
    if words := result.session.config.sensor.clock_words:
        found.append(f"{words}, included in every scale's sigma; `fit --clock arrivals` takes it out")
    if result.prior is not None and result.prior.used != "yes":
        found.append(result.prior.words)
    return [one_line(text, "yellow") for text in found] + (
        [one_line(result.prior.words)] if result.prior is not None and result.prior.used == "yes" else []
    )


def files_line(result: FitResult, folder: Path, decision: Acceptance) -> Text:
    """Name the model's file, and whether to use it."""
    if result.file_to_use is None:
        return one_line(f"do not use the models in {folder}: {result.use.why}", "bold red")
    path = folder / result.file_to_use
    if decision.answer in ("pass", "doubtful pass", "no limit") and not missing_of(result):
        return one_line(f"use {path}", "bold green")
    return one_line(f"best so far: {path}")


def next_line(result: FitResult, decision: Acceptance, effects: Sequence[Path] = (), reported: bool = False) -> Text:
    """What to run next; effects: folders of effects given to the fit, which the next command needs, too; reported: with a report."""
    folder = result.session.folder
    if result.file_to_use is None:
        return one_line(f"next: record more turns, to more attitudes; {command_line('check', folder)}")
    if EARTH_ROTATION in missing_of(result) and result.session.config.site.latitude_deg is None:
        return one_line(f"next: {command_line('fit', folder, '--latitude', 'DEG', *given_effects(effects))}")
    if missing_of(result):
        return one_line(f"next: {command_line('fit', folder, '--physics', 'auto', *given_effects(effects))}")
    if contradictions(result.tests) or not decision.passed:
        return one_line(f"next: {command_line('explain', folder, *given_effects(effects))}")
    if decision.answer == "not decided":
        return one_line(f"next: record more turns; {command_line('check', folder, '--plan')} names them")
    if not reported:
        return one_line(f"next: {command_line('report', folder, *given_effects(effects))}")
    if not (folder / "fit" / "fit.json").is_file():
        return one_line(f"next: {command_line('fit', folder, *given_effects(effects))}")
    more, logs = given_effects(effects), result.session.logs
    log = folder if len(logs) == 1 else logs[0].path  # the folder stands for its only log
    apply, export = command_line("apply", folder, log, "-o", "calibrated.csv", *more), command_line("export", folder, "--to", "c", *more)
    return one_line(f"next: {apply}").append("\n").append_text(one_line(f"  or: {export}"))


def missing_of(result: FitResult) -> str:
    """Name the effects that are probably missing, such as ``gyro.bandwidth or timing.axis_skew``; empty without one or with physics."""
    return "" if result.allowed is None or result.physics is not None else " or ".join(result.allowed.suspected)
