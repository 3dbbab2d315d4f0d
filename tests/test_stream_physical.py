"""Text streams in physical units: what they say is what the log holds, whatever the wire does to them and however they are cut."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from conftest import DEG, config
from streams import INFO, frame_list, sent

from session.bench.decoder import StreamDecoder
from session.bench.events import Info, SampleChunk, Trouble, parse_header
from session.bench.guide import samples_of
from session.bench.logwriter import LogWriter
from session.bench.session_file import SessionFile
from session.bench.text_stream import parse_decimals
from session.io.config import Sensor
from session.io.logfile import read_log
from session.io.registers import RegisterUnits
from session.replay.raw import convert_raw
from tinygc import CalibrationError

UNITS = RegisterUnits("ASM330LHH", 500, 4)
HEADER = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c"
COMMENT = b"# gyro_fs_dps=500 accel_fs_g=4 odr_hz=1666.5 serial=77 sensor=MPU-9250\n"


def values_of(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (count,) us and numbers (count, 7) in dps, g and degC with the digits that a board prints."""
    t_us, registers = sent(count, seed=seed)
    scale = [UNITS.gyro_rps / DEG] * 3 + [UNITS.accel_mps2 / 9.80665] * 3 + [1 / 256]
    return t_us, np.round(registers * np.array(scale) + np.array([0] * 6 + [25.0]), 5)


def lines_of(t_us, values, header=HEADER, time=lambda t: str(t)) -> list[bytes]:
    rows = zip(t_us.tolist(), values.tolist(), strict=True)
    return [f"{header}\n".encode(), *(f"{time(t)},{','.join(f'{x:.5f}' for x in row)}\n".encode() for t, row in rows)]


def decode(data: bytes, cuts=(), told=None) -> tuple[StreamDecoder, list]:
    decoder, events, edges = StreamDecoder(told), [], [0, *sorted(cuts), len(data)]
    for start, stop in pairwise(edges):
        events += decoder.feed(data[start:stop])
    return decoder, events + decoder.finish()


def samples(events) -> tuple[np.ndarray, np.ndarray]:
    chunks = [event for event in events if isinstance(event, SampleChunk)]
    return np.concatenate([chunk.t_us for chunk in chunks]), np.concatenate([chunk.registers for chunk in chunks])


@pytest.mark.parametrize(
    ("header", "time", "columns"),
    [
        (HEADER, str, 7),
        (HEADER.replace("t_us", "t_s"), lambda t: f"{t / 1e6:.6f}", 7),
        (HEADER.replace("t_us", "t_ns"), lambda t: str(t * 1000 + 400), 7),
        (HEADER.replace(",temp_c", ""), str, 6),
        (HEADER.replace("_dps", "_rps").replace("_g", "_mps2"), str, 7),
        (HEADER + ",note", str, 7),
    ],
)
def test_what_is_sent_is_what_the_log_holds(header, time, columns, tmp_path):
    t_us, values = values_of(400)
    values = values[:, :columns]
    lines = lines_of(t_us, values, header, time)
    if header.endswith("note"):
        lines[1:] = [line[:-1] + b",x\n" for line in lines[1:]]
    data = lines[0] + COMMENT + b"".join(lines[1:])
    decoder, events = decode(data)
    found_us, found = samples(events)
    np.testing.assert_array_equal(found_us, t_us)
    np.testing.assert_array_equal(found, values)
    assert (decoder.garbage, decoder.lost, decoder.info) == (0, 0, Info(500, 4, 1666.5, "77", "MPU-9250"))
    writer = LogWriter(tmp_path)
    writer.write(events)
    writer.close()
    assert writer.physical
    log = read_log(writer.paths[0], Sensor("unknown", "", 1667, 500, 4))
    assert not log.raw
    rad, force = ("rps" in header, "mps2" in header)
    np.testing.assert_allclose(log.samples.gyro, values[:, :3] * (1.0 if rad else DEG), rtol=1e-14)
    np.testing.assert_allclose(log.samples.accel, values[:, 3:6] * (1.0 if force else 9.80665), rtol=1e-14)
    live = samples_of(next(event for event in events if isinstance(event, SampleChunk)), config())
    np.testing.assert_allclose(live.gyro, log.samples.gyro[: len(live)], rtol=1e-14)
    np.testing.assert_allclose(live.accel, log.samples.accel[: len(live)], rtol=1e-14)
    assert (live.temp_c is None) == (columns == 6)


def test_what_ends_a_spoilt_line_is_no_line_however_the_bytes_are_cut():
    """Found by fuzzing: read byte by byte, what was kept for a search could begin within a line that had been passed over, at a header."""
    t_us, values = values_of(20)
    header, *rows = lines_of(t_us, values)
    data = b"\0\x15" + header + 30 * b"no such line as this\n" + b"".join(rows)
    whole, _ = decode(data)
    assert whole.samples == 0
    for step in (1, 7, 512):
        parts, _ = decode(data, range(step, len(data), step))
        assert (parts.garbage, parts.implausible) == (whole.garbage, whole.implausible)


def test_a_spoilt_number_beside_damage_is_left_out():
    t_us, values = values_of(400)
    lines = lines_of(t_us, values)
    lines[200] = b"\xff\xfe\n"
    cells = lines[300].split(b",")
    lines[300] = b",".join([*cells[:2], b"99.9", *cells[3:]])
    decoder, events = decode(b"".join(lines))
    assert decoder.implausible == 1
    assert t_us[299] not in samples(events)[0]
    untouched = lines_of(t_us, values)
    untouched[300] = lines[300]  # on a good wire a jump is a jump
    assert decode(b"".join(untouched))[0].implausible == 0


def test_without_its_header_it_is_nothing_and_with_the_option_all_of_it():
    t_us, values = values_of(300)
    data = b"".join(lines_of(t_us, values)[1:])
    decoder, events = decode(data)
    assert decoder.samples == 0
    assert decoder.garbage == len(data)
    _, events = decode(data, told=HEADER)
    np.testing.assert_array_equal(samples(events)[1], values)


def test_another_header_begins_another_log(tmp_path):
    t_us, values = values_of(200)
    rows = np.column_stack([t_us + 200 * 600, sent(200)[1]]).tolist()
    registers = "t_us,gx,gy,gz,ax,ay,az,temp\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    data = b"".join(lines_of(t_us, values)) + registers.encode()
    decoder, events = decode(data)
    assert decoder.resets == 1
    assert [event.kind for event in events if isinstance(event, Trouble)] == ["reset"]
    writer = LogWriter(tmp_path)
    writer.write(events)
    writer.close()
    assert [path.read_text().split("\n")[0] for path in writer.paths] == [HEADER, "t_us,gx,gy,gz,ax,ay,az,temp"]
    assert sum(len(path.read_text().split("\n")) - 2 for path in writer.paths) == 400


@pytest.mark.parametrize("first", [b"", b"frames"], ids=["before anything", "between frames"])
@pytest.mark.parametrize("header", [HEADER, "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"], ids=["as wide", "narrower"])
def test_frames_behind_a_header_of_text_are_registers(header, first):
    """Found by fuzzing: they were taken for numbers in the header's units, or failed where it has no temperature."""
    t_us, registers = sent(80)
    frames = frame_list(t_us, registers)
    before, behind = (b"".join(frames[:30]), b"".join(frames[30:])) if first else (b"", b"".join(frames))
    _, events = decode(b"\0" + before + 600 * b"x" + b"\n" + header.encode() + b"\n\0" + behind)
    chunks = [event for event in events if isinstance(event, SampleChunk)]
    assert not any(chunk.form.physical for chunk in chunks)
    got_us, got = samples(events)
    assert len(got_us) >= 70  # the one whose delimiter the text took is lost
    place = np.searchsorted(t_us, got_us)
    np.testing.assert_array_equal(t_us[place], got_us)
    np.testing.assert_array_equal(registers[place], got)


@pytest.mark.parametrize(
    "header",
    ["gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g", "t_us,gx_dps,gy_dps,gz_dps", "t_us,gx_dps,gy_rps,gz_dps,ax_g,ay_g,az_g", ""],
)
def test_what_is_no_header(header):
    assert parse_header(header.encode()) is None


@pytest.mark.parametrize("cell", ["nan", "inf", "1e999", "0x1", "01.5", "--1", "1_0", "", ".", "1.2.3", "1,", "٣"])
def test_numbers_that_are_none(cell):
    _, order, form = parse_header(HEADER.encode())
    good = parse_decimals(b"10,1.5,-.5,2.,1e-3,+0.25,0,25", order, form)
    assert good == (8, [10, 1.5, -0.5, 2.0, 0.001, 0.25, 0.0, 25.0])
    found = parse_decimals(f"10,{cell},-.5,2,1e-3,0.25,0,25".encode(), order, form)
    assert found is None or cell == "1,"  # an empty column more is another width


@pytest.mark.parametrize(("column", "number"), [(1, "100001"), (6, "-10000.1"), (7, "1e5"), (4, "1e99")])
def test_what_no_sensor_measures_is_no_line(column, number, tmp_path):
    """Found by fuzzing: it was written into a log that no command reads."""
    t_us, values = values_of(40)
    lines = lines_of(t_us, values)
    cells = lines[20].split(b",")
    lines[20] = b",".join([*cells[:column], number.encode(), *cells[column + 1 :]]).rstrip(b"\n") + b"\n"
    (tmp_path / "raw.bin").write_bytes(COMMENT + b"".join(lines))
    made = convert_raw(tmp_path / "raw.bin", tmp_path / "out")
    assert f"{len(lines[20])} bytes of garbage" in made.notes
    log = read_log(made.log, Sensor("MPU-9250", "77", 1666.5, 500, 4))
    assert len(log.samples) == 38  # a line counts when the next one follows it


def test_the_sensor_of_a_recording_is_the_one_that_is_named(tmp_path):
    """The option, then the board's comment, then ``--like``; else an ASM330LHH for registers, and nobody's for physical units."""
    named = Info(500, 4, 1666.5, "77", "MPU-9250")

    def model(name, info, option=None, physical=False):
        file = SessionFile(tmp_path / name, None, None, None, None, option)
        return file.configure(info, 0.0, physical).sensor.model, file.assumed

    assert model("a", named) == ("MPU-9250", False)
    assert model("b", named, "bmi270") == ("bmi270", False)
    assert model("c", INFO) == ("ASM330LHH", True)
    assert model("d", INFO, physical=True) == ("unknown", False)
    with pytest.raises(CalibrationError, match=r'sensor\.model is "MPU-9250", the board says BMI270'):
        SessionFile(tmp_path / "a", None, None, None, None).configure(Info(500, 4, 1666.5, "77", "BMI270"))
    again = SessionFile(tmp_path / "a", None, None, None, None, "mpu_9250").configure(named)
    assert again.sensor.model == "MPU-9250"
