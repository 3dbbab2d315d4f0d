"""The linear model in single precision: a correction that is added to the rate.

    y = x + (D x + b),  D = E - I

The small part is computed apart and added last: its rounding is smaller than the rate's by the size of the correction, so a rate costs
one rounding where E x + b would cost six.
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy.embedded.stage import Cost, Inputs, ProgramStage, single
from tinygc.models.linear import LinearModel

#: of one affine map of three
COST = Cost(multiply=9, add=9)
FUNCTION = """\
/* y = W x + b; b is the last column of w. */
static void affine(const float w[3][4], const float x[3], float y[3])
{
    for (int i = 0; i < 3; i++) {
        float s = w[i][3];
        s += w[i][0] * x[0];
        s += w[i][1] * x[1];
        s += w[i][2] * x[2];
        y[i] = s;
    }
}
"""
ADD = "for (int i = 0; i < 3; i++)\n    r[i] += s[i];"


def affine(w: np.ndarray, x: np.ndarray) -> np.ndarray:
    """W x + b, in the order of the C: w (3, 4), x (N, 3), all float32."""
    y = np.broadcast_to(w[:, 3], x.shape)
    for j in range(3):
        y = y + w[:, j] * x[:, j : j + 1]
    return y


def table(matrix: np.ndarray, bias: np.ndarray, what: str) -> np.ndarray:
    """(3, 4) float32 of a matrix and a bias."""
    return single(np.column_stack([matrix, bias]), what)


class Linear(ProgramStage):
    """omega = E m + B as m + (D m + B)."""

    cost = COST + Cost(add=3)

    def __init__(self, model: LinearModel, name: str, says: str):
        self._w = table(np.asarray(model.E, dtype=float) - np.eye(3), model.B, says)
        self.says, self.constants = says, {name: self._w}
        self.body = f"float s[3];\naffine({name}, r, s);\n{ADD}"

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        return rate + affine(self._w, rate)
