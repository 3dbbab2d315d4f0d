"""The judge of laws: what it puts away is untouched, a law that is there is found, and what noise makes is not said."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_twins import make_twin_of

from session.io.units import DEG
from tinygc import SimulationOptions, read_session
from tinygc.annexes.discovery import search_state
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.search_state import FEWEST, RUN, Unseen, beside_calibration, correlation, parted, without
from tinygc.annexes.discovery.selection import FormEvidence
from tinygc.closure.build import build_problem
from tinygc.noise.components import components_of, undersampling
from tinygc.noise.twin import Twin

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
FS_RPS = 500 * DEG
PRODUCT = LawForm((Factor("rate"), Factor("rate")), "next")
FORCE = LawForm((Factor("force", "square"),), "full")
#: forms for a search of a second or so: the law, what is near it, and some that have nothing to do with it
FORMS = [
    *(LawForm((Factor("rate", name),)) for name in ("signed_square", "cube", "root_cube", "square", "size", "signed_root")),
    *(LawForm((Factor(name, "square"),)) for name in ("acceleration", "force", "temperature", "time")),
    PRODUCT,
    FORCE,
    LawForm((Factor("temperature"), Factor("rate"))),
    LawForm((Factor("rate", "sign"),)),
]


def rectifying(t_s, rate, force, temp_c):
    """Two axes that turn together make the third read."""
    return rate + np.array([0.02, -0.015, 0.01]) * np.roll(rate, -1, axis=1) * np.roll(rate, -2, axis=1) / FS_RPS


@pytest.fixture(scope="module")
def plain(twin_of):
    """A twin of 24 turns with nothing wrong."""
    return twin_of(None, segments=24)[0]


@pytest.mark.broad
def test_of_several_recordings_one_is_put_away_whole(simulated_with, tmp_path):
    """The smaller of two is not searched at all, where the other is enough; its own samples are still there to be judged by."""
    folder = tmp_path / "two"
    shutil.copytree(simulated_with(None, segments=18), folder)
    shutil.copy(simulated_with(None, segments=9, seed=4) / "log0001.csv.gz", folder / "log0002.csv.gz")
    problem = build_problem(read_session(folder))
    for seed in range(4):
        split = parted(problem, seed)
        assert split.log == 1
        assert [problem.used[i].log for i in split.recording] == [1] * 9
        assert len(split.parts) >= FEWEST
        assert all(problem.used[i].log == 0 for i in split.parts)
        assert {segment.log for segment in split.seen.used} == {0}
    assert [axes.shape for axes in Twin(split.seen).level_axes] == [(len(log.samples.t_ns), 6) for log in problem.logs]


@pytest.mark.parametrize("turns", [(15,), (16,), (20,), (21,), (48,), (3,) * 10, (4,) * 6, (5,) * 6, (6,) * 4, (30, 3, 3, 3)])
def test_of_any_session_a_third_is_put_away_and_at_least_as_much_is_left(turns, monkeypatch):
    """Many short logs are one session: none is counted anew."""
    monkeypatch.setattr(search_state, "without", lambda problem, held: held)
    problem = SimpleNamespace(used=[SimpleNamespace(log=number) for number, count in enumerate(turns) for _ in range(count)])
    drawn = [parted(problem, seed) for seed in range(12)]
    for split in drawn:
        rest = sum(turns) - len(split.recording)
        assert FEWEST <= len(split.parts) <= rest / 3 + (RUN if rest > 20 else 1)
        assert np.count_nonzero(~split.seen) >= 2 * FEWEST
    assert len({tuple(split.parts.tolist()) for split in drawn}) == 3


@pytest.mark.broad
def test_a_problem_without_some_turns_is_the_same_problem_elsewhere(plain):
    """Its twin closes the turns that stay as the whole one does, and its noise has the rows of theirs."""
    held = np.zeros(24, dtype=bool)
    held[6:10] = True
    part = Twin(without(plain.problem, held))
    whole, fewer = (twin.residuals(twin.start()) for twin in (plain, part))
    np.testing.assert_allclose(fewer.closure, whole.closure[~held], atol=1e-12)
    still = np.ones(len(plain.stills), dtype=bool)
    still[7:10] = False  # the stills between two turns that go
    np.testing.assert_allclose(fewer.still, whole.still[still], atol=1e-12)
    sizes = (2 * 20, 3 * 22, 22)
    assert {component.V.shape for component in components_of(part, sizes, undersampling(part)) if hasattr(component.V, "shape")} <= {
        (sum(sizes), sum(sizes))
    }


@pytest.mark.broad
def test_neighbours_across_a_gap_share_no_still(plain):
    held = np.zeros(24, dtype=bool)
    held[6:10] = True
    floor = without(plain.problem, held).floor
    assert np.all(floor.shared[5] == 0)
    np.testing.assert_array_equal(floor.shared[4], plain.problem.floor.shared[4])
    np.testing.assert_array_equal(floor.shared[6], plain.problem.floor.shared[10])


@pytest.mark.broad
def test_what_a_calibration_takes_up_does_not_make_two_laws_alike(plain):
    movement = plain.movements[0]
    rate = movement.rate
    scale, law = 0.01 * rate + 0.02, rate * np.abs(rate)
    assert correlation(beside_calibration(law, [movement]), beside_calibration(law + scale, [movement])) == pytest.approx(1)
    assert np.abs(beside_calibration(scale, [movement])).max() < 1e-12
    assert abs(correlation(beside_calibration(law, [movement]), beside_calibration(np.roll(law, 1, axis=1), [movement]))) < 0.5


@pytest.fixture(scope="module")
def weighed(twin_of):
    """Evidence of the seen part of a session in which two axes make the third read, and what it did not see."""
    whole = twin_of(rectifying, segments=24)[0]
    split = parted(whole.problem, 1)
    evidence = FormEvidence(Twin(split.seen))
    return evidence, Unseen(whole, evidence.twin), split


@pytest.mark.broad
def test_a_law_holds_on_what_was_put_away_and_a_wrong_one_does_not(weighed):
    evidence, unseen, split = weighed
    right, wrong = (evidence.of((evidence.effect_of(form),), evidence.nothing) for form in (PRODUCT, FORCE))
    held = unseen.assessed(evidence.nothing, right, split.parts)
    assert held.p_value < 0.01
    assert held.removed > 0.97
    assert held.after_rad < 1.5 * held.floor_rad < held.before_rad
    worse = unseen.assessed(evidence.nothing, wrong, split.parts)
    assert worse.p_value > 0.05
    assert worse.removed < 0.5


@pytest.mark.broad
def test_a_form_pays_for_its_bits(weighed):
    evidence = weighed[0]
    plain, sharp = (evidence.effect_of(LawForm((factor,))) for factor in (Factor("rate", "cube"), Factor("rate", "dead_zone", 0.1)))
    assert evidence.price(sharp) > evidence.price(plain)
    assert evidence.unpriced(evidence.of((plain,), evidence.nothing)) < evidence.of((plain,), evidence.nothing).score


@pytest.fixture(scope="module")
def simulated_with(tmp_path_factory):
    from tinygc.simulation.write import write_session

    def make(distort, **options):
        chosen = SimulationOptions(**{"segments": 24, "closure_s": 0.0, "seed": 3, "odr_hz": 104.0, **options})
        return write_session(chosen, tmp_path_factory.mktemp("law") / "session", distort=distort)

    return make
