"""A fit as text: closure by method, sensor errors, remarks.  Its tables are those of the calibration report as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from session.base.numeric import rms_of, sigmas_in
from session.base.texts import command_line, fixed, listed, printable, probability, significant
from session.base.units import DEG, MG
from session.detect.accelerometer import LengthFit
from tinygc.estimation.accelerometer import AccelerometerFit, drift_json
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.choice import RAW, closure_figures, run_figures
from tinygc.estimation.options import METHODS
from tinygc.estimation.spread import ZERO
from tinygc.fitting.fit_file import known_turns_words
from tinygc.fitting.results import FitResult
from tinygc.inference.decide import Fact
from tinygc.models.linear import BIAS, PARAMETERS, field_facts, field_jacobian
from tinygc.reporting.facts import Part, Table, errors_table, screen
from tinygc.reporting.tables import degrees_text
from tinygc.reporting.terminal import Group, Text, one_line
from tinygc.verdict.model_tests import NOISE, contradictions, gravity_test

if TYPE_CHECKING:
    from tinygc.closure.runs import ClosureRun
    from tinygc.estimation.physics import PhysicsFit
    from tinygc.explanation.reported import Adopted

TITLES = {name: method.title for name, method in METHODS.items()}
#: the errors that make up E and B
TERMS = ("scale factor error", "misalignment", "bias")
MOST_RESTS = 8  #: number of stills listed that are not references
SAME_FLOOR = 0.01  #: relative difference below which two floors are equal
#: methods that the first screen leaves out: the weaker one of the raw rates, and one whose purpose is another than closure
VERBOSE = ("raw_bias_removed", "tinygc_denoised")


#: least weight of a still that counts
IDLE_WEIGHT = 0.1


# Closure, by method and by run.


class Closed(NamedTuple):
    """A method's closure: error angles of the segments, fitted (None: all are held out) and held out, and of each run, rad; seconds."""

    name: str
    title: str
    parameters: int
    fitted: np.ndarray | None
    held_out: np.ndarray
    runs: Sequence[np.ndarray]
    seconds: float | None


def closed_methods(result: FitResult, adopted: Adopted | None = None) -> list[Closed]:
    """Return the methods of a fit, and the calibration of a report where it is none of them."""
    found = [
        Closed(name, TITLES[name], fit.parameters, fit.angles, fit.held_out, [each[name] for each in result.run_errors], fit.seconds)
        for name, fit in result.methods.items()
    ]
    if adopted is not None and adopted.name not in result.methods:
        found.append(Closed(adopted.name, adopted.title, len(adopted.vector), None, adopted.angles, adopted.run_errors, None))
    return found


def closure_table(result: FitResult, adopted: Adopted | None = None, brief: bool = False) -> Table:
    """Closure of each method in degrees; adopted: the calibration of a report, in bold; brief: for the first screen."""
    used, methods, white = adopted.name if adopted else result.use.method, closed_methods(result, adopted), result.problem.floor.tilt_rms
    rows: list[dict[str, str]] = []
    styles: dict[int, str] = {}
    of_run = ("roll ", "pitch ", "yaw ", "RMSE") if len(result.runs) == 1 else ("median", "worst")

    def add(title: str, style: str, errors: Sequence[np.ndarray], **figures: float | None) -> None:
        sizes = [rms_of(error) / DEG for error in errors]
        numbers = [*run_figures(errors[0]).values()] if len(sizes) == 1 else [float(np.median(sizes)), max(sizes)] if sizes else []
        figures |= dict(zip(of_run, numbers, strict=False))
        styles[len(rows)] = style
        rows.append({"": title, "closure runs": ", ".join(map(degrees_text, sizes)), **{k: degrees_text(v) for k, v in figures.items()}})

    for each in methods:
        if brief and each.name in VERBOSE and each.name != used and len(methods) > 1:
            continue
        figures: dict[str, Any] = {**closure_figures(each.held_out)}
        own = {name.partition("_")[0]: value for name, value in figures.items()}
        fitted = None if each.fitted is None else tilt_rms(each.fitted) / DEG
        add(each.title, "bold" if each.name == used else "dim" if each.name in RAW else "", each.runs, fitted=fitted, **own)
        times, seconds = significant(tilt_rms(each.held_out) / white), "" if each.seconds is None else f"{each.seconds:.2f}"
        rows[-1] |= {"held out": rows[-1]["tilt"], "par.": str(each.parameters), "÷ floor": times, "seconds": seconds}
    beyond = result.noise.tilt_rms if result.noise is not None else white
    floor = adopted.floor_rms if adopted else result.physics.problem.floor.tilt_rms if result.physics else white
    add("noise floor", "dim", [run.floor_rad for run in result.runs], tilt=white / DEG)
    for title, tilt in (("with non-white noise", beyond), ("noise floor of the repaired log (physics)", floor)):
        if not brief and abs(tilt / white - 1) > SAME_FLOOR:
            add(title, "dim", [], tilt=tilt / DEG)
    if brief:
        title, columns = "Closure error of held-out segments, degrees rms", ["", "roll", "pitch", "yaw", "tilt"]
        if result.runs:
            what = f"{len(result.runs)} closure runs" if len(result.runs) > 1 else f"closure run of {result.runs[0].duration_s:.0f} s"
            title, columns = f"Closure error, degrees: held-out segments; {what}", [*columns, *of_run]
        return Table(title, columns, _picked(rows, columns), styles=styles)
    rows += [{"": f"{TITLES[name]}: {why}"} for name, why in result.not_run.items()]
    for row in rows:
        row.setdefault("held out", row.get("tilt", ""))
    columns = ["", "par.", "fitted", "held out", "÷ floor", "roll", "pitch", "yaw", *["closure runs"] * bool(result.runs), "seconds"]
    folds = min(result.options.folds, len(result.problem.used))
    lines = f"tilt, held out over {folds} folds; roll, pitch, yaw: held out, about the table's axes"
    lines += "; yaw here: the turns of known angle, each about its own axis" * (result.problem.batch.turns is not None)
    return Table("Closure, degrees rms", columns, _picked(rows, columns), lines, styles=styles, minor=(1, 5, 6, 7, len(columns) - 1))


def _picked(rows: Sequence[Mapping[str, str]], columns: Sequence[str]) -> list[list[str]]:
    return [[row.get(name, "") for name in columns] for row in rows]


def run_table(run: ClosureRun, errors: Mapping[str, np.ndarray], used: str | None) -> Table:
    """Error of each method at the return of a closure run, degrees; used: the method whose row is bold."""
    everything = {**{TITLES.get(name, name): error for name, error in errors.items()}, "noise floor (1σ)": run.floor_rad}
    rows = [[title, *(f"{value:.4f}" for value in run_figures(error).values())] for title, error in everything.items()]
    styles = {at: "bold" for at, name in enumerate(errors) if name == used} | {len(errors): "dim"}
    alone = (
        "the heading is unknown, or the run does not go on where the log ended (the device's clock, gravity): of the Earth's rotation only "
        "the vertical part is taken off"
    )
    title = f"Closure run {run.file}, {run.duration_s:.0f} s, never fitted: error at the return, degrees"
    return Table(title, ("", "roll", "pitch", "yaw", "RMSE"), rows, alone * (run.earth.source == "unknown"), styles=styles)


# Sensor errors.


def sensor_errors(result: FitResult) -> list[Fact]:
    """Return the sensor errors of a fit by least squares, in the terms and signs of the report."""
    moved = None if result.allowed is None else result.allowed.of
    return field_facts(result.linear.linear.vector, result.covariance, result.linear.unobserved, moved)


def parameters_table(result: FitResult, brief: bool = False) -> Table:
    """Table of the sensor errors by least squares; brief: for the first screen."""
    notes = []
    if not brief:
        spread = result.spread.at(ZERO)
        any_session = spread.any_session(np.diag(result.covariance)[BIAS]).max() / DEG
        notes.append(f"In another session the bias differs by ± {any_session:.3f} dps ({spread.source}).")
    shown = [q for q in sensor_errors(result) if q.word in TERMS]
    return errors_table("Sensor errors (least squares): value ± one sigma", shown, notes)


def accelerometer_table(found: AccelerometerFit, title: str) -> Table:
    """Table of scale, nonorthogonality and bias, each with one sigma."""
    lines = [f"{test.description}." for test in gravity_test(found)]
    lines += [f"In any other session: {found.any_session_words}."] if found.any_session_words else []
    table = errors_table(title, found.facts, lines)
    if found.drift is None:
        return table
    drift = drift_json(found.drift)
    return replace(table, rows=[*table.rows, ["drift of the bias, mg/1000s", *zip(drift["mg_per_1000s"], drift["sigma"], strict=True)]])


def lengths_page(name: str, found: LengthFit, fit: AccelerometerFit) -> Group:
    """Output of ``fit --accelerometer alone``."""
    before, after = (float(np.std(each)) / MG for each in (found.before, found.after))
    lines = f"{len(found.before)} stills in {found.attitudes} attitudes; gravity's spread {before:.2f} mg before, {after:.2f} mg after"
    parts: list[Part] = [f"{name}: {lines}", accelerometer_table(fit, "Accelerometer errors: value ± one sigma")]
    idle = np.flatnonzero(found.weight < IDLE_WEIGHT)
    if len(idle):
        some = listed([f"{i} ({found.after[i] / MG:+.1f} mg)" for i in idle], 5)
        parts.append(Text(f"stills that hardly counted, their gravity being off: {some}", "yellow"))
    if found.unobserved:
        do = "rest it on edges and corners, too"
        parts.append(Text(f"Not observed by these attitudes: {', '.join(found.unobserved)}; {do}.", "yellow"))
    return screen(parts)


# Remarks on a fit, below its tables in the terminal: warnings, noise, losses, physics, correlations.


def remarks(result: FitResult) -> list[Text]:
    """Remarks, one per line, as far as they apply."""
    lines = [Text(f"First look: {w.where}: {w.what}: {w.description}; {w.do}", "yellow") for w in result.warnings]
    if result.nominal_rate is not None:
        lines.append(one_line(f"{result.nominal_rate.doubt}.", "yellow"))
    lines += _noise_words(result)
    if result.session.reference is not None and result.session.reference.words:
        lines.append(one_line(result.session.reference.words))
    lines.append(Text(result.bias_from.words))
    if result.prior is not None:
        lines.append(one_line(result.prior.words, "" if result.prior.used == "yes" else "yellow"))
    lines += [Text(_denoiser_words(fit.notes["denoiser"])) for fit in result.methods.values() if "denoiser" in fit.notes]
    if result.physics is not None:
        lines.append(Text(_physics_words(result.physics, bool(contradictions(result.tests))), "cyan"))
        from tinygc.estimation.physics import loss_words

        lost = [(run.file, loss_words(samples)) for run, samples in zip(result.runs, result.physics.lost_s, strict=True)]
        lines += [one_line(f"{file}: {words}.", "yellow") for file, words in lost if words]
    if unobserved := result.linear.unobserved:
        seen = f"Not observed by these movements: {', '.join(unobserved)}; turn about more axes, both ways."
        if result.problem.batch.turns is not None:
            seen += " Whole circles show scale factors alone; rests half way round, or turns to other sides, show misalignments."
        lines.append(Text(seen, "yellow"))
    _, strong = correlations(result.linear.linear.vector, result.covariance)
    lines += [Text(f"Correlated beyond ±{STRONG:g}: {'; '.join(strong)}")] if strong else []
    return lines


#: the independent ones of the field's 18 quantities: scale factors, misalignments, biases
INDEPENDENT = (0, 1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 17)
ERRORS = ("scale x", "scale y", "scale z", "x to y", "x to z", "y to x", "y to z", "z to x", "z to y", "bias x", "bias y", "bias z")
STRONG = 0.5  #: correlation from which on a pair is named


def correlations(vector: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Correlations (12, 12) of the errors of a linear model with this covariance (12, 12), and the strongest of them in words."""
    slope = field_jacobian(vector)[list(INDEPENDENT)]
    covariance = slope @ covariance @ slope.T
    sigma = sigmas_in(covariance)
    found = covariance / np.outer(sigma, sigma)
    pairs = sorted(((abs(found[i, j]), i, j) for i in range(PARAMETERS) for j in range(i)), reverse=True)
    return found, [f"{ERRORS[j]} and {ERRORS[i]} {fixed(found[i, j], 2)}" for size, i, j in pairs if size > STRONG][:6]


def _noise_words(result: FitResult) -> list[Text]:
    """Noise that the sigmas include, and whether the closure exceeds it."""
    words = []
    if result.goodness.excess > 1 or any(test.name == NOISE for test in contradictions(result.tests)):
        above = closure_figures(result.linear.angles)["tilt_rms_deg"] / (result.problem.floor.tilt_rms / DEG)
        p = f" ({probability(result.goodness.p_value)})" if result.goodness.excess > 1 else ""
        if above >= 1:
            much = f"The closure is {above:.1f} times its noise floor{p}"
        else:  # for all turns together; it is larger if each is weighted by its own or the estimated noise
            much = (
                f"The closure is {above:.1f} times its noise floor over all turns, and more than noise where each is weighed by its own{p}"
            )
        words.append(
            Text(
                f"{much}: something is missing from the model, or this sensor's noise is more than white. "
                "The sigmas above are widened for it.",
                "yellow",
            )
        )
    if result.noise is None:
        words.append(one_line(f"Bias instability included in the sigmas: {result.problem.instability.words}."))
    else:
        words.append(one_line(f"Bias instability: {result.problem.instability.words}."))
        words.append(one_line(f"Non-white noise included in the sigmas: {result.noise.words}."))
    if result.problem.at_rest is not None and result.problem.at_rest.words:
        words.append(one_line(result.problem.at_rest.words))
    return words


def _denoiser_words(figures: dict) -> str:
    ratios = figures["noise_reduction"]
    reduced = (
        "not measured, no still is as long as the window" if ratios is None else " ".join(f"{ratio:.1f}" for ratio in ratios) + " × (x y z)"
    )
    return f"Denoised: noise at rest reduced {reduced}; delay {figures['delay_samples']} samples ({figures['delay_s'] * 1e3:.0f} ms)."


def _physics_words(physics: PhysicsFit, contradicted: bool) -> str:
    from tinygc.explanation.claims import described  # with the search for effects, which a plain fit does not need

    claims = enumerate(physics.fit.state.claims)
    fitted = [described(claim.effect, claim.theta, physics.fit.theta_covariance(number)) for number, claim in claims]
    notes = [f"repaired before: {', '.join(physics.repaired)}"] if physics.repaired else []
    if physics.refused and (contradicted or fitted):
        explain = command_line("explain")
        nameless = f"a mismatch that no effect in the catalogue fits ({explain} states what is known): nothing is added to the linear model"
        notes.append(f"there is more that has no name: see {explain}" if fitted or notes else nameless)
    if physics.model.session_s is not None:
        notes.append("that follows the session's time: in closure runs, and for other logs (_at_end), it stands still at the session's end")
    return "Physics: " + ("; ".join([*fitted, *notes]) or "nothing is missing; it is the linear model")


# The whole output of ``fit --verbose``; nothing is printed here.


def fit_report(result: FitResult) -> Group:
    """Closure by method, closure runs, parameters, remarks."""
    parts: list[Part] = [_headline(result), closure_table(result)]
    if result.against_raw.worse:
        parts.append(one_line(f"{'FAIL: ' if result.against_raw.failed else ''}{result.against_raw.words}", "bold red"))
    parts += [run_table(run, errors, result.use.method) for run, errors in zip(result.runs, result.run_errors, strict=True)]
    parts.append(parameters_table(result))
    if result.accelerometer.mode != "given":
        parts.append(accelerometer_table(result.accelerometer, "Accelerometer, estimated with them: value ± one sigma"))
    return screen([*parts, *remarks(result), f"{result.use.why[0].upper()}{result.use.why[1:]}."])


def _headline(result: FitResult) -> Text:
    problem = result.problem
    noise = problem.noise.gyro / DEG * 1e3
    rejected = [segment for segment in problem.segments if not segment.accepted]
    text = Text(f"{result.session.name}: ", "bold")
    text.append(
        f"{len(problem.stills)} stills, {len(problem.segments)} segments, {len(problem.used)} used; "
        f"gyro noise {noise[0]:.1f} {noise[1]:.1f} {noise[2]:.1f} mdps/√Hz; {earth_words(result)}\n",
        "not bold",
    )

    def add(line: str, style: str = "not bold") -> None:
        text.append(f"  {printable(line)}\n", style)

    for segment in rejected:
        add(f"segment {segment.number} at {segment.start_s:.0f} s left out: {segment.problem}", "yellow")
    starts = {segment.number: segment.start_s for segment in problem.used}
    for each in problem.widened:
        add(f"segment {each.segment} at {starts[each.segment]:.0f} s: {each.words}", "yellow")
    unused = problem.unused_rests
    for log, rest in unused[:MOST_RESTS]:
        add(f"rest {rest} ({log})" if len(problem.session.logs) > 1 else f"rest {rest}")
    if len(unused) > MOST_RESTS:
        add(f"… and {len(unused) - MOST_RESTS} more rests that are no reference (fit.json has all)")
    for segment in problem.used:
        if segment.note:
            add(f"segment {segment.number} at {segment.start_s:.0f} s: {segment.note}")
    if words := known_turns_words(result):
        add(words)
    return text


def earth_words(result: FitResult) -> str:
    """Describe how the Earth's rotation was taken into account."""
    groups, given = len(result.problem.earths), result.session.config.site.heading_deg
    words = _heading_words(result)
    if given is not None and result.problem.earth.source == "estimated":
        words += f" (site.heading_deg = {given:g} contradicts it: did the sensor begin at the table's index?)"
    return words + (f"; the yaw is carried in {groups} pieces, each with a heading of its own" if groups > 1 else "")


def _heading_words(result: FitResult) -> str:
    earth = result.problem.earth
    if earth.source == "given" and earth.heading_rad is not None:
        return f"Earth's rotation with the heading given ({earth.heading_rad / DEG:.0f}°)"
    if earth.source == "estimated" and earth.heading_rad is not None:
        heading = f"{earth.heading_rad / DEG:.0f}° ± {earth.heading_sigma_rad / DEG:.0f}°"
        return f"Earth's rotation, heading estimated from the stills: {heading}"
    if earth.source == "unknown":
        return "Earth's rotation about the vertical only (the stills do not show the heading)"
    if not result.options.earth:
        return "Earth's rotation left out"
    missing = "no latitude_deg in site=" if result.session.in_memory else "no site.latitude_deg in session.toml"
    return f"the Earth's rotation is left out ({missing})"
