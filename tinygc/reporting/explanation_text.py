"""An explanation in the terminal, on its picture's page and as files, whatever its reference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from session.base.files import result_folder
from session.base.records import write_whole
from session.base.units import DEG, MG
from session.detect.check_references import frame_text, mounting_text, offset_text
from session.detect.findings import xyz_text
from tinygc.effects import largest
from tinygc.effects.effect import IN_STILLS
from tinygc.explanation.checked import Checked, checked_to_json
from tinygc.explanation.claims import LEFT, Claim, measured, p_words
from tinygc.explanation.decision import tilt_rms
from tinygc.explanation.engine import Explanation
from tinygc.explanation.result import (
    HEADING,
    chance_words,
    considered_lines,
    equivalent_words,
    families_of,
    is_refitted,
    noise_rows,
    residual_table,
    rival_words,
    to_json,
    truth_to_json,
    what_next,
    where,
)
from tinygc.explanation.search import in_words, lines_end_hz
from tinygc.explanation.truth_evidence import TruthClaim, TruthExplanation
from tinygc.noise.twin import Variable
from tinygc.reporting.checked_text import checked_page
from tinygc.reporting.pictures.canvas import save as save_figure
from tinygc.reporting.pictures.page import figure_of
from tinygc.reporting.pictures.truth import figure_of as truth_figure_of
from tinygc.reporting.terminal import Group, Table, Text, one_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# An explanation as text, for the terminal and the page of pictures, and its files.

# Page of an explanation, in the terminal and on the picture.

MOST_SAID = 6  #: number of segments listed, worst first


def explanation_page(e: Explanation, with_next: bool = True) -> Group:
    """Page of verdict, effects with their parameters, residuals, evidence and, if ``with_next``, what to do next."""
    parts: list = [verdict_line(e), *([] if e.decision is None else [one_line(f"fit: {e.decision.headline}", "dim")]), Text("")]
    among = " among the catalogue's effects" if e.verdict in LEFT else ""
    # Warnings of the first look come before findings without a name: they are the likelier cause.
    parts += [Text(f"First look: {w.where}: {w.what}: {w.says}; {w.do}\n", "yellow") for w in e.warnings]
    parts += [one_line(f"{family.words}\n") for family in families_of(e)]
    for claim in e.claimed:
        parts.append(
            Text.assemble(
                (f"{claim.effect.id}  ", "bold cyan"),
                claim.effect.equation,
                f"   probability {chance_words(claim.probability)}{among}, p {p_words(claim.p_value, claim.p_is_bound)}",
            )
        )
        parts.append(one_line(f"  {claim.says}"))
        parts += [Text(f"  {line}") for line in parameter_lines(claim)]
        if claim.equivalent:
            parts.append(Text(f"  could as well be: {', '.join(equivalent_words(claim))}", "yellow"))
        parts += [*_rivals(claim), Text("")]
    for claim in e.findings:
        chance = f"   probability {chance_words(claim.probability)}, p {p_words(claim.p_value)}"
        parts.append(Text.assemble((f"{claim.effect.id}  ", "bold magenta"), claim.effect.equation, chance))
        parts.append(one_line(f"  {claim.says}; it carries {100 * (claim.share or 0):.0f} % of the misfit"))
        parts += [*_rivals(claim), Text("")]
    parts += [
        Text(HEADING, "italic"),
        _channels(e),
        _gravity(e),
        _stamps(e),
        Text(""),
    ]
    # Candidates that were detected or weighed, and rejected.
    lines = considered_lines(e)
    parts += [Text("considered, and not borne out:"), *(Text(f"  {line}") for line in lines)] if lines else []
    if e.verdict == "unexplained" and (highest := lines_end_hz(e.twin)) is not None:
        parts.append(Text(f"not looked for: lines of the rate above {highest:.2g} Hz, of which so long a session has too many"))
    parts += _noise(e)
    if not e.problem.instability.source.startswith("typical"):
        parts.append(one_line(f"bias instability, which `noise.bias_wander` begins from: {e.problem.instability.words}"))
    if e.problem.at_rest is not None and e.problem.at_rest.words:
        parts.append(one_line(e.problem.at_rest.words))
    parts += [*_where(e), _proof(e)]
    if e.verdict == "no_mismatch":
        parts += [Text(line) for line in in_words(e.detection_limits)]
    if with_next and (following := what_next(e)):
        parts.append(Text.assemble(("next: ", "bold"), following))
    return Group(*parts)


def verdict_line(e: Explanation) -> Text:
    """Session, verdict and p-value."""
    words, style = e.words
    return Text.assemble((f"{e.session.name}: ", "bold"), (words, style), f"   (p {p_words(e.p_value)})")


def _rivals(claim: Claim) -> list[Text]:
    rivals = rival_words(claim)
    return [Text(f"  weighed in its place: {', '.join(rivals)}")] if rivals else []


def _noise(e: Explanation) -> list[Text | Table]:
    """Noise components with their sizes."""
    table = Table(box=None, show_header=False)
    for row in noise_rows(e):
        table.add_row(*row)
    return [Text("estimated non-white noise:"), table] if table.row_count else []


def parameter_lines(claim: Claim) -> list[str]:
    """Parameters as ``name: value ± std``, a matrix by rows."""
    lines = []
    for name, value in claim.parameters.items():
        std = claim.std.get(name)
        rows = value if isinstance(value, list) and value and isinstance(value[0], list) else [value]
        spreads = std if isinstance(std, list) and std and isinstance(std[0], list) else [std]
        for i, row in enumerate(rows):
            spread = spreads[i] if i < len(spreads) else None
            lines.append(f"{name if i == 0 else ' ' * len(name)}: {_numbers(row, spread)}")
    return lines


def _numbers(value: Any, std: Any) -> str:
    if not isinstance(value, list):
        return str(value) if isinstance(value, int | str) else measured(value, std)  # a text describes the numbers
    if not isinstance(std, list) or len(std) != len(value):
        shown = ", ".join(f"{v:.10g}" for v in value[:16])
        return shown + (f", … ({len(value)})" if len(value) > 16 else "")
    return "   ".join(measured(v, s) for v, s in zip(value, std, strict=True))


def _channels(e: Explanation) -> Table:
    """Table of channels: root mean square of recording less prediction, in sigmas of the channel's noise."""
    table, refitted = Table(box=None), is_refitted(e)
    for column in ("channel", "values", *(("before", "after") if refitted else ("rms",))):
        table.add_column(column, justify="left" if column == "channel" else "right")
    for row in residual_table(e):
        shown = [row.before] + [row.after] * (row.after is not None)
        table.add_row(row.channel, str(row.values), *(f"{rms:.2f}" for rms in shown))
    return table


def _stamps(e: Explanation) -> Text:
    """Compare registers and stamps with the prediction, which has no false reading and one sample per period."""
    longest = max(float(log.samples.dt_s.max() / log.samples.period_s) for log in e.problem.logs)
    mended = [claim.effect for claim in e.claimed if claim.effect.id in e.mended.found]
    found = [effect.id for effect in mended if effect.occurs is None or effect.occurs.counts != IN_STILLS]
    return Text(
        f"registers: {', '.join(found) or 'none at a limit, none false, none lost unseen'}; stamps: longest interval {longest:.2f} periods"
    )


def _gravity(e: Explanation) -> Text:
    lever = ", ".join(f"{1e3 * x:.0f}" for x in e.gravity.lever_m)
    return Text(
        f"gravity during the turns: off by {e.gravity.before_mps2 / MG:.1f} mg rms; {e.gravity.after_mps2 / MG:.1f} mg with a lever arm of "
        f"{lever} mm and the gyro {1e3 * abs(e.gravity.offset_s):.2f} ms {'late' if e.gravity.offset_s > 0 else 'early'}"
        + ("" if e.gravity.is_offset else f" ± {1e3 * e.gravity.whole_sigma_s:.2f}, claimed from {1e3 * e.gravity.bar_s:.1f} on")
    )


def _where(e: Explanation) -> list[Text]:
    place = where(e)
    if not place["phases"]:
        return []
    words = [f"lives in: {', '.join(place['phases'])}"]
    if place["axes"]:
        words.append(f"axes {', '.join(place['axes'])}")
    words += [text for text in (variable_words(place["conditions"]), seconds_words(place["seconds"])) if text]
    if place["segments"]:
        worst = zip(place["segments"][:MOST_SAID], place["segment_seconds"], strict=False)
        words.append("worst segments " + ", ".join(f"{number} ({start:.0f}–{stop:.0f} s)" for number, (start, stop) in worst))
    return [Text("; ".join(words))]


def variable_words(regime: dict | None) -> str:
    """Range of the variable, such as ``gravity along x −0.98 to 1 g``; empty without a range, or if the variable is time."""
    if regime is None or regime["variable"] == "time":
        return ""
    words = Variable(regime["variable"], "xyz".index(regime["axis"]) if "axis" in regime else None).words
    return f"{words} {regime['from']:.3g} to {regime['to']:.3g} {regime['units']}".replace("-", "−")


def seconds_words(seconds: list[float] | None) -> str:
    """Time range, such as ``from 3.2 to 154.7 s``, or an empty text."""
    return "" if seconds is None else f"from {seconds[0]:.1f} to {seconds[1]:.1f} s"


def _proof(e: Explanation) -> Text:
    before, after, floor = (x / DEG for x in (tilt_rms(e.proof.before), tilt_rms(e.proof.after), e.proof.floor_rms))
    if not e.proof.changed:
        return Text(f"held-out closure: {before:.4f}°, floor {floor:.4f}°")
    removed = "" if e.proof.removed is None else f"; {100 * e.proof.removed:.1f} % of the excess is gone"
    if e.proof.removed is not None and e.proof.removed <= 0:
        removed = "; closure is no better for what is named"
    if e.proof.worse:
        removed = f"; closure is worse with what is named, {tilt_rms(e.proof.named) / DEG:.4f}°: the model without it is handed on"
    return Text(f"held-out closure: {before:.4f}° before, {after:.4f}° after, floor {floor:.4f}°{removed}")


# Report of an explanation: its page, line, JSON, picture and files.


class ExplanationReport:
    """Base class for reports of an explanation; subclasses serve other references and the search beyond the catalogue."""

    #: notes for the user on files that ``save`` kept or removed
    notes: tuple[str, ...] = ()

    #: the claims on other recordings
    checked: Sequence[Checked] = ()
    #: what a feature says of the machine that turned the table: ``page()`` and ``to_json()``; None without one
    turned_by: Any = None

    def __init__(self, explanation: Any):
        self.explanation = explanation

    def offers(self, folder: Path) -> list[tuple[str, str]]:
        """Titles and commands of what may follow; folder: where it is saved."""
        return []

    def to_json(self) -> dict:
        """``tinygc-explain/2`` (docs/formats.md)."""
        by = {} if self.turned_by is None else {"table": self.turned_by.to_json()}
        return self._table() | by | {"checked": checked_to_json(self.checked)}

    def _table(self) -> dict:
        return to_json(self.explanation)

    def line(self) -> Text:
        """Session, verdict and p-value, in one line."""
        return verdict_line(self.explanation)

    def page(self) -> Group:
        """Page for the terminal."""
        by = [] if self.turned_by is None else [self.turned_by.page()]
        return Group(self._page(), *by, *checked_page(self.checked))

    def _page(self) -> Group:
        return explanation_page(self.explanation)

    def picture(self) -> Figure:
        """Draw the page of pictures.  Raises CalibrationError if matplotlib is missing."""
        return figure_of(self.explanation)

    def save(self, folder: Path | None = None, pictures: bool = True) -> Path:
        """Write the JSON and the picture into a folder, the session's ``explain`` by default; returns that folder.

        Raises StorageError if it cannot be written, CalibrationError if a picture is requested and matplotlib is missing.
        """
        folder = folder or self.explanation.session.own_folder("explain")
        with result_folder(folder):
            write_whole(folder / "explain.json", self.to_json())
        if pictures:
            save_figure(self.picture(), folder / "explain.png")
        return folder


# An explanation with a truth file as reference, for the terminal, and its report.

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
        # A claim that was found before any fit has a p-value alone.
        weighed = f"probability {chance_words(claim.probability)}, " if claim.rivals else ""
        chance = f"   {weighed}p {p_words(claim.p_value)}{share}"
        parts.append(Text.assemble((f"{claim.effect.id}  ", "bold cyan"), claim.effect.equation, chance))
        parts.append(one_line(f"  {claim.says}"))
        parts.append(Text(f"  {claim.effect.parameter.name}: {'   '.join(values_of(claim)[:MOST_VALUES])}\n"))
    parts += [one_line(sentence, end="\n") for sentence in refusals(e)]
    table = Table(title="Evidence", title_justify="left", box=None)
    table.add_column("of")
    table.add_column("it says", overflow="fold")
    for row in evidence_rows(e):
        table.add_row(*row)
    parts += [table, Text(CANNOT)]
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


def evidence_rows(e: TruthExplanation) -> list[tuple[str, str]]:
    """Subject of each line of evidence (empty: the same as above), and its statement."""
    grown = "; ".join(f"{t:g} s: {np.sqrt(np.mean(row**2)) / DEG:.3f}" for t, row in zip(e.lengths_s, e.closure_rad, strict=True))
    before, after = e.neighbours
    lost = sum(len(truth.outages) for truth in e.session.truths or ())
    sizes = [f"{c.says}: {s / c.si:.2g} {c.unit}" for s, c in zip(e.noise.s, e.noise.components, strict=True) if s > 0]
    rows = [
        ("closure", f"{len(e.problem.used)} segments, {e.closure_rms[0] / DEG:.3f}° rms before, {e.closure_rms[1] / DEG:.3f}° after"),
        ("", f"of segments held out {e.held_out_rms[0] / DEG:.3f}° before, {e.held_out_rms[1] / DEG:.3f}° after"),
        ("noise", "; ".join(sizes) or "nothing beside the gyro's white noise"),
        ("truth", f"{len(e.jumps)} wrong moments; {lost} outages; closure per angle by length, degrees: {grown}"),
        ("", f"by this growth {e.truth_rad / DEG:.3f}° a moment of truth, {e.walk_rad / DEG:.3f}°/√s"),
        ("", _own_noise(e)),
        ("", f"neighbouring segments correlate {before:+.2f}, after {after:+.2f} (-0.5: the truth's noise, 0: the gyro's, more: slow)"),
        ("clocks", "truth not known" if e.alignment is None else f"truth {offset_text(e.alignment)}"),
        ("frames", "not known" if e.alignment is None else f"gyro to truth {mounting_text(e.alignment)}; {frame_text(e.alignment)}"),
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


class TruthReport(ExplanationReport):
    """Report of an explanation with a truth file as reference."""

    def _table(self) -> dict:
        return truth_to_json(self.explanation)

    def line(self) -> Text:
        """Session, verdict and p-value, in one line."""
        return truth_line(self.explanation)

    def _page(self) -> Group:
        return truth_page(self.explanation)

    def picture(self) -> Figure:
        """Draw the page of pictures.  Raises CalibrationError if matplotlib is missing."""
        return truth_figure_of(self.explanation)
