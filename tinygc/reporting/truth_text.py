"""An explanation with a truth file as reference, for the terminal, and its report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from session.bench.console import one_line
from session.detect.check_references import frame_text, mounting_text, offset_text
from session.io.units import DEG, MG
from tinygc.effects import largest
from tinygc.explanation.claims import p_words
from tinygc.explanation.result import truth_to_json
from tinygc.explanation.truth_evidence import TruthClaim, TruthExplanation
from tinygc.reporting.explanation_text import ExplanationReport
from tinygc.reporting.pictures.truth import figure_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: share of the gyro's own noise, which an independent truth cannot follow: two sigmas of the rms of 100 angles
OWN_NOISE_SHARE = 0.85
MOST_VALUES = 9  #: values of a claim that are printed: a whole matrix
CANNOT = (
    "cannot know: an error of the gyro's sensitivity from one of the truth's scale of angles; a common rotation of gyro and accelerometer "
    "from one of the truth's body; temperature, which is not recorded; clocks of gyro and accelerometer, where no still gives gravity"
)


def truth_page(e: TruthExplanation) -> Group:
    """Page of verdict, claims, and the evidence on sensor, truth and clocks."""
    parts: list = [truth_line(e), Text("")]
    for claim in e.claimed:
        share = f"   takes up {100 * claim.share:.0f} % of chi-square" if claim.share else ""
        share += f"   or {', '.join(claim.equivalent)}" if claim.equivalent else ""
        parts.append(Text.assemble((f"{claim.effect.id}  ", "bold cyan"), claim.effect.equation, f"   p {p_words(claim.p_value)}{share}"))
        parts.append(one_line(f"  {claim.says}"))
        parts.append(Text(f"  {claim.effect.parameter.name}: {'   '.join(values_of(claim)[:MOST_VALUES])}\n"))
    parts += [one_line(sentence, end="\n") for sentence in refusals(e)]
    parts += [_evidence(e), Text(CANNOT)]
    return Group(*parts, *(Text(f"First look: {w.where}: {w.what}: {w.says}", "yellow") for w in e.warnings))


def truth_line(e: TruthExplanation) -> Text:
    """Session, verdict and p-value."""
    return Text.assemble((f"{e.problem.session.name}: ", "bold"), e.verdict.replace("_", " "), f"   (p {p_words(e.p_value)})")


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


def _evidence(e: TruthExplanation) -> Table:
    table = Table(title="Evidence", title_justify="left", box=None)
    table.add_column("of")
    table.add_column("it says", overflow="fold")
    for row in evidence_rows(e):
        table.add_row(*row)
    return table


def evidence_rows(e: TruthExplanation) -> list[tuple[str, str]]:
    """Subject of each line of evidence (empty: the same as above), and its statement."""

    def triple(values: np.ndarray, digits: int = 2) -> str:
        return ", ".join(f"{value:.{digits}f}" for value in values)

    grown = "; ".join(f"{t:g} s: {np.sqrt(np.mean(row**2)) / DEG:.3f}" for t, row in zip(e.lengths_s, e.closure_rad, strict=True))
    before, after = e.neighbours
    rows = [
        ("closure", f"{len(e.problem.used)} segments, {e.closure_rms[0] / DEG:.3f}° rms before, {e.closure_rms[1] / DEG:.3f}° after"),
        ("", f"of segments held out {e.held_out_rms[0] / DEG:.3f}° before, {e.held_out_rms[1] / DEG:.3f}° after"),
        ("noise", _noise(e)),
        ("truth", f"{len(e.jumps)} wrong moments; closure per angle by length, degrees: {grown}"),
        ("", f"by this growth {e.truth_rad / DEG:.3f}° a moment of truth, {e.walk_rad / DEG:.3f}°/√s"),
        ("", _own_noise(e)),
        ("", f"neighbouring segments correlate {before:+.2f}, after {after:+.2f} (-0.5: the truth's noise, 0: the gyro's, more: slow)"),
        ("clocks", "truth not known" if e.alignment is None else f"truth {offset_text(e.alignment)}"),
        ("frames", "not known" if e.alignment is None else f"gyro to truth {mounting_text(e.alignment)}; {frame_text(e.alignment)}"),
    ]
    if (force := e.force) is not None:
        off = f"accelerometer off by {triple(force.bias / MG, 0)} mg ± {triple(force.sigma / MG, 0)}"
        rows.append(("", f"{off}; turned as the gyro asks: {triple(force.turned / MG, 0)}"))
    if (rests := e.rests) is not None:
        zero = f"zero-rate offset there less in motion {triple(rests.difference / DEG, 3)} dps ± {triple(rests.sigma / DEG, 3)}"
        rows.append(("rest", f"{rests.seconds:.0f} s; {zero}"))
        rows.append(("", f"vibration {rests.vibration_g2[0]:.4f} g² there, {rests.vibration_g2[1]:.4f} in motion"))
    return [(of, says if "nan" not in says else f"{says.split(' ')[0]}: not known, too few segments") for of, says in rows]


def _noise(e: TruthExplanation) -> str:
    sizes = [f"{c.says}: {s / c.si:.2g} {c.unit}" for s, c in zip(e.noise.s, e.noise.components, strict=True) if s > 0]
    return "; ".join(sizes) or "nothing beside the gyro's white noise"


def _own_noise(e: TruthExplanation) -> str:
    if not len(e.lengths_s):
        return "too few moments of truth to see the closure grow"
    if independent(e) is None:
        return "the gyro is never still: its own noise is not known"
    own = e.gyro_rad / DEG * np.sqrt(e.lengths_s[0])
    too_good = "" if independent(e) else ": more than is seen, so the truth follows this gyro's noise and was made with it"
    return f"the gyro's own noise would leave {own:.4f}° after the shortest length{too_good}"


class TruthReport(ExplanationReport):
    """Report of an explanation with a truth file as reference."""

    def to_json(self) -> dict:
        """``tinygc-explain/1`` (docs/formats.md)."""
        return truth_to_json(self.explanation)

    def line(self) -> Text:
        """Session, verdict and p-value, in one line."""
        return truth_line(self.explanation)

    def page(self) -> Group:
        """Page for the terminal."""
        return truth_page(self.explanation)

    def picture(self) -> Figure:
        """Draw the page of pictures.  Raises CalibrationError if matplotlib is missing."""
        return figure_of(self.explanation)
