"""What to know about a fit, below its tables in the terminal: warnings, noise, losses, physics, correlations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from session.checks.alignment import truth_words
from session.common.console import one_line
from session.common.units import DEG
from tinygc.fitting.figures import closure_figures
from tinygc.fitting.result import FitResult
from tinygc.methods.method_fit import MethodFit
from tinygc.models.linear import BIAS, NAMES, PARAMETERS, LinearModel
from tinygc.problem.closure_run import ClosureRun

if TYPE_CHECKING:
    from tinygc.fitting.physics.fit_physics import PhysicsFit

NAMELESS = "a mismatch that no effect in the catalogue fits (calibrate.py explain says what is known): nothing is added to the linear model"


def remarks(result: FitResult) -> list[Text]:
    """A line each, where there is something to say."""
    said = [Text(f"First look: {w.where}: {w.what}: {w.says}; {w.do}", "yellow") for w in result.warnings]
    said += _noise_words(result)
    if result.session.alignment is not None:
        said.append(one_line(f"Truth: {truth_words(result.session.alignment)}."))
    said.append(Text(result.bias_from.words))
    if result.lot is not None:
        said.append(one_line(result.lot.words, "" if result.lot.used == "yes" else "yellow"))
    said += [Text(_denoiser_words(fit.notes["denoiser"])) for fit in result.methods.values() if "denoiser" in fit.notes]
    if result.physics is not None:
        said.append(Text(_physics_words(result.physics), "cyan"))
        said += [one_line(f"{run.file}: {words}.", "yellow") for run, words in _losses(result) if words]
    unobserved = result.linear.notes.get("unobserved")
    if unobserved:
        seen = f"Not observed by these movements: {', '.join(unobserved)}; turn about more axes, both ways."
        if result.problem.batch.turns is not None:
            seen += " Whole circles show scale factors alone; rests half way round, or turns to other sides, show misalignments."
        said.append(Text(seen, "yellow"))
    pairs = _correlations(result.covariance)
    if pairs:
        said.append(Text("Correlated above 0.5: " + ", ".join(pairs)))
    now, other = (closure_figures(fit.held_out)["tilt_rms_deg"] for fit in (result.linear, result.other_choice))
    words = ("without", "with") if result.options.still_rates else ("with", "without")
    moved = np.abs(linear_of(result.other_choice).B - linear_of(result.linear).B) / np.sqrt(np.diag(result.covariance)[BIAS])
    said.append(
        Text(
            f"{words[0].capitalize()} --still-rates: held out {other:.4f} instead of {now:.4f}; "
            f"the bias moves by up to {moved.max():.1f} sigma."
        )
    )
    said.append(Text(f"The paper's first-order integrator would err by up to {result.first_order_rad / DEG:.4f}° on a segment here."))
    return said


def _noise_words(result: FitResult) -> list[Text]:
    """What the sigmas reckon with, and whether the closure needs more than noise."""
    words = []
    if result.goodness.excess > 1 or (result.noise is not None and result.noise.noise.unusual):
        above = closure_figures(result.linear.angles)["tilt_rms_deg"] / (result.problem.floor.tilt_rms / DEG)
        p = f" (p {_p_words(result.goodness.p_value)})" if result.goodness.excess > 1 else ""
        if above >= 1:
            much = f"The closure is {above:.1f} times its noise floor{p}"
        else:  # of all turns alike; weighed each by its own noise, or by the noise that is found, it is more
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
        words.append(one_line(f"Bias instability, which the sigmas reckon with: {result.problem.instability.words}."))
    else:
        words.append(one_line(f"Bias instability: {result.problem.instability.words}."))
        words.append(one_line(f"Noise beyond white, which the sigmas reckon with: {result.noise.words}."))
    return words


def linear_of(fit: MethodFit) -> LinearModel:
    """Of least squares, the model."""
    assert isinstance(fit.model, LinearModel)
    return fit.model


def _losses(result: FitResult) -> list[tuple[ClosureRun, str]]:
    """Each closure run, with what is to be said of samples lost in it."""
    from tinygc.fitting.physics.lost_in_runs import loss_words

    return [(run, loss_words(lost)) for run, lost in zip(result.runs, result.lost_s, strict=True)]


def _denoiser_words(figures: dict) -> str:
    less = figures["noise_reduction"]
    words = (
        "not measured (no still is as long as the window)" if less is None else " ".join(f"{ratio:.1f}" for ratio in less) + " times less"
    )
    return f"Denoised: noise at rest {words}; {figures['delay_samples']} samples ({figures['delay_s'] * 1e3:.0f} ms) late."


def _physics_words(physics: PhysicsFit) -> str:
    fitted = [claim.effect.says(claim.theta) for claim in physics.fit.state.claims]
    mended = [f"mended before: {', '.join(physics.mended)}"] if physics.mended else []
    if physics.refused:
        mended.append("there is more that has no name: see calibrate.py explain" if mended else NAMELESS)
    if physics.model.session_s is not None:
        mended.append(
            "that follows the session's time: in closure runs, and for other logs (_at_end), it stands still at the session's end"
        )
    return "Physics: " + ("; ".join([*fitted, *mended]) or "nothing is missing; it is the linear model with the rates of the stills")


def _p_words(p_value: float) -> str:
    return f"= {p_value:.1g}" if p_value > 1e-99 else "< 1e-99"


def _correlations(covariance: np.ndarray) -> list[str]:
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    pairs = [(abs(correlation[i, j]), i, j) for i in range(PARAMETERS) for j in range(i) if abs(correlation[i, j]) > 0.5]
    return [f"{NAMES[j]}–{NAMES[i]} {correlation[i, j]:+.2f}" for _, i, j in sorted(pairs, reverse=True)[:6]]
