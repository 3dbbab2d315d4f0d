"""One family of errors: what is wrong, where, what was expected, what to do.  Caught only in ``calibrate.py``."""


class CalibrationError(Exception):
    """Something a person can mend; printed as one line, exit code 2."""

    exit_code = 2


class FormatError(CalibrationError):
    """A file does not hold what FORMATS says it holds."""


class DataError(CalibrationError):
    """The files are readable, but the samples in them cannot be what they claim to be."""


class SegmentError(CalibrationError):
    """No usable still phases or segments."""


class FitError(CalibrationError):
    """The segments do not determine what was asked of them."""
