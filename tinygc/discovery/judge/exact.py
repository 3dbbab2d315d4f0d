"""A law's constants, fitted with all else: linear columns, by which they were sharpened, know only the rate that the law still disturbs.

Gauss-Newton, as ``explanation.twin.shapes`` has it for one scanned number; a step is kept where the recording is more probable with it.
What is not known of the constants widens what is said of the coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.as_effect import as_effect
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.judge.believable import believable
from tinygc.discovery.judge.weigh import FormEvidence
from tinygc.effects import Effect
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.twin import Twin

#: ln of a constant, for a central difference: some samples pass a threshold that moves so far
STEP = 0.01
#: ln of a constant: a prior's sigma, as wide as any grid; and the farthest that one step goes
LOOSE, FARTHEST = 1.0, 0.3
#: steps, and shares of one that are tried
STEPS, SHARES = 6, (1.0, 0.3)
#: of the residuals' squares, what a step is thought to leave at least
LEAST_LEFT = 0.01
#: sigmas: a step so short is the last
ENOUGH = 0.1


@dataclass(frozen=True, eq=False)
class Constants:
    """What one fit tells of the K constants of one of its laws, in ln of each.

    step (K,): to where the linear columns are best; covariance (K, K): all else free; along (p, K): how the fit's parameters follow them;
    worth: -2 log evidence that the step promises, the noise's size following what is left.
    """

    step: np.ndarray
    covariance: np.ndarray
    along: np.ndarray
    worth: float

    @classmethod
    def of(cls, twin: Twin, have: Hypothesis, law: Effect, form: Form) -> Constants:
        """Of a law that has constants."""
        fit, replay = have.fit, Replay(twin, have.fit)
        moves = have.whiten(_moves(twin, have, law, form, replay))
        along = fit.covariance @ (fit.J.T @ moves)
        information = moves.T @ moves - (moves.T @ fit.J) @ along + np.eye(moves.shape[1]) / LOOSE**2
        left = fit.r - fit.J @ (fit.covariance @ (fit.J.T @ fit.r))
        step = np.clip(-np.linalg.solve(information, moves.T @ left), -FARTHEST, FARTHEST)
        rows, share = len(left), float(step @ information @ step) / max(float(left @ left), 1e-300)
        return cls(step, np.linalg.inv(information), along, -rows * np.log(max(1 - share, LEAST_LEFT)))

    def sigmas(self, form: Form) -> tuple[float, ...]:
        """Of each constant, in its unit."""
        return tuple((np.sqrt(np.diag(self.covariance)) * form.constants).tolist())

    def widened(self, covariance: np.ndarray) -> np.ndarray:
        """(p, p) of the fit's parameters, the constants free."""
        return covariance + self.along @ self.covariance @ self.along.T


def exact(evidence: FormEvidence, have: Hypothesis, law: Effect) -> tuple[Hypothesis, Effect]:
    """The hypothesis with a law's constants at their best, and the law."""
    for _ in range(STEPS if evidence.forms[law.id].constants else 0):
        known = Constants.of(evidence.twin, have, law, evidence.forms[law.id])
        if np.all(np.abs(known.step) < ENOUGH * np.sqrt(np.diag(known.covariance))):
            break
        better = next((found for share in SHARES if (found := _stepped(evidence, have, law, share * known.step))), None)
        if better is None:
            break
        have, law = better
    return have, law


def one_step(evidence: FormEvidence, have: Hypothesis, law: Effect, lacking: float) -> tuple[Hypothesis, Effect]:
    """The same after one step, where it promises what the hypothesis is lacking, -2 log evidence; else as it is."""
    form = evidence.forms[law.id]
    if not form.constants:
        return have, law
    known = Constants.of(evidence.twin, have, law, form)
    if known.worth <= max(lacking, ENOUGH**2):
        return have, law
    return _stepped(evidence, have, law, known.step) or (have, law)


def _stepped(evidence: FormEvidence, have: Hypothesis, law: Effect, step: np.ndarray) -> tuple[Hypothesis, Effect] | None:
    """After a step, where the recording is more probable with it, and the fit is believed."""
    form = evidence.forms[law.id]
    other = evidence.effect_of(form.with_constants(form.constants * np.exp(step)))
    trial = evidence.of(tuple(other if effect is law else effect for effect in have.effects), have)
    return (trial, other) if trial.score < have.score and believable(trial, have) else None


def _moves(twin: Twin, have: Hypothesis, law: Effect, form: Form, replay: Replay) -> np.ndarray:
    """(n, K) how the stacked residuals change with ln of each constant."""
    claim = next(claim for claim in have.fit.state.claims if claim.effect is law)
    state, found = have.fit.state, []
    for number in range(len(form.constants)):
        sides = []
        for side in (-1, 1):
            constants = np.array(form.constants)
            constants[number] *= np.exp(side * STEP)
            effect = as_effect(form.with_constants(constants), law.id)
            sides.append(twin.effect_columns(effect, state, replay.sensitivity, replay.rates).stacked() @ claim.theta)
        found.append((sides[1] - sides[0]) / (2 * STEP))
    return np.stack(found, axis=1)
