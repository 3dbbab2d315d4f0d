"""``benchmarks/soak.py`` in small: what was received is kept through kills, pulled cables, full disks and stops; hours lose nothing."""

import sys
from pathlib import Path

import pytest
from conftest import broad

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))
import soak
from soak_day import day


@pytest.mark.slow
def test_twenty_rounds_lose_no_more_than_a_read_in_hand(tmp_path):
    table = soak.rounds(20, 1, tmp_path)
    for row in table:
        _, _, received, kept, lost, most, beyond, foreign, _, _ = row
        assert received == kept + lost
        assert beyond == foreign == 0
        assert most <= soak.READ_IN_HAND
    assert table[-1][1] == 20
    assert table[-1][2] > 100_000
    assert {row[0]: row[4] for row in table}["stopped"] == 0  # whoever stops it loses nothing at all
    assert "0 put aside" in table[-1][-1]
    assert "0 different, 0 shorter than before" in table[-1][-1]


@pytest.mark.parametrize("form", [broad("frames"), broad("text")])
def test_two_simulated_minutes_lose_nothing(form, tmp_path):
    """``day`` itself asserts that every byte was kept and every sample decoded as it was sent."""
    rows = dict(day(form, 1 / 30, 1, tmp_path))
    assert rows["samples sent"] == "200040"
    assert rows["samples lost, implausible, resets"] == "0, 0, 0"
    assert rows["last stamp"].endswith(" 0 us off")
