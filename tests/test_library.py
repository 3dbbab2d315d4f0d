"""What a notebook calls: arrays give what folders give, each function the numbers and files of its command, wrong arguments one line."""

import contextlib
import doctest
import io
import json
import pydoc
import re
import shutil
import sys

import numpy as np
import processes
import pytest
from conftest import DEG, broad
from formats_page import told as command

import calibrate
import tinygc
from session.base.texts import measured
from session.base.units import G
from tinygc import CalibrationError
from tinygc.deploy import FORMATS

METHODS = ("raw", "least_squares")
FIT = ("--methods", ",".join(METHODS))


def same(mine, theirs, **but):
    """Of a function and its command, but for paths."""
    assert json.loads(json.dumps(mine)) | but == theirs | but


@pytest.fixture(scope="module")
def simulated():
    """Two sessions of one unit."""
    return [tinygc.simulate(segments=7, closure_s=12.0, odr_hz=62.5, seed=seed, unit_seed=1) for seed in (1, 2)]


@pytest.fixture(scope="module")
def folders(simulated, tmp_path_factory):
    """Their folders, the first of which is fitted by the command, the second by the function."""
    place = tmp_path_factory.mktemp("sessions")
    return [each.save(place / f"session{n}") for n, each in enumerate(simulated, 1)]


@pytest.fixture(scope="module")
def screen(folders):
    """What the command says of the first."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert calibrate.main(["fit", str(folders[0]), *FIT]) == 0
    return out.getvalue()


@pytest.fixture(scope="module")
def fits(folders, screen):
    made = [tinygc.fit(tinygc.read_session(folder), methods=METHODS) for folder in folders]
    made[1].save()
    return made


@pytest.fixture(scope="module")
def of_arrays(simulated):
    """The fit of the first session's arrays, which were never a file."""
    return tinygc.fit(simulated[0].session, methods=METHODS)


# Fit, model


def test_a_session_of_arrays_is_the_session_of_its_files(simulated, of_arrays, folders, fits):
    here, read = simulated[0].session, tinygc.read_session(folders[0])
    for mine, theirs in zip((*here.logs, *here.closures), (*read.logs, *read.closures), strict=True):
        np.testing.assert_array_equal(mine.samples.t_ns, theirs.samples.t_ns)
        np.testing.assert_allclose(mine.samples.gyro, theirs.samples.gyro, rtol=1e-15)
    for name, estimate in of_arrays.parameters.items():
        theirs = fits[0].parameters[name]
        assert (estimate.value, estimate.sigma) == pytest.approx((theirs.value, theirs.sigma), rel=1e-9, abs=1e-12)
    (mine,), (theirs,) = of_arrays.closure_runs.values(), fits[0].closure_runs.values()
    assert mine["least_squares"]["rmse_deg"] == pytest.approx(theirs["least_squares"]["rmse_deg"], rel=1e-6)
    for thing in (simulated[0], here, of_arrays, of_arrays.parameters["E_xx"], of_arrays.model):
        assert len(repr(thing)) < 140
    assert "\x1b" not in of_arrays._repr_html_() + of_arrays.summary()
    with pytest.raises(CalibrationError, match="has no folder of its own; give one"):
        of_arrays.save()


def test_the_sensor_errors_are_the_inverse_of_the_calibration_and_those_of_the_screen(fits, screen):
    model, errors = fits[0].model.model, fits[0].sensor_errors
    reads = np.linalg.inv(model.E)
    for i, axis in enumerate("xyz"):
        assert errors[f"scale_factor_error_{axis}"].value == pytest.approx(1e6 * (np.linalg.norm(reads[i]) - 1), abs=1e-6)
        assert errors[f"bias_{axis}"].value == pytest.approx(-(reads @ model.B)[i] / DEG, rel=1e-12)
    assert [errors[name].unit for name in ("scale_factor_error_x", "misalignment_z_to_y", "bias_z")] == ["ppm", "mrad", "dps"]
    rows = {line.split(",")[0]: re.findall(r"(-?[\d.]+) ± ([\d.]+)", line) for line in screen.splitlines() if " ± " in line}
    for title, start in (
        ("scale factor error", "scale_f"),
        ("bias", "bias"),
        *((f"misalignment of {a}", f"misalignment_{a}") for a in "xyz"),
    ):
        shown = [each for name, each in errors.items() if name.startswith(start)]
        for error, (value, sigma) in zip(shown, rows[title], strict=True):
            assert measured(error.value, error.sigma) == f"{value} ± {sigma}", title


def test_a_fit_has_a_verdict_for_each_limit_that_it_is_asked(fits):
    answers = {limit: fits[0].verdict(limit).answer for limit in (1e-4, 10.0, None)}
    assert answers == {1e-4: "fail", 10.0: "doubtful pass", None: "not decided"}
    assert [fits[0].verdict(limit).answer for limit in answers] == list(answers.values())


def test_a_saved_model_is_known_as_well_and_gives_the_unit_that_it_is_told(fits, tmp_path):
    """omega = E m + B holds in any unit with B in that unit: E is the same, and the answer at no rate is B."""
    table = json.loads(fits[0].model.save(tmp_path / "gyro.json").read_text())
    np.testing.assert_array_equal(table["covariance"], fits[0].covariance)
    model, rates = tinygc.load(tmp_path / "gyro.json"), np.random.default_rng(2).normal(size=(40, 3))
    np.testing.assert_array_equal(model(rates), fits[0].model(rates))
    for unit, si in (("dps", DEG), ("mdps", 1e-3 * DEG), ("rad/s", 1.0)):
        given = rates / si
        expected = rates @ model.model.E.T + model.model.B
        np.testing.assert_allclose(model(given, unit=unit) * si, expected, rtol=1e-13, atol=1e-15)
        live = model.live()
        np.testing.assert_allclose([live(row, unit=unit) for row in given], model(given, unit=unit), rtol=1e-13)


def test_a_model_refuses_gaps_and_rates_that_are_surely_degrees(fits):
    """The bar is 1.2 times the full scale of the fitted sensor, 500 dps, and 4000 dps of a model that does not say."""
    model, nameless = fits[0].model, tinygc.Calibration(fits[0].model.model)
    for calibration, bar in ((model, 1.2 * 500 * DEG), (nameless, 4000 * DEG)):
        rates = np.zeros((5, 3))
        rates[3, 2] = 0.999 * bar
        calibration(rates)
        rates[3, 2] = -1.001 * bar
        with pytest.raises(CalibrationError, match=r'raw\[3, 2\] is -.* rad/s, .* are the rates in degrees\? give unit="dps"'):
            calibration(rates)
        with pytest.raises(CalibrationError, match=r"raw\[0, 2\] is -"):
            calibration.live()(rates[3])
        rates[3, 2] = np.nan
        with pytest.raises(CalibrationError, match=r"raw\[3\] is not finite"):
            calibration(rates)


# Each function and its command


def test_the_report_of_a_fit_is_the_commands(folders, fits, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    theirs = command(tmp_path / "r.json", "report", folders[0], *FIT, "--no-explain", "--out", tmp_path / "r.html", "--limit", 5)
    of_fit = tinygc.report(fits[0], tmp_path / "fit.html", explain=False, limit_deg=5)
    same(of_fit.to_json(), theirs)
    assert (tmp_path / "fit.html").read_text(encoding="utf-8") == of_fit.html


@pytest.mark.parametrize("kind", FORMATS)
def test_every_export_of_a_fit_is_the_commands(kind, fits, folders, tmp_path):
    exported = fits[0].export(kind, tmp_path / "mine")
    table = command(tmp_path / "e.json", "export", folders[0], "--to", kind, "--out", tmp_path / "theirs")
    for place in ("mine", "theirs"):
        assert {path.name: path.read_text() for path in (tmp_path / place).iterdir()} == exported.files
    assert exported.remarks == table["remarks"]


def test_compare_plan_and_accelerometer_give_the_commands_numbers(fits, of_arrays, folders, tmp_path):
    theirs = command(tmp_path / "c.json", "history", *folders, "--compare")
    found = tinygc.compare(fits)  # which never were saved
    same(found.to_json(), theirs)
    assert (found.agree, found.p_value) == (theirs["agree"], theirs["lasting"]["p_value"])
    assert tinygc.compare(fits, bias=True).p_value == theirs["all"]["p_value"]
    assert tinygc.compare([of_arrays, fits[1]]).p_value == pytest.approx(found.p_value, rel=1e-4)
    theirs = command(tmp_path / "p.json", "check", folders[0], "--plan", 3)
    same(tinygc.plan(folders[0], count=3).to_json(), theirs)
    theirs = command(tmp_path / "a.json", "fit", folders[0], "--accelerometer", "alone", "--out", tmp_path / "theirs")
    alone = tinygc.accelerometer(folders[0])
    same(alone.to_json(), theirs)
    assert (alone.save(tmp_path / "mine") / "session.toml").read_bytes() == (tmp_path / "theirs" / "session.toml").read_bytes()


def test_rebias_takes_a_fit_as_it_takes_its_file(folders, fits, tmp_path):
    model = folders[0] / "fit" / "model_least_squares.json"
    made, of_file = tinygc.rebias(fits[1].source, fits[0]), tinygc.rebias(folders[1], model)
    saved = (made.save(tmp_path / "mine") / "model_rebiased.json").read_bytes()
    assert saved == (of_file.save(tmp_path / "theirs") / "model_rebiased.json").read_bytes()
    change = [each.value for each in made.change.values()]
    assert change == [each.value for each in of_file.change.values()]
    rate = np.array([[0.1, -0.2, 0.3]])
    np.testing.assert_allclose((made.model(rate) - fits[0].model(rate))[0], change, rtol=1e-9)


def test_apply_gives_the_commands_log(fits, folders, tmp_path):
    log = folders[1] / "log0001.csv.gz"
    theirs = command(tmp_path / "a.json", "apply", folders[0], log, "-o", tmp_path / "theirs.csv")
    same(tinygc.apply(folders[0], log, tmp_path / "mine.csv").to_json(), theirs, out="")
    tinygc.apply(fits[0], log, tmp_path / "fit.csv")  # whose model was never a file
    for name in ("mine", "fit"):
        assert (tmp_path / f"{name}.csv").read_bytes() == (tmp_path / "theirs.csv").read_bytes()
    written = np.loadtxt(tmp_path / "theirs.csv", delimiter=",", skiprows=1)
    samples = tinygc.apply(fits[0], tinygc.read_session(folders[1]).logs[0])
    np.testing.assert_array_equal(written[:, 0], samples.t_ns)
    np.testing.assert_allclose(written[:, 1:4], samples.gyro, rtol=0, atol=6e-10)
    np.testing.assert_allclose(written[:, 4:7], samples.accel, rtol=0, atol=6e-7)
    rates = np.random.default_rng(1).normal(size=(50, 3))
    np.testing.assert_array_equal(tinygc.apply(fits[0], rates), fits[0].model(rates))
    still = fits[0].result.problem.stills[0]  # by the fit's accelerometer as long as the site's gravity
    length = np.linalg.norm(tinygc.apply(fits[0], fits[0].source.logs[0]).accel[still.start : still.stop].mean(axis=0))
    assert length == pytest.approx(fits[0].source.config.site.gravity_mps2, abs=2e-3 * G)


# Tables and pictures


def test_records_become_tables_of_pandas_and_a_fit_is_drawn(fits, tmp_path, monkeypatch):
    pandas = pytest.importorskip("pandas")
    table, findings, samples = fits[0].to_frame(), tinygc.check(fits[0].source), fits[0].session.logs[0].samples
    assert list(table.columns) == ["name", "value", "sigma", "unit"]
    assert table.loc["E_xy", "value"] == fits[0].parameters["E_xy"].value
    assert list(pandas.DataFrame(findings)["what"]) == [finding.what for finding in findings]
    np.testing.assert_array_equal(samples.to_frame()["ay_mps2"], samples.accel[:, 1])
    closure, *panels = fits[0].plot(tmp_path / "new" / "fit.svg").panels
    assert (tmp_path / "new" / "fit.svg").read_text(encoding="utf-8").startswith("<svg xmlns=")
    _, held_out = (mark for mark in closure.marks if mark.radius)
    assert np.sqrt(np.mean(held_out.y**2)) == pytest.approx(fits[0].closure["least_squares"]["tilt_rms_deg"], rel=1e-9)
    for panel, word, unit in zip(panels, ("scale_factor_error", "misalignment", "bias"), ("ppm", "mrad", "dps"), strict=True):
        shown = [each.value for name, each in fits[0].sensor_errors.items() if name.startswith(word)]
        np.testing.assert_array_equal(panel.marks[-1].y, shown)
        assert panel.y.label.endswith(f"({unit})")
    monkeypatch.setitem(sys.modules, "pandas", None)
    for call, says in ((fits[0].to_frame, "to_frame needs pandas: python"), (lambda: fits[0].plot("fit.png"), "a picture is an SVG")):
        with pytest.raises(CalibrationError, match=says):
            call()


# Names, examples


def test_the_package_and_the_pages_of_help_load_nothing_heavy():
    code = """import calibrate, sys, tinygc
try: calibrate.main(['fit', '--help'])
except SystemExit: print(sorted({'numpy', 'torch', 'scipy', 'rich.console'} & set(sys.modules)))"""
    assert processes.check_output([sys.executable, "-c", code], text=True).splitlines()[-1] == "[]"
    for name in dir(tinygc):
        assert getattr(tinygc, name) is not None
    assert pydoc.render_doc(tinygc).count("\n") < 150  # three screens
    with pytest.raises(AttributeError, match="has no attribute 'fitt'"):
        tinygc.fitt  # noqa: B018


FUNCTIONS = sorted(name for name in dir(tinygc) if name.islower() and not name.startswith("_") and callable(getattr(tinygc, name)))


@pytest.mark.parametrize(
    "name", [broad(name) for name in ("FitOptions", *FUNCTIONS) if name not in ("read_session", "explain", "fit_temperature", "fleet")]
)
def test_examples_of_docstrings_run(name):
    (example,) = doctest.DocTestFinder(recurse=False).find(getattr(tinygc, name), name, module=False, globs={})
    assert doctest.DocTestRunner().run(example).failed == 0


# What is refused, in one line


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: tinygc.fit("x", method=("raw",)), "fit: no option 'method'; did you mean methods?"),
        (lambda: tinygc.simulate(tinygc.FitOptions()), "options is of type FitOptions, expected tinygc.SimulationOptions"),
        (lambda: tinygc.fit([1, 2]), "session is a list, expected a tinygc.Session, the path of its folder, or a table"),
        (lambda: tinygc.fit(), "fit: missing a required argument: 'session'"),
        (lambda: tinygc.sensors("asm330lh"), "is no sensor that is known; is ASM330LHH meant?"),
        (lambda: tinygc.simulate(effects={"gyro.bias_drift": {"dps_over_log": [1, 0]}}), "has shape (2,), expected (3,)"),
        *(
            (lambda choices=choices: tinygc.fit("x", **choices), says)
            for choices, says in (
                ({"folds": 0}, "folds is 0, expected a whole number of 2 or more"),
                ({"methods": "resnet"}, "methods is 'resnet', expected some of raw"),
                ({"bias": "magic"}, "bias is 'magic', expected one of auto, ends, stills"),
            )
        ),
    ],
)
def test_a_wrong_argument_is_an_error_that_names_the_right_one(call, complaint):
    with pytest.raises(CalibrationError, match=re.escape(complaint)) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda fit: fit.report(explain=False, limit_deg=-1), "limit_deg is -1, expected a number above 0 deg"),
        (lambda fit: fit.export("json", model="tinygc"), "tinygc was not fitted; the fit has raw, least_squares"),
        (lambda fit: tinygc.compare([fit]), "--compare needs two sessions or more"),
        (lambda fit: tinygc.compare([fit, fit]), "hold the same log"),
        (lambda fit: tinygc.apply(fit, np.zeros((2, 3)), "x.csv"), "apply: out goes with a log file, and data is a ndarray"),
        (lambda fit: tinygc.apply(fit, "x.csv"), "give out=, the log to write"),
        (lambda fit: fit.model(np.zeros((2, 3)), unit="degrees"), "unit is 'degrees', expected one of mdps, dps"),
    ],
)
def test_what_a_fit_cannot_be_asked_is_one_line(fits, call, complaint):
    with pytest.raises(CalibrationError, match=re.escape(complaint)) as caught:
        call(fits[0])
    assert "\n" not in str(caught.value)


# A model leaves the tool only beside figures that say that it may


def edited(folder, out, change):
    """A copy of the fitted folder whose fit.json was changed."""
    made = shutil.copytree(folder, out, ignore=shutil.ignore_patterns("export", "report*"))
    path = made / "fit" / "fit.json"
    table = json.loads(path.read_text())
    change(table)
    path.write_text(json.dumps(table))
    return made


@pytest.mark.parametrize(
    ("without", "expected"),
    [
        ("segments.used", "a whole number of at least 0"),
        ("methods.least_squares", "how well that model closes held-out turns"),
        ("against_raw.tilt_rms_deg", "a number from 0 to 10000 or null"),
    ],
)
def test_a_fit_without_the_figures_of_its_model_exports_nothing(without, expected, folders, screen, tmp_path, run):
    *above, last = without.split(".")
    folder = edited(folders[0], tmp_path / "s", lambda table: (table[above[0]] if above else table).pop(last))
    code, _, err = run("export", folder, "--to", "px4")
    line = f"{without} is missing, expected {expected}; run `python calibrate.py fit {folder}` again"
    assert (code, err) == (2, f"calibrate: {folder / 'fit' / 'fit.json'}: {line}\n")
    assert not (folder / "export").exists()


def test_a_sensor_without_errors_is_better_off_without_twelve_parameters(tmp_path, run):
    """Few turns, and twelve parameters that follow their noise: raw is better, which ``fit`` says, and which is a fail."""
    none = dict.fromkeys(("gyro_scale_error", "gyro_misalignment", "gyro_bias_dps", "bias_instability_dph", "latitude_deg"), 0.0)
    made = tinygc.simulate(segments=13, closure_s=0.0, odr_hz=104.0, seed=2, **none)
    code, _, err = run("fit", made.save(tmp_path / "s"), "--methods", "least_squares", "--bias", "ends", "--quiet")
    assert (code, "Held out worse than raw" in err) == (1, True)
    raw = json.loads((tmp_path / "s" / "fit" / "fit.json").read_text())["against_raw"]
    assert (raw["worse"], raw["passed"]) == (["least_squares"], False)


@pytest.mark.parametrize(("held", "by"), [(99.0, "with 99 deg"), (None, "by no number that fit.json knows")])
def test_a_model_that_is_worse_than_raw_leaves_only_if_somebody_insists(held, by, folders, tmp_path, run):

    def worse(table):
        table["segments"]["used"] = 30  # enough for a verdict
        table["methods"]["least_squares"]["holdout"]["tilt_rms_deg"] = held

    folder = edited(folders[0], tmp_path / "s", worse)
    code, _, err = run("export", folder, "--to", "px4")
    assert (code, f"{by}, worse than the raw rates" in err) == (2, True)
    code, out, _ = run("export", folder, "--to", "px4", "--anyway")
    assert (code, "--anyway" in out) == (0, True)
