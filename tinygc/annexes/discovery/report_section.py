"""Report section on laws beyond the catalogue: the equations of an ``explain --discover``, their evidence, and their use."""

from __future__ import annotations

from base64 import b64encode

from session.io.texts import shell_word
from tinygc.annexes.discovery.result import (
    MOST_RUNNERS_UP,
    abbreviated,
    evidence_words,
    headline,
    number_lines,
    runner_up_words,
    same_words,
)
from tinygc.reporting.html.evidence import ReportData
from tinygc.reporting.html.markup import Section, code, escape, paragraph


def section(evidence: ReportData) -> Section | None:
    """The section, or None where nothing was searched."""
    found = evidence.searched
    if found is None:
        return None
    table = found.table
    words, _ = headline(table["verdict"], any(law["runners_up"] for law in table["laws"]))
    tried = f" ({table['forms']} forms tried, {table['distinct']} of them distinct here)" if table["forms"] else ""
    html = paragraph(f"<strong>{escape(words[:1].upper() + words[1:])}</strong>{tried}, by <code>explain --discover</code>.")
    for law in table["laws"]:
        html += _law(law)
    if short := abbreviated(table):
        html += paragraph(f"In these equations: {escape(short)}.", "soft")
    if table["beside"] and table["laws"]:
        html += paragraph(f"Beside them stand, of the catalogue: {escape(', '.join(each['id'] for each in table['beside']))}.")
    if table["why"]:
        html += paragraph(f"{escape(table['why'])}.")
    if found.picture is not None:
        data = b64encode(found.picture).decode()
        says = "Left: what is missed without the law, with the law through it. Right: what it leaves."
        html += (
            f'<figure><img src="data:image/png;base64,{data}" alt="The remainder against the law, and what the law leaves">'
            f"<figcaption>{says}</figcaption></figure>"
        )
    if found.following:
        html += paragraph(f"<strong>Next:</strong> {escape(found.following)}.")
    if table["laws"]:
        html += paragraph("The law as an effect, in another session:") + code(f"calibrate.py explain OTHER --effects {_effects(evidence)}")
    return Section("discovery", "Beyond the catalogue", html)


def _effects(evidence: ReportData) -> str:
    assert evidence.searched is not None
    return shell_word(evidence.searched.folder / "effects")


def _law(law: dict) -> str:
    says = law["in_words"]
    html = f'<div class="found"><h3>{escape(law["id"])}</h3>{paragraph(escape(says))}{code(law["equation"])}'
    html += code("\n".join(number_lines(law)))
    evidence = [escape(words) for words in evidence_words(law)]
    evidence += [f"equivalent in this recording: {escape(same_words(law))}"] if law["same_here"] else []
    evidence += [f"alternative: {escape(runner_up_words(each))}" for each in law["runners_up"][:MOST_RUNNERS_UP]]
    evidence += [f"written as <code>explain/{escape(law['file'])}</code>"] if law["file"] else []
    return html + "<ul>" + "".join(f"<li>{each}</li>" for each in evidence) + "</ul></div>"
