"""Use of models: live streams, logs of any length, exports for other programs, C for a microcontroller."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

from session.io.annexes import need
from session.io.errors import CalibrationError

if TYPE_CHECKING:
    from tinygc.models.model import Model

#: formats of ``export``, each a module of ``tinygc.deploy.exports``
FORMATS = ("json", "kalibr", "ros", "xio", "px4", "ardupilot", "c")
#: kind of model -> service of the annex that exports it
ANNEX_KINDS = {"thermal": "exports over temperature"}


class ExportError(CalibrationError):
    """Raised for a format that cannot carry the model, and for a fit that lacks what the format needs."""


def annex_exports(model: Model) -> ModuleType | None:
    """Return the annex module that exports a model of this kind; None for a kind of the core.

    It has ``stage(model, rate_hz)`` for C, ``px4(model, context)`` and ``ardupilot(model, context)`` for the text of these formats, and
    ``CARRIED``: what other formats cannot carry.
    """
    service = ANNEX_KINDS.get(getattr(model, "kind", ""))
    return None if service is None else need(service)
