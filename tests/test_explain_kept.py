"""What an explanation keeps while it weighs: as much whether a few hypotheses are weighed or many, and nothing that comes out otherwise."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from explained_sessions import g_sensitive
from simulated_twins import make_twin_of

from session.detect.stills import Still
from tinygc.effects import catalogue
from tinygc.explanation import evidence as of_evidence
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.search import HIGHEST_HZ, MOST_LINE_ROWS, line_frequencies, lines_end_hz, promises
from tinygc.noise import thinned
from tinygc.noise.candidates import candidates
from tinygc.noise.thinned import StillMeans
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


@pytest.fixture(scope="module")
def evidence(twin_of) -> Evidence:
    return Evidence(twin_of(g_sensitive)[0])


def test_a_hypothesis_keeps_no_array_of_samples_and_none_of_all_pairs_of_rows(evidence):
    """Of its fit the largest are the columns (n, p)."""
    h = evidence.of((catalogue()["gyro.g_sensitivity"],), evidence.nothing)
    own = [*vars(h).values(), *vars(h.fit).values(), *vars(h.fit.state).values()]
    sizes = [each.size for each in own if isinstance(each, np.ndarray)]
    assert sizes
    assert max(sizes) <= h.fit.J.size
    assert not any(isinstance(each, list | Whitener) for each in own)
    assert h.fit.J.size < min(len(h.fit.r) ** 2, sum(len(movement.rate) for movement in evidence.twin.movements))


def test_columns_of_candidates_are_kept_up_to_a_count_and_promise_the_same_beyond_it(twin_of, monkeypatch):
    evidence = Evidence(twin_of(g_sensitive)[0])
    tried = candidates(evidence.twin)
    looks = [(evidence.first_whiten, evidence.nothing.fit)]
    all_kept = promises(evidence, looks, tried)
    sizes = [evidence.columns(effect).size for effect in tried]
    most = sum(sizes) // 3
    monkeypatch.setattr(of_evidence, "MOST_KEPT", most)
    evidence = Evidence(evidence.twin)
    np.testing.assert_array_equal(promises(evidence, looks, tried), all_kept)
    kept = sum(columns.size for columns in evidence._columns.values())
    assert most - max(sizes) < kept <= most


def day_of(rows: int, duration_s: float, stills: int) -> Twin:
    movement = SimpleNamespace(t_s=np.zeros(rows), duration_s=duration_s)
    return cast(Twin, SimpleNamespace(movements=[movement], stills=[None] * stills))


def test_a_day_is_searched_for_as_many_lines_as_there_is_time_for(twin_of):
    """A quarter of a million lines stand side by side in a day; in four minutes all of them are tried."""
    rows = 800_000
    lines = line_frequencies(day_of(rows, 86_400.0, 401))
    assert 100 < len(lines) <= MOST_LINE_ROWS / rows
    np.testing.assert_allclose(np.diff(lines), 1 / 86_400.0)  # none between them is missed
    short = line_frequencies(day_of(46_800, 225.0, 41))
    assert HIGHEST_HZ - 1 / 225.0 <= short[-1] < HIGHEST_HZ
    assert len(line_frequencies(twin_of(g_sensitive)[0])) > 100
    # What was not looked for is said, and only there.
    assert lines_end_hz(day_of(rows, 86_400.0, 401)) == lines[-1]
    assert lines_end_hz(day_of(46_800, 225.0, 41)) is None


@pytest.mark.parametrize("counts", [None, np.arange(1, 401)])
def test_stills_are_averaged_some_at_a_time_as_each_alone(monkeypatch, counts):
    monkeypatch.setattr(thinned, "AT_ONCE", 16)
    values = np.random.default_rng(4).standard_normal((400, 3, 2))
    spans = [(0, 5), (5, 60), (58, 70), (100, 101), (300, 400)]
    weight = np.ones(400) if counts is None else counts
    mean = StillMeans([cast(Still, SimpleNamespace(start=a, stop=b)) for a, b in spans], counts)
    expected = [np.average(values[a:b], axis=0, weights=weight[a:b]) for a, b in spans]
    np.testing.assert_allclose(mean(values), expected, rtol=1e-12, atol=1e-14)
    assert StillMeans([], counts)(values).shape == (0, 3, 2)
