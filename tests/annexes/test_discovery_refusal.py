"""Each rule by which a law is refused or is no more than a candidate: alone it decides, and at its limit."""

from types import SimpleNamespace

import numpy as np
import pytest
from discovery_answers import DECIDED, LAWS, law_of

from tinygc.annexes.discovery import engine, search_state
from tinygc.annexes.discovery.engine import DECISIVE, SETTLED_S
from tinygc.annexes.discovery.equivalence import as_effect
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.search_state import ALL_OF_IT, CHANCE, EQUAL, HELD_OUT_P, NOISE_P, Rival, leaves_something, refused, taken
from tinygc.explanation.search import STAND_IN

FORM = LAWS["matrix"][0]
LAW = as_effect(FORM, "discovered.n0")
OTHER = as_effect(LAWS["warm"][0], "gyro.other")
#: what the law is worth, -2 log evidence
WORTH = 200.0


def held_out(**changed):
    """A test on what was put away that a law passes."""
    return SimpleNamespace(**{**vars(DECIDED), **changed})


class Answered:
    """A search that has come to one law, of which nothing speaks against it but what is changed."""

    def __init__(self, chance_p=1e-4, catalogue=WORTH, without=WORTH, shapes=WORTH, tests=(DECIDED,), unusual=False, to_noise=True):
        self.evidence = SimpleNamespace(forms={LAW.id: FORM}, unpriced=lambda have: have.score, form_in=lambda effects: [FORM])
        self.best = SimpleNamespace(score=0.0, ids={LAW.id}, effects=(LAW,), noise=SimpleNamespace(unusual=unusual))
        self.catalogue = SimpleNamespace(score=catalogue, ids={"gyro.other"})
        self.shapes = SimpleNamespace(score=shapes, ids={"unknown.smooth"})
        self.names, self.laws, self.held_out, self.closes_to_noise = [OTHER], [LAW], list(tests), to_noise
        self.near = {}
        self.chance_p, self.without = lambda law: chance_p, lambda law: SimpleNamespace(score=without)
        self.held_out_of = lambda law: tests


@pytest.fixture
def in_its_place(monkeypatch):
    """``in_its_place(worse)``: a name of the catalogue is by so much worse in the law's place."""

    def put(worse):
        rivals = [] if worse is None else [Rival(OTHER, None, worse, worse, 0.0)]
        monkeypatch.setattr(search_state, "rivals", lambda *_: rivals)

    put(None)
    return put


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"chance_p": 1.01 * CHANCE}, "no more than chance"),
        ({"catalogue": STAND_IN - 0.1}, "gyro.other is of equal worth"),
        ({"without": STAND_IN - 0.1}, "the rest explains"),
        ({"shapes": -STAND_IN - 0.1}, "a shape without a law does better: unknown.smooth"),
        ({"tests": (DECIDED, held_out(removed=0.0))}, "worsens the closure"),
        ({"tests": (DECIDED, held_out(p_value=1.01 * HELD_OUT_P))}, "chance improves the held-out segments"),
    ],
)
def test_one_reason_is_enough(in_its_place, changed, said):
    assert said in refused(Answered(**changed), LAW)


def test_what_nothing_speaks_against_is_not_refused(in_its_place):
    at_the_limits = {"chance_p": CHANCE, "catalogue": STAND_IN, "without": STAND_IN, "shapes": -STAND_IN}
    assert refused(Answered(**at_the_limits, tests=(held_out(removed=0.01, p_value=HELD_OUT_P),)), LAW) is None
    assert refused(Answered(tests=(held_out(removed=None),)), LAW) is None


def test_a_name_of_equal_worth_wins_the_laws_place(in_its_place):
    in_its_place(STAND_IN - 0.1)
    assert refused(Answered(), LAW).startswith("on the turns that were searched gyro.other is of equal worth beside the rest")
    in_its_place(STAND_IN)
    assert refused(Answered(), LAW) is None


def test_what_is_left_counts_where_it_is_no_noise():
    noise, more = held_out(removed=0.5, noise_p=NOISE_P), held_out(removed=0.97, noise_p=NOISE_P / 2)
    assert taken(Answered(tests=(noise,))) == 1
    assert taken(Answered(tests=(noise, more))) == 0.97
    assert taken(Answered(tests=(held_out(removed=None, noise_p=0.0),))) == 1


def test_what_was_put_away_does_not_ask_for_a_further_law():
    assert not leaves_something(Answered(tests=(held_out(removed=0.1, noise_p=0.0),)))
    assert leaves_something(Answered(to_noise=False))
    assert leaves_something(Answered(unusual=True))


def assessed(*others, axes=None, form=FORM, against_gravity=False, threshold=None):
    return SimpleNamespace(form=form, others=list(others), axes=axes, against_gravity=against_gravity, threshold=threshold)


def test_a_law_is_found_where_nothing_is_undecided():
    law = law_of(*LAWS["matrix"])
    assert law.gain > DECISIVE
    assert engine._undecided([assessed()], (law,), ALL_OF_IT) == ""
    assert engine._undecided([assessed()], (law,), ALL_OF_IT - 0.001).startswith("98.9 % of the excess goes with it")
    faint = law_of(*LAWS["matrix"], gain=DECISIVE - 1)
    assert engine._undecided([assessed()], (law, faint), 1.0).startswith("too little is seen of it")
    rival = Rival(OTHER, None, 3.0, 3.0, 0.5)
    assert engine._undecided([assessed(rival, rival)], (law,), 1.0) == "3 forms of equal worth add different rates"


def test_a_constant_of_each_axis_is_said():
    axes = SimpleNamespace(constant=0, values=np.array([0.01, 0.02, 0.04]), more=31.4)
    dead_zone = law_of(*LAWS["dead zone"])
    said = engine._undecided([assessed(form=dead_zone.form, axes=axes)], (dead_zone,), 1.0)
    assert said.startswith("its width (of full scale) seems to differ by axis (0.01, 0.02, 0.04; chi-square 31)")


def test_a_law_that_gravity_within_the_turns_contradicts_is_no_more_than_a_candidate():
    law = law_of(*LAWS["matrix"])
    assert engine._undecided([assessed(against_gravity=True)], (law,), 1.0).startswith("the turns close with it, and within them gravity")


def test_a_threshold_that_no_turn_determines_is_said():
    law = law_of(LawForm((Factor("rate", "latch", 0.076),)), [1.0, 1.0, 1.0])
    said = engine._undecided([assessed(form=law.form, threshold=(0.07, 0.081))], (law,), 1.0)
    assert said.startswith("its threshold (of full scale) may be from 0.07 to 0.081: no turn peaks between them")


@pytest.mark.parametrize(("lag_s", "short"), [(0.99 * SETTLED_S, True), (SETTLED_S, False)])
def test_a_lag_that_a_filter_has_too_is_not_found(lag_s, short):
    law = law_of(LawForm((Factor("rate", "size", None, lag_s),)), [1.0, 1.0, 1.0])
    assert engine._undecided([assessed(form=law.form)], (law,), 1.0).startswith("a lag below 0.1 s") == short


@pytest.mark.parametrize(("refutes", "others"), [(True, 0), (False, 1)])
def test_gravity_within_the_turns_tells_forms_apart_that_close_alike(monkeypatch, refutes, others):
    """A form of another rate that fits as well, dearer by its description and its numbers, is a rival unless gravity refutes it."""
    rival = Rival(OTHER, SimpleNamespace(), 40.0, 20.0, 0.1, chi_worse=STAND_IN - 0.1)
    monkeypatch.setattr(engine, "rivals", lambda *_: [rival])
    monkeypatch.setattr(engine, "alike", lambda *_: [])
    searched = Answered()
    searched.tried = []
    searched.evidence.within = SimpleNamespace(prefers=lambda one, other: refutes and one is searched.best)
    assert len(engine._near(searched, LAW)) == others


def test_a_rival_whose_rate_is_unknown_is_another(monkeypatch):
    """Of a rival that came near, and was not refitted, nobody knows whether it adds the same rate."""
    same, unknown, far = (
        Rival(OTHER, None, worse, worse, equivalent_forms)
        for worse, equivalent_forms in ((1.0, EQUAL + 0.001), (5.0, 0.0), (STAND_IN, 0.3))
    )
    monkeypatch.setattr(engine, "rivals", lambda *_: [same, unknown, far])
    monkeypatch.setattr(engine, "differing", lambda *_: None)
    monkeypatch.setattr(engine, "alike", lambda *_: [])
    monkeypatch.setattr(engine, "open_threshold", lambda *_: None)
    searched = Answered()
    searched.evidence.within = SimpleNamespace(prefers=lambda one, other: False)
    searched.round_of, searched.tried = lambda law: None, []
    found = engine._assessed(searched, LAW)
    assert found.others == [unknown]
    assert found.same == [same]
