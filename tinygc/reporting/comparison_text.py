"""Comparison of calibrations in the terminal."""

from __future__ import annotations

import numpy as np

from tinygc.fitting.compare import DIFFERS_P, DIGITS, MODES, Agreement, Comparison
from tinygc.reporting.terminal import Group, RenderableType, Table, Text, one_line

#: a change of at least so many sigmas is marked
MARKED = 3.0
MOST_MOVED = 5


def comparison_page(comparison: Comparison) -> Group:
    """Page of a comparison: table, verdict, changes and remarks."""
    notes = [one_line(f"Note: {note}.", "yellow") for note in comparison.notes]
    parts: list[RenderableType] = [_table(comparison), *_verdict(comparison), _triads(comparison), _triads_agree(comparison), *notes]
    return Group(*parts)


def _table(comparison: Comparison) -> Table:
    table = Table(title="Calibrations side by side: value ± one sigma", title_justify="left", box=None, padding=(0, 1))
    table.add_column("")
    for session in comparison.sessions:
        table.add_column(session.name, justify="right")
    table.add_column("most off, sigmas", justify="right")
    for q, (word, component, unit) in enumerate(comparison.labels):
        digits = _digits(comparison, q)
        pairs = zip(comparison.values[:, q], comparison.sigmas[:, q], strict=True)
        cells = [f"{value:.{digits}f} ± {sigma:.{digits}f}" for value, sigma in pairs]
        off = np.abs(comparison.sigmas_off[:, q]).max()
        table.add_row(f"{word} {component}, {unit}", *cells, Text(f"{off:.1f}", "bold red" if off > MARKED else ""))
    return table


def _triads(comparison: Comparison) -> Table:
    title = "Accelerometers side by side: value ± one sigma"
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1))
    for column in ("", *(session.name for session in comparison.sessions)):
        table.add_column(column, justify="right" if column else "left")
    for word, component, unit, values, sigmas in comparison.triads.errors:
        digits = DIGITS[unit]
        cells = [
            "not observed" if value is None else f"{value:.{digits}f}" + ("" if sigma is None else f" ± {sigma:.{digits}f}")
            for value, sigma in zip(values, sigmas, strict=True)
        ]
        table.add_row(f"{word} {component}, {unit}", *cells)
    table.caption = "; ".join(f"{s.name}: {MODES[s.triad.mode]}" for s in comparison.sessions)
    table.caption_justify = "left"
    return table


def _triads_agree(comparison: Comparison) -> Text:
    found = comparison.triads.agreement
    if found is None:
        return Text("The accelerometers were not both estimated: there is nothing to hold against each other.")
    agrees = found.p_value >= DIFFERS_P
    return Text(
        f"The accelerometers {'agree' if agrees else 'DIFFER'}, with the spread between switch-ons usual of them ({_words(found)}).",
        "bold green" if agrees else "bold red",
    )


def comparison_verdict_line(comparison: Comparison) -> Text:
    """State whether the calibrations agree."""
    agrees = comparison.verdict.p_value >= DIFFERS_P
    what = "scale factors, misalignments and biases" if comparison.with_bias else "scale factors and misalignments"
    said = f"The {what} {'agree' if agrees else 'DIFFER'} ({_words(comparison.verdict)})."
    return Text(said, "bold green" if agrees else "bold red")


def _verdict(comparison: Comparison) -> list[Text]:
    lines, agrees = [comparison_verdict_line(comparison)], comparison.verdict.p_value >= DIFFERS_P
    rest = "the others" if len(comparison.sessions) > 2 else comparison.sessions[0].name
    for moved in comparison.moved[:MOST_MOVED]:
        digits = _digits(comparison, comparison.labels.index((moved.name, moved.component, moved.unit)))
        by = f"{moved.by:+.{digits}f} {moved.unit} from {rest}, {abs(moved.sigmas):.1f} sigmas"
        lines.append(one_line(f"  {moved.name} {moved.component} of {moved.session}: {by}"))
    if len(comparison.moved) > MOST_MOVED:
        lines.append(Text(f"  and {len(comparison.moved) - MOST_MOVED} more"))
    if not agrees and not comparison.moved:
        lines.append(Text("  no single one stands out: several moved a little, together"))
    if not comparison.with_bias:
        bias = comparison.bias
        if bias.p_value < DIFFERS_P:
            said = "as after a switch-on or at another temperature; take B anew before each use (--bias if it was never off)"
            lines.append(Text(f"The bias is another one ({_words(bias)}), {said}."))
        else:
            lines.append(Text(f"The bias agrees, too ({_words(bias)})."))
    return lines


def _digits(comparison: Comparison, q: int) -> int:
    """Number of decimals that gives the smallest sigma two digits."""
    return int(np.clip(1 - np.floor(np.log10(comparison.sigmas[:, q].min())), 0, 6))


def _words(agreement: Agreement) -> str:
    p = f"p = {agreement.p_value:.2g}" if agreement.p_value > 1e-99 else "p < 1e-99"
    return f"chi-square {agreement.chi_square:.1f} for {agreement.freedom}, {p}"
