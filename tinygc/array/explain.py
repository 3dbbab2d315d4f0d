"""``explain`` of an array: each unit by itself, and what the others say of it.

What one unit has and the others have not is its own; what all have is none of the sensors': the motion, the table, the reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from session.common.errors import CalibrationError
from session.common.texts import printable
from session.log.array_session import ArraySession
from tinygc.array.fit import ArrayFit, fit_array
from tinygc.array.joint.split import OWN_P
from tinygc.array.moments import Moment, moments_of
from tinygc.explanation.verdict.explain import Explanation, explain_session

OWN, SOME, COMMON, ALIKE = "own", "some", "common", "alike"
#: of effects: what moves or is at rest is the body's, not a sensor's
OF_THE_BODY = ("motion", "still", "reference", "earth")


@dataclass(frozen=True)
class Trait:
    """An effect that is named: in which units; whose: ``own`` of one unit, ``some``, ``common`` to all through the body, or ``alike`` in
    all; says: of each unit, in its order; unknown: units that could not be explained, of which nobody knows."""

    id: str
    units: tuple[int, ...]
    whose: str
    says: tuple[str, ...]
    unknown: tuple[int, ...] = ()
    instead: tuple[str, ...] = ()  #: effects that a unit's own explanation could not tell from it

    @property
    def words(self) -> str:
        """Whose it is, in a sentence."""
        if self.unknown:
            plural = "s" * (len(self.unknown) != 1)
            return f"{self._whose}; unit{plural} {', '.join(map(str, self.unknown))} could not be explained, and may have it too"
        return self._whose

    @property
    def _whose(self) -> str:
        named = ", ".join(map(str, self.units))
        if self.instead and self.whose in (OWN, SOME):
            where = f"unit {named} alone" if self.whose == OWN else f"units {named}, not in the others"
            either = " or ".join((self.id, *self.instead))
            return f"{either} in {where}: something of their own, and which of these the recording does not tell"
        if self.whose == OWN:
            whose = "readings" if self.id.startswith(("data.", "timing.")) else "physics"
            return f"{self.id} in unit {named} alone: that unit's own {whose} ({self.says[0]})"
        if self.whose == SOME:
            return f"{self.id} in units {named}, not in the others: these units' own physics"
        if self.whose == COMMON:
            return f"{self.id} in all units: what they have in common (motion, table, reference), no unit's sensor"
        return f"{self.id} in all units: what they share (motion, table, reference, temperature), or what sensors of this kind have"


@dataclass(frozen=True, eq=False)
class ArrayExplanation:
    """fit; explanations of the units by number; not_explained: why one has none, by number; traits; moments."""

    fit: ArrayFit
    explanations: dict[int, Explanation]
    not_explained: dict[int, str]
    traits: tuple[Trait, ...]
    moments: tuple[Moment, ...]

    @property
    def verdict(self) -> str:
        """``no_mismatch``, or what the array is: ``common``, ``own``, or ``common_and_own``."""
        events = self.fit.joint.events
        at_once = {len(event.together(events)) for event in events}  # 1: a unit alone; 0, all of them, and several: no unit's own
        common = self.fit.split.p_value < 0.01 or any(trait.whose in (COMMON, ALIKE) for trait in self.traits) or bool(at_once - {1})
        own = any(trait.whose in (OWN, SOME) for trait in self.traits) or 1 in at_once
        own = own or bool((self.fit.split.own_p < OWN_P).any())
        if common and own:
            return "common_and_own"
        return "common" if common else "own" if own else "no_mismatch"


def explain_array(
    array: ArraySession,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> ArrayExplanation:
    """Fit the array, explain each unit as a session of its own, and judge with the others what is whose.

    Raises the errors of ``fit_array``; a unit that cannot be explained alone is said, and does not stop the others.
    """
    fit = fit_array(array, use_earth=use_earth, progress=lambda what: progress(what, 0, 1))
    explanations: dict[int, Explanation] = {}
    failed: dict[int, str] = {}
    for done, unit in enumerate(fit.units):
        progress(f"explaining unit {unit.number}", done, len(fit.units))
        try:
            explanations[unit.number] = explain_session(unit.session, seed=seed, use_earth=use_earth)
        except CalibrationError as error:
            failed[unit.number] = printable(str(error))
    return ArrayExplanation(fit, explanations, failed, _traits(explanations, tuple(failed)), tuple(moments_of(fit)))


def _traits(explanations: dict[int, Explanation], unknown: tuple[int, ...]) -> tuple[Trait, ...]:
    """unknown: numbers of the units that could not be explained, so that nothing is said to be in all."""
    named: dict[str, dict[int, str]] = {}
    kinds: dict[str, str] = {}
    instead: dict[str, dict[str, None]] = {}
    for number, e in explanations.items():
        for claim in e.claimed:
            named.setdefault(claim.effect.id, {})[number] = claim.says
            kinds[claim.effect.id] = claim.effect.kind
            instead.setdefault(claim.effect.id, {}).update(dict.fromkeys(claim.equivalent))
    found = []
    for name, by_unit in named.items():
        if len(by_unit) == len(explanations) and len(by_unit) > 1 and not unknown:
            whose = COMMON if kinds[name] in OF_THE_BODY or name.split(".")[0] in OF_THE_BODY else ALIKE
        else:
            whose = OWN if len(by_unit) == 1 else SOME
        found.append(Trait(name, tuple(by_unit), whose, tuple(by_unit.values()), unknown, tuple(instead[name])))
    return tuple(found)
