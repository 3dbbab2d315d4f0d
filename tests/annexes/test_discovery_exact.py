"""A law's constants are recovered with all else, however strong the law is, and their uncertainty is part of the coefficients'."""

import numpy as np
import pytest
from simulated_twins import make_twin_of

from session.io.units import DEG
from tinygc.annexes.discovery.equivalence import as_effect, columns_of, some_movement
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.selection import Constants, FormEvidence, exact, one_step
from tinygc.noise.twin import claim_slice

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
FS_RPS = 500 * DEG
#: rad/s for one of each quantity
SIZE = np.array([0.3, -0.25, 0.3]) * DEG


def soft(t_s, rate, force, temp_c):
    return rate + SIZE * np.tanh(rate / FS_RPS / 0.08)


def excess(t_s, rate, force, temp_c):
    return rate + 60 * SIZE * np.maximum(np.abs(rate) / FS_RPS - 0.1, 0)


def lagging(t_s, rate, force, temp_c):
    """Behind a first-order lag of 1.5 s, by its own steps."""
    size, dt = np.linalg.norm(rate, axis=1) / FS_RPS, t_s[1] - t_s[0]
    late, keep = np.zeros(len(size)), np.exp(-dt / 1.5)
    for n in range(1, len(size)):
        late[n] = keep * late[n - 1] + (1 - keep) * size[n]
    return rate + 5 * SIZE * late[:, None]


#: what is put in, the form that says it with a constant that is a third off, and the true one
LAWS = {
    "soft": (soft, LawForm((Factor("rate", "soft", 0.11),)), 0.08, SIZE),
    "strong excess": (excess, LawForm((Factor("rate", "excess", 0.13),)), 0.1, 60 * SIZE),
    "lag": (lagging, LawForm((Factor("rate_size", "itself", None, 1.0),)), 1.5, 5 * SIZE),
}


@pytest.mark.broad
@pytest.mark.parametrize("name", LAWS)
def test_a_constant_is_recovered_with_its_uncertainty(twin_of, name):
    distort, form, true, size = LAWS[name]
    evidence = FormEvidence(twin_of(distort, segments=24)[0])
    law = evidence.effect_of(form)
    began = evidence.of((law,), evidence.nothing)
    have, law = exact(evidence, began, law)
    form = evidence.forms[law.id]
    known = Constants.of(evidence.twin, have, law, form)
    (constant,), (sigma,) = form.constants, known.sigmas(form)
    assert have.score < began.score - 10
    assert constant == pytest.approx(true, abs=3.5 * sigma)
    assert sigma < 0.1 * true
    part = claim_slice(have.fit.state.claims, 0)
    held = have.fit.covariance
    wide = known.widened(held)
    theta, std = have.fit.state.claims[0].theta, np.sqrt(np.diag(wide))[part]
    assert np.all(np.abs(theta - size) < 4 * std)
    assert np.all(std > np.sqrt(np.diag(held))[part])


@pytest.mark.broad
def test_a_step_is_taken_where_it_promises_what_is_lacking(twin_of):
    evidence = FormEvidence(twin_of(excess, segments=24)[0])
    law = evidence.effect_of(LAWS["strong excess"][1])
    have = evidence.of((law,), evidence.nothing)
    assert one_step(evidence, have, law, 1e6) == (have, law)
    assert one_step(evidence, have, law, 0.0)[0].score < have.score - 10


@pytest.mark.broad
def test_a_law_without_constants_stays_as_it_is(twin_of):
    evidence = FormEvidence(twin_of(soft, segments=24)[0])
    law = evidence.effect_of(LawForm((Factor("rate", "signed_root"),)))
    have = evidence.of((law,), evidence.nothing)
    assert exact(evidence, have, law) == (have, law)
    assert one_step(evidence, have, law, 0.0) == (have, law)


@pytest.mark.parametrize(
    "form", [LAWS["soft"][1], LawForm((Factor("force", "size"),), "full"), LawForm((Factor("rate"), Factor("force")), "next")]
)
def test_the_rate_with_a_law_is_the_sum_of_its_columns(form):
    """Without the zeros of the columns, which cost most of the time."""
    movement, theta = some_movement(1), np.random.default_rng(2).standard_normal(form.size)
    np.testing.assert_allclose(as_effect(form).distort(movement, theta), movement.rate + columns_of(form, movement) @ theta, atol=1e-12)
