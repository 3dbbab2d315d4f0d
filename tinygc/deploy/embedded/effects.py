"""Named physics in single precision: each effect's own C (``tinygc.effects.device``) as a stage of a program.

What follows the rate itself is undone as ``Effect.correct`` does it, by PASSES substitutions of r <- r - term(r).
"""

from __future__ import annotations

import re

import numpy as np

from tinygc.deploy.embedded import affine
from tinygc.deploy.embedded.stage import Cost, Inputs, ProgramStage, single
from tinygc.deploy.errors import ExportError
from tinygc.effects import AppliedEffect, Conditions, MatrixC, NoC, PerAxisC, StageC


class Matrix(ProgramStage):
    """r -= K f, f in m/s^2."""

    cost = affine.COST + Cost(add=3)

    def __init__(self, code: MatrixC, theta: np.ndarray, known: Conditions, name: str):
        self.says = code.says
        self._w = affine.table(code.matrix(theta, known), np.zeros(3), name)
        self.constants = {code.name: self._w}
        self.body = f"float s[3];\naffine({code.name}, in->force, s);\nfor (int i = 0; i < 3; i++)\n    r[i] -= s[i];"

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        return rate - affine.affine(self._w, inputs.force)


class PerAxis(ProgramStage):
    """One coefficient k per axis: r -= term, where the term, in C and in NumPy, may follow the rate w."""

    def __init__(self, code: PerAxisC, theta: np.ndarray, known: Conditions):
        self._code, self.says = code, code.says
        self.constants = {name: single(value, code.says) for name, value in code.values(theta, known).items()}
        self.body = self._statements()
        self.cost = sum([code.cost] * (3 * code.passes), Cost())

    def _statements(self) -> str:
        code = self._code
        if code.passes == 1:
            return f"for (int i = 0; i < 3; i++)\n    r[i] -= {code.term};"
        return (
            "for (int i = 0; i < 3; i++) {\n    float w = r[i];\n"
            f"    for (int pass = 0; pass < {code.passes}; pass++)\n        w = r[i] - {code.term};\n    r[i] = w;\n}}"
        )

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        w = rate
        for _ in range(self._code.passes):
            w = rate - self._code.numpy(self.constants, w, inputs)
        return w


class Own(ProgramStage):
    """An effect's own statements."""

    def __init__(self, code: StageC, theta: np.ndarray, known: Conditions):
        self._numpy = code.numpy
        self.says, self.body, self.cost, self.functions = code.says, code.body, code.cost, code.functions
        self.state, self.state_bytes, self.start = code.state, code.state_bytes, code.start
        self.constants = {name: single(value, code.says) for name, value in code.constants(theta, known).items()}

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        return self._numpy(self.constants, rate, inputs)


def effect_stage(claim: AppliedEffect, known: Conditions) -> ProgramStage:
    """The stage that undoes a claimed effect.  ExportError for one that declares no C, with its reason, or C that cannot be."""
    effect, code = claim.effect, claim.effect.device
    if isinstance(code, NoC):
        raise ExportError(f"{effect.id} cannot be exported to C: {code.why}; json carries it, or export another method's model")
    theta = np.asarray(claim.theta, dtype=float)
    if isinstance(code, MatrixC):
        stage: ProgramStage = Matrix(code, theta, known, effect.id)
    else:
        stage = PerAxis(code, theta, known) if isinstance(code, PerAxisC) else Own(code, theta, known)
    for name in stage.constants:
        if not re.fullmatch("[A-Z][A-Z0-9_]*", name):
            raise ExportError(f"{effect.id} cannot be exported to C: {name!r} is no name for a constant, expected capital letters")
    return stage
