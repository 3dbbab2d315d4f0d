"""A file as a record: its shape, its complaints, what is read and what is written follow from its annotated fields."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import pytest
from formats_page import maker

from session.base.errors import FormatError
from session.base.records import DERIVED, Key, Share, Vector, plain, read_record, record_from, record_of, table_of, write_whole
from session.base.results import Array, ListOf, MapOf, Maybe, Number, Text, unknown_keys
from session.base.units import DEG


@dataclass(frozen=True)
class Row:
    name: str
    kind: Literal["a", "b"] = "a"
    only_then: Annotated[int | None, Key(if_known=True)] = None


@dataclass(frozen=True)
class Measured:
    written: ClassVar[tuple[str, ...]] = ("unit", "size", "words")
    size: Annotated[float, Key(si=2.0)]
    unit: str = "m"
    beside: object = None

    @property
    def words(self) -> Annotated[str, Key("description")]:
        return f"{self.size:g} {self.unit}"


@dataclass(frozen=True, eq=False)
class File:
    schema: ClassVar[str] = "tinygc-example/1"
    #: a sentence,
    #: on two lines
    rate_rps: Annotated[np.ndarray, Array((3,), Number(-10, 10)), Key("rate_dps", DEG)]
    chance: Share | None
    best: Annotated[float, Key(absent=7.0)]
    rows: tuple[Row, ...] = ()
    by_name: Mapping[str, Vector] = field(default_factory=dict)
    where: Annotated[str, DERIVED] = "here"

    @staticmethod
    def fault(table):
        return "rows is of two rows" if len(table.get("rows", ())) == 2 else ""


TABLE = {"schema": "tinygc-example/1", "rate_dps": [1, 0, -1.5], "chance": None}
MORE = {"best": 2, "rows": [{"name": "n"}, {"name": "m", "kind": "b", "only_then": 3}, {"name": "o"}], "by_name": {"x": [1, 2, 3]}}


def test_the_shape_of_a_record():
    shape = record_of(File)
    assert list(shape.must) == ["schema", "rate_dps", "chance"]
    assert shape.must["schema"] == Text(("tinygc-example/1",))
    assert shape.must["chance"] == Maybe(Number(0, 1))
    assert list(shape.may) == ["best", "rows", "by_name"]
    assert shape.may["rows"] == ListOf(record_of(Row))
    assert shape.may["by_name"] == MapOf(Array((3,)))
    assert record_of(File, null=False).must["chance"] == Number(0, 1)
    assert unknown_keys(TABLE | {"row": 1}, shape) == (("row", "rows"),)


def test_a_table_is_read_in_si_and_written_in_the_units_of_its_file(tmp_path):
    bare, full = record_from(File, TABLE, "x"), record_from(File, TABLE | MORE, "x")
    np.testing.assert_array_equal(bare.rate_rps, np.array([1, 0, -1.5]) * DEG)
    assert (bare.chance, bare.best, bare.rows, bare.by_name, bare.where) == (None, 7.0, (), {}, "here")
    assert (full.best, type(full.best), full.rows[1]) == (2.0, float, Row("m", "b", 3))
    assert table_of(bare) == TABLE | {"best": 7.0, "rows": [], "by_name": {}}
    assert list(table_of(full)) == ["schema", "rate_dps", "chance", "best", "rows", "by_name"]
    assert table_of(full)["rows"] == [{"name": "n", "kind": "a"}, {"name": "m", "kind": "b", "only_then": 3}, {"name": "o", "kind": "a"}]
    assert plain({"a": (np.float64(1), np.arange(2)), "b": Path("c"), "d": Row("e")}) == {
        "a": [1.0, [0, 1]],
        "b": "c",
        "d": {"name": "e", "kind": "a"},
    }
    write_whole(tmp_path / "x.json", table_of(full))
    assert table_of(read_record(File, tmp_path / "x.json")) == table_of(full)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ([], "it is a list of 0, expected a table"),
        (TABLE | {"schema": "tinygc-example/2"}, 'schema is "tinygc-example/2", expected one of tinygc-example/1'),
        (TABLE | {"rate_dps": [1, 2, 11]}, "rate_dps[2] is 11, expected a number within 10"),
        (TABLE | {"chance": 2}, "chance is 2, expected a number from 0 to 1"),
        ({"schema": "tinygc-example/1", "rate_dps": [1, 2, 3]}, "chance is missing, expected a number from 0 to 1 or null"),
        (TABLE | {"rows": [{"name": "n", "kind": "c"}]}, 'rows[0].kind is "c", expected one of a, b'),
        (TABLE | {"rows": [{"name": "n"}, {"name": "n"}]}, "rows is of two rows"),
    ],
)
def test_a_complaint_names_file_key_and_what_was_expected(table, says):
    with pytest.raises(FormatError) as caught:
        record_from(File, table, "x.json", "mend it")
    assert str(caught.value) == f"x.json: {says}; mend it"


def test_what_is_written_may_be_named_with_properties_among_it():
    assert table_of(Measured(3.0)) == {"unit": "m", "size": 1.5, "description": "3 m"}
    assert list(table_of(Measured(3.0))) == ["unit", "size", "description"]
    assert record_from(Measured, {"size": 1.5, "description": "x"}, "y") == Measured(3.0)
    assert table_of(Measured(float("inf"))) == {"unit": "m", "size": None, "description": "inf m"}


def test_the_sentence_of_a_key_is_the_comment_above_it():
    assert maker()._sentences(File) == {"rate_rps": "a sentence, on two lines"}
