"""The noise of a truth as variance components; named physics, fitted to the closure between its moments."""

from __future__ import annotations

import numpy as np

from session.base import rotation
from session.base.errors import FitError
from session.base.numeric import sigma_of
from session.base.progress import Told
from session.base.units import DEG
from tinygc.closure.problem import Problem
from tinygc.effects import Effect
from tinygc.effects.signals import angular_acceleration
from tinygc.estimation.physics import PhysicsFit
from tinygc.explanation.decision import without_effects
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.physics import effect_of
from tinygc.features.truth.engine import without_wrong_moments
from tinygc.features.truth.twin import TruthTwin, beside_clock, held_out, name_beside_truth
from tinygc.inference.noise import Prior, Sparse
from tinygc.models.physics import PhysicsModel
from tinygc.noise.components import Component
from tinygc.noise.thinned import conditions
from tinygc.noise.twin import Twin

# The variance components of a truth's errors, in place of the accelerometer's.
#
# - ``noise.truth``: the truth's error at each moment, shared by two neighbours with opposite signs.
# - ``noise.truth_rate``, ``noise.truth_acceleration``: further errors of each moment, in proportion to the rate and the angular
#   acceleration there: jitter of the truth's stamps, blur, markers that give way.
# - ``noise.turned``: an error of each turn whose variance is in proportion to the angle that is turned through: errors of the truth with
#   the attitude differ at the ends of a turn and agree at those of a rest.

TRUTH, TRUTH_RATE, TRUTH_ACCELERATION, TURNED = "noise.truth", "noise.truth_rate", "noise.truth_acceleration", "noise.turned"
#: ln: a truth's sigma is stated to an order of magnitude: some public ones are 30 times as good as stated, some as bad
TRUTH_SPREAD = 1.5
#: where a search starts: jitter of a camera's stamps, s; what smoothing over 50 ms may leave, s^2; a camera's errors after a radian, rad
USUAL_JITTER_S, USUAL_BLUR_S2, USUAL_TURNED_RAD = 1e-3, 1e-4, 0.1 * DEG


def truth_components(twin: Twin, sizes: tuple[int, int, int]) -> list[Component]:
    """Components of the truth's error at each moment, and of what it leaves in a turn; a segment that begins at the sample where another
    ends shares its moment."""
    sigma = twin.problem.session.reference.sigma_deg * DEG
    rates = twin.rates(twin.start())
    changes = [angular_acceleration(movement.with_rate(rate)) for movement, rate in zip(twin.movements, rates, strict=True)]
    ends: dict[tuple[int, int], np.ndarray] = {}
    for number, s in enumerate(twin.segments):
        for at, sign in ((s.start, -1.0), (s.stop - 1, 1.0)):
            ends.setdefault((s.log, at), np.zeros(len(twin.segments)))[number] += sign
    moments = np.array(list(ends.values()))

    def of_moments(name: str, sizes_at: np.ndarray, usual: float, unit: str, si: float, says: str, prior: Prior | None = None) -> Component:
        sized = moments * sizes_at[:, None]
        return Component(name, Sparse.of(np.kron(sized.T @ sized, np.eye(twin.batch.angles))), usual, unit, si, says, prior)

    rate, change = (np.array([np.linalg.norm(values[log][at]) for log, at in ends]) for values in (rates, changes))
    angle = [
        np.linalg.norm(rates[s.log][s.start : s.stop], axis=1) @ rotation.sample_weights(dt[None, : s.stop - s.start - 1])[0]
        for s, dt in zip(twin.segments, twin.batch.dt, strict=True)
    ]
    diagonal = np.zeros(sum(sizes))
    diagonal[: sizes[0]] = np.repeat(angle, twin.batch.angles)
    says = "attitude of each moment of truth"
    # A search that starts at the stated sigma, which may be off by a factor of 30, ends where other components have taken its place.
    usual = float(sigma_of(twin.residuals(twin.start()).closure.ravel())) / np.sqrt(2) or sigma
    return [
        of_moments(TRUTH, np.ones(len(moments)), usual, "deg", DEG, says, Prior(sigma, TRUTH_SPREAD)),
        of_moments(TRUTH_RATE, rate, USUAL_JITTER_S, "ms", 1e-3, "the truth's error that grows with the rate"),
        of_moments(TRUTH_ACCELERATION, change, USUAL_BLUR_S2, "ms²", 1e-6, "the truth's error that grows with the angular acceleration"),
        Component(TURNED, Sparse.of_diagonal(diagonal), USUAL_TURNED_RAD, "°/√rad", DEG, "each turn, by the root of the angle turned"),
    ]


# Named physics with a truth file: fitted to the closure between moments of truth alone, together with the truth's clock.

#: id in ``explain`` of what a fit leaves out before it starts
WRONG_MOMENTS = "reference.truth_jump"


def fit_beside_truth(problem: Problem, ids: tuple[str, ...] | None, seed: int, progress: Told, folds: int) -> PhysicsFit:
    """Fit with these effects, or with what ``explain`` names for a session with a truth file (None).  Raises FitError for an id that cannot
    be fitted."""
    sound, jumps, _ = without_wrong_moments(problem)
    twin = TruthTwin(sound)
    evidence, refused = Evidence(twin), False
    if ids is None:
        names = name_beside_truth(twin, evidence, seed, progress)
        effects, refused = names.named, names.naming.refused
    else:
        effects = tuple(_effect(twin, name) for name in ids)
    # An unnamed slow bias is not part of a model: it is noise here.
    weighed = evidence.of(effects, evidence.nothing)
    fit = beside_clock(twin, weighed.whiten, weighed.fit)
    rate_claims = tuple(claim for claim in fit.state.claims if claim.effect.kind == "rate")
    model = PhysicsModel(fit.state.model, rate_claims, conditions(sound))
    angles, unseen = twin.residuals(fit.state).closure, held_out(twin, weighed.whiten, fit, folds)
    left = without_effects(sound, twin, weighed.whiten, fit, folds)
    return PhysicsFit(model, sound, left, fit, angles, unseen, (WRONG_MOMENTS,) if jumps else (), refused)


def _effect(twin: Twin, name: str) -> Effect:
    effect = effect_of(twin, name)
    if effect.kind != "rate":
        raise FitError(f"--physics: {name} cannot be fitted beside a truth file: it bends what stills show, and none is a reference there")
    return effect
