"""The terminal's and the picture's page of an explanation."""

from __future__ import annotations

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from session.units import DEG, G
from tinygc.explain.channels import own_residuals
from tinygc.explain.explain import Explanation
from tinygc.explain.proof import tilt_rms
from tinygc.explain.result import what_next, where
from tinygc.explain.seen_from import in_words

VERDICTS = {
    "no_mismatch": ("nothing is missing: noise explains all that differs", "green"),
    "explained": ("explained", "green"),
    "ambiguous": ("explained, but this recording cannot decide between lookalikes", "yellow"),
    "partly_explained": ("partly explained: something is left that has no name here", "yellow"),
    "unexplained": ("there is a mismatch, and no effect in the catalogue fits it", "red"),
}
CHANNELS = {"closure": "closure of each segment", "still": "mean rate in each still", "length": "length of gravity in each still"}


def explanation_page(e: Explanation) -> Group:
    """Verdict, effects with their parameters, where it lives, proof, and what to do next."""
    words, style = VERDICTS[e.verdict]
    parts: list = [Text.assemble((f"{e.session.name}: ", "bold"), (words, style), f"   (p {_p(e.p_value)})\n")]
    # The first look's own suspicions stand before what has no name: they are the likelier cause.
    parts += [Text(f"First look: {w.where}: {w.what}: {w.says}; {w.do}\n", "yellow") for w in e.warnings]
    for claim in e.claimed:
        parts.append(Text.assemble((f"{claim.effect.id}  ", "bold cyan"), claim.effect.equation, f"   p {_p(claim.p_value)}"))
        parts.append(Text(f"  {claim.says}"))
        parts += [Text(f"  {line}") for line in parameter_lines(claim)]
        if claim.equivalent:
            parts.append(Text(f"  could as well be: {', '.join(claim.equivalent)}", "yellow"))
        parts.append(Text(""))
    for claim in e.findings:
        parts.append(Text.assemble((f"{claim.effect.id}  ", "bold magenta"), claim.effect.equation, f"   p {_p(claim.p_value)}"))
        parts.append(Text(f"  {claim.says}; it carries {100 * (claim.share or 0):.0f} % of the misfit\n"))
    parts += [
        Text("Recorded less predicted, in sigmas of the noise (rms; 1 is noise alone)", "italic"),
        _channels(e),
        _gravity(e),
        Text(""),
    ]
    parts += [*_where(e), _proof(e)]
    if e.verdict == "no_mismatch":
        parts += [Text(line) for line in in_words(e.seen_from)]
    if following := what_next(e):
        parts.append(Text.assemble(("next: ", "bold"), following))
    return Group(*parts)


def parameter_lines(claim) -> list[str]:
    """``name: value ± std``, a matrix by rows."""
    lines = []
    for name, value in claim.parameters.items():
        std = claim.std.get(name)
        rows = value if isinstance(value, list) and value and isinstance(value[0], list) else [value]
        spreads = std if isinstance(std, list) and std and isinstance(std[0], list) else [std]
        for i, row in enumerate(rows):
            spread = spreads[i] if i < len(spreads) else None
            lines.append(f"{name if i == 0 else ' ' * len(name)}: {_numbers(row, spread)}")
    return lines


def _numbers(value, std) -> str:
    if not isinstance(value, list):
        return f"{value:.5g}" + (f" ± {std:.2g}" if isinstance(std, float) and std > 0 else "")
    if not isinstance(std, list) or len(std) != len(value):
        shown = ", ".join(f"{v:g}" for v in value[:16])
        return shown + (f", … ({len(value)})" if len(value) > 16 else "")
    return "   ".join(f"{v:.5f} ± {s:.5f}" if abs(v) < 100 else f"{v:.4g} ± {s:.2g}" for v, s in zip(value, std, strict=True))


def _channels(e: Explanation) -> Table:
    """Predicted beside recorded: the root mean square of each channel's difference in sigmas of its noise."""
    table = Table(box=None)
    for column in ("channel", "values", "before", "after"):
        table.add_column(column, justify="left" if column == "channel" else "right")
    looks = [own_residuals(e.twin, e.whiten, fit) for fit in (e.naming.first, e.naming.fit)]
    for name, part in e.whiten.parts.items():
        values = part.stop - part.start
        before, after = ((np.sum(r[part] ** 2) / max(values - taken[name], 1)) ** 0.5 for r, taken in looks)
        table.add_row(CHANNELS[name], str(values), f"{before:.2f}", f"{after:.2f}")
    return table


def _gravity(e: Explanation) -> Text:
    lever = ", ".join(f"{1e3 * x:.0f}" for x in e.gravity.lever_m)
    return Text(
        f"gravity during the turns: {e.gravity.before_mps2 / (1e-3 * G):.1f} mg; {e.gravity.after_mps2 / (1e-3 * G):.1f} mg with lever arm "
        f"{lever} mm and the gyro {1e3 * e.gravity.offset_s:+.2f} ms late"
    )


def _where(e: Explanation) -> list[Text]:
    place = where(e)
    if not place["phases"]:
        return []
    words = [f"lives in: {', '.join(place['phases'])}"]
    if place["axes"]:
        words.append(f"axes {', '.join(place['axes'])}")
    if place["segments"]:
        words.append(f"worst segments {', '.join(map(str, place['segments'][:6]))}")
    if regime := place["regime"]:
        words.append(f"{regime['variable']} {regime['from']:.3g} to {regime['to']:.3g} {regime['units']}")
    return [Text("; ".join(words))]


def _proof(e: Explanation) -> Text:
    before, after, floor = (x / DEG for x in (tilt_rms(e.proof.before), tilt_rms(e.proof.after), e.proof.floor_rms))
    removed = f"; {100 * e.proof.removed:.1f} % of the excess is gone" if e.claimed and e.proof.removed is not None else ""
    return Text(f"held-out closure: {before:.4f}° before, {after:.4f}° after, floor {floor:.4f}°{removed}")


def _p(p_value: float) -> str:
    return f"= {p_value:.2g}" if p_value > 1e-99 else "< 1e-99"
