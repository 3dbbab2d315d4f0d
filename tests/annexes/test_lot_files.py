"""A lot's file: what is written reads back the same, and what is no lot is refused in one line."""

import json

import numpy as np
import pytest
from simulated_lots import simulated_lot

from session.io.errors import FormatError
from session.io.results import write_whole
from tinygc.annexes.lots.report import lot_of, lot_of_table, lot_table, read_lot


@pytest.fixture(scope="module")
def lot():
    """Of twelve units without accelerometers, and no repeated session: much is null."""
    return lot_of(simulated_lot(12, 0, without_accelerometer=1.0), "ASM330LHH").lot


@pytest.fixture
def table(lot):
    return json.loads(json.dumps(lot_table(lot)).replace("NaN", "null"))


def test_what_is_written_reads_back_the_same(lot, tmp_path):
    write_whole(tmp_path / "lot.json", lot_table(lot, more=1))
    again = read_lot(tmp_path / "lot.json")
    for name in ("mean", "mean_sigma", "spread", "repeatability"):
        assert np.array_equal(getattr(again, name), getattr(lot, name), equal_nan=True), name
    assert (again.sensor, again.units, again.sessions) == ("ASM330LHH", 12, 12)
    assert np.isnan(again.repeatability).all()
    assert np.isnan(again.mean[12:]).all()


def changed(key, value):
    def change(table):
        at, *path = reversed(key)
        inner = table
        for word in reversed(path):
            inner = inner[word]
        inner[at] = value

    return change


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (changed(["schema"], "tinygc-fit/2"), 'schema is "tinygc-fit/2", expected one of tinygc-lot/3'),
        (changed(["units"], 0), "units is 0, expected a whole number of at least 1"),
        (changed(["sessions"], 3), "sessions is 3, expected at least one for each unit of 12"),
        (changed(["names", 0], "E_yy"), "names are a list of 21"),
        (changed(["mean"], [1.0]), "mean has 1 entries, expected 21"),
        (changed(["spread", 0], -1.0), r"spread\[0\] is -1.0, expected a number of at least 0"),
        (changed(["mean", 0], "1"), r"mean\[0\] is \"1\", expected a number"),
    ],
)
def test_what_is_no_lot_is_refused_in_one_line(table, change, says):
    change(table)
    with pytest.raises(FormatError, match=says) as refused:
        lot_of_table(table, "lot.json")
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith("lot.json: ")


def test_a_missing_key_and_broken_json(table, tmp_path):
    del table["spread"]
    with pytest.raises(FormatError, match="spread is missing"):
        lot_of_table(table, "lot.json")
    path = tmp_path / "lot.json"
    path.write_text("{", encoding="utf-8")
    with pytest.raises(FormatError, match="broken JSON"):
        read_lot(path)
    with pytest.raises(FormatError, match="cannot be read"):
        read_lot(tmp_path / "none.json")
