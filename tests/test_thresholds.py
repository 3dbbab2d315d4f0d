"""The benchmark of thresholds names constants that are there, and changes them wherever they are used."""

import importlib
import sys

import pytest
from conftest import ROOT

BENCHMARKS = str(ROOT / "benchmarks")


@pytest.fixture(scope="module")
def thresholds():
    sys.path.insert(0, BENCHMARKS)
    try:
        yield importlib.import_module("thresholds")
    finally:
        sys.path.remove(BENCHMARKS)


def test_every_listed_constant_is_there_and_is_halved_doubled_and_put_back(thresholds):
    changes = thresholds.settings(None)
    assert len(changes) == len(set(changes)) > 0
    for module, name, factor in changes:
        changed = thresholds.Changed(module, name, factor)
        before = [getattr(place, name) for place in changed.places]
        with changed:
            assert {getattr(place, name) for place in changed.places} == {changed.new}
        assert [getattr(place, name) for place in changed.places] == before
        assert changed.new != changed.old


def test_a_constant_is_changed_where_it_was_imported_to(thresholds):
    places = [place.__name__ for place in thresholds.Changed("tinygc.explanation.clipped_turns", "FEWEST_WHOLE", 2.0).places]
    assert places == ["tinygc.explanation.clipped_turns", "tinygc.explanation.data_repair"]
