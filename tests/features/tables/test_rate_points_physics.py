"""Points of rates from a CSV."""

import numpy as np
import pytest

from session.base.errors import FormatError
from tinygc.features.tables.feature import Columns
from tinygc.features.tables.rates.points import points_of, read_points

STEPPED = (-120, -60, 0, 60, 120)


RATES = (-20, -10, 0, 10, 20)


def csv(path, header, rows):
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def plain(path, header="rate_dps,mean_v", mark=","):
    return csv(path, header, [f"{rate}{mark}{0.1 * rate}" for rate in RATES])


@pytest.mark.parametrize(
    ("header", "factor", "unit"),
    [
        ("rate_dps,mean_v", 1.0, "V"),
        ("Rate (deg/s),Output (mV)", 1.0, "mV"),
        ("rate_rad_s,output_lsb", 180 / np.pi, "LSB"),
        ("speed_rpm,voltage_v", 6.0, "V"),
        ("rpm,gz_lsb", 6.0, "LSB"),
        ("rate [°/s],mean [V]", 1.0, "V"),
    ],
)
def test_columns_and_units_by_their_names(tmp_path, header, factor, unit):
    (points,), _ = read_points(plain(tmp_path / "t.csv", header))
    assert points.rate_dps == pytest.approx(factor * np.array(RATES))
    assert points.output == pytest.approx(0.1 * np.array(RATES))
    assert points.unit == unit
    assert points.sensor == "t"


def test_semicolons_comments_and_a_mark_of_utf8(tmp_path):
    path = plain(tmp_path / "t.csv", "# bench 3\nrate_dps;mean_v", mark=";")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(read_points(path)[0][0]) == 5


def test_options_name_columns_unit_and_readings(tmp_path):
    path = csv(tmp_path / "t.csv", "r_dps,y,std", [f"{rate},{rate},0.2" for rate in RATES])
    (points,), remarks = read_points(path, Columns("r_dps", "y", "V", 100))
    assert points.unit == "V"
    assert points.sigma == pytest.approx(np.full(5, 0.02))
    assert not remarks
    assert "--readings" in read_points(path, Columns("r_dps", "y", "V"))[1][0]
    assert "--output-unit" in read_points(path, Columns("r_dps", "y", "", 100))[1][0]
    path = csv(tmp_path / "n.csv", "rate_dps,mean_v,std,n", [f"{rate},{rate},0.2,many" for rate in RATES])
    assert read_points(path, Columns(readings=100))[0][0].sigma == pytest.approx(np.full(5, 0.02))


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("", "empty; expected a header"),
        ("speed,volts\n1,2\n", "no column of output"),
        ("rate,mean_v\n1,2\n2,3\n3,4\n4,5\n", "'rate' states no unit"),
        ("rate_dps,mean_v\n1,2\n2\n", "line 3: 1 columns, expected the 2"),
        ("rate_dps,mean_v\n1,2\n2,abc\n", "line 3: mean_v is 'abc', expected a number"),
        ("rate_dps,mean_v\n1,2\n2,3\n3,4\n", r"t\.csv: t: 3 rates, expected at least four"),
        ("rate_dps,mean_v\n1,0\n2,0\n3,0\n4,0\n", r"t\.csv: t: the output is 0 V at every rate"),
        ("rate_dps,mean_v\n1,5,1,1\n", "4 columns, expected the 2 of the header; a decimal is written with a point"),
        ("rate_dps;mean_v\n1,5;1\n", "line 2: rate_dps is '1,5', expected a number with a decimal point"),
    ],
)
def test_what_is_refused(tmp_path, text, reported):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(FormatError, match=reported):
        read_points(path)


def test_a_sensor_with_too_few_rates_is_left_out_alone(tmp_path):
    rows = [f"a,{rate},{rate}" for rate in RATES] + ["b,1,1", "b,2,2"]
    found, remarks = read_points(csv(tmp_path / "t.csv", "sensor,rate_dps,mean_v", rows))
    assert [points.sensor for points in found] == ["a"]
    assert "b: 2 rates, expected at least four, in both senses: left out." in remarks


@pytest.mark.parametrize(("outputs", "quantum"), [([1.5, 2.25, 3], 0.01), ([12, 15, 1e6], 1.0), ([0.1 + 0.2, 1 / 3, 1], 0.0)])
def test_the_step_of_the_last_decimal(outputs, quantum):
    assert points_of("s", "V", [0, 1, 2, 3], [*outputs, 7], ["one"] * 4).quantum == pytest.approx(quantum)
