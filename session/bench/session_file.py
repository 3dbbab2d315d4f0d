"""``session.toml`` of a recording: a user's own is never overwritten; otherwise one is written."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from session.bench.events import STANDIN, BoardStatus, Info
from session.bench.port import RequestedSettings
from session.io.config import OWN_UNITS, SCHEMA, Accelerometer, Config, LeftOut, Protocol, Sensor, Site, TruthGiven, read_config
from session.io.errors import CalibrationError, FormatError, OtherSensor, StorageError
from session.io.files import MOST_TOML, read_bytes
from session.io.folder import add_board, add_exclude, add_notes, exclude_text, notes_text
from session.io.registers import DEFAULT, profile_of
from session.io.texts import SENSOR_NAME
from session.io.toml import Note, Value, line, setting

# A configuration as the text of a ``session.toml``: what a person may fill in stands there as a comment.

OPTIONAL = ("gyro_bias_instability_dph", "gyro_noise_mdps_rthz", *OWN_UNITS)
NO_SITE = "# latitude_deg = …  # without it the Earth's rotation stays in the rates\n"


def toml_text(config: Config) -> str:
    """``session.toml`` of a configuration (docs/formats.md)."""
    sensor, site, protocol = config.sensor, config.site, config.protocol
    here = {"latitude_deg": site.latitude_deg, "gravity_mps2": site.gravity_mps2, "heading_deg": site.heading_deg}
    chip: dict[str, Value | None] = {"model": sensor.model, "serial": sensor.serial, "odr_hz": sensor.odr_hz}
    chip |= {name: setting(getattr(sensor, name)) for name in ("gyro_fs_dps", "accel_fs_g")}
    chip |= {name: getattr(sensor, name) for name in OPTIONAL}
    table: dict[str, Value | None] = {"still_s": protocol.still_s, "segment_s": protocol.segment_s, "reference": protocol.reference}
    stated = protocol.reference == "truth" or protocol.truth_sigma_deg != Protocol().truth_sigma_deg
    table |= {"truth_sigma_deg": protocol.truth_sigma_deg} if stated else {}
    notes = f"\n[notes]\n{notes_text(config.notes)}" if config.notes else ""
    return f"""\
{line("schema", SCHEMA)}
[sensor]
{_lines(chip)}
{_accelerometer_text(config.accelerometer)}
[site]
{_lines(here) or NO_SITE}
[protocol]
{_lines(table)}{_truth_text(config.truth)}{notes}{exclude_text(config.exclude)}"""


def _lines(table: Mapping[str, Value | None]) -> str:
    return "".join(line(name, value) for name, value in table.items() if value is not None)


def _accelerometer_text(accelerometer: Accelerometer) -> str:
    """Its section; a comment where nobody has calibrated it, for a section that is there counts as a calibration."""
    if accelerometer.source == "none":
        return "# [accelerometer]  # nobody has calibrated it: the session's own stills do\n"
    table: dict[str, Value | None] = {"matrix": accelerometer.matrix.tolist(), "bias_mps2": accelerometer.bias_mps2.tolist()}
    return "[accelerometer]\n" + _lines(table | {"sigma_mg": accelerometer.sigma_mg, "own_stills": accelerometer.own_stills})


def _truth_text(truth: TruthGiven) -> str:
    """Its section; nothing where the recording is to tell how the file is to be read."""
    mounting = truth.mounting.tolist() if truth.mounting is not None else None
    given = _lines({"offset_s": truth.offset_s, "frame": truth.frame, "sense": truth.sense, "order": truth.order, "mounting": mounting})
    return f"\n[truth]\n{given}" if given else ""


# ``session.toml`` of a recording: a user's own is used as it is and never overwritten; else one is written from what the board says.

NAME = "session.toml"
#: what it says where nobody names the sensor of numbers in physical units
UNKNOWN = "unknown"
#: what is said of registers whose sensor nobody names
ASSUMED = f"nothing names the sensor: its registers are read as an {DEFAULT}'s; --sensor NAME for another (`calibrate.py sensors`)"
NOMINAL_WITHIN = 0.2  #: of a rate that is said: INTERNAL_FREQ_FINE reaches so far
NEAREST_WITHIN = 0.1  #: of a rate that is taken for it: beyond ``session.detect.check_time.ODR_WRONG``, ``check`` says that it is another
DIVIDED_WITHIN = 0.05  #: where a divider makes many rates, the next one is hardly farther
FLAGS = {"odr_hz": "--odr", "gyro_fs_dps": "--gyro-fs", "accel_fs_g": "--accel-fs"}
BOARD = "the board"
BOARD_REMARKS = {"who_am_i": "107 is 0x6B: an ASM330LHH, or a sibling of it (ASM330LHHX, ISM330DHCX, LSM6DSR …); no register says which"}
MOST_A_SECOND = 99  #: notes
SAME_MOMENT_S = 1e-3
LONGEST_WORDS = 200  #: of serial and model
PATIENCE_S = 3.0  #: of samples, for a board that says its ranges once a second


class SessionFile:
    """What is known of the session before the board speaks, and the file once it has.

    like: another session.toml, whose accelerometer, site and protocol hold here as well, and its sensor where the board says nothing;
    odr_hz, gyro_fs_dps, accel_fs_g, sensor (its model): what the user says of the board, or None; notes: for ``[notes]``; bench: where the
    table stands, without such another.  assumed: whether nobody has named the sensor of the file that was written.  Raises FormatError for
    a broken file, and for a note that says otherwise.
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
        self.path, self._model, self.assumed = folder / NAME, sensor, False
        self._notes = dict(notes or {})  # to be written as soon as there is a file
        self._bench = bench or Site()
        self._said = {"odr_hz": odr_hz, "gyro_fs_dps": gyro_fs_dps, "accel_fs_g": accel_fs_g}
        self._own = read_config(self.path) if self.path.exists() else None
        if like is not None and like.is_dir():
            like = like / NAME
        self._like = read_config(like) if like is not None else None
        self._info: Info | None = None  # the last that the board has said
        self._written = False  # by this recording, and without its [board]: a user's own file is theirs
        self._text = self._read()
        if self._own is not None:
            for name, value in self._notes.items():
                if (there := self._own.notes.get(name, value)) != value:
                    raise FormatError(f"{self.path}: notes.{name} is {there!r} already; correct it there, or give another name")
            self._require_agreement(self._own.sensor, self._said, "the command line")
            self._require_model(self._own.sensor.model, sensor, "--sensor")

    @property
    def protocol(self) -> Protocol:
        """Of the folder's own file, else of the one that it is to be like, else the default."""
        known = self._own or self._like
        return known.protocol if known else Protocol()

    def wanted(self) -> RequestedSettings:
        """What a board that takes commands is to be set to: what the user says, and in a recording that is resumed what it was set to."""
        said = self._said
        if self._own is not None and self._own.board.source == SENSOR_NAME and self._own.board.odr_hz is not None:
            mine = {
                "odr_hz": self._own.board.odr_hz,
                "gyro_fs_dps": self._own.sensor.gyro_fs_dps,
                "accel_fs_g": self._own.sensor.accel_fs_g,
            }
            said = {name: said[name] if said[name] is not None else value for name, value in mine.items()}
        return RequestedSettings(**said)

    def configure(
        self,
        info: Info | None,
        waited_s: float = 0.0,
        physical: bool | None = False,
        board: BoardStatus | None = None,
        speaks: bool = False,
    ) -> Config | None:
        """The configuration, and the file written; None while not enough is known.  waited_s: seconds of samples without an info;
        physical: whether the samples are in physical units, None while there are none; board: what it
        says of its sensor, for ``[board]`` of a file that is written here; speaks: whether it will say what it is, and its serial number.

        OtherSensor where the board contradicts the file, CalibrationError the command line; StorageError where it cannot be written.
        """
        if info is not None:
            info = replace(info, serial=plain(info.serial), sensor=plain(info.sensor))
            said: dict[str, float] = {"gyro_fs_dps": info.gyro_fs_dps, "accel_fs_g": info.accel_fs_g}
            if self._own is not None:
                self._require_agreement(self._own.sensor, said, BOARD)
                self._require_model(self._own.sensor.model, info.sensor, BOARD)
            for name, value in said.items():
                if self._said[name] not in (None, value):
                    raise CalibrationError(f"the board says {name} = {value:g}, {FLAGS[name]} says {self._said[name]:g}: leave it out")
        self._info = info = info or self._info
        if self._own is None:
            awaited = info is None and speaks and waited_s < PATIENCE_S
            sensor = None if physical is None or awaited else self._sensor(info, waited_s, physical)
            if sensor is None:
                return None
            known = _for_another(self._like) if self._like else Config(sensor, Accelerometer(source="none"), self._bench, Protocol())
            config = replace(known, sensor=sensor, unknown=(), notes={}, exclude=())  # notes are of one session alone
            self._write(config, bool(physical))
            self._own, self._written = config, True
        if board is not None and self._written:
            self._text, self._written = add_board(self.path, _board_keys(board), BOARD_REMARKS).encode(), False
        notes, self._notes = self._notes, {}
        if notes:
            self._text = add_notes(self.path, notes).encode()
        return self._own

    def note(self, text: str, when: datetime) -> None:
        """A note of this moment (UTC), in ``[notes]`` under its time; as soon as there is a file."""
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
        """The turn that moved at that moment of the log's clock does not count."""
        self._text = add_exclude(self.path, LeftOut(log, at_s)).encode()

    def excludes(self, log: str, at_s: float) -> bool:
        """Whether the file says so: a person may have taken it back."""
        return any(row.log == log and abs(row.at_s - at_s) < SAME_MOMENT_S for row in read_config(self.path).exclude)

    def save_copy(self, folder: Path) -> None:
        """What the file last held, for a folder that stands in for one that was removed.  Raises OSError."""
        if self._text is not None and not (folder / NAME).exists():
            (folder / NAME).write_bytes(self._text)

    def _read(self) -> bytes | None:
        try:
            return read_bytes(self.path, MOST_TOML)
        except FormatError:
            return None

    def _sensor(self, info: Info | None, waited_s: float, physical: bool) -> Sensor | None:
        said = dict(self._said)
        if info is not None:
            said = {name: value if value is not None else getattr(info, name) for name, value in said.items()}
        elif self._like is not None and waited_s >= PATIENCE_S:
            said = {name: value if value is not None else getattr(self._like.sensor, name) for name, value in said.items()}
        odr_hz, gyro_fs_dps, accel_fs_g = said["odr_hz"], said["gyro_fs_dps"], said["accel_fs_g"]
        if odr_hz is None or gyro_fs_dps is None or accel_fs_g is None:
            return None
        serial, like = (info.serial if info else ""), self._like.sensor if self._like is not None else None
        model = self._model or (info.sensor if info else "") or (like.model if like is not None else "")
        self.assumed, model = not (model or physical), model or (UNKNOWN if physical else DEFAULT)
        nominal = nominal_hz(odr_hz, model)
        if like is not None and _same_model(like.model, model):
            return replace(like, serial=serial, odr_hz=nominal, gyro_fs_dps=gyro_fs_dps, accel_fs_g=accel_fs_g)
        return Sensor(model, serial, nominal, gyro_fs_dps, accel_fs_g)

    def _require_model(self, mine: str, said: str | None, who: str) -> None:
        if said and not _same_model(mine, said):
            error = OtherSensor if who == BOARD else CalibrationError
            raise error(f'{self.path}: sensor.model is "{mine}", {who} says {said}; correct the wrong one')

    def _require_agreement(self, sensor: Sensor, said: Mapping[str, float | None], who: str) -> None:
        for name, value in said.items():
            mine = getattr(sensor, name)
            if value is not None and (abs(value / mine - 1) > NOMINAL_WITHIN if name == "odr_hz" else value != mine):
                error = OtherSensor if who == BOARD else CalibrationError
                raise error(f"{self.path}: sensor.{name} is {mine:g}, {who} says {value:g}; correct the wrong one")

    def _write(self, config: Config, physical: bool) -> None:
        """Whole or not at all, and only what can be read again: it is read before it gets its name."""
        fresh = self.path.with_name(f".{self.path.name}.new")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with fresh.open("w", encoding="utf-8") as file:
                file.write(text := toml_text(config))
                file.flush()
                os.fsync(file.fileno())
            _require_readable(fresh, physical)
            if self.path.exists():  # somebody has put one there meanwhile
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
            self._text = text.encode()  # before anybody can see the file, and remove it
            os.replace(fresh, self.path)
        except OSError as error:
            raise StorageError(f"{self.path}: {error.strerror or error}; give --out another folder") from None
        except FormatError as error:
            right = "where the board says it wrong, say it right: --odr, --gyro-fs, --accel-fs, --sensor"
            raise CalibrationError(f"{self.path}: not written: {str(error).removeprefix(f'{fresh}: ')}; {right}") from None
        finally:
            with contextlib.suppress(OSError):
                fresh.unlink(missing_ok=True)


def _require_readable(path: Path, physical: bool) -> None:
    """FormatError where what a board says of itself is what no command reads, or what no such sensor has."""
    sensor = read_config(path).sensor
    if not physical:
        units = sensor.register_units
        for name in ("gyro_rps", "accel_mps2"):
            getattr(units, name)


def plain(text: str) -> str:
    """What a board says of itself in words, fit for a file: one line, printable, not endless."""
    text = text.encode("utf-8", errors="replace").decode("utf-8")
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())[:LONGEST_WORDS]


def nominal_hz(odr_hz: float, model: str = DEFAULT) -> float:
    """The model's nominal data rate that is nearest to a true one, or that itself where none is near, or its rates are not known."""
    profile = profile_of(model)
    nearest = None if profile is None or not odr_hz > 0 else profile.nearest_hz(odr_hz)  # a board may say anything
    if profile is None or nearest is None:
        return odr_hz
    return nearest if abs(nearest / odr_hz - 1) < (DIVIDED_WITHIN if profile.divided else NEAREST_WITHIN) else odr_hz


def _board_keys(board: BoardStatus) -> dict[str, str | float]:
    """``[board]`` of what it says; a stand-in has no registers."""
    keys: dict[str, str | float] = {"source": board.source_name, "firmware": board.firmware}
    if board.source == STANDIN:
        return keys
    return keys | {
        "who_am_i": board.who_am_i,
        "freq_fine": board.freq_fine,
        "registers": board.registers.hex(),
        "odr_hz": setting(board.odr_hz),
    }


def _same_model(one: str, other: str) -> bool:
    first, second = profile_of(one), profile_of(other)
    return one == other or (first is not None and first is second)


def _for_another(like: Config) -> Config:
    """What holds in a further recording as well: not the stills of the one that it was, nor how a truth file of that one was written."""
    return replace(like, accelerometer=replace(like.accelerometer, own_stills=None), truth=TruthGiven())
