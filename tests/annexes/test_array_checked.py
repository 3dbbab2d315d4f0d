"""Effects of an array's units checked in another recording of the array."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG

from session.io.errors import DataError, SegmentError
from tinygc.annexes.arrays import checked as module
from tinygc.annexes.arrays.checked import check_units, checked_units_page, checked_units_to_json
from tinygc.effects import catalogue
from tinygc.explanation.checked import Checked, CheckedEffect, Outcome, SizedEffect
from tinygc.reporting.terminal import Group, as_text

THETA = np.array([1e-3, 2e-3, -1e-3])
OTHER_3 = SimpleNamespace(name="other unit 3")
NAMED = SizedEffect(catalogue()["gyro.scale_asymmetry"], THETA, 1e-10 * np.eye(3), 0.99)


@pytest.fixture(name="found")
def of_two_units(monkeypatch):
    """Units 0 and 3 of an array, of which unit 3 cannot be explained in the other recording."""

    def explain(unit, **_):
        if unit is OTHER_3:
            raise SegmentError("too few turns")
        return f"explained {unit}"

    monkeypatch.setattr(module, "with_own_accelerometer", lambda unit: (unit, []))
    monkeypatch.setattr(module, "explain_session", explain)
    there = CheckedEffect(NAMED, Outcome.CONFIRMED, 90.0, 0.4, 1.0, NAMED, (1.0, 0.02), (2 * DEG, 1 * DEG))
    session = SimpleNamespace(name="other")
    monkeypatch.setattr(
        module, "check_on", lambda first, told, seed: Checked(session, True, [there] if told == "explained other 0" else [])
    )
    return SimpleNamespace(explanations={0: "first 0", 3: "first 3"})


def test_each_unit_is_checked_on_the_unit_of_its_number(found):
    other = SimpleNamespace(name="other", folder="other", numbers=(0, 1, 3), units=("other 0", "other 1", OTHER_3))
    checked = [check_units(found, other)]
    assert checked[0].units[3].error == "too few turns"
    (table,) = checked_units_to_json(checked)
    assert [unit["number"] for unit in table["units"]] == [0, 3]
    assert table["units"][0]["effects"][0]["outcome"] == "confirmed"
    assert table["units"][1]["error"] == "too few turns"
    text = as_text(Group(*checked_units_page(checked)))
    assert "gyro.scale_asymmetry: confirmed in 1 of 1 recordings" in text
    assert "Not checked on other unit 3: too few turns" in text


def test_another_array_is_refused(found):
    other = SimpleNamespace(name="other", folder="other", numbers=(7,), units=("other 7",))
    with pytest.raises(DataError, match="it has units 7, expected some of 0, 3"):
        check_units(found, other)
