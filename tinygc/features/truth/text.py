"""An explanation with a truth file as reference: its page, its JSON and its report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session import VERSION
from session.base.records import plain
from session.base.units import DEG, MG
from session.detect.findings import xyz_text
from tinygc.effects import largest
from tinygc.explanation.claims import p_words
from tinygc.explanation.result import at_rest, chance_words, head
from tinygc.features.truth.alignment import alignment_table
from tinygc.features.truth.check import frame_text, mounting_text, offset_text
from tinygc.features.truth.evidence import TruthClaim, TruthExplanation
from tinygc.features.truth.picture import figure_of
from tinygc.library.explanations import Why
from tinygc.reporting.explanation_text import verdict_line
from tinygc.reporting.facts import Table
from tinygc.reporting.html.chart import Chart, log_axis
from tinygc.reporting.html.markup import Section, render
from tinygc.reporting.terminal import Group, Text, one_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _before_after(rms_rad: tuple[float, float]) -> dict:
    return {"before": rms_rad[0] / DEG, "after": rms_rad[1] / DEG}


# An explanation with a truth file as reference, for the terminal, and its report.

#: share of the gyro's own noise, which an independent truth cannot follow: two sigmas of the rms of 100 angles
OWN_NOISE_SHARE = 0.85
MOST_VALUES = 9  #: values of a claim that are printed: a whole matrix
CANNOT = (
    "cannot know: an error of the gyro's sensitivity from one of the truth's scale of angles; a common rotation of gyro and accelerometer "
    "from one of the truth's body; temperature, which is not recorded; clocks of gyro and accelerometer, where no still gives gravity"
)


def values_of(claim: TruthClaim) -> list[str]:
    """Each parameter in display units, with its sigma if it has one."""
    si = claim.effect.parameter.si
    if claim.sigma is None:
        return [f"{value:g}" for value in claim.theta / si]
    return [f"{value:.4g} ± {sigma:.2g}" for value, sigma in zip(claim.theta / si, claim.sigma / si, strict=True)]


def refusals(e: TruthExplanation) -> list[str]:
    """Sentence for each effect that would fit, but is rejected for its size."""
    return [
        f"not named: {claim.effect.id} would fit with {largest(claim.theta) / claim.effect.parameter.si:.2g} "
        f"{claim.effect.parameter.unit}, more than such a gyro has: it is something else, or the truth's"
        for claim in e.refused
    ]


def independent(e: TruthExplanation) -> bool | None:
    """Whether the closure over the shortest length is as large as the gyro's own noise; a truth file estimated with this gyro follows
    that noise.  None if the noise is unknown, because the gyro is never still."""
    if not len(e.lengths_s) or not len(e.problem.stills):
        return None
    return bool(np.sqrt(np.mean(e.closure_rad[0] ** 2)) > OWN_NOISE_SHARE * e.gyro_rad * np.sqrt(e.lengths_s[0]))


def evidence_rows(e: TruthExplanation) -> list[tuple[str, str]]:
    """Subject of each line of evidence (empty: the same as above), and its statement."""
    grown = "; ".join(f"{t:g} s: {np.sqrt(np.mean(row**2)) / DEG:.3f}" for t, row in zip(e.lengths_s, e.closure_rad, strict=True))
    before, after = e.neighbours
    lost = sum(len(truth.outages) for truth in e.session.reference.truths)
    sizes = [f"{c.says}: {s / c.si:.2g} {c.unit}" for s, c in zip(e.noise.s, e.noise.components, strict=True) if s > 0]
    rows = [
        ("closure", f"{len(e.problem.used)} segments, {e.closure_rms[0] / DEG:.3f}° rms before, {e.closure_rms[1] / DEG:.3f}° after"),
        ("", f"of segments held out {e.held_out_rms[0] / DEG:.3f}° before, {e.held_out_rms[1] / DEG:.3f}° after"),
        ("noise", "; ".join(sizes) or "nothing beside the gyro's white noise"),
        ("truth", f"{len(e.jumps)} wrong moments; {lost} outages; closure per angle by length, degrees: {grown}"),
        ("", f"by this growth {e.truth_rad / DEG:.3f}° a moment of truth, {e.walk_rad / DEG:.3f}°/√s"),
        ("", _own_noise(e)),
        ("", f"neighbouring segments correlate {before:+.2f}, after {after:+.2f} (-0.5: the truth's noise, 0: the gyro's, more: slow)"),
        ("clocks", f"truth {offset_text(e.alignment)}"),
        ("frames", f"gyro to truth {mounting_text(e.alignment)}; {frame_text(e.alignment)}"),
    ]
    if (force := e.force) is not None:
        off = f"accelerometer off by {xyz_text(force.bias / MG, 0)} mg ± {xyz_text(force.sigma / MG, 0)}"
        rows.append(("", f"{off}; turned as the gyro asks: {xyz_text(force.turned / MG, 0)}"))
    if (rests := e.rests) is not None:
        zero = f"zero-rate offset there less in motion {xyz_text(rests.difference / DEG, 3)} dps ± {xyz_text(rests.sigma / DEG, 3)}"
        rows.append(("rest", f"{rests.seconds:.0f} s; {zero}"))
        rows.append(("", f"vibration {rests.vibration_g2[0]:.4f} g² there, {rests.vibration_g2[1]:.4f} in motion"))
    return [(of, says if "nan" not in says else f"{says.split(' ')[0]}: not known, too few segments") for of, says in rows]


def _own_noise(e: TruthExplanation) -> str:
    if not len(e.lengths_s):
        return "too few moments of truth to see the closure grow"
    if independent(e) is None:
        return "the gyro is never still: its own noise is not known"
    own = e.gyro_rad / DEG * np.sqrt(e.lengths_s[0])
    too_good = "" if independent(e) else ": more than is seen, so the truth follows this gyro's noise and was made with it"
    return f"the gyro's own noise would leave {own:.4f}° after the shortest length{too_good}"


class TruthReport(Why):
    """Report of an explanation with a truth file as reference."""

    def _table(self) -> dict:
        e: TruthExplanation = self.explanation
        expected_deg = float(np.sqrt(np.mean(np.trace(e.problem.floor.own, axis1=1, axis2=2)))) / DEG
        lengths = {f"{length:g}": row / DEG for length, row in zip(e.lengths_s, e.closure_rad, strict=True)}
        phases = sorted({phase for c in e.claimed for phase in c.effect.observable_in})
        place = {"phases": phases, "axes": [], "segments": [], "conditions": None}
        return plain(
            head(e, e.closure_rms[0] / DEG, expected_deg, place, e.claimed)
            | {
                "refused": [claim.to_json() for claim in e.refused],
                "considered": [{"id": name, "probability": p} for name, p in e.naming.considered.items()],
                "fit": {
                    "holdout_closure_rms_deg": {**_before_after(e.held_out_rms), "floor": expected_deg},
                    "closure_rms_deg": _before_after(e.closure_rms),
                },
                "noise": e.problem.instability.to_json() | at_rest(e.problem) | {"components": e.noise.to_json()},
                "truth": {
                    "wrong_moments": [{"log": log, "at_s": round(at, 3)} for log, at in e.jumps],
                    "outages": [
                        {
                            "log": log,
                            "from_s": round(outage.from_s, 3),
                            "to_s": round(outage.to_s, 3),
                            "rms_dps": outage.size_rps / DEG,
                            "times_usual": outage.times_usual,
                            "of": "truth" if outage.sure else "truth or gyro",
                        }
                        for log, truth in enumerate(e.session.reference.truths)
                        for outage in truth.outages
                    ],
                    "sigma_deg": e.truth_rad / DEG,
                    "gyro_walk_deg_rts": e.walk_rad / DEG,
                    "closure_deg_by_length_s": lengths,
                    "gyro_noise_walk_deg_rts": e.gyro_rad / DEG,
                    "neighbours_correlation": {"before": e.neighbours[0], "after": e.neighbours[1]},
                    **alignment_table(e.alignment),
                },
                "force": None
                if e.force is None
                else {
                    "bias_mg": e.force.bias / MG,
                    "bias_turned_mg": e.force.turned / MG,
                    "std_mg": e.force.sigma / MG,
                },
                "rests": None
                if e.rests is None
                else {
                    "seconds": e.rests.seconds,
                    "zero_less_motion_dps": e.rests.difference / DEG,
                    "vibration_g2": {"rest": e.rests.vibration_g2[0], "motion": e.rests.vibration_g2[1]},
                },
                "excess": {"before": e.excess[0], "after": e.excess[1]},
                "next": None,
                "version": VERSION,
            }
        )

    def _page(self) -> Group:
        e: TruthExplanation = self.explanation
        parts: list = [verdict_line(e), Text("")]
        for claim in e.claimed:
            share = f"   takes up {100 * claim.share:.0f} % of chi-square" if claim.share else ""
            share += f"   or {', '.join(claim.equivalent)}" if claim.equivalent else ""
            # A claim that was found before any fit has a p-value alone.
            weighed = f"probability {chance_words(claim.probability)}, " if claim.rivals else ""
            chance = f"   {weighed}p {p_words(claim.p_value)}{share}"
            parts.append(Text.assemble((f"{claim.effect.id}  ", "bold cyan"), claim.effect.equation, chance))
            parts.append(one_line(f"  {claim.says}"))
            parts.append(Text(f"  {claim.effect.parameter.name}: {'   '.join(values_of(claim)[:MOST_VALUES])}\n"))
        parts += [one_line(sentence, end="\n") for sentence in refusals(e)]
        parts += [Table("Evidence", ("of", "it says"), evidence_rows(e), left=(0, 1)), Text(CANNOT)]
        return Group(*parts, *(Text(f"First look: {w.where}: {w.what}: {w.says}", "yellow") for w in e.warnings))

    def _picture(self) -> Figure:
        return figure_of(self.explanation)


# The section of a report.


def section(e: TruthExplanation) -> Section:
    """Section on the explanation."""
    html = render(
        "truth.html",
        "tinygc.features.truth",
        e=e,
        values_of=values_of,
        refusals=refusals(e),
        rows=evidence_rows(e),
        growth=lambda width: _growth(e, width),
        cannot=CANNOT,
    )
    return Section("explain", "Why recording and truth differ", html)


def _growth(e: TruthExplanation, width: int) -> str:
    closure = e.closure_rad / DEG
    # A gyro that is never still shows vibration in its apparent noise.
    own = e.gyro_rad / DEG * np.sqrt(e.lengths_s) if len(e.problem.stills) else np.zeros(0)
    x, y = log_axis(e.lengths_s, "length of a segment, s"), log_axis(np.r_[closure.ravel(), own], "closure, degrees")
    chart = Chart(width, 250, x, y, "Closure against the length of a segment")
    if len(own):
        chart.line(e.lengths_s, own, "floor", "dash")
    for i, axis in enumerate("xyz"):
        chart.dots(e.lengths_s, closure[:, i], axis)
    return chart.svg()
