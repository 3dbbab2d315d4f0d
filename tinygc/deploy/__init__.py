"""Use of models: live streams, logs of any length, exports for other programs, C for a microcontroller."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from session.base import features
from session.base.errors import CalibrationError
from session.base.options import Record, option, path_read

if TYPE_CHECKING:
    from tinygc.models.model import Model

#: formats of ``export``, each a module of ``tinygc.deploy.exports``
FORMATS = ("json", "kalibr", "openvins", "vins", "gtsam", "ros", "xio", "px4", "ardupilot", "c")
#: those that noise figures alone go to, without a model
NOISE_FORMATS = ("kalibr", "openvins", "vins", "gtsam", "ros", "px4", "ardupilot")
#: what people also call a format, in small letters and digits alone
ALSO_CALLED = {
    **dict.fromkeys(("ros1", "ros2", "rosyaml", "imutools"), "ros"),
    **dict.fromkeys(("fusion", "xiofusion", "ximu", "ximu3", "xiotechnologies"), "xio"),
    **dict.fromkeys(("apm", "ardu", "arducopter", "ardurover", "arduplane"), "ardupilot"),
    **dict.fromkeys(("c99", "cheader", "h", "firmware"), "c"),
    **dict.fromkeys(("px4autopilot", "pixhawk", "ekf2"), "px4"),
    **dict.fromkeys(("vinsfusion", "vinsmono"), "vins"),
    **dict.fromkeys(("ovmsckf", "openvin"), "openvins"),
}


def format_named(text: str) -> str:
    """Return the format of ``FORMATS`` that a person means: ``x-io``, ``XIO`` and ``Fusion`` are ``xio``; unknown text as it is."""
    plain = "".join(filter(str.isalnum, text.lower()))
    return plain if plain in FORMATS else ALSO_CALLED.get(plain, text)


@dataclass(frozen=True)
class ExportOptions(Record):
    """What is exported of a fit, and with what noise."""

    model: str | None = option(None, "method of the fit, or a model file (least_squares)")
    noise: Any = option(None, "noise figures of this unit: noise.json, or its folder (fit/noise.json)", metavar="PATH", read=path_read)
    inflation: str | None = option(None, "enlarge noise densities by the factors of this kind of motion", metavar="MOTION")
    anyway: bool = option(False, "export a model that closes held-out segments worse than raw rates, too")


@dataclass(frozen=True)
class LogSession(Record):
    """What belongs to a log file to which a model is applied."""

    session: Path | None = option(
        None, "where session.toml is (next to the log); its [accelerometer] then holds, not the model's", metavar="DIR"
    )


class ExportError(CalibrationError):
    """Raised for a format that cannot carry the model, and for a fit without what the format needs."""


def feature_exports(model: Model) -> ModuleType | None:
    """Return the feature module that exports a model of this kind; None for a kind of the core.

    It has ``stage(model, rate_hz)`` for C, ``zero(model, context, name, about_c)`` for autopilots, and ``CARRIED``: what other formats
    cannot carry.
    """
    return features.named("exports", getattr(model, "kind", ""))
