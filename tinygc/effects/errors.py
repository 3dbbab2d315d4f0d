"""What is wrong with an effect, or with the file that should define one."""

from __future__ import annotations

from session.common.errors import CalibrationError


class EffectError(CalibrationError):
    """An effect that cannot be: one line that names the file or the id, what was expected, and what to do; exit code 2."""
