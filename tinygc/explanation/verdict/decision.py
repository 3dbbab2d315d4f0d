"""Detect, name, refuse: what a recording shows, in the one way in which `explain` says it and `fit --physics auto` takes it over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.mends.mending import Mended
from tinygc.explanation.naming.forward import Naming, candidates, name_effects
from tinygc.explanation.naming.rivals import BETTER, best_rival
from tinygc.explanation.naming.selection import FAMILY_WISE, SHAPE_SHARE
from tinygc.explanation.naming.unknown import slow_candidates, unknown_candidates
from tinygc.explanation.twin.channels import bonferroni, channel_p_values
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: what is left after naming is judged at this level over the channels (Bonferroni): a right name is refused once in a thousand
LEFT_P = 1e-3
#: a right name takes up nearly all of the misfit; what it may leave, for what its model simplifies
#: (not critical: benchmarks/thresholds.py)
RIGHT_SHARE = 0.975
MOST_FINDINGS = 2  #: that a page holds
#: a shape without a name is not worth a reader's time if it carries less of the misfit than this: of what is said, not of what is decided
LEAST_FINDING = 0.1


@dataclass(frozen=True, eq=False)
class NamingDecision:
    """naming: the names that are kept, with the fit; beyond: shapes without a name, where names were refused or none was found;
    p_value of the detection; channel p-values before and with what is kept."""

    naming: Naming
    beyond: Naming | None
    p_value: float
    channel_p: dict[str, float]
    left: dict[str, float]

    @property
    def refused(self) -> bool:
        """There is a mismatch, and no name for it."""
        return not self.naming.named and self.p_value <= FAMILY_WISE


def decide(mended: Mended, twin: Twin, whiten: Whitener, seed: int, progress: Callable[[str], None] = lambda what: None) -> NamingDecision:
    """Detect and name; keep the names only if they leave what noise allows, or next to nothing, and no shape without a name does
    better; else say what is there without a name."""
    naming = name_effects(twin, whiten, candidates(twin), seed, progress, explained=mended.misfit)
    channel_p = channel_p_values(twin, whiten, naming.first.r, naming.first.J)
    detected = detection_p(naming.first_p, channel_p)
    left = channel_p_values(twin, whiten, naming.fit.r, naming.fit.J)
    if not naming.named and detected > FAMILY_WISE:
        return NamingDecision(naming, None, detected, channel_p, left)
    progress("beyond the catalogue")
    enough = bonferroni(left) > LEFT_P or _share(whiten, naming, mended.misfit) >= RIGHT_SHARE
    rival, lead = best_rival(twin, whiten, naming, slow_candidates(twin), seed) if enough and naming.named else (None, -np.inf)
    if enough and lead < BETTER:
        return NamingDecision(naming if rival is None else _with_stand_in(naming, rival), None, detected, channel_p, left)
    beyond = name_effects(twin, whiten, unknown_candidates(twin), seed, most=MOST_FINDINGS, stand_ins=False)
    return NamingDecision(Naming(naming.first, naming.first_p, naming.first), beyond, detected, channel_p, channel_p)


def detection_p(first_p: float, channel_p: dict[str, float]) -> float:
    """One p-value from the candidates' and the channels' own.

    The channels are judged against noise as it is stated, with allowances that most recordings do not use up, so their p-values are no
    uniform ones; they get so small a share of the level that only what is beyond doubt counts, and the whole stays uniform.
    """
    return min(1.0, first_p / SHAPE_SHARE, bonferroni(channel_p) / (1 - SHAPE_SHARE))


def _with_stand_in(naming: Naming, rival: Effect) -> Naming:
    """A shape that alone does as well as all names: each of them could be a part of it."""
    return replace(naming, named=[replace(named, equivalent=(*named.equivalent, rival.id)) for named in naming.named])


def _share(whiten: Whitener, naming: Naming, mended_from: float) -> float:
    """Share of the excess misfit that mending and naming took up, in the channels that the gyro moves, and gravity's length if an
    effect of the reference is among the names."""
    end = whiten.parts["length" if any(n.effect.kind == "force" for n in naming.named) else "still"].stop
    before = max(float(np.sum(naming.first.r[:end] ** 2)), mended_from)
    after = float(np.sum(naming.fit.r[:end] ** 2))
    return (before - after) / (before - end) if before > 2 * end else 0.0
