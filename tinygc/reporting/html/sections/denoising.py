"""Noise before and after the denoiser, in time and in the spectrum (the paper's Figures 7, 8 and 12), and the delay it adds."""

from __future__ import annotations

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import degrees, significant
from session.base.units import DEG
from tinygc.closure.problem import Problem
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.reported import ReportData
from tinygc.models.denoiser import REACH, DenoisedNet
from tinygc.noise.stillness import density
from tinygc.reporting.html.chart import Axis, Chart, linear_axis, log_axis
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.noise_at_rest import still_pieces

NAME = "tinygc_denoised"
#: length drawn around one turn
AROUND_S = 0.6


def section(evidence: ReportData) -> Section | None:
    """Section on denoising; None if the fit has no denoiser, or no still is long enough to tell its noise."""
    fit = evidence.fit.methods.get(NAME)
    if fit is None:
        return None
    model, problem = fit.model, evidence.problem
    assert isinstance(model, DenoisedNet)
    before, after = (still_pieces(problem, one) for one in (model.calibration, model))
    if not any(len(piece) > 2 for piece in before):
        return None
    settle = [slice(min(REACH, len(piece) // 2), None) for piece in before]
    quiet = [_scatter([piece[part] for piece, part in zip(pieces, settle, strict=True)]) for pieces in (before, after)]
    calibrated = evidence.fit.methods.get("tinygc")
    still = max(range(len(before)), key=lambda i: len(before[i]))
    period_s = problem.logs[0].samples.period_s
    spectra = [found for pieces in (before, after) if (found := density(pieces, period_s))]
    html = render(
        "denoising.html",
        numbers=[
            ("Scatter at rest, rms", f"{significant(quiet[0] / DEG * 1e3)} → {significant(quiet[1] / DEG * 1e3)} mdps"),
            ("Less by a factor of", significant(quiet[0] / quiet[1])),
            ("Delay", f"{significant(1e3 * model.delay_s)} ms"),
            ("Closure, held out", (f"{degrees(tilt_rms(calibrated.held_out))} → " if calibrated else "") + degrees(tilt_rms(fit.held_out))),
        ],
        at_rest=lambda width: _at_rest(before[still], after[still], period_s, width),
        turning=lambda width: _turning(problem, model, width),
        spectra=(lambda width: _spectra(spectra, width)) if len(spectra) == 2 else None,
    )
    return Section("denoiser", "Before and after the denoiser", html)


def _scatter(pieces: list[np.ndarray]) -> float:
    """Rms deviation from each piece's own mean over all axes, rad/s."""
    return rms_of(np.concatenate([piece - piece.mean(axis=0) for piece in pieces if len(piece) > 1]))


def _at_rest(before: np.ndarray, after: np.ndarray, period_s: float, width: int) -> str:
    t = np.arange(len(before)) * period_s
    lines = [(rate[:, 2] - rate[:, 2].mean()) / DEG * 1e3 for rate in (before, after)]
    chart = Chart(width, 210, Axis(0, t[-1], "time, s"), linear_axis(lines[0], "mdps"), "Rate at rest before and after the denoiser")
    return chart.line(t, lines[0], "before", "thin").line(t, lines[1], NAME).svg()


def _turning(problem: Problem, model: DenoisedNet, width: int) -> str:
    segment = max(problem.used, key=lambda one: one.turn_deg)
    samples = problem.logs[segment.log].samples
    rate = model.calibration(samples.gyro)
    part = rate[segment.start : segment.stop]
    row, axis = np.unravel_index(int(np.abs(part).argmax()), part.shape)
    around = max(4, round(AROUND_S / 2 / samples.period_s))
    rows = slice(max(segment.start + int(row) - around, 0), segment.start + int(row) + around)
    t = samples.t_s[rows] - samples.t_s[rows][0]
    lines = [values[rows, axis] / DEG for values in (rate, model(samples.gyro))]
    chart = Chart(
        width, 210, Axis(0, t[-1], "time, s"), linear_axis(np.concatenate(lines), "dps"), "Rate in a turn before and after the denoiser"
    )
    return chart.line(t, lines[0], "before").line(t, lines[1], NAME).svg()


def _spectra(spectra: list[tuple[np.ndarray, np.ndarray]], width: int) -> str:
    lines = [(frequency, np.sqrt(np.mean(amplitude**2, axis=1)) / DEG * 1e3) for frequency, amplitude in spectra]
    y = log_axis(np.concatenate([values for _, values in lines]), "mdps/√Hz", margin=1.2)
    chart = Chart(width, 230, Axis(0, lines[0][0][-1], "frequency, Hz"), y, "Spectrum at rest before and after the denoiser")
    for (frequency, values), kind in zip(lines, ("before", NAME), strict=True):
        chart.line(frequency, values, kind)
    return chart.svg()
