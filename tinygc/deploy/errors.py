"""What deploying refuses: both the exporters and the C that they write say it."""

from __future__ import annotations

from session.common.errors import CalibrationError


class ExportError(CalibrationError):
    """A format that cannot carry the model, or a fit that lacks what the format needs."""
