"""Whether a law's constant differs by axis, so that the one that is said for all makes another law of it."""

from __future__ import annotations

from tinygc.discovery.judge.added import EQUAL, beside_calibration, correlation
from tinygc.discovery.judge.searched import Searched
from tinygc.discovery.screen.by_axis import ByAxis, added_by, by_axis, linear
from tinygc.effects import Effect
from tinygc.explanation.naming.naming import STAND_IN


def differing(searched: Searched, law: Effect) -> ByAxis | None:
    """The constants of each axis that take up most, where they are as much better as a rival must be and add another rate; else None."""
    form, movements = searched.evidence.forms[law.id], searched.evidence.twin.movements
    responses, look = searched.round_of(law).screening.all_responses, searched.look_without(law)
    found = max(by_axis(form, responses, look), key=lambda each: each.more, default=None)
    if found is None or found.more < STAND_IN:
        return None
    rates = added_by(form, linear(form, responses, look), movements), found.added(movements)
    one, other = (beside_calibration(rate, movements) for rate in rates)
    return None if correlation(one, other) > EQUAL else found
