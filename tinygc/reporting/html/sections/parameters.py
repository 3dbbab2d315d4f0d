"""The parameters in the field's words, each with its expanded uncertainty (k = 2), or the word that the session does not show it."""

from __future__ import annotations

from math import isfinite

import numpy as np

from session.io.units import DEG_PER_HOUR
from tinygc.models.linear import Quantity
from tinygc.reporting.html.chart import enlargement, triad
from tinygc.reporting.html.evidence import Evidence
from tinygc.reporting.html.markup import Section, decimals_for, escape, figure, fixed, key, paragraph, significant
from tinygc.reporting.html.sections.recording import temperature_words

#: word -> what it means, in one line
MEANINGS = {
    "scale factor error": "the axis reads so much too far, against the data sheet’s sensitivity",
    "scale factor asymmetry": "scale factor for positive less that for negative rates, over their mean",
    "misalignment": "input axis leans towards a reference axis",
    "nonorthogonality": "90° less the angle between two input axes",
    "triad rotation": "the whole triad against the reference axes, a rotation vector",
    "bias": "what it reads at no rate",
    "g-sensitivity": "what specific force adds to the rate",
    "angle random walk": "white noise of the rate, integrated; Allan deviation at 0.2 s",
    "bias instability": "floor of the overlapping Allan deviation / 0.664",
}


def section(evidence: Evidence) -> Section:
    """Picture and tables."""
    M = np.linalg.inv(evidence.adopted.linear.E)
    html = paragraph(
        f"Of {_what(evidence)}, {escape(_at(temperature_words(evidence.problem)))}. Each value ± its expanded uncertainty, <i>k</i> "
        "= 2 (about 95 %). "
        'They say what the <em>sensor</em> does; <a href="#apply">Apply it</a> has what undoes it. Reference axes are those of the '
        f"{_reference_axes(evidence)}."
    )
    html += '<div class="pair"><div>' + figure(
        lambda width: triad(M, min(width, 320)),
        keys=[key(axis, f"{axis}, sensor", "line") for axis in "xyz"] + [key("quiet", "reference", "dash")],
    )
    html += "</div><div>" + paragraph(
        f"<strong>The sensor’s axes, errors enlarged {enlargement(M):g} times.</strong> "
        "Length: scale factor. Direction: input axis. Dashed: where each should be."
    )
    html += f"{_unobserved(evidence.quantities)}</div></div>"
    html += parameter_table(evidence.quantities)
    if evidence.problem.session.config.protocol.reference == "truth":
        html += paragraph(
            "Scale factor asymmetry and g-sensitivity are not measured against a truth file; explain names them if they are large.", "soft"
        )
    widened = evidence.fit.widened if evidence.adopted.name == "least_squares" else 1.0
    if widened > 1:
        html += paragraph(
            "The closure is above its floor: the uncertainties of the linear model are widened by "
            f"{significant(np.sqrt(widened), 2)}, as if what is missing were noise. It need not be.",
            "soft",
        )
    has, lacks = _accelerometer_words(evidence)
    html += paragraph(
        f"Uncertainties include the noise measured in the stills, the Earth’s heading where it was estimated{has}, and "
        f"{_beyond_white(evidence)}. They do not include {lacks}, nor a bias that is another one after the next switch-on.",
        "soft",
    )
    return Section("parameters", "Parameters", html)


def _reference_axes(evidence: Evidence) -> str:
    if evidence.problem.session.truths is not None:
        return "the truth file’s"
    return 'those of the accelerometer, as <a href="#accelerometer">calibrated here</a>'


def _accelerometer_words(evidence: Evidence) -> tuple[str, str]:
    """What of the accelerometer's errors the uncertainties hold, and what they do not."""
    if not evidence.adopted.claims and evidence.fit.joint_covariance is not None:
        return ", the accelerometer’s own nine numbers, estimated together with these", "an accelerometer that moves within the session"
    # A fit without stills between its turns does not reckon with the accelerometer; all others do.
    if evidence.adopted.claims or evidence.fit.noise is not None:
        return ", 0.1 mg of the accelerometer’s calibration", "a larger error of it"
    return "", "an error of the accelerometer’s calibration"


def _beyond_white(evidence: Evidence) -> str:
    noise = None if evidence.adopted.claims else evidence.fit.noise
    if noise is None:
        return f"a bias that wanders by {_instability(evidence)}"
    return f"what this recording shows beyond white noise ({escape(noise.words)})"


def _instability(evidence: Evidence) -> str:
    known = evidence.problem.instability
    return f"{known.rps / DEG_PER_HOUR:.2g} °/h ({'data sheet' if known.source.startswith('typical') else escape(known.source)})"


def _at(temperature: str) -> str:
    return f"at {temperature}" if "°C" in temperature else f"at a temperature that was {temperature}"


def _what(evidence: Evidence) -> str:
    if not evidence.adopted.claims:
        return "the linear model by least squares"
    return f"the linear model with {', '.join(escape(claim.effect.id) for claim in evidence.adopted.claims)}"


def _unobserved(quantities: list[Quantity]) -> str:
    hidden = [f"{q.word} {q.component}" for q in quantities if not q.observed and q.word != "bias instability"]
    if not hidden:
        return paragraph("Every parameter of the model is shown by this session’s movements.", "soft")
    return paragraph(
        f"<strong>Not observable here:</strong> {escape(', '.join(hidden))}. Turn about more axes, both ways, in more attitudes."
    )


def parameter_table(quantities: list[Quantity]) -> str:
    """Words down, three components across."""
    by_word: dict[str, list[Quantity]] = {}
    for quantity in quantities:
        by_word.setdefault(quantity.word, []).append(quantity)
    rows = []
    for word in sorted(by_word, key=list(MEANINGS).index):
        group = by_word[word]
        decimals = common_decimals(group)
        for at in range(0, len(group), 3):
            rows.append(_row(word, group[at : at + 3], at == 0, decimals))
    head = '<thead><tr><th scope="col">Parameter</th><th scope="col">x</th><th scope="col">y</th><th scope="col">z</th></tr></thead>'
    return f'<div class="scroll" tabindex="0"><table class="parameters">{head}<tbody>{"".join(rows)}</tbody></table></div>'


def common_decimals(group: list[Quantity]) -> int:
    """Of all values of one word: two digits of the largest uncertainty."""
    return decimals_for(max((quantity.expanded for quantity in group if quantity.observed), default=0.0))


def _row(word: str, group: list[Quantity], first: bool, decimals: int) -> str:
    plain = [quantity.component for quantity in group] == ["x", "y", "z"]
    name = f'{escape(word)}, <span class="unit">{escape(group[0].unit)}</span><br><small>{escape(MEANINGS[word])}</small>' if first else ""
    cells = "".join(f'<td data-of="{axis}">{_cell(quantity, plain, decimals)}</td>' for axis, quantity in zip("xyz", group, strict=False))
    notes = {quantity.note for quantity in group if quantity.note}
    note = f"<br><small>{escape('; '.join(sorted(notes)))}</small>" if notes and first else ""
    return f'<tr><th scope="row">{name}{note}</th>{cells}</tr>'


def _cell(quantity: Quantity, plain: bool, decimals: int) -> str:
    of = "" if plain else f'<span class="of">{escape(quantity.component)}</span>'
    if not quantity.observed:
        most = f"; at most {significant(quantity.at_most, 2)}" if isfinite(quantity.at_most) else ""
        return f'{of}<span class="absent">not observable here{most}</span>'
    return f"{of}{fixed(quantity.value, decimals)} <small>± {fixed(quantity.expanded, decimals)}</small>"
