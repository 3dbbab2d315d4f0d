"""What decides a fleet's numbers: part of every key, so that another choice is computed anew and never mixed with what is there."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from session.common.errors import CalibrationError
from session.common.texts import unicode_text
from session.log.hashes import sha256_of
from tinygc.methods.options import FitOptions
from tinygc.problem.prepared import ACCELEROMETERS, AUTO

#: in their order; fit and explain begin with what check does, so that leaving it out only leaves its findings out
STEPS = ("check", "fit", "explain")


@dataclass(frozen=True)
class FleetOptions:
    """steps: some of ``STEPS``; seed: of the fit's swarm and of explain's critical values; earth: whether the Earth's rotation is taken
    off; accelerometer: as of ``FitOptions``; effects: folders with further effects, and effects_sha256: of all files in them.
    CalibrationError for what cannot be."""

    steps: tuple[str, ...] = STEPS
    seed: int = 0
    earth: bool = True
    accelerometer: str = AUTO
    effects: tuple[str, ...] = ()
    effects_sha256: str = ""

    def __post_init__(self) -> None:
        unknown = set(self.steps) - set(STEPS)
        if unknown or not self.steps:
            raise CalibrationError(f"steps are {', '.join(self.steps) or 'none'}; expected some of {', '.join(STEPS)}")
        if self.accelerometer not in (*ACCELEROMETERS, AUTO):
            raise CalibrationError(f"accelerometer is {self.accelerometer!r}, expected one of {', '.join((AUTO, *ACCELEROMETERS))}")
        object.__setattr__(self, "steps", tuple(step for step in STEPS if step in self.steps))
        if self.effects and not self.effects_sha256:
            object.__setattr__(self, "effects_sha256", effects_hash(self.effects))

    @property
    def of_fit(self) -> FitOptions:
        """Least squares alone: nothing is trained."""
        return FitOptions(methods=("least_squares",), seed=self.seed, earth=self.earth, accelerometer=self.accelerometer)

    @property
    def text(self) -> str:
        """All that numbers follow from, in one line, as the key has it; where the folders of effects lie is not part of it."""
        table = {
            "steps": self.steps,
            "seed": self.seed,
            "earth": self.earth,
            "accelerometer": self.accelerometer,
            "effects": self.effects_sha256,
        }
        return json.dumps(table, sort_keys=True)


def effects_hash(folders: tuple[str, ...]) -> str:
    """SHA-256 over the Python files of folders with effects, those in folders of their own as well, by name and content."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(Path(folder).rglob("*.py")):
            name = unicode_text(path.relative_to(folder).as_posix())
            digest.update(f"{name}\0{sha256_of(path)}\n".encode())
    return digest.hexdigest()
