"""Logs as a session holds them, plain and packed, rest logs, and logs of other programs through the same reader."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np

from fuzz_targets.material import (
    COUNT,
    FORCES_G,
    RATES_DPS,
    REGISTER_HEADER,
    REGISTER_LINES,
    REGISTERS,
    T_US,
    UNIT_HEADER,
    UNIT_LINES,
    lines,
)
from fuzz_targets.rules import choose, finite
from session.io.config import Sensor
from session.io.dialects import Answers
from session.io.errors import CalibrationError
from session.io.logfile import read_log
from session.io.reader import Piece, Reader
from session.io.rests import read_rest

SENSOR = Sensor("ASM330LHH", "1", 104.0, 500.0, 4.0)
UNKNOWN = Sensor("no such sensor", "", 104.0, 500.0, 4.0)
SCALES = {"odr_hz": 104.0, "gyro_fs_dps": 500.0, "accel_fs_g": 4.0}
BY_NUMBER = "t_us=1,gx_dps=2,gy_dps=3,gz_dps=4,ax_g=5,ay_g=6,az_g=7"
BY_NAME = "t_ms=Time,gx=a,gy=b,gz=-c,ax_mg=d,ay_mg=e,az_mg=f,temp_c=g"
FOREIGN = (
    Answers(**SCALES),
    Answers(**SCALES, time_unit="us", gyro_unit="dps", accel_unit="g"),
    Answers(**SCALES, columns=BY_NUMBER),
    Answers(**SCALES, columns=BY_NAME, gyro_axes="y,-x,z"),
    Answers(**SCALES, columns="gx_dps=1,gy_dps=2,gz_dps=3,ax_g=4,ay_g=5,az_g=6"),
    Answers(**SCALES, time_unit="s", accel_unit="g/2048", gyro_unit="lsb"),
    Answers(**SCALES, gyro_unit="dps", accel_unit="g", packed="st"),
    Answers(**SCALES, columns="t_s=1+2*1e-9,gx_dps=3,gy_dps=4,gz_dps=5,ax_g=6,ay_g=7,az_g=8", lines="2-"),
)
MODES = ("standard", "packed", "gzip", "rest", "unknown", *FOREIGN)
SMALL = 200


def seeds() -> list[bytes]:
    """One for each way in."""
    plain = {"standard": f"{REGISTER_HEADER}\n{REGISTER_LINES}", "unknown": f"# serial=7\n{UNIT_HEADER}\n{UNIT_LINES}"}
    plain["packed"], plain["rest"] = plain["standard"], f"{REGISTER_HEADER}\n{lines(40 * T_US, REGISTERS)}"
    found = [bytes([MODES.index(mode)]) + text.encode() for mode, text in plain.items()]
    found.append(bytes([MODES.index("gzip")]) + gzip.compress(plain["unknown"].encode(), mtime=0))
    ns = lines(T_US * 1000 + 1_403_636_579_763_555_584, RATES_DPS, FORCES_G)
    clock = lines(["12/31/2023"] * COUNT, [f"23:59:{59 + t / 1e6:09.6f}" for t in T_US % 900_000], FORCES_G, RATES_DPS)
    axes = [f"{what}{axis}" for what in ("w_RS_S_{} [rad s^-1]", "a_RS_S_{} [m s^-2]") for axis in [""]]
    euroc = ",".join(name.format(axis) for name in axes for axis in "xyz")
    logs = [
        f"#timestamp [ns],{euroc}\n{ns}",
        f"rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ\n{clock}",
        lines(T_US, RATES_DPS, FORCES_G),
        "Time;a;b;c;d;e;f;g\n" + lines(T_US / 1000, RATES_DPS, FORCES_G * 1000, np.full(COUNT, 25.5), separator=";").replace(".", ","),
        lines(RATES_DPS, FORCES_G),
        "loopIteration, time (us), gyroADC[0], gyroADC[1], gyroADC[2], accSmooth[0], accSmooth[1], accSmooth[2]\n"
        + lines(np.arange(COUNT), T_US, np.rint(RATES_DPS), np.rint(FORCES_G * 2048)),
        "ready\nTimestamp[ms] A_X [mg] A_Y [mg] A_Z [mg] G_X [mdps] G_Y [mdps] G_Z [mdps]\n"
        + lines(T_US / 1000, FORCES_G * 1000, RATES_DPS * 1000, separator=" "),
    ]
    found += [bytes([len(MODES) - len(FOREIGN) + min(number, len(FOREIGN) - 1)]) + text.encode() for number, text in enumerate(logs)]
    plain_text, packed, in_columns = (len(MODES) - len(FOREIGN) + 1, len(MODES) - 2, len(MODES) - 1)
    found += [bytes([packed if re.match(r"\d+,[0-9A-F]{24}", text) else plain_text]) + text.encode() for text in forms()]
    return [*found, bytes([in_columns]) + f"x\n{lines(T_US // 10**6, T_US, RATES_DPS, FORCES_G)}".encode()]


def forms() -> list[str]:
    """Text that is no table: names and numbers on one line and on three, JSON, hexadecimal, a monitor's clock, two lines of names."""
    values = np.column_stack([RATES_DPS, FORCES_G]).tolist()
    words = "".join(f"{t},{''.join(f'{round(v) & 0xFFFF:04X}' for v in row)}\n" for t, row in zip(T_US, values, strict=True))
    pairs = [f"t:{t} gx:{a} gy:{b} gz:{c} ax:{d} ay:{e} az:{f}\n" for t, (a, b, c, d, e, f) in zip(T_US, values, strict=True)]
    three = [
        f"t: {t}\nGyro X: {a}, Y: {b}, Z: {c} dps\nAccel X: {d} Y: {e} Z: {f} g\n"
        for t, (a, b, c, d, e, f) in zip(T_US, values, strict=True)
    ]
    objects = [
        f'{{"t_us": {t}, "gyro": [{a}, {b}, {c}], "accel": {{"x": {d}, "y": {e}, "z": {f}}}}}\n'
        for t, (a, b, c, d, e, f) in zip(T_US, values, strict=True)
    ]
    table = lines(T_US, RATES_DPS, FORCES_G)
    return [
        "".join(pairs),
        "ready\n" + "".join(three),
        "".join(objects),
        words,
        "".join(f"12:30:{i % 60:02d}.000 -> {line}" for i, line in enumerate(pairs)),
        "gx,gy,gz,ax,ay,az\n" + "".join(",".join(f"0x{round(v) & 0xFFFF:04X}" for v in row) + "\n" for row in values),
        "time,gyro,,,accel,,\nus,x,y,z,x,y,z\n" + table,
    ]


def run(data: bytes, folder: Path) -> None:
    """As a session's log, a rest log, or another program's."""
    mode, data = choose(data, MODES)
    path = folder / ("log0001.csv.gz" if mode in ("packed", "gzip") else "log0001.csv")
    path.write_bytes(gzip.compress(data, 1) if mode == "packed" else data)
    if isinstance(mode, Answers):
        _foreign(path, mode)
    elif mode == "rest":
        rest = read_rest(path, SENSOR)
        finite(rest.gyro, rest.accel, rest.gyro_sd, rest.accel_sd)
        assert (np.diff(rest.number) > 0).all()
    else:
        samples = read_log(path, UNKNOWN if mode == "unknown" else SENSOR).samples
        finite(samples.gyro, samples.accel, samples.temp_c)
        assert (np.diff(samples.t_ns) > 0).all()
        assert len(samples) == len(samples.gyro) == len(samples.accel)


def _foreign(path: Path, answers: Answers) -> None:
    """In usual, and in small pieces: the same rows, unless a counter or a comma is told from more of them alone."""
    usual = list(Reader(path, answers).pieces())
    if not usual:
        return
    parts = ([getattr(piece, name) for piece in usual] for name in ("t_ns", "gyro", "accel", "temp"))
    whole = Piece(*(None if part[0] is None else np.concatenate(part) for part in parts))
    finite(whole.gyro, whole.accel, whole.temp)
    assert whole.t_ns is None or (np.diff(whole.t_ns) >= 0).all()
    try:
        pieces = list(Reader(path, answers).pieces(SMALL))
    except CalibrationError:
        return
    for name in ("gyro", "accel", "temp"):
        if (all_of_it := getattr(whole, name)) is not None:
            assert np.array_equal(all_of_it, np.concatenate([getattr(piece, name) for piece in pieces])), f"{name} depends on the pieces"
