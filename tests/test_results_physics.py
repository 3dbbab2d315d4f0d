"""The validator of every JSON that the tool reads: whatever stands where, one line says file, key and what was expected."""

import numpy as np
import pytest

from session.base.errors import FormatError
from session.base.records import write_whole
from session.base.results import Array, Flag, Keys, ListOf, MapOf, Maybe, Number, Text, read_json, require

SHAPE = Keys(
    {"name": Text(), "E": Array((3, 3)), "count": Number(1, 9, whole=True)},
    {"kind": Text(("a", "b")), "rows": ListOf(Keys({"x": Number(0, above=True)})), "fine": Flag(), "of": MapOf(Maybe(Number(0, 1)))},
)
GOOD = {
    "name": "n",
    "E": np.eye(3).tolist(),
    "count": 3,
    "kind": "a",
    "rows": [{"x": 1.5}],
    "fine": True,
    "of": {"q": None, "r": 0.5},
    "z": 7,
}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"name": None}, "name is null, expected text"),
        ({"E": [[1, 0], [0, 1]]}, "E has shape 2 x 2, expected 3 x 3 numbers"),
        ({"E": [[1, 0, 0], [0, 1], [0, 0, 1]]}, "E[1] has 2 entries, expected 3 x 3 numbers"),
        ({"E": [[1, 0, 0], [0, "1", 0], [0, 0, 1]]}, 'E[1][1] is "1", expected a number'),
        ({"E": [[1, 0, 0], [0, float("nan"), 0], [0, 0, 1]]}, "E[1][1] is NaN, which is not finite; expected a number"),
        ({"count": 2.5}, "count is 2.5, expected a whole number from 1 to 9"),
        ({"count": float("inf")}, "count is Infinity, which is not finite"),
        ({"kind": "c"}, 'kind is "c", expected one of a, b'),
        ({"rows": [{"x": 1}, {}]}, "rows[1].x is missing, expected a number above 0"),
        ({"fine": 1}, "fine is 1, expected true or false"),
        ({"of": {"q": 2}}, "of.q is 2, expected a number from 0 to 1"),
    ],
)
def test_what_does_not_fit_is_said_with_its_key(changes, says):
    require(GOOD, SHAPE, "x.json")
    with pytest.raises(FormatError) as caught:
        require(GOOD | changes, SHAPE, "x.json", "mend it")
    said = str(caught.value)
    assert said.startswith(f"x.json: {says}")
    assert said.endswith("; mend it")
    assert "\n" not in said


def test_long_integers_become_floats_and_what_is_not_finite_is_written_as_null(tmp_path):
    (tmp_path / "x.json").write_text('{"short": 123, "long": ' + "1" * 30 + ', "huge": ' + "9" * 5000 + "}")
    table = read_json(tmp_path / "x.json")
    assert (table["short"], type(table["short"]), table["huge"]) == (123, int, float("inf"))
    assert table["long"] == pytest.approx(1.1111111e29)
    write_whole(tmp_path / "y.json", {"a": [1.5, float("nan")], "b": {"c": float("inf")}, "d": "NaN"})
    assert read_json(tmp_path / "y.json") == {"a": [1.5, None], "b": {"c": None}, "d": "NaN"}
