"""Calibrate a MEMS gyroscope on a hand-turned table, and find where simulation and recording differ.

    session = tinygc.read_session("data/session1")        # or tinygc.Session.from_arrays(t_s, gyro_rps, accel_mps2, …)
    result = tinygc.fit(session)                          # result.parameters["E_xy"].value, .sigma; print(result.summary())
    result.model.save("gyro.json")                        # or result.report("report.html"), result.export("ros", "export")
    why = tinygc.explain(session)                         # why.verdict, why.effects; why.plot()
    model = tinygc.load("gyro.json")                      # omega = model(raw); live = model.live()
    tinygc.simulate(segments=12, seed=3).session

Functions (``help(tinygc.fit)`` has parameters, units and examples):

    read_session      a folder -> Session; Session.save writes one
    import_log, read_log   any program's log -> a session folder; -> plain arrays
    check             Session -> list of Finding
    accelerometer     Session -> OwnAccelerometer
    fit               Session, FitOptions -> Fit
    explain           Session -> Why
    report, export    Session or Fit -> Report; Fit -> Exported
    compare, plan     fits -> Compared; Session -> Plan
    rebias, apply     Calibration and another recording -> Rebias; calibrated rates, samples, or a log
    list_sessions, sensors   what a folder holds; the sensors that are known
    simulate          SimulationOptions -> Simulated
    load              a model's file -> Calibration

Records:

    Session           configuration, logs and closure runs; Accelerometer, Site and Protocol are parts of its configuration
    Finding           one result of the first check
    Fit               parameters and sensor_errors (Estimate), covariance, closure (ClosureFigures), accelerometer (AccelerometerFit),
                      models (Calibration), report, export, plot
    Why               verdict, effects and findings (FoundEffect), noise, pictures
    Simulated         a session with its truth
    Calibration       a model in use: omega = model(raw)
    CalibrationError  whatever is wrong with data or arguments, in one line; FormatError, DataError and FitError are kinds of it

Conventions (frames, signs, units, shapes) are those of ``session``'s docstring.  The commands of ``calibrate.py`` call these functions
as well; docs/library.md has the function of each.  Features have functions and records of their own: ``dir(tinygc)`` lists them, too.
Nothing heavy is imported before a name is used.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

import session as _session

# Any project may have a ``session``.  That of this installation lies beside this package; another one would fail somewhere within.
_home = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_found = os.path.abspath(_session.__file__ or os.curdir)
if not hasattr(_session, "VERSION") or os.path.dirname(os.path.dirname(_found)) != _home:
    raise ImportError(
        f"{_found} is imported as 'session' in place of TinyGC's own, {os.path.join(_home, 'session')}; rename it, or take its folder "
        "off the path (PYTHONPATH, or the folder of the script that was started), or install TinyGC into an environment of its own",
        name="session",
        path=_found,
    )

from session.base import features as _features  # noqa: E402  # of this installation

if TYPE_CHECKING:
    from session.base.errors import CalibrationError as CalibrationError
    from session.base.errors import DataError as DataError
    from session.base.errors import FitError as FitError
    from session.base.errors import FormatError as FormatError
    from session.detect.findings import Finding as Finding
    from session.log.config import Accelerometer as Accelerometer
    from session.log.config import Protocol as Protocol
    from session.log.config import Site as Site
    from session.log.folder import Session as Session
    from session.log.folder import read_session as read_session
    from tinygc.deploy.calibration import Calibration as Calibration
    from tinygc.deploy.calibration import load as load
    from tinygc.estimation.accelerometer import AccelerometerFit as AccelerometerFit
    from tinygc.estimation.choice import ClosureFigures as ClosureFigures
    from tinygc.estimation.options import FitOptions as FitOptions
    from tinygc.library.applied import apply as apply
    from tinygc.library.biases import Rebias as Rebias
    from tinygc.library.biases import rebias as rebias
    from tinygc.library.checks import check as check
    from tinygc.library.explanations import FoundEffect as FoundEffect
    from tinygc.library.explanations import Why as Why
    from tinygc.library.explanations import explain as explain
    from tinygc.library.fits import Fit as Fit
    from tinygc.library.fits import fit as fit
    from tinygc.library.known import list_sessions as list_sessions
    from tinygc.library.known import sensors as sensors
    from tinygc.library.logs import Imported as Imported
    from tinygc.library.logs import LogArrays as LogArrays
    from tinygc.library.logs import import_log as import_log
    from tinygc.library.logs import read_log as read_log
    from tinygc.library.records import Estimate as Estimate
    from tinygc.library.reports import Exported as Exported
    from tinygc.library.reports import Report as Report
    from tinygc.library.reports import export as export
    from tinygc.library.reports import report as report
    from tinygc.library.sessions import OwnAccelerometer as OwnAccelerometer
    from tinygc.library.sessions import Plan as Plan
    from tinygc.library.sessions import accelerometer as accelerometer
    from tinygc.library.sessions import plan as plan
    from tinygc.library.simulations import Simulated as Simulated
    from tinygc.library.simulations import simulate as simulate
    from tinygc.simulation.options import SimulationOptions as SimulationOptions

__version__ = _session.VERSION

#: module -> the public names that stand there
_HOMES = {
    "session.detect.findings": ("Finding",),
    "session.log.config": ("Accelerometer", "Protocol", "Site"),
    "session.base.errors": ("CalibrationError", "DataError", "FitError", "FormatError"),
    "session.log.folder": ("Session", "read_session"),
    "tinygc.deploy.calibration": ("Calibration", "load"),
    "tinygc.estimation.accelerometer": ("AccelerometerFit",),
    "tinygc.estimation.choice": ("ClosureFigures",),
    "tinygc.estimation.options": ("FitOptions",),
    "tinygc.library.applied": ("apply",),
    "tinygc.library.biases": ("Rebias", "rebias"),
    "tinygc.library.checks": ("check",),
    "tinygc.library.explanations": ("FoundEffect", "Why", "explain"),
    "tinygc.library.fits": ("Fit", "fit"),
    "tinygc.library.known": ("list_sessions", "sensors"),
    "tinygc.library.logs": ("Imported", "LogArrays", "import_log", "read_log"),
    "tinygc.library.records": ("Estimate",),
    "tinygc.library.reports": ("Exported", "Report", "export", "report"),
    "tinygc.library.sessions": ("OwnAccelerometer", "Plan", "accelerometer", "plan"),
    "tinygc.library.simulations": ("Simulated", "simulate"),
    "tinygc.simulation.options": ("SimulationOptions",),
}
_features.look_in(os.path.join(_home, "tinygc", "features"), "tinygc.features")

# There is no ``__all__``: ``help(tinygc)`` would print every class in full.  The docstring above lists the names, as ``dir`` does.


def __getattr__(name: str) -> Any:
    module = next((importlib.import_module(home) for home, names in _HOMES.items() if name in names), None)
    if module is None and not name.startswith("_"):
        module = _features.named("public", name)
    if module is None:
        raise AttributeError(f"module 'tinygc' has no attribute {name!r}")
    value = globals()[name] = getattr(module, name)
    return value


def __dir__() -> list[str]:
    return sorted(["__doc__", "__version__", *_features.names("public"), *(name for names in _HOMES.values() for name in names)])
