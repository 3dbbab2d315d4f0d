"""session.toml: what it means, what is added to it, and that every complaint names file, key, expectation and value."""

import numpy as np
import pytest
from conftest import SESSION_TOML

from session.base.errors import FormatError
from session.base.units import STANDARD_GRAVITY_MPS2
from session.log.config import Accelerometer, LeftOut, StillByHand, read_config
from session.log.folder import add_by_hand, add_notes, remove_by_hand
from tinygc import CalibrationError


def read(tmp_path, text):
    path = tmp_path / "session.toml"
    path.write_text(text)
    return read_config(path)


def test_a_full_file_is_read(tmp_path):
    config = read(
        tmp_path,
        SESSION_TOML
        + "heading_deg = -12.5\n[accelerometer]\nmatrix = [[1.01,0,0],[0,0.99,0],[0,0,1]]\nbias_mps2 = [0.1,-0.2,0.3]\n"
        + '[protocol]\nstill_s = 2\nsegment_s = 6.5\nreference = "table"\n',
    )
    assert config.sensor.odr_hz == 208.0
    assert (config.sensor.gyro_fs_dps, config.sensor.accel_fs_g, config.sensor.serial) == (500, 4, "42")
    assert (config.site.latitude_deg, config.site.gravity_mps2, config.site.heading_deg) == (31.03, 9.7946, -12.5)
    assert (config.protocol.still_s, config.protocol.segment_s, config.protocol.reference) == (2.0, 6.5, "table")
    assert config.accelerometer.matrix[0, 0] == 1.01


def test_what_is_optional_has_the_defaults_of_formats(tmp_path):
    config = read(tmp_path, 'schema = "tinygc-session/1"\n[sensor]\nodr_hz = 104\ngyro_fs_dps = 250\naccel_fs_g = 2\n')
    assert config.site.latitude_deg is None
    assert config.site.expected_gravity_mps2 == STANDARD_GRAVITY_MPS2
    assert (config.protocol.still_s, config.protocol.segment_s, config.protocol.reference) == (1.0, 5.0, "gravity")
    np.testing.assert_array_equal(config.accelerometer.matrix, np.eye(3))
    np.testing.assert_array_equal(config.accelerometer.bias_mps2, np.zeros(3))


def test_the_pre_calibration_undoes_offset_and_matrix():
    matrix = np.array([[1.01, 0.002, 0], [-0.003, 0.99, 0.004], [0, 0, 1.02]])
    bias = np.array([0.1, -0.2, 0.3])
    truth = np.array([[0, 0, -9.8], [9.8, 0, 0], [1.0, 2.0, 3.0]])
    measured = truth @ np.linalg.inv(matrix).T + bias
    np.testing.assert_allclose(Accelerometer(matrix, bias).correct(measured), truth, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('schema = "tinygc-session/2"\n', "tinygc-session/2"),
        (SESSION_TOML.replace("odr_hz = 208.0\n", ""), "sensor.odr_hz is missing"),
        (SESSION_TOML.replace("31.03", "131.03"), "site.latitude_deg is 131.03"),
        (SESSION_TOML.replace("9.7946", "979.46"), "site.gravity_mps2 is 979.46"),
        (SESSION_TOML + '[protocol]\nreference = "dial"\n', '"dial"'),
        (SESSION_TOML + "[accelerometer]\nmatrix = [[1,0],[0,1]]\n", "accelerometer.matrix"),
        (SESSION_TOML + "[accelerometer]\nmatrix = [[1,0,0],[0,1,0],[0,1,0]]\n", "singular"),
        (SESSION_TOML + "[accelerometer]\nsigma_mg = 0.3\n", "accelerometer.sigma_mg is of a calibration that is not there"),
        (SESSION_TOML + "[accelerometer]\nown_stills = true\n", "accelerometer.own_stills is of a calibration that is not there"),
        (SESSION_TOML.replace("208.0", "1" + "0" * 5000), "broken TOML"),
        (SESSION_TOML.replace("208.0", "0x" + "f" * 5000), "sensor.odr_hz is a number of thousands of digits"),
        (SESSION_TOML + f"[accelerometer]\nbias_mps2 = [0, 0, 1{'0' * 400}]\n", "accelerometer.bias_mps2[2] is 1000"),
        (SESSION_TOML + "[accelerometer]\nmatrix = [[1e200,0,0],[0,1e200,0],[0,0,1e200]]\n", "accelerometer.matrix"),
        (SESSION_TOML + "[site\n", "broken TOML"),
        (SESSION_TOML + "[notes]\na = [1]\n", "notes.a is a list of 1, expected text, a number or a date"),
        (SESSION_TOML + '[[exclude]]\nlog = "log0001.csv"\n', "exclude[0].at_s is"),
    ],
)
def test_a_complaint_names_the_key_and_the_value(tmp_path, text, said):
    with pytest.raises(FormatError) as error:
        read(tmp_path, text)
    assert said in str(error.value)
    assert "session.toml" in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "key", "near"),
    [
        ("latitude_deg", "latitude", "site.latitude", "site.latitude_deg"),
        ("serial =", "heading_deg = 3.0\nserial =", "sensor.heading_deg", "site.heading_deg"),
        ("[sensor]", "still_s = 2\n[sensor]", "still_s", "protocol.still_s"),
        ("[site]", "[weather]\nkind = 3\n[site]", "weather.kind", None),
    ],
)
def test_a_key_that_nothing_reads_is_named_with_the_nearest_known_one(tmp_path, old, new, key, near):
    config = read(tmp_path, SESSION_TOML.replace(old, new, 1))
    assert config.unknown == ((key, near),)


def test_a_file_that_is_missing_no_text_or_a_folder_is_refused(tmp_path):
    path = tmp_path / "session.toml"
    with pytest.raises(CalibrationError, match=r"session.toml.*log\*\.csv"):
        read_config(path)
    path.write_bytes(b"\xff\xfe\x00s\x00c")
    with pytest.raises(FormatError, match="broken TOML"):
        read_config(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(CalibrationError):
        read_config(path)


# Notes and moments that are added

NOTES = """
[notes]  # of the bench
operator = "Mara"   # she turned

"room temperature" = 21.5
date = 2026-11-22

[site2]
x = 1
"""


def file_of(tmp_path, text):
    path = tmp_path / "session.toml"
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize("text", [SESSION_TOML.rstrip("\n"), (SESSION_TOML + NOTES).replace("\n", "\r\n"), "\ufeff" + SESSION_TOML])
def test_what_is_added_leaves_every_line_as_it_was(tmp_path, text):
    path = file_of(tmp_path, text)
    add_notes(path, {"place": "cellar", 'q"1"': 'say "hi"\\ 😀'})
    add_by_hand(path, LeftOut("log0001.csv", 12.5))
    add_notes(path, {"later": "x"})
    with path.open(encoding="utf-8", newline="") as file:
        now = file.read()
    before, after = text.splitlines(), iter(now.splitlines())
    assert all(line in after for line in before), "a line was lost, changed or moved"
    config = read_config(path)
    assert list(config.notes)[-3:] == ["place", 'q"1"', "later"]
    assert config.notes['q"1"'] == 'say "hi"\\ 😀'
    assert config.exclude == (LeftOut("log0001.csv", 12.5),)
    assert not list(tmp_path.glob(".*"))


ROWS = [LeftOut("log0001.csv", 12.5), StillByHand("log0001.csv", 1.25, 1.0, 2.5), StillByHand("log0002.csv", 3.75)]


@pytest.mark.parametrize("text", [SESSION_TOML.rstrip("\n"), SESSION_TOML + NOTES, "\ufeff" + SESSION_TOML + "# the last word\n"])
def test_what_a_person_changed_is_taken_back_to_the_same_text(tmp_path, text):
    path = file_of(tmp_path, text)
    texts = [path.read_bytes()]
    for row in ROWS:
        add_by_hand(path, row)
        texts.append(path.read_bytes())
    config = read_config(path)
    assert (*config.exclude, *config.still) == tuple(ROWS)
    for row, before in zip(reversed(ROWS), reversed(texts[:-1]), strict=True):
        remove_by_hand(path, row)
        assert path.read_bytes() == before
    with pytest.raises(FormatError, match=r"\[\[exclude\]\] of log0001.csv at 12.5 s is not there any more"):
        remove_by_hand(path, ROWS[0])


def test_a_row_in_a_persons_own_form_is_taken_back_among_others(tmp_path):
    rows = "# why\n[[still]] # the door\nat_s = 3.75\nlog = 'log0002.csv'\n\n[[still]]\nlog = 'a.csv' # kept\nat_s = 1\n"
    path = file_of(tmp_path, SESSION_TOML + rows)
    remove_by_hand(path, ROWS[2])
    assert read_config(path).still == (StillByHand("a.csv", 1),)
    assert path.read_text(encoding="utf-8").startswith(SESSION_TOML.rstrip("\n"))
    assert "# kept" in path.read_text(encoding="utf-8")


def test_a_note_is_never_lost(tmp_path):
    path = file_of(tmp_path, SESSION_TOML + NOTES)
    before = path.read_bytes()
    add_notes(path, {"operator": "Mara"})
    assert path.read_bytes() == before
    with pytest.raises(FormatError, match=r'notes.operator is "Mara" already'):
        add_notes(path, {"operator": "Tom", "new": "y"})
    assert path.read_bytes() == before
