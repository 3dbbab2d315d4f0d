"""Effects of the accelerometer in simulated sessions: parameters lie within their stated sigmas, beside a given calibration and beside one
from the session's own stills."""

import re

import numpy as np
import pytest

from tinygc.annexes.challenge.proof_sessions import FittedProof, fitted, inject
from tinygc.closure.prepared import prepare
from tinygc.effects import catalogue
from tinygc.noise.components import known_whitener
from tinygc.noise.refit import refit
from tinygc.noise.twin import Twin

OWN = sorted(name for name in catalogue() if name.startswith("accelerometer."))
SHARE = 0.05  #: of the plausible size


def beside_its_own_stills(effect, injected) -> FittedProof:
    """The fit of a session that states no calibration of its accelerometer."""
    path = injected.folder / "session.toml"
    path.write_text(re.sub(r"\[accelerometer\][^[]*(\[\[.*\]\])?[^[]*\[-?\d.*\]\n", "", path.read_text(encoding="utf-8")), encoding="utf-8")
    problem = prepare(injected.folder).as_given().problem
    assert problem.session.config.accelerometer.source == "stills"
    twin = Twin(problem)
    whiten = known_whitener(twin)
    first = refit(twin, whiten, [], twin.start())
    return FittedProof(injected, twin, whiten, first, refit(twin, whiten, [effect], twin.start()))


def errors_of(found: FittedProof) -> np.ndarray:
    """(P,) errors of the parameters in their sigmas, inflated as ``fit`` does."""
    widen = max(1.0, found.fit.chi_square / max(len(found.fit.r) - found.fit.J.shape[1], 1))
    return (found.claim.theta - found.injected.theta) / np.sqrt(widen * np.diag(found.fit.theta_covariance(0)))


@pytest.mark.parametrize("name", ["accelerometer.zero_drift", "accelerometer.nonlinearity"])
def test_an_effect_is_recovered_beside_nine_numbers_of_the_same_stills(tmp_path, name):
    """They took up a part of it, from turns as well as from lengths; unless that is taken back, errors are many sigmas."""
    effect = catalogue()[name]
    injected = inject(effect, tmp_path, 2 * SHARE * effect.parameter.plausible, 2)
    found = beside_its_own_stills(effect, injected)
    assert np.abs(errors_of(found)).max() < 3.5
    assert np.abs(found.claim.theta).max() > 8 * np.sqrt(np.diag(found.fit.theta_covariance(0))).min()


@pytest.mark.slow
@pytest.mark.parametrize("fit", [fitted, beside_its_own_stills])
def test_two_thirds_lie_within_one_sigma(tmp_path, fit):
    errors = []
    for name in OWN:
        effect = catalogue()[name]
        for seed in range(1, 9):
            injected = inject(effect, tmp_path / f"{name}{seed}", SHARE * effect.parameter.plausible, seed)
            errors.append(errors_of(fit(effect, injected)))
    within = np.concatenate(errors)
    assert 0.58 < np.mean(np.abs(within) < 1) < 0.80, np.mean(np.abs(within) < 1)
    assert np.abs(within).max() < 5
