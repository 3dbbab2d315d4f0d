"""Calibrate a MEMS gyroscope on a hand-turned table, and say where simulation and recording differ.

    session = tinygc.read_session("data/session1")        # or tinygc.Session.from_arrays(t_s, gyro_rps, accel_mps2, …)
    result = tinygc.fit(session)                          # result.parameters["E_xy"].value, .sigma; print(result.summary())
    result.model.save("gyro.json")
    why = tinygc.explain(session)                         # why.verdict, why.effects; why.plot()
    model = tinygc.load("gyro.json")                      # omega = model(raw); live = model.live()
    tinygc.simulate(segments=12, seed=3).session

Conventions (frames, signs, units, shapes) are those of ``session``'s docstring.  The commands ``fit``, ``explain``, ``check``,
``simulate`` and ``apply`` of ``calibrate.py`` call these as well.
Nothing heavy is imported before a name is used; torch only where a network is trained by AdamW.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from session.common.version import VERSION as __version__

if TYPE_CHECKING:
    from session.common.errors import CalibrationError
    from session.log.folder import Session, read_session
    from tinygc.deploy.calibration import load
    from tinygc.library.check import check
    from tinygc.library.explain import explain
    from tinygc.library.fit import fit
    from tinygc.library.simulate import simulate
    from tinygc.library.temperature import fit_temperature
    from tinygc.methods.options import FitOptions
    from tinygc.simulation.options import SimulationOptions

#: name -> where it stands, and what it is called there
_HOMES = {
    "CalibrationError": ("session.common.errors", "CalibrationError"),
    "FitOptions": ("tinygc.methods.options", "FitOptions"),
    "Session": ("session.log.folder", "Session"),
    "SimulationOptions": ("tinygc.simulation.options", "SimulationOptions"),
    "check": ("tinygc.library.check", "check"),
    "explain": ("tinygc.library.explain", "explain"),
    "fit": ("tinygc.library.fit", "fit"),
    "fit_temperature": ("tinygc.library.temperature", "fit_temperature"),
    "load": ("tinygc.deploy.calibration", "load"),
    "read_session": ("session.log.folder", "read_session"),
    "simulate": ("tinygc.library.simulate", "simulate"),
}

__all__ = [
    "CalibrationError",
    "FitOptions",
    "Session",
    "SimulationOptions",
    "__version__",
    "check",
    "explain",
    "fit",
    "fit_temperature",
    "load",
    "read_session",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'tinygc' has no attribute {name!r}")
    module, own_name = _HOMES[name]
    value = globals()[name] = getattr(importlib.import_module(module), own_name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
