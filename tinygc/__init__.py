"""Calibrate a MEMS gyroscope on a hand-turned table, and find where simulation and recording differ.

    session = tinygc.read_session("data/session1")        # or tinygc.Session.from_arrays(t_s, gyro_rps, accel_mps2, …)
    result = tinygc.fit(session)                          # result.parameters["E_xy"].value, .sigma; print(result.summary())
    result.model.save("gyro.json")
    why = tinygc.explain(session)                         # why.verdict, why.effects; why.plot()
    model = tinygc.load("gyro.json")                      # omega = model(raw); live = model.live()
    tinygc.simulate(segments=12, seed=3).session

Functions (``help(tinygc.fit)`` has parameters, units and examples):

    read_session      a folder -> Session
    check             Session -> list of Finding
    fit               Session, FitOptions -> Fit
    fit_temperature   folders -> ThermalFit
    fit_turns         folder of a gyroscope alone -> TurnFit
    explain           Session -> Why
    simulate          SimulationOptions -> Simulated
    load              a model's file -> Calibration

Records:

    Session           configuration, logs and closure runs; Accelerometer, Site and Protocol are parts of its configuration
    Finding           one result of the first check
    Fit               parameters (Estimate), covariance, closure (ClosureFigures), accelerometer (AccelerometerFit), models (Calibration)
    Why               verdict, effects and findings (FoundEffect), noise, pictures
    Simulated         a session with its truth
    Calibration       a model in use: omega = model(raw)
    ArraySession, ThermalFit, TurnFit   of the annexes arrays, temperature and turntable
    CalibrationError  whatever is wrong with data or arguments, in one line; FormatError, DataError and FitError are kinds of it

Conventions (frames, signs, units, shapes) are those of ``session``'s docstring.  The commands ``fit``, ``explain``, ``check``,
``simulate`` and ``apply`` of ``calibrate.py`` call these functions as well.
Nothing heavy is imported before a name is used; torch only where a network is trained by AdamW.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from session import VERSION

if TYPE_CHECKING:
    from session.detect.findings import Finding as Finding
    from session.io.config import Accelerometer as Accelerometer
    from session.io.config import Protocol as Protocol
    from session.io.config import Site as Site
    from session.io.errors import CalibrationError as CalibrationError
    from session.io.errors import DataError as DataError
    from session.io.errors import FitError as FitError
    from session.io.errors import FormatError as FormatError
    from session.io.folder import Session as Session
    from session.io.folder import read_session as read_session
    from tinygc.deploy.calibration import Calibration as Calibration
    from tinygc.deploy.calibration import load as load
    from tinygc.estimation.accelerometer import AccelerometerFit as AccelerometerFit
    from tinygc.estimation.choice import ClosureFigures as ClosureFigures
    from tinygc.estimation.options import FitOptions as FitOptions
    from tinygc.library.explanations import FoundEffect as FoundEffect
    from tinygc.library.explanations import Why as Why
    from tinygc.library.explanations import explain as explain
    from tinygc.library.sessions import Estimate as Estimate
    from tinygc.library.sessions import Fit as Fit
    from tinygc.library.sessions import Simulated as Simulated
    from tinygc.library.sessions import check as check
    from tinygc.library.sessions import fit as fit
    from tinygc.library.sessions import fit_temperature as fit_temperature
    from tinygc.library.sessions import fit_turns as fit_turns
    from tinygc.library.sessions import simulate as simulate
    from tinygc.simulation.options import SimulationOptions as SimulationOptions

__version__ = VERSION

#: module -> the public names that stand there
_HOMES = {
    "session.detect.findings": ("Finding",),
    "session.io.config": ("Accelerometer", "Protocol", "Site"),
    "session.io.errors": ("CalibrationError", "DataError", "FitError", "FormatError"),
    "session.io.folder": ("Session", "read_session"),
    "tinygc.deploy.calibration": ("Calibration", "load"),
    "tinygc.estimation.accelerometer": ("AccelerometerFit",),
    "tinygc.estimation.choice": ("ClosureFigures",),
    "tinygc.estimation.options": ("FitOptions",),
    "tinygc.library.explanations": ("FoundEffect", "Why", "explain"),
    "tinygc.library.sessions": ("Estimate", "Fit", "Simulated", "check", "fit", "fit_temperature", "fit_turns", "simulate"),
    "tinygc.simulation.options": ("SimulationOptions",),
}
#: name -> the service of the annex that has it
_OF_ANNEXES = {
    "ArraySession": "recordings of arrays",
    "ThermalFit": "calibrations over temperature",
    "TurnFit": "known turns of a gyroscope alone",
}

# There is no ``__all__``: ``help(tinygc)`` would print every class in full.  The docstring above lists the names, as ``dir`` does.


def __getattr__(name: str) -> Any:
    module = next((importlib.import_module(home) for home, names in _HOMES.items() if name in names), None)
    if name in _OF_ANNEXES:
        from session.io.annexes import find

        module = find(_OF_ANNEXES[name])
    if module is None:
        raise AttributeError(f"module 'tinygc' has no attribute {name!r}")
    value = globals()[name] = getattr(module, name)
    return value


def __dir__() -> list[str]:
    return sorted(["__doc__", "__version__", *_OF_ANNEXES, *(name for names in _HOMES.values() for name in names)])
