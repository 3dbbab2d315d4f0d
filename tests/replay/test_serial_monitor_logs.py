"""Logs of a serial monitor as the sketches of well-known libraries print them; and units, sensors and columns that physics decides."""

from dataclasses import dataclass

import numpy as np
import pytest
from conftest import DEG, Table

from session.base.errors import FormatError
from session.base.questions import QuestionsError
from session.base.units import G
from session.replay.convert import convert
from session.replay.options import Answers
from tinygc import read_session

MOVED = Table().tumble(6, seed=3, turn_s=3.0).samples(odr_hz=52)
RATES, FORCES = MOVED.gyro / DEG, MOVED.accel / G
#: an MPU-6050's registers at ±500 dps and ±4 g
COUNTS = np.column_stack([np.rint(FORCES * 8192), np.rint(RATES * 65.5)]).astype(int)
MS = MOVED.t_ns // 1_000_000 + 3214
NUMBERS = [f"{a[0]:.4f},{a[1]:.4f},{a[2]:.4f},{g[0]:.3f},{g[1]:.3f},{g[2]:.3f}" for a, g in zip(FORCES, RATES, strict=True)]
BOOT = ("ets Jul 29 2019 12:21:46", "", "rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST_FLASH_BOOT)", "entry 0x400805f0", "MPU6050 Found!", "")


def clock(ms):
    """The time of day of a monitor, which was begun a second before midnight."""
    ms = (int(ms) + 86_395_000) % 86_400_000
    return f"{ms // 3_600_000:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d}.{ms % 1000:03d}"


def ide(records, before=()):
    """The lines of the Arduino IDE with its time stamps."""
    lines = [f"{clock(ms)} -> {line}" for ms, record in zip(MS, records, strict=True) for line in record]
    return [f"{clock(MS[0])} -> {line}" for line in before] + lines


def of(line):
    """A record of each sample; line: of forces and rates."""
    return [line(a, g) for a, g in zip(FORCES, RATES, strict=True)]


def counted(line):
    """A line with six registers a sample."""
    return [[line.format(*row)] for row in COUNTS]


def flat(records):
    """Their lines."""
    return [line for record in records for line in record]


@dataclass(frozen=True)
class Log:
    """lines; rate, force: rounding of what is printed, dps and g; asked: whether the rate is; end: of lines; torn: of the ends' lines;
    read: what the import states of the gyroscope's unit."""

    lines: list[str]
    rate: float = 6e-4
    force: float = 6e-5
    asked: bool = False
    end: str = "\n"
    torn: bool = False
    read: str = "in dps"


MPU = {"rate": 0.51 / 65.5, "force": 0.51 / 8192, "read": "65.5 counts/dps"}
ADAFRUIT = of(
    lambda a, g: [
        f"Acceleration X: {a[0] * G:.4f}, Y: {a[1] * G:.4f}, Z: {a[2] * G:.4f} m/s^2",
        f"Rotation X: {g[0] * DEG:.4f}, Y: {g[1] * DEG:.4f}, Z: {g[2] * DEG:.4f} rad/s",
        "Temperature: 26.53 degC",
        "",
    ]
)
LIGHT = of(
    lambda a, g: [
        "TEMPERATURE: 26.53",
        f"ACCELERO  X: {a[0]:.4f}\tY: {a[1]:.4f}\tZ: {a[2]:.4f}",
        f"GYRO      X: {g[0]:.3f}\tY: {g[1]:.3f}\tZ: {g[2]:.3f}",
        "ACC ANGLE X: 0.12\tY: -0.54",
        "=====================================================",
        "",
    ]
)
SPARKFUN = of(
    lambda a, g: [
        *("", "Accelerometer:", *(f" {n} = {x:.4f}" for n, x in zip("XYZ", a, strict=True))),
        *("", "Gyroscope:", *(f" {n} = {x:.4f}" for n, x in zip("XYZ", g, strict=True))),
        *("", "Thermometer:", " Degrees C = 26.53"),
    ]
)
ICM = of(
    lambda a, g: [
        f"Scaled. Acc (mg) [ {1e3 * a[0]:08.2f}, {1e3 * a[1]:08.2f}, {1e3 * a[2]:08.2f} ], "
        f"Gyr (DPS) [ {g[0]:08.2f}, {g[1]:08.2f}, {g[2]:08.2f} ], Mag (uT) [ 00012.30, -00004.10, 00033.00 ], Tmp (C) [ 00026.50 ]"
    ]
)
WINER = of(
    lambda a, g: [
        "".join(f"{n}-acceleration: {1e3 * x:.2f} mg " for n, x in zip("XYZ", a, strict=True))
        + " ".join(f"{n}-gyro rate: {x:.3f} degrees/sec" for n, x in zip("XYZ", g, strict=True))
    ]
)
PLOTTER = of(lambda a, g: [",".join(f"{n}:{x:.4f}" for n, x in zip(("gx", "gy", "gz", "ax", "ay", "az"), (*g, *a), strict=True))])
BOLDER = of(lambda a, g: ["\t".join(f"{x:.6f}" for x in (*(a * G), *(g * DEG))) + "\t26.53"])
STAMPED = [f"{ms},{row}" for ms, row in zip(MS, NUMBERS, strict=True)]
LOGS = {
    "Adafruit_MPU6050, with the IDE's clock": Log(
        ide(ADAFRUIT, ("Adafruit MPU6050 test!", "MPU6050 Found!", "")), 3.1e-3, 6e-6, read="rad/s"
    ),
    "Adafruit_MPU6050": Log([*BOOT, *flat(ADAFRUIT)], 3.1e-3, 6e-6, asked=True, end="\r\n", read="rad/s"),
    "jrowberg": Log([*BOOT, "-76\t-2359\t1688\t0\t0\t0\t", *flat(counted("a/g:\t{}\t{}\t{}\t{}\t{}\t{}"))], **MPU, asked=True, end="\r\n"),
    "jrowberg, with the IDE's clock": Log(ide(counted("a/g:\t{}\t{}\t{}\t{}\t{}\t{}"), ("Initializing I2C devices...",)), **MPU),
    "aX = 12 | gX = 3": Log(ide(counted("aX = {} | aY = {} | aZ = {} | tmp = 26.53 | gX = {} | gY = {} | gZ = {}")), **MPU),
    "AcX = 12 | GyX = 3": Log(ide(counted("AcX = {} | AcY = {} | AcZ = {} | Tmp = 26.53 | GyX = {} | GyY = {} | GyZ = {}")), **MPU),
    "X: 12 Y: 3 of one sensor": Log(ide(counted("X: {} Y: {} Z: {} GX: {} GY: {} GZ: {}")), **MPU),
    "MPU6050_light": Log(ide(LIGHT, ("MPU6050 status: 0", "Calculating offsets, do not move MPU6050"))),
    "SparkFun LSM6DS3": Log(ide(SPARKFUN)),
    "SparkFun ICM-20948": Log(ide(ICM, ("Initialization of the sensor returned: All is well.",)), 6e-3, 6e-6, read="in dps"),
    "Kris Winer": Log(ide(WINER), 6e-4, 6e-6, read="degrees/sec"),
    "Bolder Flight": Log(ide(BOLDER), 6e-5, 6e-7, read="in rad/s"),
    "Serial Plotter": Log(flat(PLOTTER), asked=True, end="\r\n"),
    "Serial Plotter, with the IDE's clock": Log(ide(PLOTTER)),
    "Arduino_LSM6DS3": Log(
        ide(of(lambda a, g: ["\t".join(f"{x:.4f}" for x in (*a, *g))]), ("Gyroscope sample rate = 104.00 Hz", "X\tY\tZ\tX\tY\tZ")), 6e-5
    ),
    "a table behind boot lines": Log([*BOOT, "time,ax,ay,az,gx,gy,gz", *STAMPED], torn=True),
    "numbers alone, torn at both ends": Log(STAMPED, torn=True),
    "numbers alone, with the IDE's clock": Log(ide([[row] for row in STAMPED], ("Starting...",))),
    "six numbers": Log(list(NUMBERS), asked=True),
    "six numbers, with the IDE's clock": Log(ide([[row] for row in NUMBERS])),
    "PlatformIO": Log(["--- Quit: Ctrl+C"] + [f"{clock(ms)} > {row}" for ms, row in zip(MS, NUMBERS, strict=True)]),
    "Tera Term": Log([f"[2026-05-03 {clock(ms)}] {row}" for ms, row in zip(MS, NUMBERS, strict=True)]),
    "CoolTerm": Log([f"2026-05-03 {clock(ms)} {row}" for ms, row in zip(MS, NUMBERS, strict=True)]),
    "PuTTY": Log(["=~=~=~= PuTTY log 2026.05.03 14:03:07 =~=~=~=", "time,ax,ay,az,gx,gy,gz", *STAMPED], end="\r\n"),
}


def made_of(path, text, **answers):
    path.write_bytes(text.encode())
    made = convert([path], path.with_suffix(""), Answers(**answers))
    return made, read_session(made.folder).logs[0].samples


@pytest.mark.parametrize("name", LOGS)
def test_a_log_of_a_serial_monitor_is_read_without_a_question_but_for_a_rate_that_nothing_states(name, tmp_path):
    log, path, answers = LOGS[name], tmp_path / "monitor.txt", {}
    text = log.end.join(log.lines) + log.end
    if log.torn:
        text = f"{text}{log.lines[-1][:11]}" if log.lines[0] == BOOT[0] else f"{log.lines[0][9:]}\n{text}{log.lines[-1][:11]}"
    if log.asked:
        with pytest.raises(QuestionsError) as refused:
            made_of(path, text)
        assert [question.option for question in refused.value.questions] == ["--odr HZ"]
        answers["odr_hz"] = 52.0
    made, samples = made_of(path, text, **answers)
    assert log.read in made.took[1]
    assert len(samples) == len(MOVED)
    np.testing.assert_allclose(samples.gyro, MOVED.gyro, atol=log.rate * DEG)
    np.testing.assert_allclose(samples.accel, MOVED.accel, atol=log.force * G)
    np.testing.assert_allclose((samples.t_ns - samples.t_ns[0]) * 1e-9, MOVED.t_s - MOVED.t_s[0], atol=0.02)


# What physics decides, against what a log's names state.


def table(t, gyro, accel, names):
    """A table of these columns; t (N,) as it is written."""
    rows = (",".join(f"{x:.10g}" for x in row) for row in np.column_stack([t, gyro, accel]))
    return "\n".join([names, *rows, ""])


S = MOVED.t_s + 3.2
PLAIN = "t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"


@pytest.mark.parametrize(
    ("text", "states"),
    [
        (table(S, FORCES, RATES, PLAIN), "gyroscope: ax_g, ay_g, az_g in dps (by gravity)"),
        (table(S, FORCES * G, MOVED.gyro, "time [s],gx,gy,gz,ax,ay,az"), "accelerometer: gx, gy, gz in m/s2 (by gravity)"),
        (table(S * 1e3, RATES, FORCES, PLAIN), "clock: t_s in ms (by gravity)"),
        (table(S, MOVED.gyro, MOVED.accel, PLAIN), "gyroscope: gx_dps, gy_dps, gz_dps in rad/s (by gravity)"),
        (table(S * 1e6, RATES, FORCES, PLAIN.replace("t_s", "time_ms")), "clock: time_ms in us (by gravity)"),
        (table(S, MOVED.gyro, FORCES, PLAIN), "gyroscope: gx_dps, gy_dps, gz_dps in rad/s (by gravity)"),
        (table(S, RATES, FORCES, PLAIN.replace("dps", "rps")), "gyroscope: gx_rps, gy_rps, gz_rps in dps (by gravity)"),
        (table(S, RATES, MOVED.accel, PLAIN), "accelerometer: ax_g, ay_g, az_g in m/s2 (by gravity)"),
        (
            table(S * 1e6, *np.hsplit(COUNTS[:, [3, 4, 5, 0, 1, 2]], 2), "t_us,gx,gy,gz,ax,ay,az"),
            "gy, gz 65.5 counts/dps (by gravity), ±500",
        ),
        (
            table(S * 1e6, np.rint(RATES / 0.00875), np.rint(FORCES * 16384), "t_us,gx,gy,gz,ax,ay,az"),
            "in counts of 8.75 mdps (by gravity), ±250 dps accelerometer: ax, ay, az 16384 counts/g (by gravity), ±2 g",
        ),
    ],
)
def test_units_and_sensors_that_are_named_wrongly_are_read_by_physics_and_it_is_stated(text, states, tmp_path):
    made, samples = made_of(tmp_path / "log.csv", text)
    assert states in " ".join(made.took)
    np.testing.assert_allclose(samples.gyro, MOVED.gyro, atol=0.008 * DEG)
    np.testing.assert_allclose(samples.accel, MOVED.accel, atol=7e-5 * G)
    np.testing.assert_allclose(np.diff(samples.t_ns), np.diff(MOVED.t_ns), atol=20)


def test_stamps_in_ms_of_a_rate_that_a_sensor_could_have_in_s_are_in_ms(tmp_path):
    made, samples = made_of(tmp_path / "log.csv", table(S * 500, 2 * RATES, FORCES, PLAIN))  # 104 Hz: mdps in s turn as far
    assert made.took[-1].startswith("clock: t_s in ms (by gravity)")
    assert "gz_dps in dps (by gravity)" in made.took[1]
    np.testing.assert_allclose(samples.gyro, 2 * MOVED.gyro, atol=0.008 * DEG)


def test_what_a_person_states_stays_and_files_may_be_exchanged(tmp_path):
    """Where physics does not decide, as at rest, all is asked."""
    made, samples = made_of(tmp_path / "log.csv", table(S, MOVED.gyro, FORCES, PLAIN), gyro_unit="dps")
    assert "in dps (as given)" in made.took[1]
    np.testing.assert_allclose(samples.gyro, MOVED.gyro * DEG, atol=1e-9)
    for name, values, unit in (("Gyroscope", MOVED.accel, "rad/s"), ("Accelerometer", MOVED.gyro, "m/s^2")):
        names = [f"Time (s),{name} x ({unit}),{name} y ({unit}),{name} z ({unit})"]
        rows = (",".join(f"{x:.10g}" for x in (t, *row)) for t, row in zip(S, values, strict=True))
        (tmp_path / f"{name}.csv").write_text("\n".join([*names, *rows, ""]))
    made = convert([tmp_path / "Gyroscope.csv", tmp_path / "Accelerometer.csv"], tmp_path / "two", Answers())
    np.testing.assert_allclose(read_session(made.folder).logs[0].samples.gyro, MOVED.gyro, atol=1e-8)
    rest = Table().rest(20).samples(odr_hz=52)
    still = table(rest.t_s, rest.gyro, rest.accel * 0.4, "time [s],gx,gy,gz,ax,ay,az")
    with pytest.raises(QuestionsError, match=r"give --gyro-unit .* --accel-unit"):
        made_of(tmp_path / "rest.csv", still)
    nameless = "\n".join(still.splitlines()[1:])
    with pytest.raises(FormatError, match="no header, 7 columns of numbers"):
        made_of(tmp_path / "nameless.csv", nameless)


def test_stamps_of_arrival_are_counted_evenly_unless_the_readings_went_along_with_them(tmp_path):
    """A terminal receives samples some ms late.  Where the sensor was read at those moments, the stamps are right, and stay."""
    moved = Table().tumble(12, seed=3, turn_s=3.0).samples(odr_hz=104)
    t_s = moved.t_ns * 1e-9
    arrived_s = np.maximum.accumulate(t_s + np.random.default_rng(1).exponential(2e-3, len(t_s)))
    counts = np.hstack([moved.accel / G * 8192, moved.gyro / DEG * 65.5])
    for name, at_s, stamps in (("even", t_s, "evenly by the stamps (104 Hz)"), ("uneven", arrived_s, "time of day (103.5 Hz)")):
        log, rows = tmp_path / f"{name}.txt", np.rint([np.interp(at_s, t_s, axis) for axis in counts.T]).astype(int).T
        line = "{} -> aX = {} | aY = {} | aZ = {} | gX = {} | gY = {} | gZ = {}"
        lines = [line.format(clock(round(1e3 * at)), *row) for at, row in zip(arrived_s, rows, strict=True)]
        log.write_text("\n".join([f"{lines[0].split(' ->')[0]} -> MPU6050 Found!", *lines, ""]))
        made = convert([log], tmp_path / name, Answers())
        assert made.read_as == f"read as: MPU-6050 at ±500 dps, {stamps}, gyro in dps/65.5, accelerometer in g/8192"
        sensor, samples = made.session.config.sensor, made.session.logs[0].samples
        assert (sensor.model, sensor.even_sigma_ppm is not None) == ("MPU-6050", name == "even")
        assert f"{log.name}: the sensor is MPU-6050, as a line without readings states" in made.notes
        assert name == "uneven" or np.ptp(samples.t_s - t_s) < 3e-4
