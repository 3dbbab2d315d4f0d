"""Which sensor's a log is, and what to say where nobody tells, or where it is none that is known."""

from __future__ import annotations

from dataclasses import replace

from session.common.errors import FormatError
from session.dialects.layout import Answers
from session.dialects.reader import Reader
from session.dialects.standard import OWN
from session.recording.session_file import ASSUMED
from session.sensor.known import DEFAULT, nearest_name, profile_of
from session.sensor.registers import require_profile


def with_sensor(readers: list[Reader], answers: Answers) -> tuple[Answers, list[str]]:
    """The answers with the sensor, and notes: registers must be some sensor's, numbers in physical units may be anyone's.

    FormatError: registers of a sensor that is not known, or of a foreign log that does not name it.
    """
    registers = any(unit.si is None for reader in readers for _, _, unit in reader.layout.kinds)
    if answers.sensor:
        if registers:
            require_profile(answers.sensor)
        return answers, [] if profile_of(answers.sensor) is not None else [_not_known(answers.sensor)]
    if not registers:
        return answers, []
    if any(reader.layout.dialect != OWN for reader in readers):
        named = " and ".join(reader.path.name for reader in readers)
        raise FormatError(f"{named} holds registers and does not name the sensor; give --sensor NAME (`calibrate.py sensors` lists them)")
    return replace(answers, sensor=DEFAULT), [ASSUMED]


def _not_known(name: str) -> str:
    near = nearest_name(name)
    meant = f" (is {near} meant?)" if near else ""
    return f"{name} is no sensor that is known{meant}: it has no yardstick (`calibrate.py sensors` lists those that have one)"
