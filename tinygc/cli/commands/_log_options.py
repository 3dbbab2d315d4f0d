"""What a log may not tell, as options: the same wherever a foreign log is read."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from tinygc.cli.arguments import accel_full_scale, data_rate, gyro_full_scale

if TYPE_CHECKING:
    from session.dialects.layout import Answers


def add_log_options(command: argparse.ArgumentParser) -> None:
    """``--odr``, ``--gyro-fs``, … in a group of their own."""
    asked = command.add_argument_group("what a log may not tell")
    asked.add_argument("--sensor", metavar="NAME", help="what the sensor is, such as MPU-9250 (calibrate.py sensors lists those known)")
    asked.add_argument("--odr", type=data_rate, metavar="HZ", help="data rate")
    asked.add_argument("--gyro-fs", type=gyro_full_scale, metavar="DPS", help="full scale of the gyroscope")
    asked.add_argument("--accel-fs", type=accel_full_scale, metavar="G", help="full scale of the accelerometer")
    asked.add_argument("--time-unit", metavar="UNIT", help="s, ms, us, ns, 25us; none: count samples at --odr")
    asked.add_argument("--gyro-unit", metavar="UNIT", help="dps, mdps, rad/s, lsb, or one count: 0.061dps")
    asked.add_argument("--accel-unit", metavar="UNIT", help="g, mg, m/s2, lsb, or one count: g/2048")
    asked.add_argument("--columns", metavar="LIST", help="of any other CSV: t_us=NAME,gx_dps=NAME,…,az_g=NAME,temp_c=NAME")
    asked.add_argument("--gyro-axes", default="x,y,z", metavar="X,Y,Z", help="the log's axes that become x,y,z: y,-x,z")
    asked.add_argument(
        "--accel-axes", default="x,y,z", metavar="X,Y,Z", help="the same for the accelerometer; -x,-y,-z if it shows gravity"
    )


def answers_of(args: argparse.Namespace) -> Answers:
    """``session.dialects.layout.Answers`` of the options."""
    from session.dialects.layout import Answers

    return Answers(
        odr_hz=args.odr,
        gyro_fs_dps=args.gyro_fs,
        accel_fs_g=args.accel_fs,
        time_unit=args.time_unit,
        gyro_unit=args.gyro_unit,
        accel_unit=args.accel_unit,
        columns=args.columns,
        gyro_axes=args.gyro_axes,
        accel_axes=args.accel_axes,
        sensor=args.sensor,
    )
