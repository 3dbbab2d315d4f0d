"""Units as people write them, headings that say by themselves what their columns are, and the column that is the clock."""

import numpy as np
import pytest
from conftest import DEG

from session.base.errors import FormatError
from session.base.units import BEYOND, LONGEST, LONGEST_NS, G, beyond_any_sensor, endings, parse_unit
from session.replay.clock import exact_ns, find_clock, holds_intervals
from session.replay.headings import name_and_unit, spread, usual_columns


@pytest.mark.parametrize(
    ("kind", "text", "si"),
    [
        *(("time", text, si) for text, si in (("0.5 ms", 500_000), ("0.001ns", 0.001), (f"{LONGEST_NS - 8}ns", LONGEST_NS - 8))),
        *(("gyro", text, DEG) for text in ("deg/s", "º/s", "ø/s", "Grad/s")),
        *(("gyro", text, 1.0) for text in ("rad s^-1", "rad·s⁻¹")),
        *(("gyro", text, si) for text, si in (("0.061 dps", 0.061 * DEG), ("rpm", 6 * DEG), ("lsb", None))),
        *(("accel", text, 1.0) for text in ("m/s/s", "m/s2", "m·s⁻²", "m/s**2")),
        ("accel", "g/2048", G / 2048),
        ("accel", "2.5e-1 g", G / 4),
        ("gyro", " " * (LONGEST - 3) + "dps", DEG),
    ],
)
def test_units(kind, text, si):
    assert parse_unit(kind, text).si == (None if si is None else pytest.approx(si))


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("time", "lsb"),
        ("time", "fortnight"),
        ("gyro", "g"),
        ("accel", "0g"),
        ("gyro", "dps/0"),
        ("time", "0.0001ns"),
        ("time", f"{LONGEST_NS}ns"),
        ("gyro", "1e999dps"),
        ("gyro", " " * (LONGEST - 2) + "dps"),
    ],
)
def test_no_units(kind, text):
    assert parse_unit(kind, text) is None


@pytest.mark.parametrize(
    ("head", "gyro", "gyro_unit", "accel"),
    [
        ("t in s;Acc_x / m/s²;Acc_y / m/s²;Acc_z / m/s²;Gyr_x / °/s;Gyr_y / °/s;Gyr_z / °/s", (4, 5, 6), "°/s", (1, 2, 3)),
        (
            "T;Mag X [G];Mag Y [G];Mag Z [G];Przysp. X [g];Przysp. Y [g];Przysp. Z [g];V X [dps];V Y [dps];V Z [dps]",
            (7, 8, 9),
            "dps",
            (4, 5, 6),
        ),
        ("Zeit [ms];Rollrate [°/s];Nickrate [°/s];Gierrate [°/s];Beschl. X [g];Beschl. Y [g];Beschl. Z [g]", (1, 2, 3), "°/s", (4, 5, 6)),
        # of two accelerometers a person says which
        ("Zeit;Fuß X [g];Fuß Y [g];Fuß Z [g];Hand X [g];Hand Y [g];Hand Z [g];V X [dps];V Y [dps];V Z [dps]", (7, 8, 9), "dps", ()),
    ],
)
def test_columns_are_known_by_their_names_or_units(head, gyro, gyro_unit, accel):
    columns = usual_columns(head.split(";"), "log.csv")
    assert [columns[f"g{axis}"] for axis in "xyz"] == [(column, gyro_unit, 1) for column in gyro]
    assert [columns[f"a{axis}"][0] for axis in "xyz" if f"a{axis}" in columns] == [*accel]


def test_less_than_a_triad_or_one_of_two_sensors_is_nothing():
    two = [[f"V {axis} [dps]" for axis in axes] for axes in ("XY", "XZ", "YZ")]
    assert not any(usual_columns(names, "log.csv") for names in (*two, ("temp",), ("gx", "gy", "gz", "ax"), ("gx", "gy", "gz", "gyrox")))


@pytest.mark.parametrize(
    ("file", "letter"), [("Gyroscope.csv", "g"), ("imu_acc_2.json", "a"), ("rotation_vector.csv", ""), ("walk.csv", "")]
)
def test_a_files_name_says_whose_axes_it_holds(file, letter):
    assert set(usual_columns(("t", "x", "y", "z"), file)) == ({f"{letter}{axis}" for axis in "xyz"} if letter else set())


def test_what_no_sensor_measures_and_the_units_of_a_standard_log():
    for kind, si in (("gyro", DEG), ("accel", G)):
        edge = BEYOND[kind] / si
        assert beyond_any_sensor(np.array([1.0001, -1.0001, 0.9999, 0]) * edge, si, kind).tolist() == [True, True, False, False]
    assert (BEYOND["gyro"] / DEG, BEYOND["accel"] / G) == (pytest.approx(1e5), pytest.approx(1e4))
    assert {ending: unit.si for ending, unit in endings("gyro").items()} == {"": None, "_dps": DEG, "_rps": 1.0}


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("Gyro X (deg/s)", "gyro x", "deg/s"),
        ("a / (m/s²)", "a", "m/s²"),
        ("a in m/s²", "a", "m/s²"),
        ("X (1) [dps]", "x (1)", "dps"),
        ("Gyro (2)", "gyro (2)", ""),
        ("[dps]", "", "dps"),
        ("temp, c", "temp", "c"),
        ("made in Japan", "made in japan", ""),
    ],
)
def test_the_unit_that_stands_behind_a_name(text, name, unit):
    assert name_and_unit(text) == (name, unit)


def test_one_name_for_three_columns_is_spread():
    assert spread(("t", "Gyro (z,-x,y) [rad/s]", "1", "2", "b")) == ("t", "Gyro z [rad/s]", "Gyro -x [rad/s]", "Gyro y [rad/s]", "b")
    assert spread(("a", "1", "2")) == ("a x", "a y", "a z")
    assert spread(("a", "1", "3")) == ("a", "1", "3")


@pytest.mark.parametrize(
    ("text", "unit_ns", "ns"),
    [
        ("12", 1000, 12_000),
        (' "1.25" ', 10**9, 1_250_000_000),
        ("0.0000000015", 10**9, 2),
        ("7", 15.625, 109),
        ("01:02:03.5", 1, 3_723_500_000_000),
        ("2026-03-29T01:30:00+02:00", 1, 84_600 * 10**9),
        ("23:30:00-0130", 1, 3600 * 10**9),
        ("5:00:00 Z", 1, 18_000 * 10**9),
        ("9" * 30, 10**9, int("9" * 30) * 10**9),
    ],
)
def test_a_time_to_the_nanosecond(text, unit_ns, ns):
    """The zone's time of day in UTC; halves go to the even one."""
    found = exact_ns(text, unit_ns)
    assert (found, type(found)) == (ns, int)


# The clock among the columns

TIMES_S = np.arange(300) / 105.4


def ticks(unit_s, begins=0):
    return np.rint(TIMES_S / unit_s).astype(int) + begins


def clock_of(names, *columns, odr_hz=None, stated=None, before=()):
    rows = [[str(cell) for cell in row] for row in zip(*columns, strict=True)]
    found = find_clock(rows, names.split(","), (), odr_hz, stated, "x", before)
    return found and (found.column, found.unit, found.known, *(found.finer or ()))


SLOW, INTERVALS = np.rint(np.arange(300) / 9.4 * 1e3).astype(int), 9_487_666 + 9000 * (np.arange(300) % 3)
CLOCKS = [
    (("millis", ticks(1e-3)), {}, (0, "ms", "by its name")),
    (("timestamp", ticks(1e-6, 1_700_000_000_000_000)), {"odr_hz": 100.0}, (0, "us", "as 100 Hz are declared")),
    (("ts", ticks(1e-9)), {"odr_hz": 100.0}, (0, "ns", "as 100 Hz are declared")),
    (("time", ticks(1e-3)), {}, (0, "ms", "by the sensors' rates")),
    (("time", SLOW + 1_700_000_000_000), {}, (0, "ms", "by its date")),
    (("time", SLOW), {"before": ["rate: 9.5 Hz"]}, (0, "ms", "as 9.5 Hz stand before its rows")),
    (("foo", ticks(1e-4)), {"stated": "100us"}, (0, "100us", "as given")),
    (("seq,ms", np.arange(300), ticks(1e-3)), {}, (1, "ms", "by its name")),
    (("sec,ms", ticks(1e-3) // 1000, ticks(1e-3)), {}, (1, "ms", "by its name")),  # no fraction: beyond a second
    (("gps sec,imu nsec", ticks(1e-9) // 10**9, ticks(1e-9) % 10**9), {}, (0, "s", "by its name")),
    (("time,ms", ticks(1e-4), ticks(1e-3)), {"stated": "us"}, (1, "us", "as given")),
    *((("dt_s", apart), {}, (0, "s", "by its name")) for apart in ([0, 1, 0], [0, 0, 1])),
    (("sec,nsec", ticks(1e-9) // 10**9 + 1_700_000_000, ticks(1e-9) % 10**9), {}, (0, "s", "by its name", 1, 1)),
    (("sec,ms", [5] * 300, ticks(1e-3) % 1000), {}, None),  # which fall back, and are no fraction
    (("datetime", [f"23:59:{57 + t:09.6f}" if t < 3 else f"00:00:{t - 3:09.6f}" for t in TIMES_S]), {}, (0, "s", "by its name")),
    (("dt_ns", INTERVALS), {}, (0, "ns", "by its name")),
    (("micros", np.delete(ticks(1e-6, 2**32 - 1_000_000) % 2**32, slice(100, 120))), {}, (0, "us", "by its name")),
    (("millis", ticks(1e-3, 2**16 - 1000) % 2**16), {}, (0, "ms", "by its name")),
    (("foo,dt_ns", ticks(1e-4), INTERVALS), {}, (1, "ns", "by its name")),
    (("micros", ticks(1e-6) * (np.arange(300) != 70)), {}, (0, "us", "by its name")),  # a single bad stamp
    (("seq", 2 * np.arange(300)), {}, None),
    (("foo", 2 * np.arange(15)), {}, None),
    (("ms", ticks(1e-3), ticks(1e-4)), {}, (0, "ms", "by its name")),  # a name too few
    (("t", np.cumsum([0, *[*[1] * 9, 2] * 2])), {"odr_hz": 100.0}, None),  # of which one in ten is lost
    (("mx", ticks(2.0, 8096)), {}, None),
    (("foo", np.arange(300)), {}, None),
    (("t", np.arange(300)), {"odr_hz": 100.0}, None),
]


@pytest.mark.parametrize(("columns", "told", "found"), CLOCKS)
def test_the_clock_its_unit_and_how_that_is_known(columns, told, found):
    assert clock_of(*columns, **told) == found


@pytest.mark.parametrize(
    ("step", "of_them", "steady"), [(1501, 14, 1), (1501, 16, 0), (1500, 16, 1), (499, 14, 1), (499, 16, 0), (500, 16, 1)]
)
def test_without_a_clocks_name_all_but_one_step_in_twenty_are_within_half_of_their_median(step, of_them, steady):
    steps = np.repeat([1000, step], [299 - of_them, of_them])
    assert clock_of("foo", np.cumsum([0, *steps]), stated="us") == ((0, "us", "as given") if steady else None)


@pytest.mark.parametrize(
    ("stamps", "says"),
    [
        ((100_000,), "16 rows; "),
        ((20_000_000,), r"16 rows \(steps of 2 ms"),  # as single precision has them
        ((100_000, 100_002, 100_004), r"\(steps of 2 ms"),
        ((100_000, 100_001), None),
        ((99_999, 100_001), None),
    ],
)
def test_large_stamps_that_stand_still_or_leap_by_several_units_have_lost_digits(stamps, says):
    column = "t_ms", np.repeat(stamps, 16)
    if says:
        with pytest.raises(FormatError, match=f"too few digits: .*{says}"):
            clock_of(*column)
    else:
        assert clock_of(*column) == (0, "ms", "by its name")


def test_of_several_clocks_a_person_names_one():
    with pytest.raises(FormatError, match="'time' and 'clock' rise; name the clock, --columns t_ms=NAME"):
        clock_of("time,clock", ticks(1e-3), ticks(1e-4), stated="ms")


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (("foo", ticks(1e-4)), "'foo', which rises steadily by 94.8.* a row.*--time-unit.*--odr HZ"),
        (("t", np.delete(np.arange(303), [50, 51, 200])), "'t', which rises by 1 a row, numbers the rows or is the clock.*--odr HZ"),
        (("time", 1000 * np.arange(300)), "'time', which rises by 1000 a row: 1 Hz in ms or 1000 Hz in us"),
        (
            ("foo,clock,timestamp", [7] * 16, -np.arange(16), [f"{t:.6g}" for t in 1.7e9 + TIMES_S[:16]]),
            r"'timestamp' have too few digits: 1.7e\+09 stands for 16 rows",
        ),
        (("t_s", (1.7e9 + TIMES_S).astype(np.float32).astype(float)), r"'t_s' have too few digits.*\(steps of 128 s\)"),
    ],
)
def test_a_column_that_may_be_the_clock_is_asked_about(columns, says):
    with pytest.raises(FormatError, match=says):
        clock_of(*columns)


def test_intervals_are_told_by_their_name_and_as_they_do_not_rise():
    for cells, name, found in (("5657", "dt", True), ("5657", "dT", True), ("5657", "t", False), ("567", "dt", False)):
        assert holds_intervals([[cell] for cell in cells], 0, [name]) == found
    assert not holds_intervals([["-5"], ["-6"]], 0, ["dt"])
