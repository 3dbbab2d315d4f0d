"""Variance components of a session's noise: what is put into the residuals comes back, with the uncertainty that is stated for it."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_twins import make_twin_of

from tinygc.noise import components
from tinygc.noise.components import REFERENCE, STILL_RATE, TURN, UNDERSAMPLED, WANDER, Prior, first_noise, undersampling
from tinygc.noise.refit import design, prior_sigmas
from tinygc.noise.whitening import Sparse, Whitener

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
SEEDS = range(40)
#: of the size that white noise has in the channel concerned: plain to see, and not so great that it drowns the others
TIMES = {WANDER: 3.0, STILL_RATE: 2.0, REFERENCE: 2.0, TURN: 2.5, UNDERSAMPLED: 1.5}


class Session:
    """White noise of one small session, its components, and the columns of the linear model."""

    def __init__(self, twin, missed=None):
        self.twin, self.whiten = twin, Whitener(twin)
        self.noise = first_noise(twin, self.whiten, missed or undersampling(twin))
        start = twin.start()
        self.J = self.whiten.back(design(twin, self.whiten, start, twin.rates(start))[0]) * prior_sigmas(twin, [])

    @property
    def usual(self) -> dict[str, float]:
        return {c.name: c.usual for c in self.noise.components}

    def left_by_a_fit(self, sizes: dict[str, float], seed: int) -> np.ndarray:
        """Residuals (n,) of noise with these components, after the linear model has taken up what it can."""
        V = {c.name: c.V.dense() if isinstance(c.V, Sparse) else c.V for c in self.noise.components}
        covariance = self.whiten.white + sum((s**2 * V[name] for name, s in sizes.items()), np.zeros_like(self.whiten.white))
        r = np.linalg.cholesky(covariance) @ np.random.default_rng(seed).standard_normal(len(covariance))
        white_J, white_r = self.whiten(self.J), self.whiten(r)
        return r - self.J @ np.linalg.solve(white_J.T @ white_J + np.eye(white_J.shape[1]), white_J.T @ white_r)

    def estimated(self, sizes: dict[str, float], noise=None, seeds=SEEDS) -> dict[str, np.ndarray]:
        """name -> (2, seeds): s and its sigma."""
        noise = noise or self.noise
        found = [noise.estimated(self.whiten, self.left_by_a_fit(sizes, seed), self.J, with_sigma=True) for seed in seeds]
        return {c.name: np.array([(f.s[k], f.sigma[k]) for f in found]).T for k, c in enumerate(noise.components)}

    def with_prior(self, name: str, prior):
        """The components, one of them with something else known of it."""
        changed = tuple(replace(c, prior=prior) if c.name == name else c for c in self.noise.components)
        return replace(self.noise, components=changed)


@pytest.fixture(scope="module")
def session(twin_of):
    return Session(twin_of(segments=30, seed=5)[0])


@pytest.fixture(scope="module")
def quick(session):
    """The same, as if its turns missed three times the white noise, unevenly: this slow hand misses next to nothing at 104 Hz."""
    floor = np.sqrt(np.mean(session.twin.problem.floor.sigma**2))
    each = np.exp(np.random.default_rng(1).normal(0, 0.8, len(session.twin.segments)))
    return Session(session.twin, replace(session.noise.missed, predicted_rad=3 * floor * each))


def comes_back(found: np.ndarray, true: float, near: float) -> None:
    """The mean within a share of the truth, and some 68 % within one stated sigma: of forty, 50 to 85 %."""
    s, sigma = found
    assert np.mean(s) == pytest.approx(true, rel=near)
    assert 0.5 <= np.mean(np.abs(s - true) < sigma) <= 0.85
    # The stated sigma is that of the estimates themselves.
    assert np.median(sigma) == pytest.approx(np.std(s), rel=0.4)


@pytest.mark.slow
@pytest.mark.parametrize("name", TIMES)
def test_a_component_comes_back_with_its_size_and_uncertainty(session, quick, name):
    """The bias's wander as well, if nothing is known of it beforehand."""
    session = quick if name == UNDERSAMPLED else session
    true = TIMES[name] * session.usual[name]
    found = session.estimated({name: true}, session.with_prior(name, None))
    comes_back(found[name], true, near=0.12)
    for other in set(found) - {name, WANDER}:
        assert np.mean(found[other][0]) < session.usual[other]


@pytest.mark.slow
def test_two_components_at_once_are_told_apart(session):
    """Turns that err by themselves, and rests that creep: one shows in the closure alone, the other in the rates at rest."""
    true = {name: TIMES[name] * session.usual[name] for name in (STILL_RATE, TURN)}
    found = session.estimated(true)
    for name, s in true.items():
        comes_back(found[name], s, near=0.12)
    assert np.mean(found[REFERENCE][0]) < session.usual[REFERENCE]


def test_where_nothing_is_there_next_to_nothing_is_found(session):
    found = session.estimated({}, seeds=range(12))
    for name in (STILL_RATE, REFERENCE, TURN):
        assert np.mean(found[name][0]) < 0.3 * session.usual[name]
        assert np.median(found[name][0]) < np.median(found[name][1])


@pytest.mark.parametrize("times", [{TURN: 40}, {STILL_RATE: 20, TURN: 40}, {REFERENCE: 20}])
def test_components_far_larger_than_white_noise_are_found_in_two_searches(session, times):
    """As where an effect that has no name yet is taken for noise, and as a hypothesis is weighed: the second goes on from the first.  A
    search of two hundred steps that begins at the truth finds nothing likelier."""
    true = {name: factor * session.usual[name] for name, factor in times.items()}
    at_truth = np.array([true.get(c.name, c.usual) for c in session.noise.components])
    for seed in range(4):
        r = session.left_by_a_fit(true, seed)
        once = session.noise.estimated(session.whiten, r, session.J)
        twice = session.noise.estimated(session.whiten, r, session.J, once.s)
        assert twice.value < session.noise.estimated(session.whiten, r, session.J, at_truth, steps=200).value + 0.5
        for name, s in true.items():
            assert twice.size(name) == pytest.approx(s, rel=0.3)


def test_a_session_in_blocks_says_what_it_says_as_a_whole(session, monkeypatch):
    monkeypatch.setattr(components, "BLOCK", 10)
    in_blocks = first_noise(session.twin, session.whiten, session.noise.missed)
    assert [len(noise.blocks) for noise in (session.noise, in_blocks)] == [1, 3]
    rows = np.sort(np.concatenate(in_blocks.blocks))
    np.testing.assert_array_equal(rows, np.arange(sum(session.whiten.sizes)))
    true = {name: TIMES[name] * session.usual[name] for name in (STILL_RATE, REFERENCE, TURN)}
    whole, parts = (session.estimated(true, noise, seeds=range(6)) for noise in (session.noise, in_blocks))
    for name in true:
        assert (np.abs(parts[name][0] - whole[name][0]) < whole[name][1]).all()


def test_what_is_known_of_the_wander_is_left_where_the_recording_is_silent(session):
    """A tenth of the wander that would be as large as white noise cannot be seen; eight times what is known can, and is not overruled."""
    faint, usual = 0.1 * session.usual[WANDER], session.usual[WANDER]
    silent = session.estimated({}, session.with_prior(WANDER, Prior(faint, 0.5)), seeds=range(6))[WANDER]
    np.testing.assert_allclose(silent[0], faint, rtol=0.1)
    loud = session.estimated({WANDER: 8 * usual}, session.with_prior(WANDER, Prior(usual, 0.5)), seeds=range(6))[WANDER]
    assert (loud[0] > 3 * usual).all()
