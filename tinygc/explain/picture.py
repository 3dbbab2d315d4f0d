"""One page per explanation: the mismatch where it lives, against what explains it, before and after; and closure per segment."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

import numpy as np

from session.errors import CalibrationError
from session.units import DEG
from tinygc.explain.drawn import added_in_stills, rates_per_still, segment_peak, still_variable, told
from tinygc.explain.explain import Claimed, Explanation
from tinygc.explain.pages import VERDICTS
from tinygc.explain.proof import tilt_rms

COLOURS = {"x": "#c0392b", "y": "#27804a", "z": "#2c5fa8"}
BEFORE, AFTER, FLOOR = "#c0392b", "#2c5fa8", "#777777"


def draw(e: Explanation, path: Path) -> None:
    """Write the page as PNG.  Raises CalibrationError where matplotlib is missing."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise CalibrationError("pictures need matplotlib: python -m pip install 'tinygc[plot]', or use --no-pictures") from None
    figure = Figure(figsize=(13, 8), layout="constrained")
    top, bottom = figure.subplots(2, 2, gridspec_kw={"height_ratios": [1.15, 1]})
    claim = told(e)
    _along_variable(e, claim, top[0])
    _recorded_against_modelled(e, claim, top[1])
    _closure(e, bottom[0])
    _stills_in_time(e, bottom[1])
    names = ", ".join(claim.effect.id for claim in [*e.claimed, *e.findings])
    says = "  ".join(claim.says for claim in [*e.claimed, *e.findings])
    title = f"{e.session.name}: {VERDICTS[e.verdict][0]}" + (f"\n{names}" if names else "")
    figure.suptitle(title + ("\n" + fill(says, 150) if says else ""), fontsize=11)
    figure.savefig(path, dpi=110)


def _along_variable(e: Explanation, claim: Claimed | None, axes) -> None:
    """Closure, or rate in the stills, along the variable that the effect follows."""
    twin = e.twin
    variable, units = claim.effect.regime if claim else ("time", "s")
    if claim is not None and "still" not in claim.effect.seen_in:
        x = segment_peak(twin, variable)
        numbers = [segment.number for segment in twin.segments]
        index = {number: i for i, number in enumerate(e.proof.before_numbers)}
        before = np.array([np.linalg.norm(e.proof.before[index[n]][:2]) if n in index else np.nan for n in numbers]) / DEG
        after = np.linalg.norm(e.proof.after[:, :2], axis=1) / DEG
        axes.semilogy(x, before, "o", color=BEFORE, label="before")
        axes.semilogy(x, after, "o", mfc="none", color=AFTER, label="after")
        axes.axhline(e.proof.floor_rms / DEG, color=FLOOR, ls="--", label="floor")
        axes.set(
            xlabel=f"{variable} in the segment ({units})", ylabel="held-out closure (°)", title="Where it lives: closure of each segment"
        )
        axes.legend()
        return
    before, after = rates_per_still(e)
    x = still_variable(twin, variable)
    for i, axis in enumerate("xyz"):
        axes.plot(x, before[:, i] * 1e3, "o", color=COLOURS[axis], label=f"{axis} before")
        axes.plot(x, after[:, i] * 1e3, "o", mfc="none", color=COLOURS[axis], label=f"{axis} after")
    axes.axhline(0, color=FLOOR, lw=0.8)
    label = "gravity along the sensor's z axis (g)" if variable == "attitude" else f"{variable} ({units})"
    axes.set(xlabel=label, ylabel="rate beyond the prediction (mdps)", title="Where it lives: rate in each still")
    axes.legend(ncols=3, fontsize=8)


def _recorded_against_modelled(e: Explanation, claim: Claimed | None, axes) -> None:
    """Each still's rate and what the effect says it should be; or the two channels' sigmas where no rate effect is told."""
    if claim is not None and "still" in claim.effect.seen_in and claim in e.claimed:
        modelled = added_in_stills(e.twin, claim, e.naming.fit.rates) * 1e3
        _, after = rates_per_still(e)
        recorded = modelled + after * 1e3
        for i, axis in enumerate("xyz"):
            axes.plot(modelled[:, i], recorded[:, i], "o", color=COLOURS[axis], label=axis, ms=4)
        span = [min(modelled.min(), recorded.min()), max(modelled.max(), recorded.max())]
        axes.plot(span, span, color=FLOOR, lw=0.8)
        axes.set(xlabel=f"{claim.effect.id} says (mdps)", ylabel="recorded in the still (mdps)", title="Recorded against explained")
        axes.legend()
        return
    names, before, after = [], [], []
    for name, part in e.whiten.parts.items():
        names.append({"closure": "closure", "still": "rate in stills", "length": "gravity's length"}[name])
        before.append(np.sqrt(np.mean(e.naming.first.r[part] ** 2)))
        after.append(np.sqrt(np.mean(e.naming.fit.r[part] ** 2)))
    at = np.arange(len(names))
    axes.bar(at - 0.2, before, 0.4, color=BEFORE, label="before")
    axes.bar(at + 0.2, after, 0.4, color=AFTER, label="after")
    axes.axhline(1, color=FLOOR, ls="--", label="noise alone")
    axes.set_xticks(at, names)
    axes.set(ylabel="rms in sigmas", title="Recorded less predicted, by channel")
    if max(before) > 20:
        axes.set_yscale("log")
    axes.legend()


def _closure(e: Explanation, axes) -> None:
    """Held-out closure per segment, before, after, floor."""
    before = np.linalg.norm(e.proof.before[:, :2], axis=1) / DEG
    after = np.linalg.norm(e.proof.after[:, :2], axis=1) / DEG
    axes.semilogy(e.proof.before_numbers, before, "o-", color=BEFORE, lw=0.7, label=f"before, {tilt_rms(e.proof.before) / DEG:.4f}° rms")
    axes.semilogy(e.proof.after_numbers, after, "o-", mfc="none", color=AFTER, lw=0.7, label=f"after, {tilt_rms(e.proof.after) / DEG:.4f}°")
    axes.axhline(e.proof.floor_rms / DEG, color=FLOOR, ls="--", label=f"floor, {e.proof.floor_rms / DEG:.4f}°")
    axes.set(xlabel="segment", ylabel="closure (°)", title="Closure of segments that the fit never saw")
    axes.legend()


def _stills_in_time(e: Explanation, axes) -> None:
    """Rate in each still over the session: where drifts, steps and stills that are none show."""
    before, after = rates_per_still(e)
    t = still_variable(e.twin, "time")
    for i, axis in enumerate("xyz"):
        axes.plot(t, before[:, i] * 1e3, "-", color=COLOURS[axis], lw=0.8, alpha=0.6)
        axes.plot(t, after[:, i] * 1e3, "o", mfc="none", color=COLOURS[axis], ms=4, label=axis)
    axes.set(
        xlabel="time (s)", ylabel="rate beyond the prediction (mdps)", title="Rate in the stills over time: lines before, circles after"
    )
    axes.legend(ncols=3)
