"""What was said of one session against what is hidden in it: two curves over the recording, compared beyond a linear calibration.

Both are asked on the true movement, at the recorded samples: on readings with noise the exact law of a dead zone at rest would differ from
itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tinygc.challenge.discover.answer import added_by_laws, added_by_names
from tinygc.challenge.discover.laws.table import LAWS
from tinygc.challenge.discover.truth import AddedRate
from tinygc.effects import EffectError, Movement, catalogue

#: correlation from which on two laws are the same over a recording: 14 % of their size are between them
SAME = 0.99
#: up to here the law that was said is another one, not a near relative
FAR = 0.9
#: of a session that hides a law; of one that hides none
WITH_LAW = ("found", "catalogue_equal", "ambiguous", "wrong", "missed")
WITHOUT_LAW = ("silent", "ambiguous", "invented")


@dataclass(frozen=True)
class LawScore:
    """hidden: ids, law: that of the law or None; strength: the law's, or of what is hidden instead; expression: of a drawn law.

    outcome, with a law: ``found``, its curve is the truth's (correlation > SAME); ``catalogue_equal``: no law, and the catalogue's names
    give the truth's curve; ``ambiguous``; ``wrong``: a law with another curve; ``missed``: none was said.  Without a law: ``silent``,
    ``ambiguous`` or ``invented``.  correlation: of all laws that were said, together (of the names, where there is no law); listed: the
    best of the single ones; why: what is wrong with the files, if anything; misnamed: a law is hidden, none was said, and names of the
    catalogue that add something else were; removed, p_value, chance_p: what the answer says of its own
    proof, the least of its laws.
    """

    name: str
    hidden: tuple[str, ...]
    law: str | None
    strength: float | None
    expression: str | None
    outcome: str
    equations: tuple[str, ...]
    named: tuple[str, ...]
    misnamed: bool
    correlation: float | None
    listed: float | None
    removed: float | None
    p_value: float | None
    chance_p: float | None
    seconds: float | None
    why: str | None

    @property
    def listed_same(self) -> bool:
        """Whether one of the laws that were listed is numerically the truth."""
        return self.listed is not None and self.listed > SAME

    @property
    def kind(self) -> str:
        """``law``, ``beside`` (a law beside an effect of the catalogue), ``catalogue`` or ``nothing``."""
        if self.law is not None:
            return "law" if len(self.hidden) == 1 else "beside"
        return "catalogue" if self.hidden else "nothing"


def correlation(true: AddedRate, truth: dict, said: np.ndarray) -> float:
    """Of the law's curve and another (N, 3), after a bias, a 3x3 of the rate and the columns of the concealed effects of the catalogue
    (truth: id -> parameters) are regressed out of both; 0 where nothing is left of one."""
    left = [_beyond(true, truth, curve).ravel() for curve in (true.law, said)]
    sizes = [float(np.linalg.norm(each)) for each in left]
    whole = float(np.linalg.norm(said))
    return float(left[0] @ left[1] / (sizes[0] * sizes[1])) if sizes[0] > 0 and sizes[1] > 1e-9 * whole > 0 else 0.0


def _beyond(true: AddedRate, truth: dict, curve: np.ndarray) -> np.ndarray:
    """(N, 3): least squares over all axes, by the normal equations of unit columns."""
    known = np.column_stack([np.ones(len(curve)), true.movement.rate])
    blocks = [np.kron(np.eye(3), column[:, None]).reshape(3, -1, 3).transpose(1, 0, 2) for column in known.T]
    blocks += [one[:, :, None] for one in true.catalogue.values()]
    blocks += [columns for name in true.catalogue if (columns := _columns(name, truth[name], true.movement)) is not None]
    design = np.concatenate(blocks, axis=2).reshape(curve.size, -1)
    design = design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    theta, *_ = np.linalg.lstsq(design.T @ design, design.T @ curve.ravel(), rcond=1e-10)
    return (curve.ravel() - design @ theta).reshape(curve.shape)


def _columns(name: str, parameters: dict, movement: Movement) -> np.ndarray | None:
    """(N, 3, P) of an effect of the catalogue, at its true moment."""
    effect = catalogue()[name]
    if effect.kind != "rate":
        return None
    if effect.scan is not None and effect.scan.name in parameters:
        effect = effect.at(float(parameters[effect.scan.name]) * effect.scan.si)
    return effect.columns(effect.shown(movement))


def score_law(name: str, truth: dict, said: dict, true: AddedRate, folder: Path) -> LawScore:
    """truth: as it was sealed; said: ``tinygc-explain/1`` with ``discovery``; folder: the explain folder with the laws' files."""
    law = next((each for each in truth["effects"] if each in LAWS), None)
    discovery = said.get("discovery") or {"verdict": "none", "laws": []}
    laws, verdict, why = discovery["laws"], discovery["verdict"], None
    named = tuple(each["id"] for each in said["effects"])
    together = listed = None
    if law is not None:
        try:
            curves = added_by_laws(laws, folder, true.movement)
            alone = [correlation(true, truth["effects"], curve) for curve in curves]
            listed = max(alone, default=None)
            names = added_by_names(discovery.get("beside", []), true.movement) if curves else None
            whole = curves if names is None else [*curves, names]
            together = correlation(true, truth["effects"], sum(whole[1:], whole[0])) if curves else None
        except EffectError as error:
            why = str(error)
        if not laws and (by_names := added_by_names(said["effects"], true.movement)) is not None:
            together = correlation(true, truth["effects"], by_names)
    outcome = _outcome(law, verdict, bool(laws), together)
    proofs = [proof for each in laws for proof in each["held_out"]]
    strengths = truth.get("strengths", {})
    return LawScore(
        name=name,
        hidden=tuple(truth["effects"]),
        law=law,
        strength=truth["strength"] if law is None else strengths.get(law, truth["strength"]),
        expression=None if law is None else truth["effects"][law].get("expression"),
        outcome=outcome,
        equations=tuple(each["equation"] for each in laws),
        named=named,
        misnamed=law is not None and outcome == "missed" and bool(set(named) - set(truth["effects"])),
        correlation=together,
        listed=listed,
        removed=min((each["removed"] for each in proofs if each["removed"] is not None), default=None),
        p_value=max((each["p_value"] for each in proofs), default=None),
        chance_p=max((each["chance_p"] for each in laws), default=None),
        seconds=said.get("seconds"),
        why=why or said.get("why"),
    )


def _outcome(law: str | None, verdict: str, has_laws: bool, together: float | None) -> str:
    if verdict == "ambiguous":
        return "ambiguous"
    same = together is not None and together > SAME
    if verdict == "found" and has_laws:
        return "invented" if law is None else "found" if same else "wrong"
    if law is None:
        return "silent"
    return "catalogue_equal" if same else "missed"
