"""``session.toml`` of a recording."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from session.base.errors import CalibrationError, FormatError, OtherSensor, StorageError
from session.base.files import MOST_TOML, read_bytes, replaced, write_new
from session.base.texts import SENSOR_NAME, one_line
from session.base.toml import Note, parse_toml, setting
from session.bench.clocks import ClockRatio
from session.bench.events import CHIPS, SENSOR, STANDIN, BoardStatus, Info
from session.log.config import Accelerometer, Config, LeftOut, Protocol, Sensor, Site, clock_words, config_of, read_config
from session.log.folder import add_board, add_by_hand, add_notes, set_sensor
from session.log.registers import DEFAULT, UNKNOWN, profile_of
from session.log.written import toml_text

# ``session.toml`` of a recording: the user's own file is used as it is; without one it is written from the board's info.

NAME = "session.toml"
#: note on registers of an unnamed sensor
ASSUMED = f"nothing names the sensor: its registers are read as an {DEFAULT}'s; --sensor NAME for another (`calibrate.py sensors`)"
NOMINAL_WITHIN = 0.2  #: relative tolerance of a stated rate: the range of INTERNAL_FREQ_FINE
FLAGS = {"odr_hz": "--odr", "gyro_fs_dps": "--gyro-fs", "accel_fs_g": "--accel-fs"}
BOARD = "the board"
BOARD_REMARKS = {
    "who_am_i": "107 is 0x6B: an ASM330LHH, or a sibling of it (ASM330LHHX, ISM330DHCX, LSM6DSR …); no register shows which; "
    "108 is 0x6C: an LSM6DSO or LSM6DSOX; an LSM6DSO32 as well, but its accelerometer's ranges are twice as wide: do not use it here"
}
MOST_A_SECOND = 99  #: notes
SAME_MOMENT_S = 1e-3
LONGEST_WORDS = 200  #: of serial and model
PATIENCE_S = 3.0  #: of samples: a board sends its info once a second


class SessionFile:
    """The session's configuration: what is known before the board's info, and the file after it.

    like: another session.toml, whose accelerometer, site and protocol are taken over, and its sensor where the board sends no info; odr_hz,
    gyro_fs_dps, accel_fs_g, sensor (its model): from the user, or None; notes: for ``[notes]``; bench: the site, without ``like``.
    Raises FormatError for a broken file, and for a note that contradicts it.
    """

    def __init__(
        self,
        folder: Path,
        like: Path | None,
        odr_hz: float | None,
        gyro_fs_dps: float | None,
        accel_fs_g: float | None,
        sensor: str | None = None,
        notes: Mapping[str, Note] | None = None,
        bench: Site | None = None,
    ):
        self.path, self._model = folder / NAME, sensor
        self.assumed = False  #: whether the sensor of the written file is not named by anything
        self._notes = dict(notes or {})  # written as soon as there is a file
        self._bench = bench or Site()
        self._given = {"odr_hz": odr_hz, "gyro_fs_dps": gyro_fs_dps, "accel_fs_g": accel_fs_g}
        self._own = read_config(self.path) if self.path.exists() else None
        if like is not None and like.is_dir():
            like = like / NAME
        self._like = read_config(like) if like is not None else None
        self._info: Info | None = None  # the last
        self._written = False  # by this recording, and still without [board]; a user's own file gets none
        self._text: bytes | None = None
        with contextlib.suppress(FormatError):
            self._text = read_bytes(self.path, MOST_TOML)
        if self._own is not None:
            for name, value in self._notes.items():
                if (there := self._own.notes.get(name, value)) != value:
                    raise FormatError(f"{self.path}: notes.{name} is {there!r} already; correct it there, or give another name")
            self._require_agreement(self._own.sensor, self._given, "the command line")
            self._require_model(self._own.sensor.model, sensor, "--sensor")

    @property
    def protocol(self) -> Protocol:
        """From the folder's own file, else from ``like``, else the default."""
        known = self._own or self._like
        return known.protocol if known else Protocol()

    def wanted(self) -> dict[str, float | None]:
        """The settings for a board that takes commands (``BoardSetup``): the user's, and in a resumed recording those of the file."""
        given = self._given
        if self._own is not None and self._own.board.source == SENSOR_NAME and self._own.board.odr_hz is not None:
            mine = {
                "odr_hz": self._own.board.odr_hz,
                "gyro_fs_dps": self._own.sensor.gyro_fs_dps,
                "accel_fs_g": self._own.sensor.accel_fs_g,
            }
            given = {name: given[name] if given[name] is not None else value for name, value in mine.items()}
        return given

    def configure(
        self,
        info: Info | None,
        waited_s: float = 0.0,
        physical: bool | None = False,
        board: BoardStatus | None = None,
        speaks: bool = False,
    ) -> Config | None:
        """The configuration, whose file is written; None while not enough is known.

        waited_s: seconds of samples without an info; physical: whether the samples are in physical units, None without samples; board: its
        status, for the sensor's model and for ``[board]`` of a file that is written here; speaks: whether the board will send both.

        OtherSensor where the board contradicts the file, CalibrationError where it contradicts the command line; StorageError where the
        file cannot be written.
        """
        if info is not None:
            info = replace(info, serial=plain(info.serial), sensor=plain(info.sensor))
            ranges: dict[str, float] = {"gyro_fs_dps": info.gyro_fs_dps, "accel_fs_g": info.accel_fs_g}
            if self._own is not None:
                self._require_agreement(self._own.sensor, ranges, BOARD)
                self._require_model(self._own.sensor.model, info.sensor, BOARD)
            for name, value in ranges.items():
                if self._given[name] not in (None, value):
                    raise CalibrationError(f"the board reports {name} = {value:g}, {FLAGS[name]} gives {self._given[name]:g}: leave it out")
        self._info = info = info or self._info
        if self._own is None:
            awaited = speaks and (info is None or board is None) and waited_s < PATIENCE_S
            sensor = None if physical is None or awaited else self._sensor(info, waited_s, physical, board)
            if sensor is None:
                return None
            bench = self._bench
            if info is not None and bench.latitude_deg is None:
                bench = replace(bench, latitude_deg=info.latitude_deg)
            known = self._like or Config(sensor, Accelerometer(source="none"), bench, Protocol())
            accelerometer = replace(known.accelerometer, own_stills=None)  # which are of one session alone, as its notes and limits
            config = Config(sensor, accelerometer, known.site, known.protocol)
            self._write(config, bool(physical))
            self._own, self._written = config, True
        if board is not None and self._written:
            keys: dict[str, str | float] = {"source": board.source_name, "firmware": board.firmware}
            if board.source != STANDIN:  # which has no registers
                keys |= {"who_am_i": board.who_am_i, "freq_fine": board.freq_fine, "registers": board.registers.hex()}
                keys["odr_hz"] = setting(board.odr_hz)
            self._text, self._written = add_board(self.path, keys, BOARD_REMARKS).encode(), False
        notes, self._notes = self._notes, {}
        if notes:
            self._text = add_notes(self.path, notes).encode()
        return self._own

    def note(self, text: str, when: datetime) -> None:
        """Add a note of this moment (UTC) to ``[notes]`` under its time, as soon as there is a file."""
        name = f"{when:%Y-%m-%dT%H:%M:%SZ}"
        if self._own is None:
            self._notes[name] = text
            return
        for number in itertools.count(2):
            try:
                self._text = add_notes(self.path, {name: text}).encode()
                return
            except FormatError:  # two within a second
                if number > MOST_A_SECOND:
                    raise
                name = f"{when:%Y-%m-%dT%H:%M:%SZ} ({number})"

    def exclude(self, log: str, at_s: float) -> None:
        """Exclude the turn that moved at that moment of the log's clock."""
        self._text = add_by_hand(self.path, LeftOut(log, at_s)).encode()

    def excludes(self, log: str, at_s: float) -> bool:
        """Whether the file excludes that turn: the user may have withdrawn it."""
        return any(row.log == log and abs(row.at_s - at_s) < SAME_MOMENT_S for row in read_config(self.path).exclude)

    def measured(self, clock: ClockRatio | None) -> str:
        """Write the board's clock, as it was measured, with what the file has of an earlier part; returns a note of it.

        A clock that the user knows, ``clock_sigma_ppm`` alone, stays.
        """
        if clock is None or self._own is None or not clock.is_informative:
            return ""
        words = clock_words(clock.ratio, clock.sigma_ppm)
        try:
            sensor = read_config(self.path).sensor
            if sensor.clock_ratio is None and sensor.clock_sigma_ppm is not None:
                return f"{words}; session.toml has its own clock_sigma_ppm, {sensor.clock_sigma_ppm:g}, and is left so"
            if sensor.clock_ratio is not None and sensor.clock_sigma_ppm:
                clock = ClockRatio.of([clock, ClockRatio.written(sensor.clock_ratio, sensor.clock_sigma_ppm)]) or clock
            values = {"clock_ratio": round(clock.ratio, 9), "clock_sigma_ppm": float(f"{clock.sigma_ppm:.3g}")}
            self._text = set_sensor(self.path, values).encode()
        except FormatError:  # of a user's own form, or spoilt meanwhile: no recording fails by it
            return f"{words}; session.toml leaves no place for it: give sensor.clock_ratio = {clock.ratio:.9g} by hand"
        return f"{words}: sensor.clock_ratio of session.toml; `fit --clock arrivals` divides the stamps by it"

    def save_copy(self, folder: Path) -> None:
        """Write the last content of the file into the folder that replaces a removed one.  Raises OSError."""
        if self._text is not None and not (folder / NAME).exists():
            write_new(folder / NAME, self._text)

    def _sensor(self, info: Info | None, waited_s: float, physical: bool, board: BoardStatus | None) -> Sensor | None:
        like = self._like.sensor if self._like is not None else None
        source = info or (like if waited_s >= PATIENCE_S else None)
        values = {name: value if value is not None else getattr(source, name, None) for name, value in self._given.items()}
        odr_hz, gyro_fs_dps, accel_fs_g = values["odr_hz"], values["gyro_fs_dps"], values["accel_fs_g"]
        if odr_hz is None or gyro_fs_dps is None or accel_fs_g is None:
            return None
        odr_hz = float(f"{odr_hz:.7g}")  # a frame's has single precision
        serial = info.serial if info else ""
        chip = CHIPS.get(board.who_am_i, DEFAULT) if board is not None and board.source == SENSOR else DEFAULT
        of_board = (info.sensor if info else "") or (chip if chip != DEFAULT else "")  # siblings share the identity of the default
        model = self._model or of_board or (like.model if like is not None else "")
        self.assumed, model = not (model or physical), model or (UNKNOWN if physical else DEFAULT)
        if like is not None and _same_model(like.model, model):
            clock = like.clock_sigma_ppm if like.clock_ratio is None else None  # a ratio is of one recording
            like = replace(like, clock_ratio=None, clock_sigma_ppm=clock)
            return replace(like, serial=serial, odr_hz=odr_hz, gyro_fs_dps=gyro_fs_dps, accel_fs_g=accel_fs_g)
        return Sensor(model, serial, odr_hz, gyro_fs_dps, accel_fs_g)

    def _require_model(self, mine: str, other: str | None, who: str) -> None:
        if other and not _same_model(mine, other):
            error = OtherSensor if who == BOARD else CalibrationError
            raise error(f'{self.path}: sensor.model is "{mine}", {who} gives {other}; correct the wrong one')

    def _require_agreement(self, sensor: Sensor, values: Mapping[str, float | None], who: str) -> None:
        for name, value in values.items():
            mine = getattr(sensor, name)
            if value is not None and (abs(value / mine - 1) > NOMINAL_WITHIN if name == "odr_hz" else value != mine):
                error = OtherSensor if who == BOARD else CalibrationError
                raise error(f"{self.path}: sensor.{name} is {mine:g}, {who} gives {value:g}; correct the wrong one")

    def _write(self, config: Config, physical: bool) -> None:
        """Write the whole file or nothing: the new file is read and checked before it gets its name."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            text = toml_text(config)
            # FormatError where the board's info cannot be read again, or no such sensor has these ranges.
            sensor = config_of(self.path, parse_toml(text, str(self.path))).sensor
            if not physical:
                units = sensor.register_units
                _ = units.gyro_rps, units.accel_mps2
            with replaced(self.path) as file:
                file.write(text.encode())
                if self.path.exists():  # it was created meanwhile
                    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
                self._text = text.encode()  # before anybody can remove the file
        except OSError as error:
            raise StorageError(f"{self.path}: {error.strerror or error}; give --out another folder") from None
        except FormatError as error:
            right = "if the board sends a wrong value, give the right one: --odr, --gyro-fs, --accel-fs, --sensor"
            raise CalibrationError(f"{self.path}: not written: {str(error).removeprefix(f'{self.path}: ')}; {right}") from None


def plain(text: str) -> str:
    """A board's text for a file: one printable line of limited length."""
    return one_line(text.encode("utf-8", errors="replace").decode("utf-8"))[:LONGEST_WORDS]


def _same_model(one: str, other: str) -> bool:
    first, second = profile_of(one), profile_of(other)
    return one == other or (first is not None and first is second)
