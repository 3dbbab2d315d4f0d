"""Options that several commands share: of a fit, and of a foreign log."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from session.base.names import CLOCKS
from session.base.options import Record, file_written, option
from tinygc.cli.arguments import EFFECTS_HELP, LARGEST_SEED, accel_full_scale, data_rate, gyro_full_scale
from tinygc.cli.defaults import Defaults

if TYPE_CHECKING:
    from session.log.folder import Session
    from session.replay.dialects import Answers


# Options that several commands have.


@dataclass(frozen=True)
class Command(Record):
    """Options of every command; defaults: what was taken of the user's own; of_several: whether this is one of several folders."""

    json: Path | None = option(None, "write the result as JSON (- for standard output)", read=file_written)
    quiet: bool = option(False, "print nothing but errors, and the verdict where one was asked for")
    defaults: Defaults | None = None
    of_several: bool = False


@dataclass(frozen=True)
class UsesEffects(Record):
    """Options of a command that uses the catalogue of effects."""

    effects: tuple[Path, ...] = option((), EFFECTS_HELP, repeated=True)


@dataclass(frozen=True)
class Force(Record):
    """Options of a command that writes where an option says."""

    force: bool = option(False, "write over what is there: another's file, a log, an earlier simulation")


@dataclass(frozen=True)
class Seed(Record):
    """Options of a command that draws."""

    seed: int = option(0, "of every random draw", least=0, most=LARGEST_SEED)


# Options of a fit, the same for ``fit`` and ``report``, so that a report can use the saved fit.


def add_clock_argument(command: argparse.ArgumentParser) -> None:
    """Add ``--clock``."""
    what = "arrivals: divide the stamps by sensor.clock_ratio, the board's clock against the computer's as record measured it (%(default)s)"
    command.add_argument("--clock", choices=CLOCKS, default=CLOCKS[0], help=what)


def session_of(args: argparse.Namespace) -> Path | Session:
    """Return the folder, or with another ``--clock`` its session."""
    from session.log.folder import read_session

    return args.folder if args.clock == CLOCKS[0] else read_session(args.folder).on_clock(args.clock)


# Options for what a foreign log may not contain, the same wherever one is read.


def add_log_options(command: argparse.ArgumentParser) -> None:
    """Add ``--odr``, ``--gyro-fs``, … in a group of their own."""
    asked = command.add_argument_group("what a log may not tell")
    asked.add_argument("--sensor", metavar="NAME", help="what the sensor is, such as MPU-9250 (the command sensors lists those known)")
    asked.add_argument("--odr", type=data_rate, metavar="HZ", help="data rate")
    asked.add_argument("--gyro-fs", type=gyro_full_scale, metavar="DPS", help="full scale of the gyroscope")
    asked.add_argument("--accel-fs", type=accel_full_scale, metavar="G", help="full scale of the accelerometer")
    asked.add_argument("--time-unit", metavar="UNIT", help="s, ms, us, ns, 25us; none: count samples at --odr")
    asked.add_argument("--gyro-unit", metavar="UNIT", help="dps, mdps, rad/s, lsb, or one count: 0.061dps")
    asked.add_argument("--accel-unit", metavar="UNIT", help="g, mg, m/s2, lsb, or one count: g/2048")
    what = "of any other table: t_us=NAME,gx_dps=NAME,…,az_g=NAME,temp_c=NAME; once for each file"
    asked.add_argument("--columns", action="append", metavar="LIST", help=what)
    asked.add_argument("--lines", metavar="FIRST-LAST", help="the rows that are meant, by their lines: 1-2991")
    asked.add_argument("--packed", metavar="ORDER", help="of registers in one hexadecimal word: st, mpu, or big:ax,ay,az,temp,gx,gy,gz")
    asked.add_argument("--topic", metavar="NAME", help="of a binary log that holds several; or two, GYROSCOPE,ACCELEROMETER")
    asked.add_argument("--like", metavar="PROGRAM", help="take it for this program's log (`import --list` names them)")
    asked.add_argument("--rows", metavar="WORD", help="of several kinds of rows: those that begin with this word, or have so many columns")
    asked.add_argument("--where", metavar="NAME=VALUE", help="of several sensors' rows: those with this value in a column: I=0")
    asked.add_argument("--gyro-axes", default="x,y,z", metavar="X,Y,Z", help="the log's axes that become x,y,z: y,-x,z")
    asked.add_argument(
        "--accel-axes", default="x,y,z", metavar="X,Y,Z", help="the same for the accelerometer; -x,-y,-z if it shows gravity"
    )


def answers_of(args: argparse.Namespace, files: int = 1) -> Answers:
    """Return ``session.replay.dialects.Answers`` of the options; files: how many the command reads.

    Raises FormatError where ``--columns`` is given more often than that.
    """
    from session.base.errors import FormatError
    from session.replay.dialects import Answers

    if len(args.columns or ()) > files:
        raise FormatError(f"--columns is given {len(args.columns)} times for {files} file{'s' * (files != 1)}; give it once for each")

    same_name = ("time_unit", "gyro_unit", "accel_unit", "gyro_axes", "accel_axes", "sensor", "rows", "where")
    more = ("lines", "packed", "topic", "like")
    columns = args.columns[0] if args.columns and len(args.columns) == 1 else None
    told = {name: getattr(args, name) for name in same_name + more}
    return Answers(odr_hz=args.odr, gyro_fs_dps=args.gyro_fs, accel_fs_g=args.accel_fs, columns=columns, **told)
