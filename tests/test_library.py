"""What a notebook calls: sessions of arrays, fit, explain, simulate, load; the same answers as from files and commands."""

import doctest
import importlib
import json
import pydoc
import re
import sys

import numpy as np
import processes
import pytest
from conftest import DEG

import tinygc
from session.io.config import Protocol
from session.io.errors import DataError, FitError
from tinygc import CalibrationError
from tinygc.deploy.calibration import Calibration

#: functions and classes whose docstrings have an example
EXAMPLES = ["FitOptions", "accelerometer", "apply", "array", "check", "compare", "explain", "export", "fit", "fit_temperature", "fit_turns"]
EXAMPLES += [
    "budget",
    "estimate_noise",
    "estimate_rates",
    "verify",
    "fleet",
    "history",
    "import_log",
    "list_sessions",
    "load",
    "lot",
    "plan",
    "read_log",
    "rebias",
    "report",
    "sensors",
    "watch",
    "simulate",
    "to_frame",
]


@pytest.fixture(scope="module")
def simulated():
    return tinygc.simulate(segments=12, closure_s=30.0, seed=4)


@pytest.fixture(scope="module")
def fitted(simulated):
    return tinygc.fit(simulated.session, methods=("raw", "least_squares"))


def test_a_session_of_arrays_is_the_session_of_its_files(simulated, fitted, tmp_path):
    folder = simulated.save(tmp_path / "session")
    read = tinygc.read_session(folder)
    for mine, theirs in zip((*simulated.session.logs, *simulated.session.closures), (*read.logs, *read.closures), strict=True):
        np.testing.assert_array_equal(mine.samples.t_ns, theirs.samples.t_ns)
        np.testing.assert_allclose(mine.samples.gyro, theirs.samples.gyro, rtol=1e-15)
    from_files = tinygc.fit(folder, methods=("least_squares",))
    for name, estimate in fitted.parameters.items():
        assert estimate.value == pytest.approx(from_files.parameters[name].value, rel=1e-9, abs=1e-12)
        assert estimate.sigma == pytest.approx(from_files.parameters[name].sigma, rel=1e-9)
    assert fitted.closure_runs.keys() != from_files.closure_runs.keys()  # a run of arrays has no file's name
    (mine,), (theirs,) = fitted.closure_runs.values(), from_files.closure_runs.values()
    assert mine["least_squares"]["rmse_deg"] == pytest.approx(theirs["least_squares"]["rmse_deg"], rel=1e-6)


def test_a_saved_model_says_how_well_it_is_known(fitted, simulated, tmp_path):
    table = json.loads(fitted.model.save(tmp_path / "gyro.json").read_text())
    np.testing.assert_array_equal(table["covariance"], fitted.covariance)
    model, rate = tinygc.load(tmp_path / "gyro.json"), simulated.session.logs[0].samples.gyro[:50]
    np.testing.assert_array_equal(model(rate), fitted.model(rate))
    np.testing.assert_array_equal(model(rate), model(rate))  # nothing is remembered


def test_arrays_have_no_folder_to_save_into(fitted, tmp_path):
    with pytest.raises(CalibrationError, match="has no folder of its own; give one"):
        fitted.save()
    assert (fitted.save(tmp_path / "fit") / "model_least_squares.json").exists()


def test_a_method_that_was_not_fitted_is_not_invented(simulated):
    with pytest.raises(FitError, match="least_squares was not fitted; take one of models: raw"):
        tinygc.fit(simulated.session, methods=("raw",)).model  # noqa: B018


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"t_s": [0.0]}, "t_s has 1 samples, expected at least 2"),
        ({"t_s": [0.0, 0.01, 0.01]}, r"t_s\[2\] = 0.01 s does not go on"),
        ({"gyro_rps": np.zeros((3, 2))}, r"gyro_rps has shape \(3, 2\), expected \(3, 3\)"),
        ({"accel_mps2": [[0, 0, "g"]] * 3}, "accel_mps2 is not made of numbers"),
        ({"gyro_rps": [[0, 0, 0], [0, np.nan, 0], [0, 0, 0]]}, r"gyro_rps\[1, 1\] is nan"),
        ({"temp_c": [20.0, 21.0]}, r"temp_c has shape \(2,\), expected \(3,\)"),
        ({"t_s": [0.0, 1e10, 2e10]}, "expected seconds"),
    ],
)
def test_arrays_that_are_no_log_are_refused_in_one_line(changes, complaint):
    arrays = {"t_s": [0.0, 0.01, 0.02], "gyro_rps": np.zeros((3, 3)), "accel_mps2": np.zeros((3, 3))} | changes
    with pytest.raises(DataError, match=complaint) as caught:
        tinygc.Session.from_arrays(**arrays)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("hidden", "complaint"),
    [
        ({"reference.accelerometer": {"bias_mg": [1, 0, 0]}}, "does not add to the rate"),
        ({"gyro.bias_drift": {"dps": [1, 0, 0]}}, "parameters are dps, expected dps_over_log"),
        ({"gyro.bias_drift": {"dps_over_log": [1, 0]}}, r"has shape \(2,\), expected \(3,\)"),
    ],
)
def test_what_cannot_be_hidden_is_refused(hidden, complaint):
    with pytest.raises(DataError, match=complaint):
        tinygc.simulate(segments=8, effects=hidden)


def test_full_scales_that_nobody_gave_hold_what_was_measured():
    rate = np.zeros((200, 3))
    rate[50] = [300 * DEG, 0, 0]
    session = tinygc.Session.from_arrays(np.arange(200) / 100, rate, np.tile([0, 0, -9.8], (200, 1)))
    assert (session.config.sensor.gyro_fs_dps, session.config.sensor.accel_fs_g) == (500, 2)
    assert session.config.sensor.odr_hz == pytest.approx(100)


def test_the_package_loads_nothing_heavy_before_it_is_asked():
    code = "import sys, tinygc; print(sorted({'numpy', 'torch', 'scipy', 'rich'} & set(sys.modules)))"
    assert processes.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_all_names_are_there_and_no_other():
    assert {"Session", "fit", "fit_temperature", "ThermalFit", "CalibrationError"} <= set(dir(tinygc))
    for name in dir(tinygc):
        assert getattr(tinygc, name) is not None
    assert pydoc.render_doc(tinygc).count("\n") < 150  # three screens
    with pytest.raises(AttributeError, match="has no attribute 'fitt'"):
        tinygc.fitt  # noqa: B018


def home(name):
    """A public name where it is defined."""
    module = next(module for module, names in tinygc._HOMES.items() if name in names)
    return getattr(importlib.import_module(module), name)


def test_every_public_function_has_an_example():
    functions = {name for name in dir(tinygc) if name.islower() and not name.startswith("_") and callable(getattr(tinygc, name))}
    assert functions - {"read_session"} == {name for name in EXAMPLES if name.islower()}
    for name in EXAMPLES:
        assert doctest.DocTestParser().get_examples(home(name).__doc__), name


@pytest.mark.broad
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_of_docstrings_run(name):
    (example,) = doctest.DocTestFinder(recurse=False).find(home(name), name, module=False, globs={})
    assert doctest.DocTestRunner().run(example).failed == 0


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: tinygc.fit("x", method=("raw",)), "fit: no option 'method'; did you mean methods?"),
        (lambda: tinygc.explain("x", seeds=1), "explain: no option 'seeds'; did you mean seed?"),
        (lambda: tinygc.simulate(xyz=8), "simulate: no option 'xyz'; expected some of options, effects, segments"),
        (lambda: tinygc.simulate(tinygc.FitOptions()), "options is of type FitOptions, expected tinygc.SimulationOptions"),
        (lambda: tinygc.fit([1, 2]), "session is of type list, expected a tinygc.Session or the path of its folder"),
        (lambda: tinygc.check(3), "session is of type int"),
        (lambda: tinygc.fit("x", progress=3), "progress is 3, expected a function"),
        (lambda: tinygc.fit(), "fit: missing a required argument: 'session'"),
    ],
)
def test_a_wrong_argument_is_an_error_that_names_the_right_one(call, complaint):
    with pytest.raises(CalibrationError, match=re.escape(complaint)):
        call()


@pytest.mark.parametrize(
    ("choices", "complaint"),
    [
        ({"folds": 0}, "folds is 0, expected a whole number of 2 or more"),
        ({"methods": "raw", "as_in_paper": True}, "expected a net .tinygc, tinygc_denoised. for --as-in-paper to train"),
        ({"methods": ()}, r"methods is \(\), expected some of raw"),
        ({"methods": "resnet"}, r"methods is \('resnet',\), expected some of raw"),
        ({"bias": "magic"}, "bias is 'magic', expected one of auto, ends, stills"),
        ({"folds": 2.5}, "folds is 2.5, expected a whole number"),
    ],
)
def test_options_that_cannot_be_are_refused_in_one_line(simulated, choices, complaint):
    with pytest.raises(CalibrationError, match=complaint):
        tinygc.fit(simulated.session, **choices)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"protocol": Protocol(reference="truth")}, 'reference is "truth"; arrays have "gravity", or "truth" with truth='),
        ({"protocol": Protocol(reference="table")}, 'reference is "table"; arrays have "gravity"'),
        ({"closures": [(1, 2)]}, "each of closures is"),
        ({"name": "../etc"}, "expected one word"),
        ({"gyro_fs_dps": -5}, "gyro_fs_dps is -5, expected the full scale"),
    ],
)
def test_settings_that_arrays_cannot_have_are_refused(settings, complaint):
    with pytest.raises(DataError, match=complaint):
        tinygc.Session.from_arrays([0.0, 0.01, 0.02], np.zeros((3, 3)), np.zeros((3, 3)), **settings)


def test_a_gap_in_what_is_needed_is_no_rate(fitted, simulated):
    raw = simulated.session.logs[0].samples.gyro[:20].copy()
    raw[7, 1] = np.nan
    with pytest.raises(CalibrationError, match=r"raw\[7\] is not finite"):
        fitted.model(raw)
    with pytest.raises(CalibrationError, match=r"raw\[0\] is not finite"):
        fitted.model.live()(raw[7])
    with pytest.raises(CalibrationError, match="raw is not made of numbers"):
        fitted.model("abc")
    with pytest.raises(CalibrationError, match="rate_hz is -5"):
        Calibration(fitted.model.model, -5)
