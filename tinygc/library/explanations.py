"""``tinygc.explain``: why a recording differs from its simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from session.base import features
from session.base.errors import CalibrationError
from session.base.files import result_folder
from session.base.options import records, refuse_with
from session.base.progress import Progress, no_report
from session.base.records import write_whole
from session.log.config import read_config, reference_of
from session.log.folder import Session, read_session
from session.log.siblings import recordings_at, serial_of
from tinygc.estimation.options import AtRest, Seed
from tinygc.explanation.checked import Checked, checked_to_json
from tinygc.explanation.checked import check_on as check
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json
from tinygc.library.arguments import public
from tinygc.library.records import Listed, Shown
from tinygc.library.sources import session_or_folder
from tinygc.reporting.checked_text import checked_page
from tinygc.reporting.drawing import Picture, saved
from tinygc.reporting.explanation_text import explanation_facts, explanation_screen, headline, next_commands, next_line
from tinygc.reporting.facts import Part, screen
from tinygc.reporting.pictures.page import picture_of
from tinygc.reporting.terminal import Group, Text


@dataclass(frozen=True, eq=False)
class FoundEffect:
    """An effect that is reported, or a finding without a name."""

    #: identifier in the catalogue, such as ``gyro.g_sensitivity``
    id: str
    #: formula of what the effect adds, in one line
    equation: str
    #: values by JSON name, in the unit of that name
    parameters: dict[str, Any]
    #: standard deviations by JSON name, in the same units
    std: dict[str, Any]
    #: probability of as strong a sign of it in a session without the effect; None if unknown
    p_value: float | None
    #: probability of the effect after comparison of all candidates
    probability: float
    #: probabilities of the competing candidates, by id
    rivals: dict[str, float]
    #: ids of effects that this recording cannot distinguish from it
    equivalent: tuple[str, ...]
    #: description in one sentence
    description: str

    def __repr__(self) -> str:
        return f"<{self.id}: {self.description}>"


class Why(Shown):
    """Result of ``tinygc.explain``; a subclass serves the search beyond the catalogue.

    explanation: the complete result, in SI; beyond: what was found beyond the catalogue, None if not requested; checked: outcome
    of each effect in each of the recordings that it was checked on; notes: on the effect files that ``save`` has written: which user-edited
    file was kept, which was removed.
    """

    beyond: Any = None
    checked: Sequence[Checked] = ()
    notes: tuple[str, ...] = ()

    def __init__(self, explanation: Any):
        self.explanation = explanation

    def __repr__(self) -> str:
        named = ", ".join(effect.id for effect in self.effects)
        return f"<Why {self.table['session']}: {self.verdict}{f': {named}' if named else ''}>"

    @cached_property
    def table(self) -> dict:
        """``tinygc-explain/2`` (docs/formats.md)."""
        return self._table() | {"checked": checked_to_json(self.checked)}

    def _table(self) -> dict:
        return to_json(self.explanation)

    @property
    def verdict(self) -> str:
        """``no_mismatch``, ``explained``, ``ambiguous``, ``partly_explained`` or ``unexplained``."""
        return self.explanation.verdict

    @property
    def p_value(self) -> float:
        """Probability of at least this mismatch from noise alone."""
        return self.explanation.p_value

    def offers(self, folder: Path, effects: Sequence[Path] = ()) -> list[tuple[str, list[str]]]:
        """What to do next, and the commands for it; folder: where it is saved; effects: folders of effects that it was given."""
        line, commands = next_line(self.explanation, self.next), next_commands(self.explanation, effects)
        return [(line or "next:", commands)] if line or commands else []

    @cached_property
    def effects(self) -> Listed[FoundEffect]:
        """Reported effects, strongest first; ``effects.to_frame()`` is a pandas DataFrame."""
        return Listed(_found(entry) for entry in self.table["effects"])

    @cached_property
    def findings(self) -> Listed[FoundEffect]:
        """Findings without a name."""
        return Listed(_found(entry) for entry in self.table["findings"])

    @property
    def considered(self) -> list[dict[str, Any]]:
        """Candidates that were weighed and rejected, likeliest first: ``id``, ``probability``.

        Also ``moments`` that a detector proposed, and ``closure_rms_deg`` of their segments, ``before`` and ``after`` data repair, or
        None.
        """
        return self.table["considered"]

    @property
    def noise(self) -> list[dict[str, Any]]:
        """Components of the non-white noise: ``name``, ``size``, ``sigma`` (None: not known), ``unit``, ``description``."""
        return self.table["noise"]["components"]

    @property
    def next(self) -> str | None:
        """The movement that would resolve what this recording cannot, or None."""
        return self.table["next"]

    @property
    def page(self) -> Group:
        """What ``explain --verbose`` prints, as a rich renderable: effects, residuals, evidence and what to do next."""
        return screen([*self.parts(), *checked_page(self.checked), *filter(None, [next_line(self.explanation, self.next)])])

    def parts(self, brief: bool = False) -> list[Part]:
        """Its facts, without what to do next; brief: those of the command's first screen."""
        return explanation_screen(self.explanation) if brief else explanation_facts(self.explanation)

    @property
    def verdict_line(self) -> Text:
        """The answer in one line, for rich."""
        return headline(self.explanation)[0]

    def plot(self, path: Path | str | None = None) -> Picture:
        """Draw the picture; path: an SVG to write."""
        return saved(self._picture(), path)

    def _picture(self) -> Picture:
        return picture_of(self.explanation)

    def to_json(self) -> dict:
        """``tinygc-explain/2`` (docs/formats.md)."""
        return self.table

    def save(self, folder: Path | str | None = None, pictures: bool = True) -> Path:
        """Write the result and its picture into a folder (``explain`` in the session's folder by default); returns it."""
        folder = self.explanation.session.own_folder("explain") if folder is None else Path(folder)
        with result_folder(folder):
            write_whole(folder / "explain.json", self.table)
        if pictures:
            self.plot(folder / "explain.svg")
        return folder


#: what features add to it
FURTHER = tuple(features.each("options of explain"))


@public(Seed, AtRest, *FURTHER)
def explain(
    session: Session | Path | str,
    *,
    check_on: Sequence[Session | Path | str] = (),
    progress: Progress | None = None,
    **choices: Any,
) -> Why:
    """Explain the mismatch of a session against its reference: gravity in the stills, table dials, or a further reference.

    Parameters
    ----------
    session : Session, table, str or Path
        The recording, or its folder.
    check_on : sequence of Session, str or Path, optional
        Other recordings of the unit, or folders of them, on which each effect is checked with the size that it has here.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    Why
        ``verdict``, ``effects``, ``findings``, ``noise``, ``checked``; ``summary()``, ``plot()`` and ``save()``.

    Raises
    ------
    CalibrationError
        For data that cannot be read, and for an error in the data that must be repaired first; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> why = tinygc.explain(tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session)
    >>> why.verdict
    'no_mismatch'

    """
    where = session_or_folder(session)
    others = _others(where, check_on)
    (draws, options, *further) = records(choices, Seed, AtRest, *FURTHER)
    how = {"seed": draws.seed, "use_earth": options.earth, "noise": options.noise, "progress": progress or no_report}
    why = _explained(where, further, how)
    checked = []
    for other in others:
        try:
            explained = _explained(other, (), how).explanation
            checked.append(check(why.explanation, explained, draws.seed))
        except CalibrationError as error:  # of the other recording: the first one's result stands
            checked.append(Checked(other, None, error=str(error)))
    why.checked = checked
    return why


def _others(first: Session | Path, places: Sequence[Session | Path | str]) -> list[Session]:
    """The recordings to check on, each once; a folder of sessions stands for those of the same unit."""
    if isinstance(places, str | Path | Session):
        places = [places]
    folder = first.folder if isinstance(first, Session) else first
    serial = first.config.sensor.serial if isinstance(first, Session) else serial_of(first)
    found: dict[Path, Session] = {}
    for place in map(session_or_folder, places):
        # Read before anything is explained: one that cannot be read must not cost the first result.
        for other in [place] if isinstance(place, Session) else map(read_session, recordings_at(place, folder, serial)):
            found.setdefault(other.folder.resolve(), other)
    return list(found.values())


def _explained(where: Session | Path, further: Sequence[Any], how: dict[str, Any]) -> Why:
    config = where.config if isinstance(where, Session) else read_config(where / "session.toml")
    reference = reference_of(config.protocol.reference)
    if reference is not None and reference.accelerometer:
        refuse_with(f"a {reference.title} as the reference", {}, further)
        return Why(explain_session(where, **how))
    explanation = explain_session(where, **how)
    beyond = features.first("search beyond the catalogue", explanation, tuple(further), seed=how["seed"], progress=how["progress"])
    why: Why = Why(explanation) if beyond is None else features.first("report beyond the catalogue", explanation, beyond)
    return why


def _found(entry: dict) -> FoundEffect:
    names = ("id", "equation", "parameters", "std", "p_value", "probability", "rivals")
    fields: dict[str, Any] = {name: entry.get(name) for name in names}
    return FoundEffect(**fields, description=entry["description"], equivalent=tuple(entry.get("equivalent", ())))
