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

from session import VERSION as __version__

if TYPE_CHECKING:
    from session.io.errors import CalibrationError
    from session.io.folder import Session, read_session
    from tinygc.annexes.temperature.library import fit_temperature
    from tinygc.deploy.calibration import load
    from tinygc.estimation.options import FitOptions
    from tinygc.library.explanations import explain
    from tinygc.library.sessions import check, fit, simulate
    from tinygc.simulation.options import SimulationOptions

#: name -> where it stands, and what it is called there
_HOMES = {
    "CalibrationError": ("session.io.errors", "CalibrationError"),
    "FitOptions": ("tinygc.estimation.options", "FitOptions"),
    "Session": ("session.io.folder", "Session"),
    "SimulationOptions": ("tinygc.simulation.options", "SimulationOptions"),
    "check": ("tinygc.library.sessions", "check"),
    "explain": ("tinygc.library.explanations", "explain"),
    "fit": ("tinygc.library.sessions", "fit"),
    "fit_temperature": ("tinygc.annexes.temperature.library", "fit_temperature"),
    "load": ("tinygc.deploy.calibration", "load"),
    "read_session": ("session.io.folder", "read_session"),
    "simulate": ("tinygc.library.sessions", "simulate"),
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
