"""Effects: everything that can make a recording differ from its simulation, one record each, and their catalogue.

A file that defines ``EFFECT``, an ``Effect``, is an effect.  It may lie in ``entries`` here, or in a folder that the user names
(``load_folder``, ``--effects DIR``).  Nothing else has to be changed: model selection, refitting, simulation, plots, live use, exports
and C follow from the record.
``docs/writing-an-effect.md`` is the guide; ``tinygc.effects.testing.check`` tests an effect.
"""

from tinygc.effects import signals
from tinygc.effects.catalogue import catalogue, effect_of, load_folder, using
from tinygc.effects.device import AHEAD, BYGONE, MatrixC, NoC, PerAxisC, StageC
from tinygc.effects.effect import (
    AppliedEffect,
    CommonDelay,
    Convention,
    Derived,
    Effect,
    Occurrence,
    Parameter,
    Parts,
    ReferenceConditions,
    Scan,
    StatedNumbers,
)
from tinygc.effects.movement import (
    NEIGHBOURS,
    Conditions,
    EffectError,
    Movement,
    Reach,
    axis_of,
    before,
    behind,
    cross,
    diagonal,
    full,
    largest,
    movement_of,
    nothing,
    per_axis,
    rows,
    without_vibration,
)

__all__ = [
    "AHEAD",
    "BYGONE",
    "NEIGHBOURS",
    "AppliedEffect",
    "CommonDelay",
    "Conditions",
    "Convention",
    "Derived",
    "Effect",
    "EffectError",
    "MatrixC",
    "Movement",
    "NoC",
    "Occurrence",
    "Parameter",
    "Parts",
    "PerAxisC",
    "Reach",
    "ReferenceConditions",
    "Scan",
    "StageC",
    "StatedNumbers",
    "axis_of",
    "before",
    "behind",
    "catalogue",
    "cross",
    "diagonal",
    "effect_of",
    "full",
    "largest",
    "load_folder",
    "movement_of",
    "nothing",
    "per_axis",
    "rows",
    "signals",
    "using",
    "without_vibration",
]
