"""When a session was recorded: by its port, its notes, its log's stamps, its folder's name, and never by a file's time."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from conftest import config

from tinygc.estimation.session_times import YEAR_S, Moment, moment_of, parsed, times_of

NOTED = replace(config(), notes={"date": "2026-03-04T10:00:00+02:00"})


def log(folder, first_ns):
    rows = "".join(f"{first_ns + 10_000_000 * i},0,0,0,0,0,-1000\n" for i in range(5))
    (folder / "log0001.csv").write_text("t_ns,gx,gy,gz,ax,ay,az\n" + rows)


def test_the_first_of_port_notes_stamps_and_name_counts(tmp_path):
    folder = tmp_path / "bench_20250607_a"
    folder.mkdir()
    assert moment_of(folder, config()) == Moment(datetime(2025, 6, 7, tzinfo=UTC), "name")
    assert moment_of(folder, None) == Moment(datetime(2025, 6, 7, tzinfo=UTC), "name")
    log(folder, 1_700_000_000 * 10**9)
    assert moment_of(folder, config()) == Moment(datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC), "stamps")
    assert moment_of(folder, NOTED) == Moment(datetime(2026, 3, 4, 8, tzinfo=UTC), "notes")
    (folder / "raw.times").write_text("0,0,open 2026-01-02T03:04:05+00:00\n")
    assert moment_of(folder, NOTED).source == "port"


def test_a_boards_own_clock_a_files_time_and_other_text_are_no_date(tmp_path):
    log(tmp_path, 5 * 10**9)
    plain = tmp_path / "day1"
    plain.mkdir()
    log(plain, 5 * 10**9)
    assert moment_of(plain, config()) is None
    assert moment_of(plain, replace(config(), notes={"date": "a rainy Tuesday"})) is None
    assert parsed("2026-02-30") is None
    assert parsed("0001-01-01T00:00:00+14:00") is None
    assert [parsed(text) for text in ("", "5", "x" * 1000)] == [None, None, None]


@pytest.mark.parametrize("name", ["a1202506071", "2025-16-07", "r20250647"])
def test_digits_that_are_no_day_are_none(tmp_path, name):
    (tmp_path / name).mkdir()
    assert moment_of(tmp_path / name, None) is None


def test_sessions_are_in_the_order_of_their_dates_or_as_they_come():
    days = [Moment(datetime(2026, month, 1, tzinfo=UTC), "notes") for month in (5, 1, 9)]
    order, at = times_of(days)
    assert order.tolist() == [1, 0, 2]
    np.testing.assert_allclose(at, np.array([0, 120, 243]) * 86400 / YEAR_S)
    for without in ([*days, None], [days[0], days[0]]):
        order, at = times_of(without)
        assert order.tolist() == at.tolist() == list(range(len(without)))
