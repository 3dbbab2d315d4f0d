"""Foreign logs as they are: stamps that repeat, stop and go back; torn, quoted, packed; the folder that they become."""

import gzip

import numpy as np
import pytest
from conftest import write_session
from dialect_logs import (
    ACCEL,
    ARTEMIS,
    DIALECTS,
    EPOCH_NS,
    EUROC,
    GYRO,
    NONE,
    SAMPLES,
    T_US,
    TEMP,
    clock,
    inertial,
    make,
    rows,
    same,
    triads,
)

from session.common.errors import CalibrationError, DataError, FormatError, StorageError
from session.dialects.layout import Answers
from session.dialects.stamps import exact_ns
from session.log.folder import read_session
from session.replay.convert import convert

# Time


def test_stamps_stay_exact(tmp_path):
    """Nanoseconds of an epoch, seconds of an epoch with nine decimals: a float64 would round both by some 100 ns."""
    ns = EPOCH_NS + np.arange(0, 2 * 10**9, 4_800_001)
    some = np.column_stack([np.zeros((len(ns), 5)), np.full(len(ns), -1.0)]).T
    euroc = make(tmp_path, EUROC + rows(ns, *some))
    seconds = [f"{t // 10**9}.{t % 10**9:09d}" for t in ns.tolist()]
    decimal = make(tmp_path, "Time,G_x [mdps],G_y [mdps],G_z [mdps],A_x [g],A_y [g],A_z [g]\n" + rows(seconds, *some), out="decimal")
    for made in (euroc, decimal):
        np.testing.assert_array_equal(read_session(made.folder).logs[0].samples.t_ns, ns)


def test_duplicate_and_irregular_stamps_are_ordinary(tmp_path):
    lines = inertial().split("\n")
    lines.insert(50, lines[50])
    made = make(tmp_path, "\n".join(lines[:100] + lines[103:]))
    log = read_session(made.folder).logs[0]
    assert len(log.samples) == len(SAMPLES) - 3
    assert any("repeat the stamp" in note for note in log.notes)


def test_coarse_stamps_are_counted_along(tmp_path):
    """A clock of 10 ms under 104 samples a second: the counted times are right to a fraction of the clock's step."""
    text = ARTEMIS + rows(["1/1/2024"] * len(T_US), clock(T_US, 2), *ACCEL["mg"].T, *GYRO["dps"].T, NONE, NONE, NONE, TEMP, NONE)
    made = make(tmp_path, text)
    (note,) = [note for note in made.notes if "share a stamp" in note]
    assert "counted" in note
    t_s = same(made, exact_time=False).logs[0].samples.t_s
    assert np.abs(t_s - SAMPLES.t_s).max() < 2e-3
    assert np.abs(np.diff(t_s) - 1 / 104).max() < 1e-5


def test_coarse_stamps_over_lost_samples_are_refused(tmp_path):
    keep = np.r_[0:300, 360 : len(T_US)]
    columns = [np.array(c)[keep].tolist() for c in (clock(T_US, 2), *map(list, ACCEL["mg"].T), *map(list, GYRO["dps"].T))]
    text = ARTEMIS + rows(["1/1/2024"] * len(keep), *columns, *[["0"] * len(keep)] * 5)
    with pytest.raises(DataError, match="--odr"):
        make(tmp_path, text)
    assert any("counted at 104" in note for note in make(tmp_path, text, odr_hz=104.0).notes)


def test_micros_come_round(tmp_path):
    wrapped = (T_US + 2**32 - 3_000_000) % 2**32
    text = inertial().split("\n", 1)[0] + "\n" + rows(wrapped, *triads("dps", "g"))
    made = make(tmp_path, text)
    assert any("came round 1x" in note for note in made.notes)
    same(made)


@pytest.mark.parametrize(("back_s", "start_ns"), [(3.0, EPOCH_NS), (3.9, EPOCH_NS), (4.0, 0), (3.0, 60 * 10**9)])
def test_nanoseconds_that_step_back_are_no_counter(back_s, start_ns, tmp_path):
    """A 32-bit counter of ns would come round every 4.3 s."""
    t_ns = start_ns + T_US * 1000
    t_ns[len(t_ns) // 2 :] -= round(back_s * 1e9)
    if start_ns == 0:
        t_ns += 10**9
    text = inertial().split("\n", 1)[0].replace("us", "ns") + "\n" + rows(t_ns, *triads("dps", "g"))
    with pytest.raises(FormatError, match="goes backward by"):
        make(tmp_path, text)


def test_a_counter_with_a_sign_comes_round(tmp_path):
    wrapped = (T_US + 2**31 - 3_000_000 + 2**31) % 2**32 - 2**31
    made = make(tmp_path, inertial().split("\n", 1)[0] + "\n" + rows(wrapped, *triads("dps", "g")))
    assert any("came round 1x" in note for note in made.notes)
    same(made)


@pytest.mark.parametrize("lost", [0.01, 0.05])
def test_lost_samples_leave_the_data_rate_as_it_is(lost, tmp_path):
    text = inertial().split("\n")
    kept = np.random.default_rng(1).random(len(text)) >= lost
    kept[:2] = True
    made = make(tmp_path, "\n".join(line for line, keep in zip(text, kept, strict=True) if keep) + "\n")
    assert read_session(made.folder).config.sensor.odr_hz == pytest.approx(104, rel=2e-4)


# Hostile


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: "", ("empty",)),
        (lambda text: "\n\n", ("empty",)),
        (lambda text: text.split("\n")[0] + "\n", ("no samples",)),
        (lambda text: "\0\1\2\3" * 100, ("not a text log",)),
        (lambda text: text.encode("utf-16"), ("not a text log",)),
        (lambda text: "hello\nworld\n", ("no header", "--columns")),
        (lambda text: "a,b,c\n1,2,3\n", ("no header", "'a,b,c'")),
        (lambda text: _line(text, 40, "1,2,3"), ("line 41", "3 columns")),
        (lambda text: _line(text, 40, "384615,x,0,0,0,0,0"), ("line 41", "Gyroscope X", "'x'")),
        (lambda text: _line(text, 40, "384615,,0,0,0,0,0"), ("line 41",)),
        (lambda text: _line(text, 40, "384615,nan,0,0,0,0,0"), ("line 41", "Gyroscope X", "expected a finite number")),
        (lambda text: _line(text, 40, "384615,1e999,0,0,0,0,0"), ("line 41", "is inf, expected a finite number")),
        (lambda text: _line(text, 40, "384615,0,1e308,0,0,0,0"), ("LOG.CSV line 41", "Gyroscope Y", "1e+308", "unit")),
        (lambda text: _line(text, 40, "384615,0,0,0,0,0,-1e5"), ("LOG.CSV line 41", "Accelerometer Z", "10000 g")),
        (lambda text: _line(text, 40, "nan,0,0,0,0,0,0"), ("line 41", "Timestamp")),
        (lambda text: _line(text, 40, "9" * 40 + ",0,0,0,0,0,0"), ("line 41", "Timestamp", "no time of this era")),
        (lambda text: _line(text, 40, "1_000,0,0,0,0,0,0"), ("line 41",)),
        (lambda text: _line(text, 40, "5,0,0,0,0,0,0"), ("line 41", "backward")),
    ],
)
def test_bad_files_get_one_line(change, words, tmp_path):
    with pytest.raises(CalibrationError) as caught:
        make(tmp_path, change(inertial()))
    assert all(word in str(caught.value) for word in words), caught.value
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["LOG.CSV"]


def _line(text, number, line):
    lines = text.split("\n")
    return "\n".join([*lines[:number], line, *lines[number + 1 :]])


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", ",\n"),
        lambda text: text.rstrip("\n"),
        lambda text: "\n\n" + text.replace("\n", "\n\n"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: "x-IMU3 log,v1\nserial,0123\n\n" + text,
        lambda text: text + text.split("\n")[0] + "\n",
        lambda text: text + "384615,12.5",
        lambda text: '"' + text.split("\n")[0].replace(",", '","') + '"\n' + text.split("\n", 1)[1],
    ],
    ids=[
        "bom",
        "crlf",
        "trailing comma",
        "no last newline",
        "blank lines",
        "spaces",
        "semicolons",
        "tabs",
        "preamble",
        "header again",
        "torn",
        "quoted",
    ],
)
def test_ordinary_disorder_changes_nothing(change, tmp_path):
    same(make(tmp_path, change(inertial())))


def test_a_broken_gzip_gives_what_came_before(tmp_path):
    packed = gzip.compress(inertial().encode())
    made = make(tmp_path, packed[: len(packed) // 2], name="log.csv.gz")
    assert 100 < made.samples < len(SAMPLES)
    assert any("breaks off" in note for note in made.notes)
    with pytest.raises(FormatError, match="gzip"):
        make(tmp_path, b"no gzip", name="log.csv.gz", out="other")


def test_pieces_of_a_file_join_without_a_seam(tmp_path, monkeypatch):
    from session.dialects import lines

    monkeypatch.setattr(lines.Lines.take, "__defaults__", (1000,))
    monkeypatch.setattr(lines, "READ_BYTES", 100)
    for number, text in enumerate((inertial(), DIALECTS["OpenLog Artemis"]())):
        same(make(tmp_path, text, out=f"session{number}"))
    with pytest.raises(FormatError, match="line 401"):
        make(tmp_path, _line(inertial(), 400, "1,2,3"), out="bad")


# The folder


def test_an_existing_folder_is_not_written_over(tmp_path):
    made = make(tmp_path, inertial())
    before = made.log.read_bytes()
    with pytest.raises(FormatError, match="--add"):
        make(tmp_path, inertial())
    assert made.log.read_bytes() == before


def test_a_closure_run_is_added_to_its_session(tmp_path):
    made = make(tmp_path, inertial())
    more = convert([tmp_path / "LOG.CSV"], made.folder, Answers(), add="closure")
    assert more.log.name == "closure0001.csv"
    session = read_session(made.folder)
    assert (len(session.logs), len(session.closures)) == (1, 1)
    assert convert([tmp_path / "LOG.CSV"], made.folder, Answers(), add="log").log.name == "log0002.csv"
    with pytest.raises(FormatError, match="--gyro-fs"):
        convert([tmp_path / "LOG.CSV"], made.folder, Answers(gyro_fs_dps=2000.0), add="log")


def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    import session.replay.convert as module

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "_columns", full)
    with pytest.raises(StorageError, match=r"new/folder/session: No space.*choose another folder"):
        make(tmp_path, inertial(), out="new/folder/session")
    assert [path.name for path in tmp_path.iterdir()] == ["LOG.CSV"]


def test_a_full_disk_under_a_copied_log_is_not_the_logs_fault(tmp_path, monkeypatch):
    import session.replay.convert as module

    def full(source, target):
        raise OSError(28, "No space left on device", str(source), None, str(target))

    own = (write_session(tmp_path / "own", SAMPLES) / "log0001.csv").read_bytes()
    monkeypatch.setattr(module.shutil, "copyfile", full)
    with pytest.raises(StorageError, match="session: No space") as said:
        make(tmp_path, own)
    assert "LOG.CSV" not in str(said.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["LOG.CSV", "own"]


def test_the_command_line_makes_a_session_that_fits(simulated, tmp_path, capsys):
    """A simulated session, written as a logger would, is replayed, and fits as the session itself."""
    import json

    import calibrate
    from session.log.logfile import read_log

    folder = simulated()
    sensor = read_session(folder).config.sensor
    samples = read_log(folder / "log0001.csv.gz", sensor).samples
    log = tmp_path / "sensor_combined_0.csv"
    names = ",".join([f"gyro_rad[{i}]" for i in range(3)] + [f"accelerometer_m_s2[{i}]" for i in range(3)])
    log.write_text(f"timestamp,{names}\n" + rows(samples.t_ns // 1000, *samples.gyro.T, *samples.accel.T))
    made, table = tmp_path / "made", tmp_path / "made.json"
    command = ["replay", str(log), "--out", str(made)]
    assert calibrate.main(command) == 2
    assert "--gyro-fs DPS --accel-fs G" in capsys.readouterr().err
    assert calibrate.main([*command, "--gyro-fs", "500", "--accel-fs", "4", "--json", str(table)]) == 0
    assert "next: calibrate.py check" in capsys.readouterr().out
    assert json.loads(table.read_text())["dialects"] == ["PX4 sensor_combined"]
    head, site = (made / "session.toml").read_text().split("# Fill in"), (folder / "session.toml").read_text()
    (made / "session.toml").write_text(head[0] + site[site.index("[accelerometer]") :])
    found = {}
    for where in (folder, made):
        result = tmp_path / "fit.json"
        fit = ["fit", str(where), "--methods", "least_squares", "--folds", "2", "--out", str(tmp_path / "fit"), "--quiet"]
        assert calibrate.main([*fit, "--json", str(result)]) == 0
        found[where] = json.loads(result.read_text())["methods"]["least_squares"]["train"]["tilt_rms_deg"]
    assert found[made] == pytest.approx(found[folder], rel=1e-6)


def test_no_damage_raises_anything_but_one_line(tmp_path):
    """Random damage to every dialect's file: a session, or one line and nothing left behind."""
    rng = np.random.default_rng(0)
    texts = [make_text()[:4000] for make_text in DIALECTS.values()]
    pieces = [
        "nan",
        "1e999",
        "1e999999",
        "-",
        "9" * 30,
        "\n",
        '"',
        "#",
        "0x1F",
        "1_0",
        ":",
        "12:99:aa",
        "[mg]",
        "(deg/s)",
        ",,",
        "%s",
        "\r",
        "\0",
        "é",
    ]
    outcomes = {"made": 0, "refused": 0}
    for trial in range(250):
        text = texts[rng.integers(len(texts))]
        for _ in range(rng.integers(1, 6)):
            at = int(rng.integers(len(text)))
            cut = int(rng.integers(0, 40)) if rng.random() < 0.5 else 0
            text = text[:at] + (pieces[rng.integers(len(pieces))] if rng.random() < 0.8 else "") + text[at + cut :]
        try:
            make(tmp_path, text, out=f"session{trial}", gyro_unit=[None, "lsb"][trial % 2])
            outcomes["made"] += 1
        except CalibrationError as error:
            outcomes["refused"] += len(str(error).splitlines()) == 1
            assert not (tmp_path / f"session{trial}").exists()
    assert min(outcomes.values()) > 10
    assert sum(outcomes.values()) == 250
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {"LOG.CSV"}


@pytest.mark.parametrize("text", ["nan", "inf", "1e999999", "1e400000", "", "1:2", "a:b:c", "::"])
def test_what_is_no_time(text):
    with pytest.raises(ValueError, match=r"no time|unpack|invalid"):
        exact_ns(text, 10**9)
