"""Effects: everything that can make a recording differ from its simulation, one record each, and the catalogue of them all.

A file that defines ``EFFECT``, an ``Effect``, is an effect, wherever it lies: in ``entries`` here, in an installed package (an entry
point of the group ``tinygc.effects``), or in a folder that the user names (``load_folder``, ``--effects DIR``).  Nothing else has to be
changed: naming, refitting, simulating, drawing, live use, exports and C follow from what the record declares.
``docs/writing-an-effect.md`` is the guide; ``tinygc.effects.testing.check`` proves an effect.

May import: session, attitude.
"""

from tinygc.effects import signals
from tinygc.effects.applied_effect import AppliedEffect
from tinygc.effects.columns import axis_of, before, behind, cross, diagonal, full, largest, nothing, per_axis, rows
from tinygc.effects.conditions import Conditions, movement_of, without_vibration
from tinygc.effects.device import AHEAD, BYGONE, Cost, MatrixC, NoC, PerAxisC, StageC
from tinygc.effects.discovery import catalogue, effect_of, load_folder, using
from tinygc.effects.effect import Effect
from tinygc.effects.errors import EffectError
from tinygc.effects.found_at import FoundAt
from tinygc.effects.gauge import CommonDelay, Convention
from tinygc.effects.movement import Movement
from tinygc.effects.occurrence import Occurrence
from tinygc.effects.parameter import Derived, Parameter, Parts, Scan
from tinygc.effects.picture import PictureData
from tinygc.effects.reach import NEIGHBOURS, Reach

__all__ = [
    "AHEAD",
    "BYGONE",
    "NEIGHBOURS",
    "AppliedEffect",
    "CommonDelay",
    "Conditions",
    "Convention",
    "Cost",
    "Derived",
    "Effect",
    "EffectError",
    "FoundAt",
    "MatrixC",
    "Movement",
    "NoC",
    "Occurrence",
    "Parameter",
    "Parts",
    "PerAxisC",
    "PictureData",
    "Reach",
    "Scan",
    "StageC",
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
