"""Which factor of a law is drawn along, and which beside it."""

import pytest

from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.law_fits import component_beside, has_curve, main_of, other_of

RATE, FORCE = Factor("rate", "itself"), Factor("force", "itself")


def test_a_factor_may_stand_beside_itself():
    """The product of two axes' rates is no line along one of them."""
    form = LawForm((RATE, RATE), "next")
    assert other_of(form) == main_of(form) == RATE
    # x follows y times z
    assert component_beside(form, form.terms()[0]) == 2


def test_the_factor_that_bends_is_the_main_one_wherever_it_stands():
    form = LawForm((FORCE, Factor("rate", "size")), "next")
    assert (main_of(form).quantity, other_of(form).quantity) == ("rate", "force")
    assert component_beside(form, form.terms()[0]) == 1


@pytest.mark.parametrize("function", ["latch", "play"])
def test_what_remembers_has_no_curve_along_its_quantity(function):
    """On the way up and on the way down it is another."""
    assert not has_curve(LawForm((Factor("rate", function, 0.07),)))
    assert has_curve(LawForm((Factor("rate", "dead_zone", 0.07),)))
