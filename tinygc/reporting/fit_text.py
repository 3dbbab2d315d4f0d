"""A fit in the terminal: closure table, parameters, remarks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.base.numeric import sigmas_in
from session.base.texts import command_line, listed, printable
from session.base.units import DEG, MG
from session.detect.accelerometer import LengthFit
from tinygc.estimation.accelerometer import AccelerometerFit, drift_json
from tinygc.estimation.choice import closure_figures, run_figures
from tinygc.estimation.expected_zero import USUAL_SPREAD
from tinygc.estimation.options import METHODS
from tinygc.fitting.fit_file import known_turns_words
from tinygc.fitting.results import FitResult
from tinygc.models.linear import BIAS, NAMES, PARAMETERS, Quantity, field_quantities
from tinygc.reporting.terminal import Group, RenderableType, Table, Text, one_line, plain_table
from tinygc.verdict.model_tests import NOISE, contradictions, gravity_test

if TYPE_CHECKING:
    from tinygc.estimation.physics import PhysicsFit
    from tinygc.fitting.bias_of_day import Rebiased


# An accelerometer's calibration as a table in the terminal.

#: decimals in a table, by unit
DIGITS = {"ppm": 0, "mrad": 3, "mg": 3}
#: least weight of a still that counts
IDLE_WEIGHT = 0.1


def accelerometer_table(found: AccelerometerFit, title: str) -> Table:
    """Table of scale, nonorthogonality and bias, each with one sigma."""
    table = plain_table(title, "", "x", "y", "z", right=True)
    for word, unit, values, sigmas, names in found.errors():
        digits, spread = DIGITS[unit], np.zeros(3) if sigmas is None else sigmas
        shown = zip(values, spread, names, strict=True)
        cells = ["not observed" if name in found.unobserved else f"{v:.{digits}f} ± {s:.{digits}f}" for v, s, name in shown]
        table.add_row(f"{word}, {unit}" + (" (xy, xz, yz)" if unit == "mrad" else ""), *cells)
    if found.drift is not None:
        drift = drift_json(found.drift)
        cells = [f"{v:.2f} ± {s:.2f}" for v, s in zip(drift["mg_per_1000s"], drift["sigma"], strict=True)]
        table.add_row("drift of the bias, mg/1000s", *cells)
    said = [test.says for test in gravity_test(found)]
    said += [f"in any other session: {found.any_session_words}"] if found.any_session_words else []
    if said:
        table.caption, table.caption_justify = "; ".join(said), "left"
    return table


def lengths_page(name: str, found: LengthFit, fit: AccelerometerFit) -> Group:
    """Output of ``fit --accelerometer alone``."""
    text = Text(f"{name}: ", "bold")
    before, after = (float(np.std(each)) / MG for each in (found.before, found.after))
    said = f"{len(found.before)} stills in {found.attitudes} attitudes; gravity's spread {before:.2f} mg before, {after:.2f} mg after"
    text.append(said, "not bold")
    parts: list[RenderableType] = [text, accelerometer_table(fit, "Accelerometer errors: value ± one sigma")]
    idle = np.flatnonzero(found.weight < IDLE_WEIGHT)
    if len(idle):
        some = listed([f"{i} ({found.after[i] / MG:+.1f} mg)" for i in idle], 5)
        parts.append(Text(f"stills that hardly counted, their gravity being off: {some}", "yellow"))
    if found.unobserved:
        do = "rest it on edges and corners, too"
        parts.append(Text(f"Not observed by these attitudes: {', '.join(found.unobserved)}; {do}.", "yellow"))
    return Group(*parts)


# Remarks on a fit, below its tables in the terminal: warnings, noise, losses, physics, correlations.


def remarks(result: FitResult) -> list[Text]:
    """Remarks, one per line, as far as they apply."""
    said = [Text(f"First look: {w.where}: {w.what}: {w.says}; {w.do}", "yellow") for w in result.warnings]
    if result.nominal_rate is not None:
        said.append(one_line(f"D{result.nominal_rate.doubt[1:]}.", "yellow"))
    said += _noise_words(result)
    if result.session.reference is not None and result.session.reference.words:
        said.append(one_line(result.session.reference.words))
    said.append(Text(result.bias_from.words))
    if result.prior is not None:
        said.append(one_line(result.prior.words, "" if result.prior.used == "yes" else "yellow"))
    said += [Text(_denoiser_words(fit.notes["denoiser"])) for fit in result.methods.values() if "denoiser" in fit.notes]
    if result.physics is not None:
        said.append(Text(_physics_words(result.physics, bool(contradictions(result.tests))), "cyan"))
        from tinygc.estimation.physics import loss_words

        lost = [(run.file, loss_words(samples)) for run, samples in zip(result.runs, result.physics.lost_s, strict=True)]
        said += [one_line(f"{file}: {words}.", "yellow") for file, words in lost if words]
    if unobserved := result.linear.unobserved:
        seen = f"Not observed by these movements: {', '.join(unobserved)}; turn about more axes, both ways."
        if result.problem.batch.turns is not None:
            seen += " Whole circles show scale factors alone; rests half way round, or turns to other sides, show misalignments."
        said.append(Text(seen, "yellow"))
    covariance = result.covariance
    sigma = sigmas_in(covariance)
    correlation = covariance / np.outer(sigma, sigma)
    pairs = [(abs(correlation[i, j]), i, j) for i in range(PARAMETERS) for j in range(i) if abs(correlation[i, j]) > 0.5]
    if pairs:
        shown = (f"{NAMES[j]}–{NAMES[i]} {correlation[i, j]:+.2f}" for _, i, j in sorted(pairs, reverse=True)[:6])
        said.append(Text("Correlated above 0.5: " + ", ".join(shown)))
    now, other = (closure_figures(fit.held_out)["tilt_rms_deg"] for fit in (result.linear, result.other_choice))
    words = ("without", "with") if result.options.still_rates else ("with", "without")
    moved = np.abs(result.other_choice.linear.B - result.linear.linear.B) / np.sqrt(np.diag(result.covariance)[BIAS])
    said.append(
        Text(
            f"{words[0].capitalize()} still_rates: held out {other:.4f} instead of {now:.4f}; "
            f"the bias moves by up to {moved.max():.1f} sigma."
        )
    )
    said.append(Text(f"The paper's first-order integrator would err by up to {result.first_order_rad / DEG:.4f}° on a segment here."))
    return said


def _noise_words(result: FitResult) -> list[Text]:
    """Noise that the sigmas include, and whether the closure exceeds it."""
    words = []
    if result.goodness.excess > 1 or any(test.name == NOISE for test in contradictions(result.tests)):
        above = closure_figures(result.linear.angles)["tilt_rms_deg"] / (result.problem.floor.tilt_rms / DEG)
        p_value = result.goodness.p_value
        p = f" (p {f'= {p_value:.1g}' if p_value > 1e-99 else '< 1e-99'})" if result.goodness.excess > 1 else ""
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
    mended = [f"mended before: {', '.join(physics.mended)}"] if physics.mended else []
    if physics.refused and (contradicted or fitted):
        explain = command_line("explain")
        nameless = f"a mismatch that no effect in the catalogue fits ({explain} says what is known): nothing is added to the linear model"
        mended.append(f"there is more that has no name: see {explain}" if fitted or mended else nameless)
    if physics.model.session_s is not None:
        mended.append(
            "that follows the session's time: in closure runs, and for other logs (_at_end), it stands still at the session's end"
        )
    return "Physics: " + ("; ".join([*fitted, *mended]) or "nothing is missing; it is the linear model")


# The terminal report of a fit, as rich renderables; nothing is printed here.

TITLES = {name: method.title for name, method in METHODS.items()}
MOST_RESTS = 8  #: number of stills listed that are not references
SAME_FLOOR = 0.01  #: relative difference below which two floors are equal


def fit_report(result: FitResult) -> Group:
    """Closure by method, closure runs, parameters, remarks."""
    parts: list[RenderableType] = [_headline(result), _methods(result)]
    if result.against_raw.worse:
        parts.append(one_line(f"{'FAIL: ' if result.against_raw.failed else ''}{result.against_raw.words}", "bold red"))
    if result.runs:
        table = plain_table("Closure runs, never fitted: error at the return, degrees", "", "roll", "pitch", "yaw", "RMSE", right=True)
        for run, errors in zip(result.runs, result.run_errors, strict=True):
            table.add_row(f"{run.file}, {run.duration_s:.0f} s", style="bold")
            for name, error in errors.items():
                figures = run_figures(error)
                row = (figures[key] for key in ("roll_deg", "pitch_deg", "yaw_deg", "rmse_deg"))
                table.add_row(f"  {TITLES[name]}", *(f"{value:.4f}" for value in row))
            floor = run.floor_rad / DEG
            table.add_row("  noise floor (1σ)", *(f"{x:.4f}" for x in floor), f"{np.sqrt(np.mean(floor**2)):.4f}", style="dim")
        if any(run.earth.source == "unknown" for run in result.runs):
            table.caption = (
                "the heading is unknown, or the run does not go on where the log ended (the device's clock, gravity): "
                "of the Earth's rotation only the vertical part is taken off"
            )
            table.caption_justify = "left"
        parts.append(table)
    parts.append(parameters_table(result))
    if result.accelerometer.mode != "given":
        parts.append(accelerometer_table(result.accelerometer, "Accelerometer, estimated with them: value ± one sigma"))
    return Group(*parts, *remarks(result), Text(f"{result.use.why[0].upper()}{result.use.why[1:]}."))


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
    groups, asked = len(result.problem.earths), result.session.config.site.heading_deg
    words = _heading_words(result)
    if asked is not None and result.problem.earth.source == "estimated":
        words += f" (site.heading_deg = {asked:g} contradicts it: did the sensor begin at the table's index?)"
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


def _methods(result: FitResult) -> Table:
    table = plain_table("Closure per segment, degrees rms", "", "par.", "fitted", "held out", "roll", "pitch", "yaw", "seconds", right=True)
    for name, fit in result.methods.items():
        train, held = closure_figures(fit.angles), closure_figures(fit.held_out)
        yaw = "–" if held["yaw_rms_deg"] is None else f"{held['yaw_rms_deg']:.4f}"
        table.add_row(
            TITLES[name],
            str(fit.parameters),
            f"{train['tilt_rms_deg']:.4f}",
            f"{held['tilt_rms_deg']:.4f}",
            f"{held['roll_rms_deg']:.4f}",
            f"{held['pitch_rms_deg']:.4f}",
            yaw,
            f"{fit.seconds:.2f}",
        )
    for name, why in result.not_run.items():
        table.add_row(printable(f"{TITLES[name]}: {why}"), style="yellow")
    floor = f"{result.problem.floor.tilt_rms / DEG:.4f}"
    table.add_row("noise floor", "", floor, floor, style="dim")
    if result.noise is not None and result.noise.tilt_rms > (1 + SAME_FLOOR) * result.problem.floor.tilt_rms:
        beyond = f"{result.noise.tilt_rms / DEG:.4f}"
        table.add_row("… with the noise beyond white", "", beyond, beyond, style="dim")
    if result.physics is not None and abs(result.physics.problem.floor.tilt_rms / result.problem.floor.tilt_rms - 1) > SAME_FLOOR:
        mended = f"{result.physics.problem.floor.tilt_rms / DEG:.4f}"
        table.add_row("noise floor of the mended log (physics)", "", mended, mended, style="dim")
    folds = min(result.options.folds, len(result.problem.used))
    table.caption = f"fitted, held out: tilt; held out over {folds} folds; roll, pitch, yaw: held out, about the table's axes"
    if result.problem.batch.turns is not None:
        table.caption += "; yaw here: the turns of known angle, each about its own axis"
    table.caption_justify = "left"
    return table


def sensor_errors(result: FitResult) -> list[Quantity]:
    """Return the sensor errors of a fit by least squares, in the terms and signs of the report."""
    moved = None if result.allowed is None else result.allowed.of
    return field_quantities(result.linear.linear.vector, result.covariance, result.linear.unobserved, moved)


def parameters_table(result: FitResult) -> Table:
    """Table of the sensor errors by least squares."""
    quantities = sensor_errors(result)
    by_name = {(q.word, q.component): q for q in quantities}
    table = plain_table("Sensor errors (least squares): value ± one sigma", "", "x", "y", "z", right=True)
    table.padding = (0, 1, 0, 0)

    def row(title: str, digits: int, names: list[tuple[str, str] | None]) -> None:
        table.add_row(title, *("" if name is None else _cell(by_name[name], digits) for name in names))

    row("scale factor error, ppm", 0, [("scale factor error", axis) for axis in "xyz"])
    for axis in "xyz":
        row(f"misalignment of {axis}, mrad", 3, [None if axis == other else ("misalignment", f"{axis} to {other}") for other in "xyz"])
    said = []
    if result.allowed is not None:
        most = [max(q.moved for q in quantities if q.word == word) for word in ("scale factor error", "misalignment", "bias")]
        said.append(
            f"further, by one effect that the model lacks, up to: scale {most[0]:.0f} ppm, misalignment {most[1]:.3f} mrad, "
            f"bias {most[2]:.4f} dps"
        )
    spread = result.repeatability or USUAL_SPREAD
    any_session = spread.sigma(result.covariance[BIAS, BIAS]).max() / DEG
    own = "" if result.repeatability else "this bias is of this session; "
    said.append(f"{own}the bias of any other session: ± {any_session:.3f} dps ({spread.source})")
    if said:
        table.caption, table.caption_justify = "; ".join(said), "left"
    sigma = min(by_name["bias", axis].sigma for axis in "xyz")
    row("bias, dps", int(np.clip(1 - np.floor(np.log10(max(sigma, 1e-9))), 0, 5)), [("bias", axis) for axis in "xyz"])
    return table


def _cell(quantity: Quantity, digits: int) -> str:
    return f"{quantity.value:.{digits}f} ± {quantity.sigma:.{digits}f}" if quantity.observed else "not observed"


# The bias of the day in the terminal.


def rebias_report(result: Rebiased) -> Group:
    """Table of a bias of the day: change of B and closure, by the source of the bias."""
    from tinygc.fitting.bias_of_day import remarks

    titles = {"stored": "stored bias", "start": "bias start", "gravity": "bias gravity", "given": "bias given"}
    table = Table(title=f"{result.path.name} in {result.problem.session.name}", title_justify="left", title_style="bold", box=None)
    for column in ("", "change of B, dps: x", "y", "z", "closure, degrees rms: tilt", "yaw", *(f"{run.file} RMSE" for run in result.runs)):
        table.add_column(column, justify="left" if not column else "right")
    for name, angles in result.angles.items():
        change, sigma = result.changes.get(name, (np.zeros(3), None))
        own = closure_figures(angles)
        cells = [
            f"{c / DEG:+.4f}" + ("" if sigma is None else f" ± {s / DEG:.4f}")
            for c, s in zip(change, np.zeros(3) if sigma is None else sigma, strict=True)
        ]
        yaw = "–" if own["yaw_rms_deg"] is None else f"{own['yaw_rms_deg']:.4f}"
        rmse = [f"{run_figures(errors[name])['rmse_deg']:.4f}" for errors in result.run_errors]
        table.add_row(titles[name], *cells, f"{own['tilt_rms_deg']:.4f}", yaw, *rmse, style="bold" if name == result.source else "")
    table.caption, table.caption_justify = "bold is what is saved", "left"
    first, *warnings = (f"{each[0].upper()}{each[1:]}." for each in remarks(result))
    return Group(table, one_line(first), *(one_line(each, "yellow") for each in warnings))
