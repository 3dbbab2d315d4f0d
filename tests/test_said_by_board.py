"""What a board says of itself: what is written of it into session.toml can be read again, or it is refused and nothing is written."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import decode, line_list, sent

from session.bench import frames
from session.bench.events import Info
from session.bench.session_file import SessionFile, toml_text
from session.io.config import read_config
from session.io.errors import StorageError
from tinygc import CalibrationError, read_session

numbers = st.one_of(
    st.sampled_from([500.0, 4.0, 416.0, 1666.5, 1.0, 2000.0, 1e-9, 1e9, 0.1, 333.3333333, 65535.0]),
    st.floats(min_value=1e-6, max_value=1e6, exclude_min=True, exclude_max=True),
)
ODD = ["", "77", "ASM330LHH", "MPU-9250", "nobody's", "\U0001f600", 'S/N "7"\\', "#", "a\x85b", "\udc80", " "]
words = st.one_of(st.sampled_from(ODD), st.text(max_size=30))
infos = st.builds(Info, *(st.one_of(st.just(usual), numbers) for usual in (500.0, 4.0, 416.0)), words, words)
SETTINGS = settings(max_examples=150, deadline=None, derandomize=True)


def file_of(folder: Path) -> SessionFile:
    return SessionFile(folder, None, None, None, None)


def is_read_or_refused(info: Info, physical: bool) -> bool:
    """Whether session.toml was written; if so, it is read as what was meant, and the same board goes on with it."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "s"
        refused, config = None, None
        try:
            config = file_of(folder).configure(info, 0.0, physical)
        except CalibrationError as error:
            refused = str(error)
        if config is None:
            assert refused is not None
            assert refused.isprintable()
            assert list(folder.iterdir()) == []
            return False
        read = read_config(folder / "session.toml")
        assert read.sensor == config.sensor
        assert toml_text(read) == (folder / "session.toml").read_text("utf-8")
        assert [path.name for path in folder.iterdir()] == ["session.toml"]
        assert file_of(folder).configure(info, 0.0, physical).sensor == read.sensor  # the same board, resumed
        if not physical:
            assert read.sensor.register_units.gyro_rps > 0
            (folder / "log0001.csv").write_bytes(b"t_us,gx,gy,gz,ax,ay,az,temp\n" + b"".join(line_list(*sent(200))))
            assert len(read_session(folder).logs[0].samples) == 200
        return True


@pytest.mark.broad
@SETTINGS
@given(infos, st.booleans())
def test_whatever_a_board_says_is_read_again_or_refused(info, physical):
    is_read_or_refused(info, physical)


@SETTINGS
@given(st.integers(0, 65535), st.integers(0, 65535), st.floats(width=32), st.integers(0, 2**32 - 1))
def test_whatever_an_info_frame_says_is_read_again_or_refused(gyro, accel, odr_hz, serial):
    body = frames.INFO.pack(frames.INFO_TYPE, 0, gyro, accel, odr_hz, serial)
    data = frames.encode_blocks(np.frombuffer(body, np.uint8)[None]).tobytes()
    decoder, _ = decode(b"".join(row.tobytes() for row in frames.encode_samples(np.arange(5), 600 * np.arange(5), sent(5)[1])) + data)
    if decoder.info is not None:
        is_read_or_refused(decoder.info, False)


@pytest.mark.parametrize(
    ("info", "says"),
    [
        (Info(500.0, 4.0, 9e4, "7"), "sensor.odr_hz is 90000.0, expected a number from 0.1 to 50000"),
        (Info(500.0, 5e4, 416.0, "7"), "sensor.accel_fs_g is 50000, expected"),
        (Info(1.0, 4.0, 416.0, "7"), "gyro_fs_dps = 1 is no ASM330LHH full scale"),
        (Info(500.0, 1.0, 416.0, "7"), "accel_fs_g = 1 is no ASM330LHH full scale"),
        (Info(500.0, 4.0, 416.0, "7", "nobody's"), "its registers are not known"),
    ],
)
def test_what_no_sensor_has_is_refused_before_it_is_written(info, says, tmp_path):
    with pytest.raises(CalibrationError, match=r"session\.toml: not written: ") as said:
        file_of(tmp_path).configure(info)
    assert says in str(said.value)
    assert "--odr, --gyro-fs, --accel-fs, --sensor" in str(said.value)
    assert list(tmp_path.iterdir()) == []
    right = SessionFile(tmp_path, None, 416.0, 500.0, 4.0, "ASM330LHH")
    assert right.configure(None).sensor.odr_hz == 416.0


def test_a_disk_that_fills_while_it_is_written_leaves_no_half_of_it(tmp_path, monkeypatch):
    def full(file: int) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="No space left on device; free space there, or choose another folder"):
        file_of(tmp_path).configure(Info(500.0, 4.0, 416.0, "7"))
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    file = file_of(tmp_path)
    (tmp_path / "session.toml").write_text("mine")  # put there meanwhile
    with pytest.raises(StorageError, match="File exists"):
        file.configure(Info(500.0, 4.0, 416.0, "7"))
    assert (tmp_path / "session.toml").read_text() == "mine"
