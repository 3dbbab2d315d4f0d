"""Noise before and after the denoiser, in time and in the spectrum (the paper's Figures 7, 8 and 12), and the delay it adds."""

from __future__ import annotations

import numpy as np

from session.base.numeric import rms_of
from session.base.units import DEG, MDPS
from tinygc.closure.problem import Problem
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.reported import ReportData
from tinygc.models.denoiser import REACH, DenoisedNet
from tinygc.noise.stillness import density
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.html.sections.noise_at_rest import still_pieces

NAME = "tinygc_denoised"
#: length drawn around one turn
AROUND_S = 0.6


def section(evidence: ReportData) -> Section | None:
    """Section on denoising; None if the fit has no denoiser, or no still is long enough for its noise."""
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
    still = max(range(len(before)), key=lambda i: len(before[i]))
    period_s = problem.logs[0].samples.period_s
    spectra = [found for pieces in (before, after) if (found := density(pieces, period_s))]
    html = render(
        "denoising.html",
        quiet_mdps=[each / MDPS for each in quiet],
        delay_ms=1e3 * model.delay_s,
        closure=[tilt_rms(each.held_out) for each in (evidence.fit.methods.get("tinygc"), fit) if each is not None],
        at_rest=_at_rest(before[still], after[still], period_s),
        turning=_turning(problem, model),
        spectra=_spectra(spectra) if len(spectra) == 2 else None,
    )
    return Section("denoiser", "Before and after the denoiser", html)


def _scatter(pieces: list[np.ndarray]) -> float:
    """Rms deviation from each piece's own mean over all axes, rad/s."""
    return rms_of(np.concatenate([piece - piece.mean(axis=0) for piece in pieces if len(piece) > 1]))


#: colour and name of each line
LINES = (("before", "calibrated"), (NAME, "denoised"))


def _at_rest(before: np.ndarray, after: np.ndarray, period_s: float) -> Panel:
    panel = Panel(Axis("time (s)"), Axis("rate at rest (mdps)"), about="Rate at rest before and after the denoiser")
    for rate, (kind, name) in zip((before, after), LINES, strict=True):
        values, style = (rate[:, 2] - rate[:, 2].mean()) / MDPS, "thin" if kind == "before" else "line"
        panel.line(np.arange(len(rate)) * period_s, values, kind, style, name=name)
    return panel


def _turning(problem: Problem, model: DenoisedNet) -> Panel:
    segment = max(problem.used, key=lambda one: one.turn_deg)
    samples = problem.logs[segment.log].samples
    rate = model.calibration(samples.gyro)
    part = rate[segment.start : segment.stop]
    row, axis = np.unravel_index(int(np.abs(part).argmax()), part.shape)
    around = max(4, round(AROUND_S / 2 / samples.period_s))
    rows = slice(max(segment.start + int(row) - around, 0), segment.start + int(row) + around)
    t = samples.t_s[rows] - samples.t_s[rows][0]
    panel = Panel(Axis("time (s)"), Axis("rate (dps)"), about="Rate in a turn before and after the denoiser")
    for values, (kind, name) in zip((rate, model(samples.gyro)), LINES, strict=True):
        panel.line(t, values[rows, axis] / DEG, kind, name=name)
    return panel


def _spectra(spectra: list[tuple[np.ndarray, np.ndarray]]) -> Panel:
    axes = Axis("frequency (Hz)", lo=0.0), Axis("amplitude density (mdps/√Hz)", log=True)
    panel = Panel(*axes, about="Spectrum at rest before and after the denoiser")
    for (frequency, amplitude), (kind, name) in zip(spectra, LINES, strict=True):
        panel.line(frequency, np.sqrt(np.mean(amplitude**2, axis=1)) / MDPS, kind, name=name)
    return panel
