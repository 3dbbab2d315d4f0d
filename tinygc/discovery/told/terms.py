"""What each number of a law adds to, and what it follows: ``x ← y``."""

from __future__ import annotations

from tinygc.discovery.grammar.form import Factor, Form

#: of a function with phases, each of its numbers
PHASES = {2: ("cos", "sin"), 6: ("cos", "sin", "cos 3", "sin 3", "cos 5", "sin 5")}
ARROW = " ← "


def terms_of(form: Form) -> list[str]:
    """Of each coefficient, in order: the axis that it adds to, and, of more than one for each axis, what it is of."""
    terms = form.terms()
    if form.size == 3:
        return ["xyz"[term.axis] for term in terms]
    return ["xyz"[term.axis] + ARROW + _followed(form, term.parts) for term in terms]


def _followed(form: Form, parts: tuple[tuple[Factor, int], ...]) -> str:
    words = [_component(factor, component) for factor, component in parts]
    if form.pattern == "leant":  # the first is of the axis itself
        words[0] = words[0][1:].strip()
    if form.pattern in ("full", "cross", "each") and len(words) == 2 and words[0][:1] == words[1][:1]:
        words[1] = words[1][1:].strip()  # both are of one axis, which is said once
    return " ".join(word for word in words if word)


def _component(factor: Factor, component: int) -> str:
    """``y``, ``y cos``, ``y 2 sin``: axis, direction in the world, phase; nothing of a scalar."""
    phases, directions = factor.through.phases, factor.of.directions
    axis = "xyz"[component // factor.each] if factor.vector else ""
    direction = str(component % factor.each // phases + 1) if directions > 1 else ""
    phase = PHASES[phases][component % phases] if phases > 1 else ""
    return " ".join(word for word in (axis, direction, phase) if word)
