"""What a search has come to: the best hypothesis of names, the best with laws, and what was put away."""

from __future__ import annotations

from dataclasses import dataclass

from tinygc.closure.probability import chi_square_above
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.judge.answer import HeldOut
from tinygc.discovery.judge.held_out import Unseen
from tinygc.discovery.judge.parts import Parts
from tinygc.discovery.judge.search import Found
from tinygc.discovery.judge.weigh import FormEvidence
from tinygc.discovery.screen.beside import promised_beside
from tinygc.discovery.screen.looks import Look
from tinygc.effects import Effect
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.naming.search import rewhitened

#: chance that the sensor's own noise leaves as much as laws leave, below which something is left
NOISE_P = 0.01


@dataclass(frozen=True, eq=False)
class Searched:
    """evidence of what was seen; unseen; split; names: the catalogue's effects; catalogue: the best hypothesis of them; shapes: with shapes
    that have none; best: with laws; rounds of the search; entered: of each law's id, the number of the round that brought it; forms that
    were tried; why: a law was refused."""

    evidence: FormEvidence
    unseen: Unseen
    split: Parts
    names: list[Effect]
    catalogue: Hypothesis
    shapes: Hypothesis
    best: Hypothesis
    rounds: list[Found]
    entered: dict[str, int]
    forms: list[Form]
    why: str = ""

    @property
    def laws(self) -> list[Effect]:
        """The forms among the best hypothesis' effects."""
        return [effect for effect in self.best.effects if effect.id in self.evidence.forms]

    @property
    def held_out(self) -> list[HeldOut]:
        """The tests of all laws on what was put away."""
        return [test for law in self.laws for test in self.held_out_of(law)]

    def held_out_of(self, law: Effect) -> tuple[HeldOut, ...]:
        """What a law makes of the parts of each recording that were put away, and of a whole one, where there are several."""
        split, unseen, without = self.split, self.unseen, self.without(law)
        log = None if split.log is None else unseen.whole.problem.session.logs[split.log].path.name
        tests = (unseen.judged(without, self.best, split.parts), unseen.judged(without, self.best, split.recording, log))
        return tuple(test for test in tests if test is not None)

    def without(self, law: Effect) -> Hypothesis:
        """The best hypothesis without one of its laws."""
        return self.evidence.of(tuple(effect for effect in self.best.effects if effect is not law), self.best)

    def chance_p(self, law: Effect) -> float:
        """Probability that the best of all forms promises as much in noise alone as a law does beside all that stands with it.

        Noise was asked with the constants of the grid; so is the law, by the best of its neighbours there.
        """
        screening, look = self.round_of(law).screening, self.look_without(law)
        on_grid = screening.neighbours(self.evidence.forms[law.id])
        return screening.chance_p(max(promised_beside(screening, form, look) for form in on_grid))

    def look_without(self, law: Effect) -> Look:
        """At all that stands but one of the laws, in the noise as it is with all."""
        whiten = self.best.whiten
        return Look(self.evidence.twin, whiten, rewhitened(self.without(law), whiten))

    @property
    def closes_to_noise(self) -> bool:
        """Whether the turns that were searched close as well as white noise and the sensor's bias instability allow."""
        whiten, twin = self.evidence.first_whiten, self.evidence.twin
        closure = (twin.residuals(self.best.fit.state).stacked() / whiten.sigma)[whiten.parts["closure"]]
        return chi_square_above(float(closure @ closure), closure.size) > NOISE_P

    def round_of(self, law: Effect) -> Found:
        """That in which a law was found: a later one has it as known, and nothing in its place."""
        return self.rounds[self.entered[law.id]]

    @property
    def tried(self) -> list[Effect]:
        """Forms that were weighed in any round."""
        return list(dict.fromkeys(effect for each in self.rounds for effect in each.tried))
