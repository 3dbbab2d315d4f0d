"""``import``: what it asks, what it assumes and says, which rows it takes, and what it does with several sensors."""

import json
import re
import zipfile

import numpy as np
import pytest
from conftest import DEG, ROOT, Table
from dialect_logs import ACCEL, GYRO, SAMPLES, T_US, betaflight, make, rows, same, triads
from written_texts import TEXTS, bursts, phyphox, sensor_logger

import tinygc
from session.io.errors import DataError, FormatError
from session.io.forms import form_of
from session.io.headings import usual_columns
from session.io.questions import QuestionsError
from session.io.stamps import evenly
from tinygc import read_session

WILD = ROOT.parent / "shared" / "wild"
USUAL = "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ\n" + rows(T_US / 1e3, *ACCEL["g"].T, *GYRO["dps"].T)


# What is asked, all at once


def test_all_that_a_log_does_not_say_is_asked_at_once(tmp_path):
    with pytest.raises(QuestionsError) as asked:
        make(tmp_path, betaflight("", ""))
    assert [question.option for question in asked.value.questions] == ["--gyro-unit", "--accel-unit"]
    with pytest.raises(QuestionsError) as asked:
        make(tmp_path, USUAL.replace("time_ms", "n").replace(",", ";"), gyro_fs_dps=None)
    assert [question.option for question in asked.value.questions] == ["--time-unit", "--gyro-unit", "--accel-unit"]
    said = str(asked.value)
    assert "\n" not in said
    assert all(each.option in said.partition("; give ")[2] for each in asked.value.questions)


def test_the_questions_of_two_files_are_one(tmp_path):
    gyro = "t,gx,gy,gz\n" + rows(T_US, *GYRO["dps"].T)
    accel = "t,ax,ay,az\n" + rows(T_US, *ACCEL["g"].T)
    with pytest.raises(QuestionsError) as asked:
        make(tmp_path, gyro, accel)
    assert {question.option for question in asked.value.questions} == {"--gyro-unit", "--accel-unit"}
    assert "LOG.CSV and 1LOG.CSV" in str(asked.value)
    same(make(tmp_path, gyro, accel, gyro_unit="dps", accel_unit="g"))


def test_registers_ask_for_the_sensor_and_both_full_scales(tmp_path):
    raw = "ms;gx;gy;gz;ax;ay;az\n" + rows(
        T_US // 1000, *np.rint(GYRO["dps"].T).astype(int), *np.rint(ACCEL["g"].T * 8000).astype(int), delimiter=";"
    )
    with pytest.raises(QuestionsError) as asked:
        make(
            tmp_path,
            raw,
            gyro_unit="lsb",
            accel_unit="lsb",
            gyro_fs_dps=None,
            accel_fs_g=None,
            like=None,
            columns="t_ms=1,gx=2,gy=3,gz=4,ax=5,ay=6,az=7",
        )
    assert [question.option for question in asked.value.questions] == ["--sensor NAME", "--gyro-fs DPS", "--accel-fs G"]


# What is assumed


def test_a_full_scale_that_nobody_states_is_assumed_and_said(tmp_path):
    made = make(tmp_path, USUAL, gyro_unit="dps", accel_unit="g", gyro_fs_dps=None, accel_fs_g=None)
    sensor = read_session(made.folder).config.sensor
    most = np.abs(GYRO["dps"]).max()
    assert sensor.gyro_fs_dps == next(each for each in (125, 250, 500, 1000) if each > most)
    assert sensor.accel_fs_g == 2
    assert sum("is assumed" in note for note in made.notes) == 2
    assert made.took[1].count("(assumed)") == 2
    assert (made.folder / "session.toml").read_text().count("is assumed") == 2


@pytest.mark.parametrize(("rows_at_end", "asks"), [(3, False), (4, True)])
def test_readings_that_stand_at_the_end_of_a_range_are_asked_about(rows_at_end, asks, tmp_path):
    gyro = GYRO["dps"].copy()
    gyro[500 : 500 + rows_at_end, 1] = 573.4375
    text = "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ\n" + rows(T_US / 1e3, *ACCEL["g"].T, *gyro.T)
    told = {"gyro_unit": "dps", "accel_unit": "g", "gyro_fs_dps": None}
    if not asks:
        assert read_session(make(tmp_path, text, **told).folder).config.sensor.gyro_fs_dps == 1000
        return
    with pytest.raises(QuestionsError, match=r"its readings stand at 573\.438 dps for 4 rows; give --gyro-fs DPS"):
        make(tmp_path, text, **told)


def test_readings_that_come_six_times_end_no_range(tmp_path):
    """Each stands for six rows, the largest as well."""
    held = np.arange(len(T_US)) // 6 * 6
    text = "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ\n" + rows(T_US / 1e3, *ACCEL["g"][held].T, *GYRO["dps"][held].T)
    made = make(tmp_path, text, gyro_unit="dps", accel_unit="g", gyro_fs_dps=None)
    assert any("full scale" in note and "is assumed" in note for note in made.notes)


def test_acceleration_without_gravity_is_said(tmp_path):
    text = "time,ax,ay,az,wx,wy,wz\n" + rows(T_US / 1e6, *(0.05 * ACCEL["mps2"].T), *GYRO["rps"].T)
    made = make(tmp_path, text)
    assert made.dialects == ("Physics Toolbox, linear",)
    assert any(re.search(r"shows 0\.0(?:50*|4[89]\d*) g where gravity belongs", note) for note in made.notes)


# Which rows


def test_rows_by_their_lines(tmp_path):
    head, *body = USUAL.splitlines()
    garbage = [line if i < 1000 else "~~~garbage~~~" for i, line in enumerate(body)]
    text = "\n".join([head, *garbage]) + "\n"
    told = {"gyro_unit": "dps", "accel_unit": "g"}
    with pytest.raises(FormatError, match="line 1002"):
        make(tmp_path, text, **told)
    samples = read_session(make(tmp_path, text, lines="1-1001", **told).folder).logs[0].samples
    np.testing.assert_allclose(samples.gyro, SAMPLES.gyro[:1000], atol=1e-10)
    later = read_session(make(tmp_path, text, lines="12-1001", out="later", **told).folder).logs[0].samples
    np.testing.assert_allclose(later.gyro, SAMPLES.gyro[10:1000], atol=1e-10)


@pytest.mark.parametrize("wrong", ["", "5", "0-3", "9-2", "a-b", "-1-3"])
def test_lines_that_are_no_span_are_refused(wrong, tmp_path):
    with pytest.raises(FormatError, match="expected FIRST-LAST"):
        make(tmp_path, USUAL, lines=wrong)


def test_a_reader_that_is_forced(tmp_path):
    """A gyroscope's and an accelerometer's columns that two programs use."""
    text = "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),"
    text += "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)\n" + rows(T_US, *triads("dps", "g"))
    assert make(tmp_path, text, like="x-imu3").dialects == ("x-IMU3",)
    with pytest.raises(FormatError, match="no header of phyphox"):
        make(tmp_path, text, like="phyphox", out="b")
    with pytest.raises(FormatError, match="--like is 'nonsense'"):
        make(tmp_path, text, like="nonsense", out="c")


# Several sensors


def six(units=3):
    cells = [
        f"{t},{unit},{','.join(f'{v:.12f}' for v in (*(GYRO['dps'][i] * (1 + 0.01 * unit)), *ACCEL['g'][i]))}\n"
        for i, t in enumerate(T_US)
        for unit in range(units)
    ]
    return "t_us,id,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "".join(cells)


def test_one_file_becomes_an_array(tmp_path, run):
    log, out = tmp_path / "six.csv", tmp_path / "array"
    log.write_text(six())
    code, _, said = run("import", log, "--out", out)
    assert code == 2
    assert "give --where id=0" in said
    assert run("import", log, "--out", out, "--array-by", "id", "--gyro-fs", "500", "--accel-fs", "4")[0] == 0
    from session.annexes.arrays.recording import read_array

    array = read_array(out)
    assert array.numbers == (0, 1, 2)
    for unit, session in enumerate(array.units):
        np.testing.assert_allclose(session.logs[0].samples.gyro, SAMPLES.gyro * (1 + 0.01 * unit), atol=1e-10)


def test_a_sensor_that_is_held_is_said(tmp_path, run):
    held = ACCEL["g"][np.arange(len(T_US)) // 2 * 2]
    (tmp_path / "log.csv").write_text("t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + rows(T_US, *GYRO["dps"].T, *held.T))
    code, said, _ = run("import", tmp_path / "log.csv", "--out", tmp_path / "out")
    assert code == 0
    assert "each reading of the accelerometer stands for 2 rows" in " ".join(said.split())


def test_a_column_that_tells_no_sensors_apart_makes_no_array(tmp_path, run):
    (tmp_path / "log.csv").write_text(USUAL)
    told = ("--gyro-unit", "dps", "--accel-unit", "g")
    code, _, said = run("import", tmp_path / "log.csv", "--out", tmp_path / "a", "--array-by", "time_ms", *told)
    assert code == 2
    assert "holds more than 16 values" in said
    assert not (tmp_path / "a").exists()


def test_each_file_has_columns_of_its_own(tmp_path, run):
    (tmp_path / "g.csv").write_text("a,b,c,d\n" + rows(T_US, *GYRO["dps"].T))
    (tmp_path / "a.csv").write_text("u,v,w,x\n" + rows(T_US, *ACCEL["g"].T))
    gyro, accel = "t_us=a,gx_dps=b,gy_dps=c,gz_dps=d", "t_us=u,ax_g=v,ay_g=w,az_g=x"
    paths = (tmp_path / "g.csv", tmp_path / "a.csv")
    assert run("import", *paths, "--out", tmp_path / "s", "--columns", gyro, "--columns", accel)[0] == 0
    (log,) = read_session(tmp_path / "s").logs
    np.testing.assert_allclose(log.samples.gyro, SAMPLES.gyro, atol=1e-10)
    code, _, said = run("import", *paths, "--out", tmp_path / "t", *["--columns", gyro] * 3)
    assert code == 2
    assert "3 times for 2 files" in said


# Clocks


def test_a_gap_of_the_other_file_stays_a_gap(tmp_path):
    """Two files with clocks of their own: readings are put between neighbours, and none where the other file has a hole."""
    (_, gyro), (_, accel) = phyphox(SAMPLES)
    head, *body = accel.decode().splitlines()
    hole = [line for line in body if not 3.0 < float(line.split(",")[0]) < 3.5]
    made = make(tmp_path, gyro, "\n".join([head, *hole]) + "\n")
    t_s = read_session(made.folder).logs[0].samples.t_ns * 1e-9
    assert not ((t_s > 3.01) & (t_s < 3.49)).any()
    assert ((t_s > 2.5) & (t_s < 2.99)).sum() >= 50
    assert any("an offset between their clocks stays" in note for note in made.notes)


def test_an_end_that_is_repeated_is_left_out(tmp_path):
    """A display's last second, as a telephone's program appends it; a single row that steps back is no repeated end."""
    head, *body = USUAL.splitlines()
    told = {"gyro_unit": "dps", "accel_unit": "g"}
    made = make(tmp_path, "\n".join([head, *body, *body[-60:]]) + "\n", **told)
    same(made)
    assert any("its last 60 rows repeat the time before them" in note for note in made.notes)
    with pytest.raises(FormatError, match="goes backward"):
        make(tmp_path, "\n".join([head, *body, *body[500:560]]) + "\n", out="other", **told)


def test_bursts_are_counted_along_their_stamps():
    """The rate is the mean one; a stamp is late by the wait, so the least late of a burst is the time."""
    table = Table().tumble(2, rest_s=2.0).samples(odr_hz=104)
    _, data = bursts(table)[0]
    stamps = np.array([round(float(line.split(";")[0]) * 1e9) for line in data.decode().splitlines()[1:]])
    even, note, _ = evenly(stamps, None, "x")
    assert "come in bursts" in note
    steps = np.diff(even)
    assert np.ptp(steps) <= 1
    assert steps.mean() == pytest.approx(1e9 / 104, rel=2e-5)


def test_bursts_with_samples_missing_keep_their_stamps():
    count = np.arange(5000)
    t_ns = count // 7 * 7 * 10_000_000 + count % 7 * 100_000
    kept = np.delete(t_ns, np.s_[2000:2042])
    even, note, _ = evenly(kept, None, "x")
    assert "samples are missing" in note
    np.testing.assert_array_equal(even, kept)


def test_coarse_stamps_are_counted_along_their_changes():
    """Whole seconds, cut off: where a stamp changes it is right to a sample."""
    true_ns = np.round(np.arange(16_000) * (1e9 / 104.03)).astype(np.int64) + 370_000_000
    even, note, sigma_ppm = evenly(true_ns // 10**9 * 10**9, None, "x")
    assert "share a stamp" in note
    assert 1e9 / np.diff(even).mean() == pytest.approx(104.03, rel=1e-5)
    assert sigma_ppm == pytest.approx(1e6 / 12**0.5 / 16_000, rel=0.02)  # each change to a sample, in a pattern that hardly scatters


@pytest.mark.parametrize("stamp", ["2025-01-27T11:03:{:09.6f}Z", "2025-01-27 11:03:{:09.6f}", "11:03:{:09.6f}+01:00"])
def test_stamps_as_people_write_dates(stamp, tmp_path):
    few = T_US < 50e6
    text = "time,wx,wy,wz,gFx,gFy,gFz\n" + rows([stamp.format(t / 1e6) for t in T_US[few]], *GYRO["rps"][few].T, *ACCEL["g"][few].T)
    t_ns = read_session(make(tmp_path, text).folder).logs[0].samples.t_ns
    np.testing.assert_array_equal(t_ns - t_ns[0], SAMPLES.t_ns[few])


# Forms of text


@pytest.mark.parametrize(
    ("line", "torn"), [("ax:1 ay:2 az:3 gx:4 gy:5", True), ("the battery is low", False), ("ax:1 ay:x az:3 gx:4 gy:5 gz:6", True)]
)
def test_a_torn_record_is_refused_and_chatter_is_counted(line, torn, tmp_path):
    body = [f"t:{t} ax:{i % 7} ay:0 az:8192 gx:{i % 5} gy:0 gz:1" for i, t in enumerate(T_US)]
    text = "\n".join([*body[:50], line, *body[50:]]) + "\n"
    told = {"sensor": "MPU-6050"}
    if torn:
        with pytest.raises(FormatError, match=r"LOG\.CSV line 5[12]"):
            make(tmp_path, text, **told)
    else:
        assert any("1 lines hold no reading" in note for note in make(tmp_path, text, **told).notes)


def test_the_order_of_packed_registers_is_asked_for():
    words = ["0C00F9FF00100300000000FE"] * 20
    with pytest.raises(FormatError, match=r"6 registers a line, packed in hexadecimal.*give --packed"):
        form_of(words, None, "x")
    form = form_of(words, "st", "x")
    assert form.header == "gx,gy,gz,ax,ay,az"
    assert form(words[:1]) == ["12,-7,4096,3,0,-512"]
    with pytest.raises(FormatError, match="6 registers a line, but --packed mpu has 7"):
        form_of(words, "mpu", "x")
    with pytest.raises(FormatError, match="--packed is 'middle:gx'"):
        form_of(words, "middle:gx", "x")


def test_json_keeps_every_digit_of_a_stamp():
    form = form_of(['{"t_ns": 1732600000123456789, "g": [1, 2, 3], "a": {"x": 0.10, "y": 1e-3, "z": 9}}'] * 9, None, "x")
    assert form.header == "t_ns,g[0],g[1],g[2],a.x,a.y,a.z"
    assert form(['{"t_ns": 1732600000123456789, "g": [1, 2, 3], "a": {"x": 0.10, "y": 1e-3, "z": 9}}']) == [
        "1732600000123456789,1,2,3,0.10,1e-3,9"
    ]


# Archives


def test_an_archive_that_is_damaged_or_holds_no_sensor_is_refused_in_one_line(tmp_path, run):
    ((name, data),) = sensor_logger(SAMPLES)
    path = tmp_path / name
    for spoilt in (data[: len(data) // 2], data[:40], data[:200] + bytes(300) + data[500:]):
        path.write_bytes(spoilt)
        code, _, said = run("import", path, "--out", tmp_path / "s")
        assert (code, said.count("\n")) == (2, 1)
        assert not (tmp_path / "s").exists()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../../evil.csv", "a,b\n1,2\n")
    code, _, said = run("import", path, "--out", tmp_path / "s")
    assert code == 2
    assert "none of its 1 text files holds a gyroscope" in said
    assert not (tmp_path.parent.parent / "evil.csv").exists()


def test_an_archives_words_do_not_exceed_any_log(tmp_path, run, monkeypatch):
    import session.replay.sources as module

    monkeypatch.setattr(module, "MOST_ARCHIVE", 1000)
    ((name, data),) = sensor_logger(SAMPLES)
    (tmp_path / name).write_bytes(data)
    code, _, said = run("import", tmp_path / name, "--out", tmp_path / "s")
    assert code == 2
    assert "larger than 1000 bytes" in said


# The command


def test_every_kind_of_log_is_listed(run, tmp_path):
    code, out, _ = run("import", "--list", "--json", tmp_path / "x.json")
    assert code == 0
    readers = json.loads((tmp_path / "x.json").read_text())["readers"]
    assert len(readers) > 20
    assert all(each["name"] in out and each["example"] in out for each in readers)


def test_the_folder_is_named_as_the_log(tmp_path, run, monkeypatch):
    (tmp_path / "flight_3.csv").write_bytes(TEXTS["EuRoC"].write(SAMPLES)[0][1])
    monkeypatch.chdir(tmp_path)
    assert run("import", "flight_3.csv")[0] == 0
    assert (tmp_path / "flight_3" / "session.toml").exists()
    code, _, said = run("import")
    assert code == 2
    assert "no log" in said


@pytest.mark.skipif(not (WILD / "repoimu").exists(), reason="the public recordings are not beside the project")
def test_a_public_table_with_two_lines_of_names(tmp_path, run):
    """RepoIMU: groups in the first line, axes in the second, a time without a second name, and a semicolon at each end."""
    path = WILD / "repoimu" / "TStick_Test06_Trial1.csv"
    code, _, said = run("import", path, "--out", tmp_path / "s")
    assert code == 2
    assert "does not say the unit of the gyroscope and the unit of the accelerometer; give" in said
    assert run("import", path, "--out", tmp_path / "s", "--gyro-unit", "rad/s", "--accel-unit", "m/s2")[0] == 0
    first = path.read_text().splitlines()[2].split(";")
    samples = read_session(tmp_path / "s").logs[0].samples
    np.testing.assert_allclose(samples.accel[0], [float(cell) for cell in first[5:8]])
    np.testing.assert_allclose(samples.gyro[0], [float(cell) for cell in first[8:11]])


@pytest.mark.skipif(not (WILD / "sundevil").exists(), reason="the public recordings are not beside the project")
def test_a_public_log_whose_rates_are_half_of_the_truth_is_found_out(tmp_path, run):
    """A rocket's board: no header, rows of garbage from line 2992 on, and a full scale that was read as another."""
    path = WILD / "sundevil" / "rev2" / "IMU_Rev2_Data_Long.txt"
    assert "no header, 13 columns of numbers" in run("import", path, "--out", tmp_path / "s")[2]
    columns = "t_s=1,ax_mps2=2,ay_mps2=3,az_mps2=4,gx_dps=5,gy_dps=6,gz_dps=7,temp_c=13"
    code, out, _ = run("import", path, "--out", tmp_path / "s", "--columns", columns, "--lines", "1-2991")
    assert code == 0
    assert "gravity requires rates x 1.9" in out
    assert read_session(tmp_path / "s").config.sensor.gyro_fs_dps == 250
    assert len(read_session(tmp_path / "s").logs[0].samples) == 2991


# From Python


def test_python_is_asked_for_keywords(tmp_path):
    path = tmp_path / "sketch.csv"
    path.write_text(USUAL)
    with pytest.raises(tinygc.CalibrationError, match=r"give gyro_unit= \(dps.*accel_unit= \(g"):
        tinygc.read_log(str(path))
    with pytest.raises(tinygc.CalibrationError, match=r"did you mean gyro_unit\?"):
        tinygc.import_log(path, tmp_path / "s", gyro_units="dps")
    with pytest.raises(tinygc.CalibrationError):
        tinygc.read_log(3)


# What went wrong silently once


def two_in_turn(apart_us=0):
    cells = [
        f"{t + unit * apart_us},{'AB'[unit]},{','.join(f'{v:.9f}' for v in (*(GYRO['dps'][i] * (1 + 0.01 * unit)), *ACCEL['g'][i]))}\n"
        for i, t in enumerate(T_US)
        for unit in range(2)
    ]
    return "t_us,rig,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "".join(cells)


@pytest.mark.parametrize("apart_us", [0, 300])
def test_two_sensors_in_turn_are_found_whatever_their_column_is_called(apart_us, tmp_path):
    with pytest.raises(FormatError, match=r"the column 'rig' holds A, B in turn.*give --where rig=A"):
        make(tmp_path, two_in_turn(apart_us))
    same(make(tmp_path, two_in_turn(apart_us), where="rig=A"))


def test_a_bit_that_changes_with_each_row_is_no_second_sensor(tmp_path):
    text = "t_us,tick,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + rows(T_US, [i % 2 for i in range(len(T_US))], *triads("dps", "g"))
    same(make(tmp_path, text))


@pytest.mark.parametrize("lost", [10, 100])
def test_samples_that_whole_seconds_lack_are_missed(lost):
    true_ns = np.round(np.arange(12_000) * (1e9 / 105.1)).astype(np.int64)
    whole = np.delete(true_ns // 10**9 * 10**9, np.s_[5000 : 5000 + lost])
    with pytest.raises(DataError, match="samples are missing"):
        evenly(whole, None, "x")


def records():
    return [f"t: {t} ax: {i % 7}.5 ay: 0.25 az: 9.75 gx: {i % 5}.125 gy: 0.5 gz: 1.5" for i, t in enumerate(T_US)]


def test_a_capture_that_begins_in_mid_line_keeps_each_reading_at_its_time(tmp_path):
    """The rest of a record before the first whole one is no record's beginning."""
    lines_of = records()
    made = make(tmp_path, "\n".join([lines_of[0][20:], *lines_of[1:]]) + "\n", gyro_unit="dps", accel_unit="m/s2", time_unit="us")
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_array_equal(samples.t_ns, T_US[1:] * 1000)
    np.testing.assert_allclose(samples.gyro[:, 0] / DEG, [i % 5 + 0.125 for i in range(1, len(T_US))])
    np.testing.assert_allclose(samples.accel[:, 0], [i % 7 + 0.5 for i in range(1, len(T_US))])
    torn = [*lines_of[:50], lines_of[50][12:], *lines_of[51:]]
    with pytest.raises(FormatError, match=r"LOG\.CSV line 51"):
        make(tmp_path, "\n".join(torn) + "\n", gyro_unit="dps", accel_unit="m/s2", time_unit="us", out="torn")


@pytest.mark.parametrize(
    "write",
    [
        lambda line: line.replace(".", ","),
        lambda line: re.sub(r"t: (\d+) ", r"\1 ", line),
        lambda line: re.sub(r"t: (\d+) ", r"I (\1) IMU: ", line),
        lambda line: re.sub(
            r"ax: (\S+) ay: (\S+) az: (\S+) gx: (\S+) gy: (\S+) gz: (\S+)", r"acc: x=\1 y=\2 z=\3 gyr: x=\4 y=\5 z=\6", line
        ),
        lambda line: re.sub(r"ax: (\S+) ay: (\S+) az: (\S+) gx: (\S+) gy: (\S+) gz: (\S+)", r"Accel: \1, \2, \3 Gyro: \4, \5, \6", line),
        lambda line: re.sub(r"gz: (\S+)", r"gz: \1 degrees/s", re.sub(r"az: (\S+)", r"az: \1 m/s^2", line)),
    ],
    ids=["decimal commas", "leading stamp", "a log's tag", "labels", "lists", "units"],
)
def test_names_and_numbers_as_people_print_them(write, tmp_path):
    made = make(tmp_path, "\n".join(map(write, records())) + "\n", gyro_unit="dps", accel_unit="m/s2", time_unit="us")
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_array_equal(samples.t_ns - samples.t_ns[0], SAMPLES.t_ns)
    np.testing.assert_allclose(samples.gyro[:, 0] / DEG, [i % 5 + 0.125 for i in range(len(T_US))])
    np.testing.assert_allclose(samples.accel[:, 0], [i % 7 + 0.5 for i in range(len(T_US))])


def test_rows_that_are_wider_than_the_header_are_refused(tmp_path):
    head, *body = USUAL.splitlines()
    wide = [line if i < 900 else line.replace(",", ",7,", 1) for i, line in enumerate(body)]
    with pytest.raises(FormatError, match=r"line 902: 8 columns, expected 7"):
        make(tmp_path, "\n".join([head, *wide]) + "\n", gyro_unit="dps", accel_unit="g")
    same(make(tmp_path, "\n".join([head, *(f"{line},," for line in body)]) + "\n", gyro_unit="dps", accel_unit="g"))


def test_a_column_that_is_taken_twice_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"takes the column .* for two things"):
        make(tmp_path, rows(T_US, *triads("dps", "g")), columns="t_us=1,gx_dps=2,gy_dps=2,gz_dps=2,ax_g=5,ay_g=6,az_g=7")


def test_readings_far_beyond_a_full_scale_are_refused(tmp_path):
    told = {"gyro_unit": "dps", "accel_unit": "g"}
    with pytest.raises(DataError, match="more than --gyro-fs 50 holds"):
        make(tmp_path, USUAL, **told | {"gyro_fs_dps": 50.0})
    with pytest.raises(DataError, match=r"more than any usual full scale \(up to 4000 dps\) holds; is its unit right"):
        make(tmp_path, USUAL, **told | {"gyro_unit": "rad/s", "gyro_fs_dps": None})


def test_a_decimal_stamp_beside_hexadecimal_registers_stays_decimal(tmp_path):
    """Four digits or eight: what has no letter and no leading zero is no register."""
    raw = [f"{1000 + 10 * i},{(i * 7) % 4096:04X},FFFE,0003,00A0,FF00,1000" for i in range(800)]
    form = form_of(["ms,gx,gy,gz,ax,ay,az", *raw], None, "x")
    assert form(["1010,0007,FFFE,0003,00A0,FF00,1000"]) == ["1010,7,-2,3,160,-256,4096"]


def test_a_peak_in_coarse_steps_is_no_end_of_a_range(tmp_path):
    gyro = np.rint(GYRO["dps"] / 5) * 5
    text = "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ\n" + rows(T_US / 1e3, *ACCEL["g"].T, *gyro.T)
    assert make(tmp_path, text, gyro_unit="dps", accel_unit="g", gyro_fs_dps=None).samples == len(T_US)


@pytest.mark.parametrize("behind", [" gx: 0.5 gy: 0.5 gz: 0.5", " gz: 0.5"])
def test_what_comes_twice_in_a_line_leaves_no_trace_in_the_next(behind, tmp_path):
    """Bytes that were lost between two lines, or a stray one: the line is refused, and the others keep their readings."""
    lines_of = records()
    spoilt = [*lines_of[:50], lines_of[50] + behind, *lines_of[51:]]
    told = {"gyro_unit": "dps", "accel_unit": "m/s2", "time_unit": "us"}
    with pytest.raises(FormatError, match=r"LOG\.CSV line 51"):
        make(tmp_path, "\n".join(spoilt) + "\n", **told)


@pytest.mark.parametrize("first", [0, 1, 2])
def test_a_record_of_several_lines_begins_with_its_time_wherever_the_capture_does(first, tmp_path):
    three = [
        part
        for i, t in enumerate(T_US)
        for part in (f"time: {t}", f"acc x: {i % 7}.5 y: 0.25 z: 9.75", f"gyr x: {i % 5}.125 y: 0.5 z: 1.5")
    ]
    made = make(tmp_path, "\n".join(three[first:]) + "\n", gyro_unit="dps", accel_unit="m/s2", time_unit="us")
    skipped = bool(first)
    samples = read_session(made.folder).logs[0].samples
    np.testing.assert_array_equal(samples.t_ns, T_US[skipped:] * 1000)
    np.testing.assert_allclose(samples.gyro[:, 0] / DEG, [i % 5 + 0.125 for i in range(skipped, len(T_US))])
    del three[3 * 60]
    with pytest.raises(FormatError, match=r"line 18[123]"):
        make(tmp_path, "\n".join(three) + "\n", gyro_unit="dps", accel_unit="m/s2", time_unit="us", out="torn")


@pytest.mark.parametrize("head", ["temp,", "extra,other,"])
def test_a_row_that_lacks_a_cell_is_refused(head, tmp_path):
    columns = head.count(",")
    text = f"{head}{USUAL}".replace("\n", ",mag\n", 1)
    body = [f"{'25.0,' * columns}{line},0.1" for line in USUAL.splitlines()[1:]]
    body[700] = body[700].split(",", 1)[1]
    with pytest.raises(FormatError, match=rf"line 702: {columns + 7} columns, expected {columns + 8}"):
        make(tmp_path, text.splitlines()[0] + "\n" + "\n".join(body) + "\n", gyro_unit="dps", accel_unit="g")


def test_words_that_say_the_sensor_are_seen(tmp_path):
    told = {"gyro_unit": "dps", "accel_unit": "m/s2", "time_unit": "us"}
    labelled = [f"IMU{i % 2}: {line}" for i, line in enumerate(records())]
    with pytest.raises(FormatError, match="lines of several sensors"):
        make(tmp_path, "\n".join(labelled) + "\n", **told)
    objects = [json.dumps({"dev": "AB"[i % 2], "t": int(t), "gyro": [1, 2, 3], "accel": [0, 0, 9.5]}) for i, t in enumerate(T_US)]
    with pytest.raises(FormatError, match=r"the column 'dev' holds A, B.*give --where dev=A"):
        make(tmp_path, "\n".join(objects) + "\n", **told)
    assert make(tmp_path, "\n".join(objects) + "\n", where="dev=B", **told).samples == len(T_US) // 2


def test_a_unit_that_changes_in_mid_file_is_refused(tmp_path):
    changed = [line.replace("gz: 1.5", f"gz: 1.5 {'dps' if i < 1000 else 'rad/s'}") for i, line in enumerate(records())]
    with pytest.raises(FormatError, match="line 1001"):
        make(tmp_path, "\n".join(changed) + "\n", accel_unit="m/s2", time_unit="us")


def test_rows_that_were_written_twice_count_once(tmp_path):
    head, *body = USUAL.splitlines()
    told = {"gyro_unit": "dps", "accel_unit": "g"}
    twice = [line for i, line in enumerate(body) for line in [line] * (1 + (i % 10 == 0))]
    made = make(tmp_path, "\n".join([head, *twice]) + "\n", **told)
    same(made)
    assert any("rows repeat the one before them, stamp and readings: left out" in note for note in made.notes)


OF_OTHERS = rows(T_US, *GYRO["dps"].T, *ACCEL["mps2"].T)
ARRIVED = [f"10:00:{k / 100:06.3f} -> {line}\n" for k, line in enumerate(rows(*ACCEL["g"].T, *GYRO["dps"].T).splitlines()[:900])]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b,c,d,e,f,g\n" + OF_OTHERS, "give --columns t_UNIT=a,gx_UNIT=b,gy_UNIT=c,gz_UNIT=d,ax_mps2=e,ay_mps2=f,az_mps2=g"),
        ("Uhr;b [°/s];c,1;d;e;f;g\n" + OF_OTHERS.replace(",", ";"), "'t_UNIT=Uhr,gx_dps=b [°/s],gy_UNIT=3,gz_UNIT=d,ax_mps2=e"),
        (
            "".join(ARRIVED),
            "a serial monitor's lines: no header, 7 columns of numbers; name them by number, --columns t=7,gx_UNIT=4,.*,az_g=3",
        ),
        ("t_us,dtheta_x_deg,dtheta_y_deg,dtheta_z_deg,ax_g,ay_g,az_g\n" + OF_OTHERS, "'dtheta_x_deg' is the angle of each sample"),
    ],
)
def test_a_log_that_says_nothing_is_named_with_the_option_to_edit(text, said, tmp_path):
    with pytest.raises(FormatError, match=said.replace("[", r"\[")):
        make(tmp_path, text)


def test_a_sentence_whose_checksum_is_wrong_is_refused_by_its_line(tmp_path):
    ((_, data),) = TEXTS["VectorNav, $VNYMR"].write(SAMPLES)
    lines = data.decode().splitlines(keepends=True)
    lines[70] = lines[70].replace("+1.0", "+1.1", 1)
    with pytest.raises(FormatError, match="line 71: its checksum is wrong"):
        make(tmp_path, "".join(lines), odr_hz=104.0)
    lines[70] = "$VNINS,1,2*00\r\n"  # another kind is left out
    make(tmp_path, "".join(lines), odr_hz=104.0, out="others")


@pytest.mark.parametrize(
    ("text", "said"), [('{"a": [1, 2', "damaged JSON"), ('{"a": {"b": 1}}', "without a list"), ("[" * 99_999, "line 1: longer than")]
)
def test_a_json_document_without_readings_is_refused(text, said, tmp_path):
    with pytest.raises(FormatError, match=said):
        make(tmp_path, text)


@pytest.mark.parametrize(
    ("head", "gyro"),
    [
        ("t in s;Acc_x / m/s²;Acc_y / m/s²;Acc_z / m/s²;Gyr_x / °/s;Gyr_y / °/s;Gyr_z / °/s", (4, 5, 6)),
        ("Czas;Mag X [G];Mag Y [G];Mag Z [G];Przysp. X [g];Przysp. Y [g];Przysp. Z [g];V X [dps];V Y [dps];V Z [dps]", (7, 8, 9)),
        ("Zeit [ms];Rollrate [°/s];Nickrate [°/s];Gierrate [°/s];Beschl. X [g];Beschl. Y [g];Beschl. Z [g]", (1, 2, 3)),
        ("Zeit;Fuß X [g];Fuß Y [g];Fuß Z [g];Hand X [g];Hand Y [g];Hand Z [g];V X [dps];V Y [dps];V Z [dps]", (7, 8, 9)),
    ],
)
def test_columns_are_known_by_their_names_or_units(head, gyro):
    columns = usual_columns(head.split(";"), "log.csv")
    assert tuple(columns[f"g{axis}"][0] for axis in "xyz") == gyro
    assert ("ax" in columns) == ("Hand" not in head)  # of two accelerometers a person says which


@pytest.mark.parametrize(
    ("file", "letter"), [("Gyroscope.csv", "g"), ("imu_acc_2.json", "a"), ("rotation_vector.csv", ""), ("file.csv", ""), ("walk.csv", "")]
)
def test_a_files_name_says_whose_axes_it_holds(file, letter):
    assert set(usual_columns(("t", "x", "y", "z"), file)) == ({f"{letter}{axis}" for axis in "xyz"} if letter else set())
