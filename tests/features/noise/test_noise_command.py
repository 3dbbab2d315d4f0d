"""``noise`` from the command line and in Python: one screen, the files, the JSON, and an Allan curve in a file."""

import dataclasses
import json

import numpy as np
import pytest
from conftest import Table, write_session
from formats_page import strangers
from processes import as_it_stands, refused

import tinygc
from session.base.errors import CalibrationError
from session.base.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MG, G
from tinygc.features.noise.curve import read_curve
from tinygc.features.noise.library import Noise
from tinygc.noise.figures import TERMS, AllanBand, AxisNoise, NoiseFigures, SensorNoise, Term, read_figures
from tinygc.reporting.terminal import as_text

#: a term that no log shows
ABSENT = Term(0.0, None, 0.01)


def axis(**chosen):
    """An axis with these terms, and no others."""
    return AxisNoise({name: chosen.get(name, ABSENT) for name in TERMS}, p_value=0.4)


def shown(value, relative, probability=1.0):
    """A term of this size and relative sigma."""
    return Term(value, value * relative, probability)


def hidden(at_most, probability=0.02):
    """A term that is not shown, with its upper limit."""
    return Term(0.0, None, probability, at_most)


N, H, WALK, UG = DEG_PER_SQRT_HOUR, DEG_PER_HOUR, DEG_PER_HOUR / 60, 1e-3 * MG


def figures(**changes):
    """A unit much like an ADIS16405, at rest for 10 000 s at 100 Hz."""
    gyro = SensorNoise(
        (
            axis(N=shown(2.41 * N, 0.002), B=shown(28.7 * H, 0.04), K=hidden(31 * WALK, 0.3)),
            axis(N=shown(2.54 * N, 0.002), B=shown(35.2 * H, 0.05), K=shown(119 * WALK, 0.07)),
            axis(N=shown(2.29 * N, 0.002), B=shown(26.5 * H, 0.06), K=shown(178 * WALK, 0.05, 0.9)),
        )
    )
    accel = SensorNoise(tuple(axis(N=shown(n / 60, 0.003), B=shown(120 * UG, 0.1), K=hidden(500 * UG / 60)) for n in (0.17, 0.18, 0.2)))
    made = NoiseFigures(
        gyro=gyro, accel=accel, rate_hz=100.0, duration_s=10_000.0, samples=1_000_000, logs=("imu1.npz",), sensor="ADIS16405"
    )
    return dataclasses.replace(made, **changes)


def estimate(of=None, seed=1):
    """An estimate with Allan deviations that scatter about the terms as those of a recording do."""
    of = figures() if of is None else of
    rng, tau_s, bands = np.random.default_rng(seed), np.geomspace(1 / of.rate_hz, of.duration_s / 3, 40), {}
    for kind, sensor in of.sensors().items():
        true = np.sqrt(np.column_stack([own.allan_variance(tau_s) for own in sensor.axes]))
        sigma = np.sqrt(tau_s / of.duration_s / 2)[:, None]
        seen = true * np.exp(sigma * rng.normal(size=true.shape))
        bands[kind] = AllanBand(tau_s, seen, seen * np.exp(-sigma), seen * np.exp(sigma))
    return Noise.of(dataclasses.replace(of, allan=bands), (), 12.0)


@pytest.fixture(scope="module")
def rests(tmp_path_factory):
    """A session's folder with one rest log, of white noise that no register hides."""
    samples = Table().rest(12).samples(gyro_mdps=20.0, accel_ug=240.0, seed=8)
    return write_session(tmp_path_factory.mktemp("noise") / "rests", samples, "rest0001.csv")


def test_of_a_session_the_files_go_beside_its_fit_and_hold_the_noise_that_went_in(rests, run):
    code, out, _ = run("noise", rests)
    assert code == 0
    assert out.startswith("Noise: 2")
    table = json.loads((rests / "fit" / "noise.json").read_text())
    assert strangers(table) == []
    assert (table["sensor"], table["serial"], table["logs"]) == ("ASM330LHH", "42", ["rest0001.csv"])
    assert (rests / "fit" / "noise.svg").read_text(encoding="utf-8").startswith("<svg")
    white = {"gyro": 20e-3 * DEG / np.sqrt(2), "accel": 240e-6 * G / np.sqrt(2)}
    for kind, sensor in read_figures(rests / "fit" / "noise.json").sensors().items():  # as exports and explain do
        for axis in sensor.axes:
            assert abs(axis.value("N") - white[kind]) < 4 * axis.terms["N"].sigma < 0.2 * white[kind]
    # one-sided and two-sided, as the page says
    assert table["kalibr"]["gyroscope_noise_density"] == pytest.approx(white["gyro"], rel=0.1)
    assert [row["value"] for row in table["data_sheet"] if row["term"] == "N"] == pytest.approx([20.0, 240.0], rel=0.1)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("", "give logs or session folders at rest, or --curve FILE"),
        ("a.csv --curve b.csv", "and not both"),
        ("a.csv --duration 3", "are of --curve FILE"),
        ("a.csv", "a.csv: cannot be read"),
        ("a.csv --json nowhere/x.json", "nowhere/x.json"),  # before the log is looked at
        ("curve.csv", "curve.csv: its first column is an averaging time, as of an Allan curve, and no log; run `"),
        ("curve.csv a.csv", "noise --curve curve.csv`"),
        ("--curve b.csv", "b.csv"),
    ],
)
def test_what_is_refused_in_one_line(words, says, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curve.csv").write_text("# tau_s, deviation of the gyroscope x y z (deg/s)\n0.1 1 1 1\n")
    refused(run("noise", *words.split(), "--quiet"), says)


@pytest.mark.parametrize(
    ("given", "more", "says"),
    [
        ((3,), {}, "logs is of type int"),
        (([],), {}, "no log is given; give at least one log, session folder or tuple of arrays"),
        (("a.csv",), {"curve": "c.csv"}, "give logs or curve"),
    ],
)
def test_what_is_no_argument_is_refused(given, more, says):
    with pytest.raises(CalibrationError, match=says):
        tinygc.estimate_noise(*given, **more)


# The screen


def of_gyro(*walks, floor=ABSENT):
    return figures(gyro=SensorNoise(tuple(axis(N=shown(N, 0.001), B=floor, K=walk) for walk in walks)))


def sheet(gyro_mdps, gyro_terms, accel_ug=60.0, sensor="ASM330LHH"):
    """Of a unit with these one-sided densities and B of three axes, held against 5 mdps, 3 °/h and 60 µg."""
    half = np.sqrt(0.5)
    gyro = SensorNoise(tuple(axis(N=shown(gyro_mdps * 1e-3 * DEG * half, 0.001), B=each) for each in gyro_terms))
    accel = SensorNoise(tuple(axis(N=shown(accel_ug * UG * half, 0.001)) for _ in "xyz"))
    return figures(gyro=gyro, accel=accel, sensor=sensor)


def misfit(gyro, accel):
    """Axes that the terms do not describe."""
    of = figures(sensor="ASM330LHH")
    spoilt = {
        kind: [dataclasses.replace(own, p_value=1e-9, excess=7.0) if k in axes else own for k, own in enumerate(of.sensors()[kind].axes)]
        for kind, axes in (("gyro", gyro), ("accel", accel))
    }
    return dataclasses.replace(of, **{kind: SensorNoise(tuple(axes)) for kind, axes in spoilt.items()})


UNSURE, SURE = dataclasses.replace(shown(178 * WALK, 0.6, 0.7), at_most=350 * WALK), shown(178 * WALK, 0.05)
SCREENS = {
    "N of x is sqrt(2) 2.41 / 60 dps/√Hz, one-sided, and sqrt(2) 0.17 / 60 m/s²/√Hz": figures(),
    "a size that is not determined is no number": of_gyro(UNSURE, UNSURE, UNSURE),
    "nor is that of one axis": of_gyro(UNSURE, SURE, SURE),
    "open terms say when they will be known": of_gyro(*[shown(H / 60, 0.19)] * 3, floor=shown(H, 0.21)),
    "within the data sheet": sheet(5.0, [shown(3.0 * H, 0.1)] * 3),
    "above by 18 %, below, within": sheet(5.9, [shown(1.5 * H, 0.1)] * 3, 65.0),
    "no data sheet": sheet(5.0, [shown(H, 0.1)] * 3, sensor="unheard of"),
    "below by its limit": sheet(5.0, [hidden(2.0 * H)] * 3),
    "open without a limit": sheet(5.0, [hidden(None)] * 3),
    "open by the limit of one axis": sheet(5.0, [shown(2.0 * H, 0.01), hidden(3.1 * H), shown(H, 0.01)]),
    "within, whatever is hidden below": sheet(5.0, [shown(3.1 * H, 0.01), hidden(2.9 * H), shown(H, 0.01)]),
    "y and z are not described: left out": misfit([1], [2]),
    "no axis is described: no number": misfit([0, 1, 2], [0, 1, 2]),
}


def test_the_screens_are_as_they_stand():
    said = []
    for name, of in SCREENS.items():
        found = estimate(of)
        table = found.to_json()
        verdicts = [row["verdict"] for row in table["data_sheet"]]
        terms = [" ".join(each[key] for key in ("sensor", "axis", "term")) for each in table["open_terms"]]
        kalibr = [value if value is None else f"{value:.4g}" for value in table["kalibr"].values()]
        said.append(f"# {name}\n{found.summary()}\nJSON: {verdicts} {terms} {kalibr}\n")
    as_it_stands("noise.txt", "\n".join(said))
    assert "µrad" not in said[0]
    assert "Q  µrad" in as_text(estimate().pages(verbose=True))


def test_the_picture_has_data_model_terms_and_ratio():
    gyro, accel, ratio, _ = estimate().plot().panels
    assert (gyro.y.label, accel.y.label) == ("Allan deviation (°/h)", "Allan deviation (µg)")
    # white noise of x at the first averaging time, 0.01 s: 2.41 °/√h / sqrt(0.01 s)
    x = next(mark for mark in gyro.marks if mark.name == "x")
    assert x.y[0] == pytest.approx(2.41 * 60 * 10, rel=0.01)
    assert {mark.labels[0] for mark in gyro.marks if mark.style == "word"} == {"N", "B", "K"}
    assert all(np.abs(np.log(mark.y[:20])).max() < 0.05 for mark in ratio.marks if mark.radius)


# An Allan curve in a file


TAU = np.geomspace(0.1, 1000, 20)


def written(path, columns, header="", delimiter=" "):
    rows = np.column_stack([TAU, *[(1 + column) / np.sqrt(TAU) for column in range(columns)]])
    np.savetxt(path, rows, header=header, delimiter=delimiter)
    return path


@pytest.mark.parametrize(
    ("columns", "header", "units", "si", "delimiter"),
    [
        (6, "tau_s, deviation of accelerometer x y z (m/s2), gyroscope x y z (deg/s)", None, {"accel": 1.0, "gyro": DEG}, " "),
        (6, "tau [s] gx [deg/h] gy [deg/h] gz [deg/h] ax [ug] ay [ug] az [ug]", None, {"gyro": H, "accel": UG}, ", "),
        (3, "tau x y z (rad/s)", None, {"gyro": 1.0}, ";"),
        (1, "", "deg/h", {"gyro": H}, " "),
        (2, "", "mg,dps", {"accel": 1e3 * UG, "gyro": DEG}, "\t"),
        (3, "tau x y z (rad/s)", "deg/s", {"gyro": DEG}, " "),  # who says it knows better than the header
    ],
)
def test_columns_and_units(columns, header, units, si, delimiter, tmp_path):
    tau_s, deviations = read_curve(written(tmp_path / "c.csv", columns, header, delimiter), units)
    assert (list(deviations), tau_s) == (list(si), pytest.approx(TAU))
    each = columns // len(si)
    for place, (kind, unit) in enumerate(si.items()):
        expected = unit * (1 + place * each + np.arange(each)) / np.sqrt(TAU)[:, None]
        assert deviations[kind] == pytest.approx(expected)


ROWS = "\n".join(f"{tau} 1 1 1" for tau in range(1, 9))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 2\n2 2\n", "2 averaging times, expected 6"),
        ("# (deg/s)\n" + ROWS.replace("\n", " 1\n") + " 1", "5 columns, expected tau and"),
        ("# (deg/s)\n1 1\n2 1\n2 1\n", "line 4: expected averaging times that increase"),
        ("# (deg/s)\n1 1\n2 -1\n", "line 3: expected averaging times that increase and deviations above 0"),
        ("# (deg/s)\n1 1\nend\n", "line 3: 'end' is no row of numbers"),
        ("# (deg/s), (g)\n" + ROWS, "does not state one unit"),
        (bytes(range(256)) * 20, "c.csv"),
    ],
)
def test_what_is_no_curve_is_refused(text, says, tmp_path):
    (tmp_path / "c.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(CalibrationError, match=r"^\S*c\.csv[^\n]*$") as refused:
        read_curve(tmp_path / "c.csv")
    assert says in str(refused.value)


def test_what_a_curve_does_not_say_is_assumed_and_said(tmp_path):
    """White noise of 1 °/√h, of one axis."""
    path = written(tmp_path / "c.csv", 1, "(deg/h)")
    found = tinygc.estimate_noise(curve=path)
    assert found.gyro.axes[2].value("N") == pytest.approx(H, rel=0.02)  # deviation 1 °/h at 1 s
    assert (found.accel, found.duration_s, found.to_json()["rate_known"]) == (None, 10_000.0, False)
    for words in ("--duration", "stands for all three", "The data rate is not known: 1 over the shortest averaging time, 10 Hz"):
        assert any(words in remark for remark in found.remarks)
    told = tinygc.estimate_noise(curve=path, duration_s=73_800, odr_hz=400, sensor="BMI055", serial="7")
    assert (told.duration_s, told.rate_hz, told.rate_known, told.sensor, told.serial) == (73_800, 400, True, "BMI055", "7")
    for header, more, says in (("(deg/h)", {"duration_s": 100}, "beyond 100 s of recording"), ("(mg)", {}, "holds no gyroscope")):
        with pytest.raises(CalibrationError, match=says):
            tinygc.estimate_noise(curve=written(tmp_path / "d.csv", 3, header), **more)
    with pytest.raises(CalibrationError, match="'furlong' is no unit of a deviation"):
        tinygc.estimate_noise(curve=path, curve_units="furlong")
