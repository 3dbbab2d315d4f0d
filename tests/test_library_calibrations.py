"""From a fit to its report, exports and uses: arrays give what folders give, and each function the numbers of its command."""

import json
import re
import sys

import numpy as np
import pytest
from conftest import DEG, broad

import calibrate
import tinygc
from tinygc import CalibrationError
from tinygc.deploy import FORMATS

METHODS = ("raw", "least_squares")
FIT = ("--methods", ",".join(METHODS))


def command(out, *words, code=0) -> dict:
    """The JSON of a command."""
    assert calibrate.main([*map(str, words), "--quiet", "--json", str(out)]) == code
    return json.loads(out.read_text())


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two fitted sessions of one unit."""
    place = tmp_path_factory.mktemp("sessions")
    made = []
    for seed in (1, 2):
        simulated = tinygc.simulate(segments=20, closure_s=20.0, odr_hz=104.0, seed=seed, unit_seed=1)
        made.append(simulated.save(place / f"session{seed}"))
        command(place / "fit.json", "fit", made[-1], *FIT)
    return made


@pytest.fixture(scope="module")
def fits(folders):
    return [tinygc.fit(tinygc.read_session(folder), methods=METHODS) for folder in folders]


@pytest.fixture(scope="module")
def of_arrays(folders):
    """The fit of the first session's arrays, which were never a file."""
    read = tinygc.read_session(folders[0])
    arrays = [(s.t_ns * 1e-9, s.gyro, s.accel, s.temp_c) for s in (log.samples for log in (*read.logs, *read.closures))]
    config, sensor = read.config, read.config.sensor
    session = tinygc.Session.from_arrays(
        *arrays[0],
        closures=arrays[1:],
        name="notebook",
        model=sensor.model,
        serial=sensor.serial,
        gyro_fs_dps=sensor.gyro_fs_dps,
        accel_fs_g=sensor.accel_fs_g,
        accelerometer=config.accelerometer,
        site=config.site,
        protocol=config.protocol,
    )
    return tinygc.fit(session, methods=METHODS)


# the sensor's errors


def test_the_sensor_errors_are_the_numbers_of_the_screen(folders, fits, capsys):
    assert calibrate.main(["fit", str(folders[0]), *FIT]) == 0
    rows = {
        line.split(",")[0]: re.findall(r"(-?[\d.]+) ± ([\d.]+)", line) for line in capsys.readouterr().out.splitlines() if " ± " in line
    }
    errors = fits[0].sensor_errors
    terms = {"scale factor error": [f"scale_factor_error_{axis}" for axis in "xyz"], "bias": [f"bias_{axis}" for axis in "xyz"]}
    terms |= {f"misalignment of {axis}": [f"misalignment_{axis}_to_{other}" for other in "xyz" if other != axis] for axis in "xyz"}
    assert {name for names in terms.values() for name in names} == set(errors)
    for title, names in terms.items():
        assert len(rows[title]) == len(names)
        for name, (value, sigma) in zip(names, rows[title], strict=True):
            digits = len(value.partition(".")[2])
            assert (f"{errors[name].value:.{digits}f}", f"{errors[name].sigma:.{digits}f}") == (value, sigma), name
    assert [errors[name].unit for name in ("scale_factor_error_x", "misalignment_z_to_y", "bias_z")] == ["ppm", "mrad", "dps"]


def test_the_sensor_errors_are_the_inverse_of_the_calibration(fits):
    model, errors = fits[0].model.model, fits[0].sensor_errors
    reads = np.linalg.inv(model.E)
    for i, axis in enumerate("xyz"):
        assert errors[f"scale_factor_error_{axis}"].value == pytest.approx(1e6 * (np.linalg.norm(reads[i]) - 1), abs=1e-6)
        assert errors[f"bias_{axis}"].value == pytest.approx(-(reads @ model.B)[i] / DEG, rel=1e-12)


# report and exports


def test_the_report_of_arrays_is_that_of_their_folder(of_arrays, folders, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notebook").mkdir()  # a folder of the session's name is not the session's
    (tmp_path / "notebook" / "raw.times").write_text("0,0,open 2001-01-01T00:00:00+00:00 x\n")
    made = of_arrays.report(tmp_path / "new" / "report.html", explain=False)
    assert (tmp_path / "new" / "report.html").read_text(encoding="utf-8") == made.html
    assert "notebook" in made.html
    assert "2001" not in made.html
    theirs = command(tmp_path / "r.json", "report", folders[0], *FIT, "--no-explain", "--out", tmp_path / "r.html")
    mine = made.to_json()
    assert (mine["answer"], made.verdict.word, mine["calibration"]) == (theirs["answer"], "PASS", theirs["calibration"])
    for one, other in zip(mine["parameters"], theirs["parameters"], strict=True):
        assert (one["parameter"], one["component"], one["unit"]) == (other["parameter"], other["component"], other["unit"])
        for key in ("value", "expanded_uncertainty"):
            assert one[key] == (None if other[key] is None else pytest.approx(other[key], rel=1e-6, abs=1e-9))
    assert made.summary().startswith(f"PASS: {made.verdict.closure}"[:40])


@pytest.mark.parametrize("kind", FORMATS)
def test_every_export_of_a_fit_is_the_commands(kind, fits, of_arrays, folders, tmp_path):
    exported = fits[0].export(kind, tmp_path / "mine")
    table = command(tmp_path / "e.json", "export", folders[0], "--to", kind, "--out", tmp_path / "theirs")
    assert {path.name: path.read_text() for path in (tmp_path / "theirs").iterdir()} == exported.files
    assert {path.name: path.read_text() for path in (tmp_path / "mine").iterdir()} == exported.files
    assert exported.remarks == table["remarks"]
    assert tinygc.export(folders[0], kind).files == exported.files
    arrays = tinygc.export(of_arrays, kind)  # its numbers are another's to the last digits, and its logs have other names
    assert [name.replace("notebook", "session1") for name in arrays.files] == list(exported.files)
    assert "notebook" in "".join([*arrays.files, *arrays.files.values()])


def test_what_an_export_refuses_is_refused_of_a_fit(fits, tmp_path, monkeypatch):
    with pytest.raises(CalibrationError, match="to is 'matlab', expected one of json, kalibr"):
        fits[0].export("matlab")
    with pytest.raises(CalibrationError, match="tinygc was not fitted; the fit has raw, least_squares"):
        fits[0].export("json", model="tinygc")
    with pytest.raises(CalibrationError, match="source is of type int, expected a Fit"):
        tinygc.export(3, "json")
    assert "fusion_calibration.h" in fits[0].export("x-io").files
    (tmp_path / "none" / "x").mkdir(parents=True)
    monkeypatch.setattr("tinygc.deploy.exports._context.worse_in_table", lambda fit, name: (2.0, 1.0))
    with pytest.raises(CalibrationError, match="worse than the raw rates"):
        fits[0].export("json", tmp_path / "none" / "y")
    assert not (tmp_path / "none" / "y").exists()
    (remark,) = fits[0].export("json", anyway=True).remarks
    assert "worse than the raw rates" in remark


# compare, plan, rebias, accelerometer


def test_compare_gives_the_commands_numbers(fits, folders, tmp_path):
    theirs = command(tmp_path / "c.json", "compare", *folders)
    assert json.loads(json.dumps(tinygc.compare(folders).to_json())) == theirs
    found = tinygc.compare(fits)  # which never were saved
    assert json.loads(json.dumps(found.to_json())) == theirs
    assert found.agree == theirs["agree"]
    assert found.p_value == theirs["lasting"]["p_value"]
    assert tinygc.compare(fits, bias=True).p_value == theirs["all"]["p_value"]
    with pytest.raises(CalibrationError, match="compare needs two sessions or more"):
        tinygc.compare(fits[:1])
    with pytest.raises(CalibrationError, match="hold the same log"):
        tinygc.compare([fits[0], fits[0]])


def test_plan_gives_the_commands_numbers(folders, of_arrays, tmp_path):
    theirs = command(tmp_path / "p.json", "plan", folders[0], "--count", 3)
    assert tinygc.plan(folders[0], count=3).to_json() == theirs
    mine = tinygc.plan(of_arrays.source, count=3)
    assert [move.words for move in mine.proposals] == [move["words"] for move in theirs["proposals"]]
    assert mine.enough == theirs["enough"]
    assert mine.summary().startswith("1. from a still")
    with pytest.raises(CalibrationError, match="count is 0, expected a whole number"):
        tinygc.plan(folders[0], count=0)


@pytest.mark.parametrize("source", ["start", broad("gravity"), broad("given")])
def test_rebias_gives_the_commands_numbers(source, folders, fits, tmp_path):
    model = folders[0] / "fit" / "model_least_squares.json"
    words = ("--model", model, "--bias", source, *(("--bias-dps", "0.5,-0.3,0.6") if source == "given" else ()))
    theirs = command(tmp_path / "b.json", "fit", folders[1], *words, "--out", tmp_path / "theirs")
    given = {"bias_dps": (0.5, -0.3, 0.6)} if source == "given" else {}
    in_memory = tinygc.rebias(fits[1].source, fits[0], source, **given)
    mine = json.loads(json.dumps(in_memory.to_json()))
    bias = mine.pop("bias")
    assert bias | {"model": str(model)} == theirs.pop("bias")
    assert mine == theirs
    saved = (in_memory.save(tmp_path / "mine") / "model_rebiased.json").read_bytes()
    assert saved == (tmp_path / "theirs" / "model_rebiased.json").read_bytes()
    change = [each.value for each in in_memory.change.values()]
    np.testing.assert_allclose(np.array(change) / DEG, bias["change_dps"][source], rtol=1e-12)
    rate = np.array([[0.1, -0.2, 0.3]])
    np.testing.assert_allclose((in_memory.model(rate) - fits[0].model(rate))[0], change, rtol=1e-9)
    of_file = tinygc.rebias(folders[1], model, source, **given).to_json()
    assert json.loads(json.dumps(of_file))["bias"] == bias | {"model": str(model)}


def test_rebias_refuses_a_source_without_its_bias(folders, fits):
    for source, bias in (("given", None), ("start", (0, 0, 0)), ("noon", None)):
        with pytest.raises(CalibrationError, match=f"source is '{source}', expected start or gravity, or given with bias_dps="):
            tinygc.rebias(folders[1], fits[0], source, bias_dps=bias)
    with pytest.raises(CalibrationError, match=r"bias_dps is .*, expected three numbers"):
        tinygc.rebias(folders[1], fits[0], "given", bias_dps=(1, 2))
    with pytest.raises(CalibrationError, match="model is of type float, expected a Calibration"):
        tinygc.rebias(folders[1], 3.0)
    with pytest.raises(CalibrationError, match="has no folder of its own"):
        tinygc.rebias(tinygc.simulate(segments=16, closure_s=0.0, odr_hz=104.0, seed=3).session, fits[0]).save()


def test_the_accelerometer_alone_gives_the_commands_numbers(folders, of_arrays, tmp_path):
    theirs = command(tmp_path / "a.json", "accelerometer", folders[0], "--out", tmp_path / "theirs")
    found = tinygc.accelerometer(folders[0])
    assert json.loads(json.dumps(found.to_json())) == theirs
    assert (found.save(tmp_path / "mine") / "session.toml").read_bytes() == (tmp_path / "theirs" / "session.toml").read_bytes()
    in_memory = tinygc.accelerometer(of_arrays.source)
    for name, estimate in found.parameters.items():
        assert in_memory.parameters[name].value == pytest.approx(estimate.value, rel=1e-6, abs=1e-9)
    own = tinygc.read_session(in_memory.save(tmp_path / "arrays")).config.accelerometer
    np.testing.assert_array_equal(own.matrix, in_memory.calibration.matrix)
    assert own.own_stills


# a calibration in use


def test_apply_gives_the_commands_log(fits, folders, tmp_path):
    log = folders[1] / "log0001.csv.gz"
    words = ("apply", folders[0], log, "-o", tmp_path / "theirs.csv")
    theirs = command(tmp_path / "a.json", *words)
    done = tinygc.apply(folders[0], log, tmp_path / "mine.csv")
    assert (tmp_path / "mine.csv").read_bytes() == (tmp_path / "theirs.csv").read_bytes()
    assert json.loads(json.dumps(done.to_json())) | {"out": theirs["out"]} == theirs
    tinygc.apply(fits[0], log, tmp_path / "fit.csv")  # whose model was never a file
    assert (tmp_path / "fit.csv").read_bytes() == (tmp_path / "theirs.csv").read_bytes()
    written = np.loadtxt(tmp_path / "theirs.csv", delimiter=",", skiprows=1)
    samples = tinygc.apply(fits[0], tinygc.read_session(folders[1]).logs[0])
    np.testing.assert_array_equal(written[:, 0], samples.t_ns)
    np.testing.assert_allclose(written[:, 1:4], samples.gyro, rtol=0, atol=6e-10)
    np.testing.assert_allclose(written[:, 4:7], samples.accel, rtol=0, atol=6e-7)


@pytest.mark.parametrize(("unit", "si"), [("dps", DEG), ("mdps", 1e-3 * DEG), ("rad/s", 1.0)])
def test_a_model_gives_the_unit_that_it_is_told(fits, unit, si):
    """omega = E m + B holds in any unit with B in that unit: E is the same, and the answer at no rate is B."""
    model, rates = fits[0].model, np.random.default_rng(2).normal(size=(40, 3))
    given = rates / si
    np.testing.assert_allclose(model(given, unit=unit) * si, model(rates), rtol=1e-13, atol=1e-15)
    zero = model(0 * given, unit=unit)
    np.testing.assert_allclose(zero[0], model.model.B / si, rtol=1e-14)
    np.testing.assert_allclose((model(given, unit=unit) - zero) @ np.linalg.inv(model.model.E).T, given, rtol=1e-9, atol=1e-9 / si)
    live = model.live()
    np.testing.assert_allclose([live(row, unit=unit) for row in given], model(given, unit=unit), rtol=1e-13)
    with pytest.raises(CalibrationError, match="unit is 'degrees', expected one of mdps, dps"):
        model(given, unit="degrees")


# tables, pictures, and what is the same of all


def test_records_become_tables_of_pandas(fits, monkeypatch):
    pandas = pytest.importorskip("pandas")
    table = fits[0].to_frame()
    assert list(table.columns) == ["name", "value", "sigma", "unit"]
    assert table.loc["E_xy", "value"] == fits[0].parameters["E_xy"].value
    assert fits[0].closure.to_frame().loc["least_squares", "tilt_rms_deg"] == fits[0].closure["least_squares"]["tilt_rms_deg"]
    findings = tinygc.check(fits[0].source)
    assert list(tinygc.to_frame(findings)["what"]) == [finding.what for finding in findings]
    assert isinstance(tinygc.to_frame(fits[0]), pandas.DataFrame)
    assert isinstance(tinygc.to_frame(fits[0].session.logs[0].samples), pandas.DataFrame)
    with pytest.raises(CalibrationError, match="records is of type int"):
        tinygc.to_frame(3)
    monkeypatch.setitem(sys.modules, "pandas", None)
    for call in (fits[0].to_frame, fits[0].closure.to_frame, lambda: tinygc.to_frame(findings), fits[0].session.logs[0].samples.to_frame):
        with pytest.raises(CalibrationError, match="to_frame needs pandas: python -m pip install pandas"):
            call()


def test_a_fit_is_drawn(fits, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    figure = fits[0].plot(tmp_path / "new" / "fit.png")
    assert (tmp_path / "new" / "fit.png").read_bytes().startswith(b"\x89PNG")
    closure, scale, misalignment, bias = figure.axes
    raw, held_out, floor = closure.lines
    assert len(raw.get_xdata()) == len(fits[0].result.problem.used)
    rms = np.sqrt(np.mean(np.square(held_out.get_ydata())))
    assert rms == pytest.approx(fits[0].closure["least_squares"]["tilt_rms_deg"], rel=1e-9)
    assert (np.array(raw.get_ydata()) > np.array(floor.get_ydata())[0]).all()
    for axes, word, unit in ((scale, "scale_factor_error", "ppm"), (misalignment, "misalignment", "mrad"), (bias, "bias", "dps")):
        shown = [each.value for name, each in fits[0].sensor_errors.items() if name.startswith(word)]
        np.testing.assert_array_equal(axes.lines[0].get_ydata(), shown)
        assert axes.get_ylabel() == unit
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(CalibrationError, match="pictures need matplotlib"):
        fits[0].plot()


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: tinygc.compare([], biases=True), "compare: no option 'biases'; did you mean bias?"),
        (lambda: tinygc.plan("x", counts=1), "plan: no option 'counts'; did you mean count?"),
        (lambda: tinygc.rebias("x", "y", bias=1), "rebias: no option 'bias'; did you mean bias_dps?"),
        (lambda: tinygc.export("x"), "export: missing a required argument: 'to'"),
        (lambda: tinygc.accelerometer(3), "session is of type int, expected a tinygc.Session or the path of its folder"),
        (lambda: tinygc.report(3), "session is of type int"),
        (lambda: tinygc.array(3), "units is of type int, expected an array's folder"),
        (lambda: tinygc.fleet("x", "y", job=1), "fleet: no option 'job'; did you mean jobs?"),
        (lambda: tinygc.lot("x", models=1), "lot: no option 'models'; did you mean model?"),
        (lambda: tinygc.sensors("asm330lh"), "is no sensor that is known; is ASM330LHH meant?"),
        (lambda: tinygc.list_sessions("nowhere"), "nowhere: no folder; give one with session folders in it"),
    ],
)
def test_a_wrong_argument_is_one_line(call, complaint):
    with pytest.raises(CalibrationError, match=re.escape(complaint)) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda fit: fit.report(3), "report: path is 3, expected a path"),
        (lambda fit: fit.report(explain=False, limit_deg=-1), "report: limit_deg is -1, expected a number above 0"),
        (lambda fit: fit.export("json", "a\0b"), "export: folder is 'a\\x00b', expected a path"),
        (lambda fit: fit.export("json", model=[1]), "export: model is [1], expected text"),
        (lambda fit: fit.save(b"x"), "save: folder is b'x', expected a path"),
        (lambda fit: fit.plot(3), "plot: path is 3, expected a path"),
        (lambda fit: tinygc.compare([fit, None]), "sessions holds None, expected a Fit or the path of a fitted session"),
        (lambda fit: tinygc.rebias(fit.source, fit, exclude=["a"]), "rebias: exclude is ['a'], expected a list of whole numbers"),
        (lambda fit: tinygc.apply(fit, "x.csv", "y.csv", gyro_fs_dps="fast"), "gyro_fs_dps is 'fast', expected a number above 0"),
        (lambda fit: tinygc.apply(fit, "x.csv", "y.csv", columns=3), "columns is 3, expected text"),
        (lambda fit: tinygc.sensors(3), "sensors: name is 3, expected text"),
        (lambda fit: tinygc.fleet(3, "x"), "fleet: folders is 3, expected a path, or a list of paths"),
    ],
)
def test_an_argument_of_another_kind_is_one_line(fits, call, complaint):
    with pytest.raises(CalibrationError, match=re.escape(complaint)) as caught:
        call(fits[0])
    assert "\n" not in str(caught.value)


def test_nothing_is_written_over_what_is_read(fits, folders, tmp_path):
    log = tmp_path / "log.csv.gz"
    log.write_bytes((folders[0] / "log0001.csv.gz").read_bytes())
    before = log.read_bytes()
    (tmp_path / "link.csv.gz").symlink_to(log)
    for out in (log, tmp_path / "link.csv.gz"):
        with pytest.raises(CalibrationError, match="is what is read, and nothing is written over it"):
            tinygc.apply(fits[0], log, out, gyro_fs_dps=500, accel_fs_g=4)
    with pytest.raises(CalibrationError, match="that is a folder; give a file"):
        fits[0].report(tmp_path, explain=False)
    with pytest.raises(CalibrationError, match="no result is written over one"):
        fits[0].report(folders[0] / "log0001.csv.gz", explain=False)
    assert log.read_bytes() == before
