"""Malformed logs: each says what is wrong and where."""

import re

import numpy as np
import pytest
from four_readings import HEADER, SENSOR, TIMES, read, text_of

from session.io.config import Sensor
from session.io.errors import FormatError
from session.io.logfile import read_log
from tinygc import CalibrationError


def test_registers_of_a_full_scale_that_the_sensor_has_not_are_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text_of())
    with pytest.raises(FormatError, match=r"gyro_fs_dps = 245 .*125, 250, 500"):
        read_log(path, Sensor("ASM330LHH", "", 208.0, 245.0, 4.0))


@pytest.mark.parametrize(
    ("cells", "names"),
    [
        ("0,1e308,0,0,0,1,20", "gy_dps is 1e+308"),
        ("-100001,0,0,0,0,1,20", "gx_dps is -100001, beyond any sensor"),
        ("0,0,0,0,0,10001,20", "az_g"),
        ("0,0,0,0,0,1,1e300", "temp_c"),
    ],
)
def test_what_no_sensor_measures_is_refused(tmp_path, cells, names):
    header = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c"
    rows = [f"{i / 100},-99999,0,0,0,0,-9999,20" for i in range(5)]
    read(tmp_path, "\n".join([header, *rows]) + "\n")
    with pytest.raises(FormatError, match=f"line 4: {re.escape(names)}"):
        read(tmp_path, "\n".join([header, *rows[:2], f"0.02,{cells}", *rows[3:]]) + "\n")


@pytest.mark.parametrize("back_us", [2**31 + 1, 2**32 - 5000])
def test_a_time_beyond_the_counter_that_goes_back_is_refused(tmp_path, back_us):
    stamps = 2**40 + 4808 * np.arange(6) - back_us * (np.arange(6) > 2)
    with pytest.raises(FormatError, match="goes backward"):
        read(tmp_path, HEADER + "\n" + "".join(f"{t},1,2,3,4,5,6,7\n" for t in stamps))


def row(text, number=3):
    """The four readings with another line in the place of the second one (line 3 of the file)."""
    lines = text_of().splitlines()
    lines[number - 1] = text
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("\n\n", "empty"),
        ("# only a comment\n", ""),
        (HEADER, "no samples"),
        (HEADER + "\n", "no samples"),
        ("\n".join(text_of().splitlines()[1:]), "no header"),
        ("some text\n1,2,3\n", "no header"),
        (text_of().replace("gz", "gq"), "gyroscope"),
        (text_of().replace("t_us", "time"), "no time column"),
        (text_of().replace("t_us", "t_s,t_us"), "time"),
        (text_of(gyro="_dps").replace("gx_dps", "gx_rps"), "gyroscope"),
        (text_of(gyro="_dps").replace("_dps", "_mdps"), "unknown unit in 'gx_mdps'"),
        (text_of(accel="_g").replace("_g", "_mg"), "unknown unit in 'ax_mg'"),
        (text_of().replace("temp", "temp,temp_c"), "two temperature columns"),
        (row("1004808,1,2,x,4,5,6,7"), "line 3: gz is 'x'"),
        (row("1004808,1,2,3,4,5"), "line 3: 6 columns, expected 8"),
        (row("1004808,1,2,3.5,4,5,6,7"), "line 3: gz is '3.5', expected a whole number"),
        (row("1004808,1,2,,4,5,6,7"), "line 3: gz is ''"),
        (row("1004808,1,2,32768,4,5,6,7"), "line 3: gz is 32768, no 16-bit register"),
        (row("1004808,1,2,3,-32769,5,6,7"), "line 3: ax is -32769, no 16-bit register"),
        (row("990000,1,2,3,4,5,6,7"), "line 3: t_us goes backward by 0.01 s"),
        (row("Boot v1.2 0x6B ok", 4), "line 4: 1 columns"),
        (row(f"{2**60},1,2,3,4,5,6,7"), f"line 3: t_us is {2**60}, which is no time of this era"),
        (row(f"-{2**60},1,2,3,4,5,6,7"), "which is no time of this era"),
        (row(f"{10**30},1,2,3,4,5,6,7"), "line 3: t_us is '10000000000000000000'…, a number too long"),
        (row("1004808,1,2," + "9" * 5000 + ",4,5,6,7"), "line 3: gz is '99999999999999999999'…, a number too long"),
        (row("1004808,1,1_000,3,4,5,6,7"), "line 3: gy is '1_000', expected a whole number"),
        (row("1004808,1,2,\u0663,4,5,6,7"), "line 3: gz is"),
        (row("1004808,1,2,3,4\x0c5,5,6,7"), "line 3: ax is '4\\x0c5'"),
        (text_of().replace(",", ";"), "line 1: separated by semicolons; expected commas"),
        (text_of().replace(",", "\t"), "line 1: separated by tabs; expected commas"),
        (text_of().upper(), "(is 'T_US' meant as 't_us'?)"),
        (text_of().replace("gx,gy,gz", "GX,GY,GZ"), "(is 'GX' meant as 'gx'?)"),
        (text_of(gyro="_dps").replace("gy_dps", "gy_DPS"), "unknown unit in 'gy_DPS'; known are gx, gx_dps"),
        (text_of().encode("utf-16"), "not a text log (UTF-16 or binary)"),
        (b"\x7fELF\0\0\0" * 40, "not a text log (UTF-16 or binary)"),
        (text_of("t_s").replace(repr(TIMES["t_s"][1].item()), "1e300"), "line 3: t_s is 1e+300, which is no time of this era"),
        (text_of(gyro="_dps", accel="_g", temp=None).replace("1004808", "1e300"), "line 3: t_us is '1e300', expected a whole number"),
        (text_of(gyro="_dps").replace("1004808", "1_004_808"), "line 3: t_us is '1_004_808', expected a whole number"),
        (text_of("t_s").replace(repr(TIMES["t_s"][1].item()), "1_0.04808"), "line 3: t_s is '1_0.04808', expected a number"),
    ],
)
def test_a_malformed_log_says_what_and_where(tmp_path, text, said):
    with pytest.raises(CalibrationError) as error:
        read(tmp_path, text)
    assert said in str(error.value)
    assert "log0001.csv" in str(error.value)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("column", ["gy_dps", "az_g", "temp_c", "t_s"])
def test_a_reading_that_is_no_number_is_refused(tmp_path, value, column):
    lines = text_of("t_s", "_dps", "_g", "temp_c").splitlines()
    cells = lines[3].split(",")
    cells[lines[0].split(",").index(column)] = value
    lines[3] = ",".join(cells)
    with pytest.raises(FormatError, match=f"line 4: {column} is"):
        read(tmp_path, "\n".join(lines) + "\n")


def test_line_numbers_count_comments_and_blank_lines(tmp_path):
    text = "# one\n\n" + HEADER + "\n1,1,2,3,4,5,6,7\n# five\n2,1,2,3,4,5,6,7\n3,oops,2,3,4,5,6,7\n4,1,2,3,4,5,6,7\n"
    with pytest.raises(FormatError, match="line 7: gx is 'oops'"):
        read(tmp_path, text)


def test_text_that_calls_itself_gzip_is_refused(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_text(text_of())
    with pytest.raises(FormatError, match="not a gzip file"):
        read_log(path, SENSOR)
