"""``import``: options that would be ignored, files that would be left out in silence, names that mean several programs."""

import io
import zipfile

import numpy as np
import pytest
from dialect_logs import ACCEL, GYRO, SAMPLES, T_US, rows, same
from streams import frame_list, line_list, sent
from written_texts import TEXTS

from session.io.errors import FormatError
from session.io.questions import QuestionsError
from session.replay.importing import import_log, kind_named
from session.replay.sources import Answers
from tinygc import read_session

HEAD = "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ\n"
USUAL = HEAD + rows(T_US / 1e3, *ACCEL["g"].T, *GYRO["dps"].T)
TOLD = {"gyro_unit": "dps", "accel_unit": "g"}
GYR = "t_us,gx_dps,gy_dps,gz_dps\n" + rows(T_US, *GYRO["dps"].T)
ACC = "t_us,ax_g,ay_g,az_g\n" + rows(T_US, *ACCEL["g"].T)


def imported(tmp_path, path, told=None, **more):
    return import_log([path], tmp_path / "out", Answers(**(told or {})), **more)


def refused(tmp_path, path, match, told=None, **more):
    with pytest.raises(FormatError, match=match) as error:
        imported(tmp_path, path, told, **more)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()
    return error.value


def folder_of(tmp_path, **texts):
    folder = tmp_path / "phone"
    folder.mkdir()
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text)
    return folder


# Folders and archives


def test_a_folders_questions_are_asked_though_another_file_says_all(tmp_path):
    folder = folder_of(tmp_path, acc=ACC, gyr=GYR.replace("_dps", ""))
    asked = refused(tmp_path, folder, "unit of the gyroscope")
    assert isinstance(asked, QuestionsError)
    same(imported(tmp_path, folder, {"gyro_unit": "dps", "gyro_fs_dps": 500.0, "accel_fs_g": 4.0}))


def test_why_a_sensors_file_was_left_out_is_said(tmp_path):
    doubled = GYR.replace("gz_dps", "gy_dps", 1)
    folder = folder_of(tmp_path, acc=ACC, gyr=doubled, battery="level,volt\n1,2\n")
    said = str(refused(tmp_path, folder, "no gyroscope in it; files were left out"))
    assert "gyr.csv line 1" in said
    assert said.index("gyr.csv") < said.index("battery.csv")


def archive(path, *members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as file:
        for name, text in members:
            file.writestr(name, text)
    return path


def test_two_runs_in_one_archive_are_refused(tmp_path):
    path = archive(tmp_path / "a.zip", ("run1/gyr.csv", GYR), ("run1/acc.csv", ACC), ("run2/gyr.csv", GYR))
    refused(tmp_path, path, r"it holds run1/gyr\.csv and run2/gyr\.csv; unpack it, and give the files of one run")


def test_a_damaged_lzma_member_is_refused(tmp_path):
    path = archive(tmp_path / "a.zip", ("gyr.csv", GYR), method=zipfile.ZIP_LZMA)
    data = bytearray(path.read_bytes())
    data[200:2000] = bytes(range(256)) * 7 + bytes(8)
    path.write_bytes(data)
    refused(tmp_path, path, "a damaged zip archive")


@pytest.mark.parametrize("suffix", ["log", "jsonl", "ndjson"])
def test_other_endings_of_text_are_read_from_archives(suffix, tmp_path):
    made = imported(tmp_path, archive(tmp_path / "a.zip", (f"imu.{suffix}", USUAL), ("__MACOSX/._imu.csv", "\0\1")), TOLD)
    assert len(read_session(made.folder).logs[0].samples) == len(SAMPLES)


# A port's bytes


def test_a_table_that_is_named_as_a_ports_bytes_is_a_table(tmp_path):
    path = tmp_path / "x.bin"
    path.write_text(USUAL)
    assert len(read_session(imported(tmp_path, path, TOLD).folder).logs[0].samples) == len(SAMPLES)
    path.write_text(GYR)
    with pytest.raises(FormatError, match="no samples among"):  # with a board's own header it is a board's
        import_log([path], tmp_path / "b", Answers())
    path.write_text(USUAL)
    with pytest.raises(QuestionsError, match="unit of the gyroscope"):
        import_log([path], tmp_path / "c", Answers())


@pytest.mark.parametrize("wire", [frame_list, line_list])
def test_a_ports_bytes_are_told_of_in_three_lines(wire, tmp_path):
    t_us, registers = sent(500)
    path = tmp_path / "raw.bin"
    path.write_bytes(b"".join(wire(t_us, registers)))
    made = imported(tmp_path, path, {"gyro_fs_dps": 500.0, "accel_fs_g": 4.0})
    program, sensors, clock = made.took
    rate_hz = 1e6 / np.diff(t_us).mean()
    assert program.startswith("raw.bin: a port's bytes")
    assert "gx, gy, gz registers (header), ±500 dps (session.toml)" in sensors
    assert "±4 g" in sensors
    assert clock.startswith(f"clock: t_us in us, the board's own; {rate_hz:.4g} Hz for ")


@pytest.mark.parametrize(
    ("told", "more", "option"),
    [
        ({"where": "id=0"}, {}, "--where"),
        ({"like": "phyphox"}, {}, "--like"),
        ({"lines": "1-5"}, {}, "--lines"),
        ({}, {"columns": ["t_us=1"]}, "--columns"),
        ({}, {"add": "log"}, "--add"),
        ({}, {"array_by": "id"}, "--array-by"),
        ({}, {"turns": "turns.csv"}, "--turns"),
        ({}, {"serial": "7"}, "--serial"),
    ],
)
def test_what_a_ports_bytes_take_no_notice_of_is_refused(told, more, option, tmp_path):
    path = tmp_path / "raw.bin"
    path.write_bytes(b"".join(frame_list(*sent(50))))
    refused(tmp_path, path, f"of which {option} says nothing", told, **more)


# Options that do not go together


@pytest.mark.parametrize(
    ("told", "more", "match"),
    [
        ({}, {"array_by": "id", "add": "log"}, "--array-by and --add do not go together"),
        ({}, {"array_by": "id", "serial": "7"}, "--array-by and --serial"),
        ({}, {"array_by": "id", "turns": "turns.csv"}, "--array-by and --turns"),
        ({"where": "id=0"}, {"array_by": "id"}, "--array-by and --where"),
        ({}, {"turns": "turns.csv", "add": "log"}, "--turns and --add"),
        ({"topic": "imu"}, {}, "a text log has no topics; leave --topic out"),
        ({}, {"header": "t_us,gx"}, "--header is of a port's bytes"),
        ({}, {"add": "foo"}, "add is 'foo', expected log or closure"),
    ],
)
def test_options_that_would_be_ignored_are_refused(told, more, match, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(USUAL)
    refused(tmp_path, path, match, TOLD | told, **more)


# --like


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("x-imu3", "x-IMU3"),
        ("sensorlog", "SensorLog"),
        ("physics toolbox", "Physics Toolbox"),
        ("ros1 bag", "ROS 1 bag"),
        ("matlab", "MATLAB"),
        ("columns by", "columns by their names"),
        ("Names and numbers in turn", "names and numbers in turn"),
    ],
)
def test_a_beginning_that_one_name_has_is_that_name(text, name):
    assert kind_named(text) == name


@pytest.mark.parametrize(
    ("text", "match"), [("", "expected one of"), ("!", "expected one of"), ("ROS", "which may be one of ROS"), ("no", "one of")]
)
def test_a_beginning_that_no_name_or_several_have_is_refused(text, match):
    with pytest.raises(FormatError, match=match):
        kind_named(text)


def test_a_form_of_text_that_is_not_there_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(USUAL)
    assert imported(tmp_path, path, TOLD | {"like": "columns by their names"}).samples == len(SAMPLES)
    with pytest.raises(FormatError, match="and --like is 'names and numbers in turn'; leave --like out"):
        import_log([path], tmp_path / "b", Answers(**TOLD, like="names and"))
    path.write_text("\n".join(f"t:{t} ax:1 ay:0 az:8192 gx:{i % 5} gy:0 gz:1" for i, t in enumerate(T_US)) + "\n")
    told = {"sensor": "MPU-6050", "gyro_fs_dps": 500.0, "accel_fs_g": 4.0}
    assert import_log([path], tmp_path / "c", Answers(**told, like="names and")).samples == len(SAMPLES)
    path.write_bytes(TEXTS["EuRoC"].write(SAMPLES)[0][1])
    with pytest.raises(FormatError, match="read as EuRoC, and --like is 'columns by their names'"):
        import_log([path], tmp_path / "d", Answers(like="columns by their names"))


# Binary logs


def arrays_file(path):
    buffer = io.BytesIO()
    np.savez(buffer, t_s=SAMPLES.t_ns * 1e-9, gyro_rps=SAMPLES.gyro[:], acc_mps2=SAMPLES.accel[:])
    path.write_bytes(buffer.getvalue())
    return path


def test_a_binary_log_is_read_by_the_names_that_it_has(tmp_path):
    pytest.importorskip("session.annexes.logs.registry")
    path = arrays_file(tmp_path / "y.npz")
    made = imported(tmp_path, path, {"like": "numpy"})
    assert "gyro_rps[0], gyro_rps[1], gyro_rps[2] in rad/s (the file)" in made.took[1]
    assert made.took[2].startswith("clock: t_s (the file); ")
    assert made.took[0] == "y.npz: NumPy, as --like says"
    for told, match in (
        ({"like": "phyphox"}, "a log of NumPy, and --like is 'phyphox'"),
        ({"like": "MATLAB"}, "MATLAB"),
        ({"lines": "1-5"}, "--lines is of a text log"),
    ):
        with pytest.raises(FormatError, match=match):
            import_log([path], tmp_path / "b", Answers(**told))


def test_the_units_of_a_message_are_those_of_its_definition(tmp_path):
    pytest.importorskip("rosbags")
    pytest.importorskip("session.annexes.logs.registry")
    from written_logs import write_ros1

    write_ros1(tmp_path / "a.bag", SAMPLES.t_ns[:300], SAMPLES.gyro[:300], SAMPLES.accel[:300])
    made = imported(tmp_path, tmp_path / "a.bag")
    assert "angular_velocity.x, angular_velocity.y, angular_velocity.z in rad/s (as that message is defined)" in made.took[1]
    assert made.took[2].startswith("clock: the stamps of /imu")


# Arrays


def test_what_is_found_in_every_unit_is_said_once(tmp_path):
    pytest.importorskip("session.annexes.arrays.importing")
    readings = np.column_stack([GYRO["dps"], ACCEL["g"]])
    cells = [
        f"{t},{unit},{','.join(f'{value + 1e-9 * unit:.9f}' for value in row)}\n"
        for t, row in zip(T_US, readings, strict=True)
        for unit in range(3)
    ]
    path = tmp_path / "three.csv"
    path.write_text("t_us,id,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "".join(cells))
    made = imported(tmp_path, path, array_by="id")
    found = [(finding.level, finding.what, finding.says) for finding in made.findings]
    assert len(found) == len(set(found))
    assert any(finding.where.startswith("unit0, unit1, unit2 ") for finding in made.findings)
    assert sum("is assumed" in note for note in made.notes) == 2
