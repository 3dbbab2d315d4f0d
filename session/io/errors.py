"""One family of errors: what is wrong, where, what was expected, what to do.  Caught only in ``calibrate.py``."""

from session.io.texts import printable


class CalibrationError(Exception):
    """Something a person can mend; printed as one line, exit code 2."""

    exit_code = 2

    def __init__(self, message: str):
        super().__init__(printable(message))


class FormatError(CalibrationError):
    """A file does not hold what docs/formats.md says it holds."""


class DataError(CalibrationError):
    """The files are readable, but the samples in them cannot be what they claim to be."""


class OtherSensor(DataError):
    """The board is not the one that a recording is of."""


class SegmentError(CalibrationError):
    """No usable still phases or segments."""


class FitError(CalibrationError):
    """The segments do not determine what was asked of them."""


class DeviceError(CalibrationError):
    """The device or its port failed."""

    exit_code = 3


class StorageError(CalibrationError):
    """What was received can no longer be written: disk full, folder read-only."""
