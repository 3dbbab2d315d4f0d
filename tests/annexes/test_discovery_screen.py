"""All forms by their linear columns: the twin's own columns, laws that are put in, chance, and what could have been learnt."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from simulated_twins import make_twin_of

from session.io.units import DEG
from tinygc.annexes.discovery import screening as spread
from tinygc.annexes.discovery.constants import gain_of, refined
from tinygc.annexes.discovery.detection_limits import learnable_from
from tinygc.annexes.discovery.enumeration import bits, constant_at, enumerated, places
from tinygc.annexes.discovery.equivalence import as_effect
from tinygc.annexes.discovery.form import PATTERNS, Factor, LawForm
from tinygc.annexes.discovery.projections import FAINT, Projection, basis_of
from tinygc.annexes.discovery.quantities import largest_of
from tinygc.annexes.discovery.responses import Responses
from tinygc.annexes.discovery.screening import Chance, screened
from tinygc.annexes.discovery.selection import takes_calibration
from tinygc.explanation.evidence import left_of, orthonormal
from tinygc.noise.refit import Replay, refit

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
ROOT_CUBE = LawForm((Factor("rate", "root_cube"),))
DEAD_ZONE = LawForm((Factor("rate", "dead_zone", 0.13),))


class Seen:
    """A session, what is fitted to it, and forms; law(…): a fit whose residuals are noise and what a law adds."""

    def __init__(self, twin, whiten):
        self.twin, self.whiten = twin, whiten
        self.fit = refit(twin, whiten, [], twin.start())
        self.replay = Replay(twin, self.fit)
        self.responses = Responses(self.replay)
        every = enumerated(largest_of(twin.movements))
        plain = [form for form in every if len(form.factors) == 1 and not form.constants and form.pattern == "each"]
        some = [form for form in every if form.size <= 9][::23]
        self.forms = list(dict.fromkeys([*plain[:30], ROOT_CUBE, DEAD_ZONE, *some]))
        self.bits = np.array([bits(form) for form in self.forms])

    def law(self, seed, form=None, theta=None):
        noise = np.random.default_rng(seed).standard_normal(self.responses.channels)
        added = 0.0 if form is None else self.whiten(self.responses.columns(form) @ theta)
        return replace(self.fit, r=noise + added)

    def screened(self, fit, seed=1, **options):
        return screened(self.replay, self.forms, self.bits, [(self.whiten, fit)], seed, **options)


@pytest.fixture(scope="module")
def seen(twin_of):
    return Seen(*twin_of(warm_up_c=6.0))


@pytest.fixture(scope="module")
def null(seen):
    """A screening of noise."""
    return seen.screened(seen.law(5), seed=2)


def of_every_pattern():
    plain, lagged = Factor("rate", "size"), Factor("acceleration", "itself", None, 0.15)
    yield from (
        LawForm((factor,), pattern) for factor in (plain, lagged, Factor("force", "wave", 0.7)) for pattern in ("each", "full", "cross")
    )
    yield from (LawForm((Factor("rate"), Factor("force", "square")), pattern) for pattern in PATTERNS)
    yield from (LawForm(pair) for pair in combinations([Factor("temperature", "root"), Factor("sense"), Factor("level", "wave", 0.4)], 2))
    yield LawForm((Factor("rate"), Factor("rate")), "next")
    yield LawForm((Factor("time", "decay", 20.0),))


@pytest.mark.broad
@pytest.mark.parametrize("form", list(of_every_pattern()), ids=repr)
def test_columns_are_the_twins(seen, form):
    expected = seen.replay.columns(as_effect(form)).stacked()
    size = np.linalg.norm(expected, axis=0)
    assert np.all(np.linalg.norm(seen.responses.columns(form) - expected, axis=0) <= 1e-9 * size)
    # What all forms are ranked by: the same sums in single precision.
    factors = [*form.factors, None][:2]
    hub, partner = (seen.responses.values.of(factor) for factor in factors)
    single = seen.responses.block(*((values / np.abs(values).max()).astype(np.float32) for values in (hub, partner)))
    double = seen.responses.block(hub / np.abs(hub).max(), partner / np.abs(partner).max())
    for one, other in ((single.closure, double.closure), (single.still, double.still)):
        assert np.abs(one - other).max() <= 1e-5 * np.abs(other).max()


@pytest.mark.broad
def test_gains_are_those_of_the_catalogues_ranking(seen):
    """``search.promises`` for each form by itself, in double precision."""
    fit = seen.law(2)
    screening = seen.screened(fit, draws=8)
    q = orthonormal(fit.J)
    r = fit.r - q @ (q.T @ fit.r)
    for number in range(0, len(seen.forms), 23):
        basis = left_of(q, seen.whiten(seen.replay.columns(as_effect(seen.forms[number])).stacked()), FAINT)
        assert screening.rank[0, number] == basis.shape[1]
        assert screening.gain[0, number] == pytest.approx(np.sum((basis.T @ r) ** 2), rel=1e-3, abs=1e-3)


@pytest.mark.broad
@pytest.mark.parametrize("rows", [None, np.r_[0:20, 30:60]], ids=["all", "some rows"])
def test_a_look_is_what_a_dense_projection_makes_of_it(seen, rows):
    """Whitening by a full matrix, and the nuisance taken out by I - q q': lengths and scalar products are the same to rounding."""
    fit = seen.law(8)
    projection = Projection(seen.twin, seen.whiten, fit, rows)
    rows = np.arange(len(fit.r)) if rows is None else rows
    whitening = np.linalg.inv(np.linalg.cholesky(seen.whiten.covariance[np.ix_(rows, rows)]))
    q = orthonormal(whitening @ seen.whiten.back(fit.J)[rows])
    project = (np.eye(len(rows)) - q @ q.T) @ whitening
    columns = seen.responses.columns(LawForm((Factor("rate", "size"),), "full"))[rows]
    columns = columns / np.linalg.norm(columns, axis=0)
    recorded = seen.whiten.back(fit.r)[rows]
    expected, free = project @ columns, projection.seen(columns)
    assert projection.free == len(rows) - q.shape[1] == len(free)
    largest = np.abs(expected.T @ expected).max()
    assert np.allclose(free.T @ free, expected.T @ expected, rtol=0, atol=1e-9 * largest)
    assert np.allclose(free.T @ projection.residual, expected.T @ (project @ recorded), rtol=1e-9)
    # As one matrix, single precision: those rows first, then those along the nuisance, which have the rest of the length.
    dense = projection.matrix()
    assert dense.dtype == np.float32
    assert np.allclose(dense[: projection.free] @ columns, free, rtol=0, atol=1e-5 * np.abs(free).max())
    assert np.allclose(np.linalg.norm(dense @ columns, axis=0), np.linalg.norm(projection.whitened(columns), axis=0), rtol=1e-5)


@pytest.mark.broad
def test_a_law_that_is_put_in_promises_most(seen):
    theta = np.array([3.0, -2.0, 2.5]) * DEG
    screening = seen.screened(seen.law(3, ROOT_CUBE, theta))
    best = screening.order[0]
    assert seen.forms[best] == ROOT_CUBE
    assert screening.chance_p(screening.tested[best]) < 1e-6
    factor = learnable_from(screening, ROOT_CUBE, theta, 0.01)
    assert factor is not None
    assert factor < 2


def test_the_tail_goes_on_where_draws_end():
    """Of a law whose tail is known: the largest of a thousand exponentials."""
    largest = np.random.default_rng(0).exponential(2.0, (200, 1000)).max(axis=1)
    chance = Chance(largest)
    for p in (1e-3, 1e-5):
        exact = -2.0 * np.log(-np.expm1(np.log1p(-p) / 1000))
        assert np.log10(chance.p(exact)) == pytest.approx(np.log10(p), abs=1.0)
    assert chance.p(chance.level(0.01)) == pytest.approx(0.01)
    assert chance.p(-np.inf) == 1.0


@pytest.mark.broad
def test_forms_that_are_the_same_here_are_said(seen):
    wide = LawForm((Factor("temperature", "within", 1e3),))
    twice = LawForm((Factor("temperature"), Factor("temperature")))
    plain, square = LawForm((Factor("temperature"),)), LawForm((Factor("temperature", "square"),))
    others = [form for form in seen.forms if "temperature" not in repr(form)][:200]
    forms = [wide, twice, square, plain, *others]
    bits = np.array([8.0, 9.0, 6.0, 5.0, *[10.0] * len(others)])
    screening = screened(seen.replay, forms, bits, [(seen.whiten, seen.fit)], 1)
    assert plain in screening.same_as(wide)
    assert square in screening.same_as(twice)
    assert square not in screening.same_as(plain)
    assert screening.leaders[:4].tolist() == [3, 2, 2, 3]
    assert screening.distinct <= np.sum(screening.rank[-1] > 0) - 2


@pytest.mark.broad
def test_a_form_that_needs_the_calibrations_place_is_told_from_a_law(seen):
    """What one turn alone has is said by the rate of all the others, and a scale factor that makes up for it."""
    first = LawForm((Factor("rate"), Factor("time", "beyond", 6.0)))
    fit = seen.law(4, first, np.array([0.5, 0.5, -0.5]) * seen.twin.movements[0].fs_rps)
    projection = Projection(seen.twin, seen.whiten, fit)
    assert takes_calibration(first, seen.responses, projection, fit)
    fit = seen.law(4, ROOT_CUBE, np.array([3.0, -2.0, 2.5]) * DEG)
    assert not takes_calibration(ROOT_CUBE, seen.responses, Projection(seen.twin, seen.whiten, fit), fit)


@pytest.mark.broad
def test_the_threshold_of_a_latch_is_found_where_its_gain_is_level(seen):
    """Between the peaks of the turns its gain is level, and beyond each it falls by a step: what is near says nothing of where to go."""
    grid = [constant_at("rate", "latch", place, largest_of(seen.twin.movements)["rate"]) for place in places("rate", "latch")]
    theta = np.array([2.0, -1.5, 1.0]) * DEG
    for below, above in pairwise(grid[8:12]):
        for share in (0.25, 0.5, 0.75):
            law = LawForm((Factor("rate", "latch", float(below * (above / below) ** share)),))
            fit = seen.law(5, law, theta)
            projection = Projection(seen.twin, seen.whiten, fit)
            basis = basis_of(law, seen.responses, projection)
            found = refined(law.with_constants((below if share < 0.5 else above,)), seen.responses, projection)
            assert gain_of(seen.responses.columns(found), projection) > np.sum((basis.T @ projection.residual) ** 2) - 20


@pytest.mark.broad
def test_a_law_of_twice_the_size_is_learnable_at_half_of_it(seen, null):
    theta = np.array([1.0, 1.0, -1.0]) * DEG
    one, two = (learnable_from(null, ROOT_CUBE, size * theta, 0.01) for size in (1, 2))
    assert two == pytest.approx(one / 2, rel=0.05)


@pytest.mark.broad
def test_a_long_session_is_screened_by_part_of_its_turns(seen, monkeypatch):
    theta = np.array([3.0, -2.0, 2.5]) * DEG
    fit = seen.law(4, ROOT_CUBE, theta)
    every = seen.screened(fit)
    monkeypatch.setattr(spread, "MOST_TURNS", 8)
    monkeypatch.setattr(spread, "TURN_NEIGHBOURS", 4)
    part = spread.spread(seen.twin)
    assert len(part.segments) == 8
    assert len(part.rows) == 16 + 4 * len(part.stills) < len(fit.r)
    some = seen.screened(fit)
    assert len(some.noise) == len(part.rows)
    best = every.order[:20]
    assert np.allclose(some.promise[:, best], every.promise[:, best], rtol=1e-3, atol=1e-3)
    assert some.order[0] == every.order[0]
