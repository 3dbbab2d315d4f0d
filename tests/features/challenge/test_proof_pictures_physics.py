"""A law that a proof puts in: each turn asks for it by itself, on a picture, and the report draws it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tinygc.effects import catalogue
from tinygc.effects.effect import TURNS
from tinygc.features.challenge.proofs import _explanation_of, _inject, fitted
from tinygc.noise.twin import variable_of
from tinygc.reporting.html.sections.explanation import section
from tinygc.reporting.pictures.values import _per_turn, per_parameter

FS = 500.0  #: dps


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """An explanation of a session with a scale that grows with the square of the rate, its only claim, and the true theta (3,)."""
    folder = tmp_path_factory.mktemp("law") / "session"
    injected = _inject(catalogue()["gyro.scale_nonlinearity"], folder, 0.03, seed=4)
    e = _explanation_of(fitted(injected, folder))
    return e, e.claimed[0], injected.theta


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.broad
def test_each_turn_is_on_the_law_that_was_put_in_and_the_report_draws_it(known):
    """The fit's own error moves all turns of an axis alike.  A law that is a tenth larger is too far off, on one axis at least."""
    e, claim, truth = known
    for axis in range(3):
        of = _per_turn(e, claim, "scale", axis, variable_of(claim.effect, claim.theta))
        assert len(of.x) >= 6
        assert rms((of.before - truth[axis] * (of.x / FS) ** 2) / of.sigma) < 2.0
        assert 0.6 < rms(of.after / of.sigma) < 1.4  # the bars are the noise
        assert rms(of.before / of.sigma) > 10
        turns = per_parameter(e, claim, axis)
        weight = turns.law / turns.sigma**2
        slope, sigma = weight @ turns.before / (weight @ turns.law), (weight @ turns.law) ** -0.5
        assert slope == pytest.approx(1.0, abs=4 * sigma + 0.02)
    for picture, words in (
        ("", "the scale error of each turn follows its rate"),
        (TURNS, "each turn misses what the effect makes"),
    ):
        drawn = replace(claim, effect=replace(claim.effect, picture=picture)) if picture else claim
        found = section(SimpleNamespace(by_reference=None, explanation=replace(e, claimed=[drawn])))
        assert words in found.html
        assert "nan" not in found.html.lower().replace("nano", "")
