"""The dialects.  A new one is one entry.

Names are those of the header without unit, in small letters; ``{}`` stands for the axis.  A unit in the header, in [] or (), always
counts; the units here are those that the dialect is documented to use where its header says none.  No unit here and none in the
header: it is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Dialect:
    """name as the notes call it; signature: columns that must be there to recognise it; time: column, the first of these that is there
    (a clock is seen as one); gyro and accel with {} for the axis (axes: its three names); temp; units where the header has none;
    frame: what is documented of its axes."""

    name: str
    time: tuple[str, ...]
    gyro: str
    accel: str
    temp: str = ""
    axes: str = "xyz"
    signature: tuple[str, ...] = ()
    time_unit: str = ""
    gyro_unit: str = ""
    accel_unit: str = ""
    frame: str = ""


DIALECTS = (
    Dialect(
        "x-IMU3",
        time=("timestamp", "time"),
        gyro="gyroscope {}",
        accel="accelerometer {}",
        temp="temperature",
        frame="x-io's axes, z up when level",
    ),
    Dialect(
        "EuRoC", time=("timestamp",), gyro="w_rs_s_{}", accel="a_rs_s_{}", time_unit="ns", frame="the sensor frame S of its sensor.yaml"
    ),
    Dialect(
        "OpenLog Artemis",
        time=("micros", "rtctime"),
        gyro="g{}",
        accel="a{}",
        temp="imu_degc",
        signature=("rtctime",),
        time_unit="us",
        gyro_unit="dps",
        accel_unit="mg",
        frame="the ICM-20948's axes, z up when level",
    ),
    Dialect(
        "PX4 sensor_combined",
        time=("timestamp",),
        gyro="gyro_rad[{}]",
        accel="accelerometer_m_s2[{}]",
        axes="012",
        time_unit="us",
        gyro_unit="rad/s",
        accel_unit="m/s2",
        frame="forward, right, down",
    ),
    Dialect(
        "Betaflight blackbox",
        time=("time",),
        gyro="gyroadc[{}]",
        accel="accsmooth[{}]",
        axes="012",
        signature=("loopiteration",),
        time_unit="us",
        frame="forward, left, up",
    ),
    # Two files, one for each sensor, or their like in one.
    Dialect("ST HSDatalog", time=("time",), gyro="g_{}", accel="a_{}", temp="temp", time_unit="s", frame="the sensor's own axes"),
    Dialect("ST DataLog", time=("timestamp",), gyro="g_{}", accel="a_{}", temp="t", frame="the sensor's own axes"),
)
