"""One family of errors: what is wrong, where, what was expected, what to do.  Caught only in ``calibrate.py``."""

from session.base.texts import printable


class CalibrationError(Exception):
    """Base class for errors that the user can fix; printed as one line, exit code 2."""

    exit_code = 2

    def __init__(self, message: str):
        super().__init__(printable(message))


class FormatError(CalibrationError):
    """A file departs from docs/formats.md."""


class DataError(CalibrationError):
    """The files are readable, but their samples contradict what the files state."""


class OtherSensor(DataError):
    """The board is not the one of the recording."""


class SegmentError(CalibrationError):
    """No usable still phases or segments."""


class FitError(CalibrationError):
    """The segments do not determine the parameters."""


class DeviceError(CalibrationError):
    """The device or its port failed."""

    exit_code = 3


class StorageError(CalibrationError):
    """What was received can no longer be written: disk full, folder read-only."""
