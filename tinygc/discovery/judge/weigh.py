"""The evidence of forms: as that of the catalogue's effects, but each pays for its own description.

    -2 log p = ... + 2 (ln 2 · bits + log(scales / odds)) + coefficients

The bits are those of the form among all that the grammar can say; that the recording shows anything outside the catalogue is as improbable
beforehand as any one effect of it.  This is Rissanen's two-part code, in natural units: bits of the form, coefficients to their sigma,
remainder under the noise.  A constant within a function, such as a width, pays for the choices of its grid alone, however sharply it is
known; so rivals are compared by their fit as well (``rivals``).
"""

from __future__ import annotations

import numpy as np

from tinygc.discovery.grammar.as_effect import as_effect
from tinygc.discovery.grammar.bits import bits
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.weighing import price
from tinygc.effects import Effect, Movement
from tinygc.explanation.naming.evidence import Evidence, Guess, Hypothesis
from tinygc.explanation.twin.twin import Twin

#: what is weighed and is no name of the catalogue
FORM = "discovered."


class FormEvidence(Evidence):
    """Evidence in which forms are weighed, too; each is known by an id of its own while the search lasts."""

    def __init__(self, twin: Twin):
        self.forms: dict[str, Form] = {}
        self._ids: dict[Form, Effect] = {}
        super().__init__(twin)

    def effect_of(self, form: Form) -> Effect:
        """The form as an effect, always the same one."""
        if form not in self._ids:
            name = f"{FORM}n{len(self._ids)}"
            self.forms[name] = form
            self._ids[form] = as_effect(form, name, rms_of(form, self.twin.movements), name)
        return self._ids[form]

    def price(self, effect: Effect) -> float:
        """As ``Evidence.price``, of a form by its bits."""
        form = self.forms.get(effect.id)
        return super().price(effect) if form is None else float(price(np.array(bits(form)), np.array(effect.parameter.size)))

    def unpriced(self, have: Hypothesis | Guess) -> float:
        """The score of a hypothesis as if nothing had been paid for its description but its coefficients: how well it fits."""
        return have.score - sum(self.price(effect) - effect.parameter.size for effect in have.effects)

    def form_in(self, have: tuple[Effect, ...]) -> list[Form]:
        """The forms among effects, in their order."""
        return [self.forms[effect.id] for effect in have if effect.id in self.forms]


def rms_of(form: Form, movements: list[Movement]) -> float:
    """Of the form's products over a recording."""
    squares = [np.mean(columns[columns != 0] ** 2) for m in movements if (columns := as_effect(form).columns(m)).any()]
    return float(np.sqrt(np.mean(squares))) if squares else 1.0
