"""The arrays of the MIMU22BT set as session folders: frames bit for bit, what was decoded before, and what is damaged refused."""

import io

import numpy as np
import pytest
from public_files import mimu_data, mimu_frames, write_mimu
from test_public import made, refused

from session.annexes.public.mimu import read_frames
from session.io.units import DEG, G


def test_mimu_frames_come_back_bit_for_bit(tmp_path, capsys):
    ticks, registers = mimu_data()
    path = write_mimu(tmp_path, mimu_frames(ticks, registers), number=3)
    again, same, cut = read_frames(path)
    np.testing.assert_array_equal(again, ticks - ticks[0])
    np.testing.assert_array_equal(same, registers)
    assert (same.dtype, again.dtype, cut) == (np.int16, np.int64, 0)
    sessions = made(capsys, "mimu", tmp_path)
    assert sorted(sessions) == [f"e3u{unit}" for unit in range(8)]
    for unit in range(8):
        samples = sessions[f"e3u{unit}"].logs[0].samples
        np.testing.assert_array_equal(np.rint(samples.gyro / DEG * 16.4), registers[:, unit, 3:])
        np.testing.assert_array_equal(np.rint(samples.accel / G * 2048), registers[:, unit, :3])
        np.testing.assert_array_equal(samples.t_ns, np.rint((ticks - ticks[0]) / 0.064))
    assert sessions["e3u7"].config.site.latitude_deg == 59.35


def test_mimu_decoded_before_gives_the_same_folders(tmp_path, capsys):
    ticks, registers = mimu_data()
    write_mimu(tmp_path / "a", mimu_frames(ticks, registers))
    (tmp_path / "b").mkdir()
    np.savez(tmp_path / "b" / "exp_1.npz", ticks_64mhz=ticks - ticks[0], registers=registers)
    from_frames, decoded = (made(capsys, "mimu", tmp_path / name) for name in "ab")
    assert list(from_frames) == list(decoded)
    for name, session in from_frames.items():
        for what in ("t_ns", "gyro", "accel"):
            np.testing.assert_array_equal(getattr(session.logs[0].samples, what), getattr(decoded[name].logs[0].samples, what))


def test_mimu_last_frame_may_be_cut_off(tmp_path):
    ticks, registers = mimu_data()
    frames = mimu_frames(ticks, registers)
    path = write_mimu(tmp_path, frames[:-1], tail=frames[-1][:83])
    again, _, cut = read_frames(path)
    assert (len(again), cut) == (len(ticks) - 1, 83)


def short(frames):
    frames[7] = frames[7][:50]
    return "frame 7 at byte 746"


def flipped(frames):
    frames[7] = frames[7][:20] + bytes([frames[7][20] ^ 1]) + frames[7][21:]
    return "frame 7 at byte 746"


def first_flipped(frames):
    frames[0] = frames[0][:-1] + bytes([frames[0][-1] ^ 1])
    return "no whole frame"


def lost(frames):
    del frames[9:11]
    return "2 frames are missing before frame 9"


def nothing(frames):
    del frames[:]
    return "no whole frame"


def rubbish_after(frames):
    frames.append(b"rubbish")
    return "last 7 bytes"


@pytest.mark.parametrize("spoil", [short, flipped, first_flipped, lost, nothing, rubbish_after], ids=lambda spoil: spoil.__name__)
def test_mimu_refuses_damaged_frames(tmp_path, capsys, spoil):
    frames = mimu_frames(*mimu_data())
    said = spoil(frames)
    write_mimu(tmp_path, frames)
    refused(capsys, ["mimu", tmp_path], "data.bin", said)
    assert not (tmp_path / "sessions").exists()


def pickled():
    file = io.BytesIO()
    np.savez(file, ticks_64mhz=np.array([{}], dtype=object), registers=np.zeros((1, 8, 6), np.int16))
    return file.getvalue()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", pickled()], ids=["empty", "broken", "pickled"])
def test_mimu_refuses_a_broken_archive(tmp_path, capsys, content):
    (tmp_path / "exp_1.npz").write_bytes(content)
    refused(capsys, ["mimu", tmp_path], "exp_1.npz")


def test_mimu_refuses_other_arrays_and_other_names(tmp_path, capsys):
    refused(capsys, ["mimu", tmp_path], "exp_*/data.bin")
    np.savez(tmp_path / "exp_1.npz", ticks_64mhz=np.arange(5), registers=np.zeros((5, 8, 6)))
    refused(capsys, ["mimu", tmp_path], "int16")
    (tmp_path / "exp_1.npz").rename(tmp_path / "exp_one.npz")
    refused(capsys, ["mimu", tmp_path], "exp_one.npz", "number")
