"""Options that several commands share: of a fit, and of a foreign log."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from session.base import features
from session.base.names import CLOCKS
from tinygc.cli.arguments import METHODS, accel_full_scale, count, data_rate, gyro_full_scale, methods, path_read, segment_numbers
from tinygc.estimation.options import ACCELEROMETERS, BIASES

if TYPE_CHECKING:
    from pathlib import Path

    from session.log.folder import Session
    from session.replay.dialects import Answers
    from tinygc.estimation.options import FitOptions


# Options of a fit, the same for ``fit`` and ``report``, so that a report can use the saved fit.


def add_fit_arguments(command: argparse.ArgumentParser, of_day: tuple[str, ...] = (), trained: bool = True) -> None:
    """Add the options that affect a fit's numbers; of_day: further sources of a bias, for a stored calibration; trained: those of the
    methods too, without which a command sets ``methods`` itself."""
    if trained:
        _add_methods(command)
    command.add_argument("--folds", type=count(2), default=5, help="folds of the held-out closure (%(default)s)")
    command.add_argument("--still-rates", action="store_true", help="use the mean rate in each still as data, too")
    command.add_argument(
        "--bias-per-log", action="store_true", help="each log has a bias of its own, as of several days; their median is kept"
    )
    sources = "from the ends of the turns, from the stills around each, or whichever closes held-out segments better (auto)"
    if of_day:
        sources += "; with --model, of the day: the first still, gravity over the run, --bias-dps"
    command.add_argument("--bias", choices=(*BIASES, *of_day), metavar="|".join((*BIASES, *of_day)), help=sources)
    what = (
        "the accelerometer's calibration: as it is given, fitted, or given as a prior; auto: a prior while it holds, fitted where none is"
    )
    command.add_argument("--accelerometer", choices=ACCELEROMETERS, default="auto", help=what)
    what = "a fitted session of the same unit; of two or more, the spread of their biases is that of any session"
    command.add_argument("--history", type=path_read, action="append", default=[], metavar="DIR", help=what)
    what = "noise figures of the unit, measured at rest: the prior of its bias drift (fit/noise.json in the session folder, if it is there)"
    command.add_argument("--noise", type=path_read, metavar="FILE", help=what)
    what = "limits of closure and sensor errors, and the rule that decides (session.toml's [requirements])"
    command.add_argument("--requirements", type=path_read, metavar="FILE", help=what)
    add_clock_argument(command)
    command.add_argument("--no-earth", action="store_true", help="leave the Earth's rotation in the rates")
    command.add_argument(
        "--exclude", type=segment_numbers, action="extend", default=[], metavar="N,N", help="numbers of segments to leave out"
    )
    for add in features.each("arguments of a fit"):
        add(command)


def add_clock_argument(command: argparse.ArgumentParser) -> None:
    """Add ``--clock``."""
    what = "arrivals: divide the stamps by sensor.clock_ratio, the board's clock against the computer's as record measured it (%(default)s)"
    command.add_argument("--clock", choices=CLOCKS, default=CLOCKS[0], help=what)


def session_of(args: argparse.Namespace) -> Path | Session:
    """Return the folder, or with another ``--clock`` its session."""
    from session.log.folder import read_session

    return args.folder if args.clock == CLOCKS[0] else read_session(args.folder).on_clock(args.clock)


def _add_methods(command: argparse.ArgumentParser) -> None:
    """Add the choice of methods, and of the training of those that are nets."""
    command.add_argument("--methods", type=methods, default=METHODS.split(","), metavar="A,B", help=f"among {METHODS} (all)")
    what = "train the nets as the paper does: AdamW (needs PyTorch), the distance at the ends, the first-order integrator"
    command.add_argument("--as-in-paper", action="store_true", help=what)


def fit_options(args: argparse.Namespace) -> FitOptions:
    """Return the fit's options from the parsed arguments, without physics."""
    from tinygc.estimation.options import FitOptions

    chosen = {name: getattr(args, name) for name in FitOptions.__dataclass_fields__ if hasattr(args, name)}
    chosen |= {
        "methods": tuple(args.methods),
        "earth": not args.no_earth,
        "history": tuple(args.history),
        "exclude": tuple(dict.fromkeys(args.exclude)),
        "bias": args.bias or "auto",
        "physics": None,
    }
    return FitOptions(**chosen)


def given(args: argparse.Namespace, but: tuple[str, ...]) -> list[str]:
    """Return the options of a fit that differ from their defaults, as written, apart from ``but``, which are used."""
    parser = argparse.ArgumentParser(add_help=False)
    add_fit_arguments(parser)
    usual = {**vars(parser.parse_args([])), "resume": False, "physics": None}
    return [f"--{name.replace('_', '-')}" for name, value in usual.items() if name not in but and getattr(args, name) != value]


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
