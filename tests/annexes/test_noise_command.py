"""``noise`` from the command line and in Python: one screen, the files, the JSON; with an estimator that returns what is known."""

import dataclasses
import json
import re

import numpy as np
import pytest
from conftest import Table, write_session
from formats_page import strangers
from noise_made import UG, WALK, H, N, axis, estimate, figures, hidden, shown

import tinygc
from session.io.errors import CalibrationError
from session.io.units import DEG
from tinygc.annexes.noise import library, text
from tinygc.annexes.noise.library import Noise
from tinygc.annexes.noise.text import against_data_sheet, kalibr_figures, kalibr_line, open_lines, open_terms
from tinygc.noise.figures import Inflation, SensorNoise, read_figures
from tinygc.reporting.terminal import as_text

#: s, after which a term of each axis is known
AFTER = {0: 3.1 * 3600, 1: 900.0, 2: float("inf")}


@pytest.fixture(autouse=True)
def estimator(monkeypatch):
    """Estimates nothing; keeps how many rests it was given."""
    given = []

    class Counted:
        def __init__(self, rate_hz):
            self.rate_hz, self.count = rate_hz, 0

        def add(self, samples):
            self.count += len(samples)

    def estimate_noise(sums, progress=None):
        given.append([each.count for each in sums])
        return estimate(said=("Knocks at 2 and 1084 s are left out.",))

    monkeypatch.setattr("tinygc.annexes.noise.inputs.RestSums", Counted)
    monkeypatch.setattr(library, "estimate_noise", estimate_noise)
    monkeypatch.setattr(text, "known_after_s", lambda figures, kind, axis, name, relative: AFTER[axis])
    return given


@pytest.fixture
def rests(tmp_path):
    return write_session(tmp_path / "rests", Table().rest(20).samples(), "rest0001.csv")


# The command


def test_of_a_session_the_files_go_beside_its_fit(rests, run):
    code, out, _ = run("noise", rests)
    assert code == 0
    assert out.startswith("Noise at rest, ASM330LHH 42: 1 log, 2.8 h")
    table = json.loads((rests / "fit" / "noise.json").read_text())
    assert strangers(table) == []
    assert (table["sensor"], table["serial"], table["logs"]) == ("ASM330LHH", "42", ["rest0001.csv"])
    assert (rests / "fit" / "noise.png").read_bytes().startswith(b"\x89PNG")
    read = read_figures(rests / "fit" / "noise.json")  # as exports and explain do
    assert read.gyro.values("N") == pytest.approx(figures().gyro.values("N"))
    assert read.gyro.axes[0].terms["K"].at_most == pytest.approx(figures().gyro.axes[0].terms["K"].at_most)


def test_json_and_out(rests, tmp_path, run):
    code, out, _ = run("noise", rests, "--out", tmp_path / "there", "--no-pictures", "--json", "-")
    assert code == 0
    assert strangers(json.loads(out)) == []
    assert [path.name for path in (tmp_path / "there").iterdir()] == ["noise.json"]
    assert json.loads((tmp_path / "there" / "noise.json").read_text()) == json.loads(out)
    assert not (rests / "fit").exists()
    assert run("noise", rests, "--json", rests / "fit" / "noise.json")[0] == 0
    assert run("noise", rests, "--json", rests / "rest0001.csv")[0] == 2


def test_a_bare_log_leaves_no_file(rests, run, tmp_path, monkeypatch):
    (rests / "session.toml").unlink()
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    code, out, err = run("noise", rests / "rest0001.csv", "--sensor", "ASM330LHH", "--gyro-fs", "500", "--accel-fs", "4")
    assert code == 0, err
    assert "--out DIR keeps" in out
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "give logs or session folders at rest, or --curve FILE"),
        (["a.csv", "--curve", "b.csv"], "and not both"),
        (["a.csv", "--duration", "3"], "are of --curve FILE"),
        (["a.csv"], "a.csv: cannot be read"),
        (["a.csv", "--json", "nowhere/x.json"], "nowhere/x.json"),  # before the log is looked at
        (["curve.csv"], "curve.csv: its first column is an averaging time, as of an Allan curve, and no log; run `"),
        (["curve.csv"], "noise --curve curve.csv`"),
        (["curve.csv", "a.csv"], "noise --curve curve.csv`"),
        (["--curve", "b.csv"], "b.csv"),
        (["a.csv", "--like", "nothing"], "--like is 'nothing'"),
    ],
)
def test_what_is_refused_in_one_line(words, says, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curve.csv").write_text("# tau_s, deviation of the gyroscope x y z (deg/s)\n0.1 1 1 1\n")
    code, out, err = run("noise", *words, "--quiet")
    assert (code, out) == (2, "")
    assert says in err
    assert err.count("\n") == 1


# In Python


def test_paths_sessions_and_arrays(rests, estimator, tmp_path):
    still = Table().rest(20).samples(registers=False)
    arrays = (still.t_ns * 1e-9, still.gyro, still.accel)
    assert tinygc.estimate_noise(rests).remarks[0] == "Knocks at 2 and 1084 s are left out."
    tinygc.estimate_noise([str(rests), arrays])
    tinygc.estimate_noise(tinygc.read_session(write_session(tmp_path / "turned", Table().tumble(3).samples())))
    assert estimator[:2] == [[4160], [4160, 4160]]
    assert len(estimator[2]) == 4
    with pytest.raises(CalibrationError, match="logs is of type int"):
        tinygc.estimate_noise(3)
    with pytest.raises(CalibrationError, match="no log is given; give at least one log, session folder or tuple of arrays"):
        tinygc.estimate_noise([])
    with pytest.raises(CalibrationError, match="give logs or curve"):
        tinygc.estimate_noise(rests, curve="c.csv")
    np.savetxt(tmp_path / "u.csv", np.column_stack(arrays), delimiter=",", header="t_s,gx,gy,gz,ax,ay,az", comments="")
    with pytest.raises(CalibrationError, match="gyro_unit="):
        tinygc.estimate_noise(tmp_path / "u.csv")
    assert tinygc.estimate_noise(tmp_path / "u.csv", gyro_unit="rad/s", accel_unit="m/s2").figures.sensor == ""


def test_a_result_shows_itself(tmp_path):
    found = Noise(estimate())
    assert repr(found) == "<Noise of ADIS16405: 10000 s of rest>"
    assert "<pre" in found._repr_html_()
    assert found.plot(tmp_path / "made" / "n.png") is not None
    assert (tmp_path / "made" / "n.png").stat().st_size > 20_000
    assert found.save(tmp_path / "made", pictures=False) == tmp_path / "made"


# The screen


def test_values_stand_in_the_units_of_the_field():
    out = Noise(estimate()).summary()
    for words in (
        r"N  °/√h, two-sided .* 2\.4100 ± 0\.0048 .* 2\.5400",
        r"mdps/√Hz, one-sided .* 56\.80 ± 0\.11",  # sqrt(2) 2.41 / 60 dps
        r"B  °/h .* 28\.7 ± 1\.1",
        r"K  °/h/√h .*< 31 \(30 %\) .* 119\.0 ± 8\.3 .* 178\.0 ± 8\.9 \(90 %\)",
        r"N  m/s/√h, two-sided .* 0\.17000",
        r"µg/√Hz, one-sided .* 408\.6",  # sqrt(2) 0.17 / 60 / g
        r"B  µg .* 120 ± 12",
        r"K  µg/√h .* < 500",
    ):
        assert re.search(words, out), words
    assert "µrad" not in out
    assert "Q  µrad" in as_text(Noise(estimate()).pages(verbose=True))


def test_kalibr_has_the_worst_axis_and_no_number_for_what_does_not_show():
    found = kalibr_figures(figures())
    assert found["gyroscope_noise_density"] == pytest.approx(2.54 * N)
    assert found["gyroscope_random_walk"] == pytest.approx(178 * H / 60)
    assert found["accelerometer_random_walk"] is None
    assert "accelerometer 0.00333, < 8.2e-05" in Noise(estimate()).summary()
    assert kalibr_figures(figures(accel=None))["accelerometer_noise_density"] is None


def test_a_size_that_is_not_determined_is_no_number():
    unsure = dataclasses.replace(shown(178 * WALK, 0.6, 0.7), at_most=350 * WALK)
    assert unsure.chosen
    gyro = SensorNoise(tuple(axis(N=shown(N, 0.001), K=unsure) for _ in "xyz"))
    out = Noise(dataclasses.replace(estimate(), figures=figures(gyro=gyro))).summary()
    assert re.search(r"K  °/h/√h +(< 350 \(70 %\) *){3}", out)
    assert kalibr_figures(figures(gyro=gyro))["gyroscope_random_walk"] is None
    assert "gyroscope 0.000291, < 2.8e-05" in out
    assert gyro.at_most("K") == pytest.approx(350 * WALK)
    one = SensorNoise((axis(N=shown(N, 0.001), K=unsure), *(axis(N=shown(N, 0.001), K=shown(178 * WALK, 0.05)) for _ in "yz")))
    assert "gyroscope 0.000291, 1.44e-05 (x < 2.8e-05)" in kalibr_line(figures(gyro=one))
    assert " (x" not in kalibr_line(figures())
    assert not gyro.measured("K")
    assert one.measured("K")
    (row,) = (row for row in open_terms(figures(gyro=gyro)) if (row.sensor, row.axis, row.term) == ("gyro", "x", "K"))
    assert row.known_after_s == AFTER[0]


def test_open_terms_say_when_they_will_be_known():
    found = {(each.sensor, each.axis, each.term): each.known_after_s for each in open_terms(figures())}
    assert found == {
        ("gyro", "x", "K"): AFTER[0],
        ("accel", "x", "K"): AFTER[0],
        ("accel", "y", "K"): 10_000.0,  # what was recorded has not shown it
        ("accel", "z", "K"): AFTER[2],
    }
    assert open_lines(figures()) == [  # of limits: a smaller term needs a longer rest
        "Gyroscope known to 20 %: N, B; not before one rest of: K 3.1 h (x)",
        "Accelerometer known to 20 %: N, B; after one rest of: K never (z); not before one rest of: K 3.1 h (x), 2.8 h (y)",
    ]
    vague = SensorNoise(tuple(axis(N=shown(N, 0.001), B=shown(H, 0.21), K=shown(H / 60, 0.19)) for _ in "xyz"))
    assert {each.term for each in open_terms(figures(gyro=vague, accel=None))} == {"B"}
    assert open_lines(figures(gyro=vague, accel=None)) == [
        "Gyroscope known to 20 %: N, K; after one rest of: B 3.1 h (x), 2.8 h (y), never (z)"
    ]


def sheet(gyro_mdps: float, b_dph: float, accel_ug: float, sensor="ASM330LHH"):
    """Verdicts of a unit with these one-sided densities, held against 5 mdps, 3 °/h and 60 µg."""
    half = np.sqrt(0.5)
    gyro = SensorNoise(tuple(axis(N=shown(gyro_mdps * 1e-3 * DEG * half, 0.001), B=shown(b_dph * H, 0.1)) for _ in "xyz"))
    accel = SensorNoise(tuple(axis(N=shown(accel_ug * UG * half, 0.001)) for _ in "xyz"))
    return against_data_sheet(figures(gyro=gyro, accel=accel, sensor=sensor))


def test_the_data_sheet_is_one_sided():
    assert [each.verdict for each in sheet(5.0, 3.0, 60.0)] == ["within"] * 3
    above, below, within = sheet(5.9, 1.5, 65.0)
    assert above.words == "gyroscope N 5.9 mdps/√Hz, data sheet 5: above by 18 %"
    assert below.words == "gyroscope B 1.5 °/h, data sheet 3: below by 50 %"
    assert within.verdict == "within"
    assert [each.verdict for each in sheet(99.0, 1.0, 1.0, "LSM6DSO")] == ["not judged"] * 2
    assert sheet(5.0, 3.0, 60.0, "unheard of") == []


def test_a_term_that_does_not_show_is_held_against_the_sheet_by_its_limit():
    for most, verdict in ((2.0, "below"), (4.0, "open"), (None, "open")):
        gyro = SensorNoise(tuple(axis(N=shown(N, 0.01), B=hidden(None if most is None else most * H)) for _ in "xyz"))
        rows = against_data_sheet(figures(gyro=gyro, accel=None, sensor="ASM330LHH"))
        (row,) = (row for row in rows if row.term == "B")
        assert row.verdict == verdict
        assert (f"B {'–' if most is None else f'< {most:g}'} °/h, data sheet 3: {verdict}") in row.words


@pytest.mark.parametrize(
    ("dph", "most", "verdict"), [(2.0, 2.9, "below"), (2.0, 3.1, "open"), (3.1, 3.5, "open"), (3.1, 2.9, "within"), (4.0, 9.0, "above")]
)
def test_an_axis_with_a_limit_alone_counts_beside_those_with_numbers(dph, most, verdict):
    axes = [axis(N=shown(N, 0.01), B=each) for each in (shown(dph * H, 0.01 * H), hidden(most * H), shown(H, 0.01 * H))]
    rows = against_data_sheet(figures(gyro=SensorNoise(tuple(axes)), accel=None, sensor="ASM330LHH"))
    (row,) = (row for row in rows if row.term == "B")
    assert row.verdict == verdict
    if verdict == "open":
        assert f"B {dph:g} (< {most:g}) °/h, data sheet 3: open" in row.words


def test_terms_that_do_not_describe_the_data_are_said():
    bad = dataclasses.replace(figures().gyro.axes[1], p_value=1e-4, excess=1.7)
    gyro = SensorNoise((figures().gyro.axes[0], bad, figures().gyro.axes[2]))
    lines = Noise(estimate(figures(gyro=gyro))).summary().splitlines()
    assert lines[1] == "NOT DESCRIBED by these terms: gyroscope y (p = 0.0001, 1.7 times their variance)"
    assert not any("NOT DESCRIBED" in line for line in lines[2:])


def misfit(of, *axes):
    """The sensor with axes that its terms do not describe."""
    return SensorNoise(
        tuple(dataclasses.replace(own, p_value=1e-9, excess=7.0) if number in axes else own for number, own in enumerate(of.axes))
    )


def test_an_axis_that_is_not_described_gives_no_number():
    of = figures(sensor="ASM330LHH")
    part = dataclasses.replace(of, gyro=misfit(of.gyro, 1), accel=misfit(of.accel, 2))
    found = kalibr_figures(part)
    assert found["gyroscope_noise_density"] == pytest.approx(2.41 * N)  # of x; y, the worst, is left out
    assert found["accelerometer_noise_density"] == pytest.approx(0.18 / 60)
    assert {(each.sensor, each.axis) for each in open_terms(part)} == {("gyro", "x"), ("accel", "x"), ("accel", "y")}
    (b,) = (row for row in against_data_sheet(part) if row.term == "B")
    assert b.value == pytest.approx(28.7)
    lines = Noise(estimate(part)).summary().splitlines()
    assert "Kalibr density, walk (SI): gyroscope 0.000701, 1.44e-05 (without y); accelerometer 0.003, < 8.2e-05 (without z)" in lines
    assert "Gyroscope (without y) known to 20 %: N, B; not before one rest of: K 3.1 h (x)" in lines
    assert any(line.startswith("Gyroscope B 28.7 °/h, data sheet 3: above, 9.6 times (without y)") for line in lines)


def test_of_a_unit_of_which_no_axis_is_described_nothing_is_stated():
    of = figures(sensor="ASM330LHH")
    none = dataclasses.replace(of, gyro=misfit(of.gyro, 0, 1, 2), accel=misfit(of.accel, 0, 1, 2))
    assert set(kalibr_figures(none).values()) == {None}
    assert open_terms(none) == against_data_sheet(none) == []
    out = Noise(estimate(none)).summary()
    assert "Kalibr density, walk (SI): gyroscope –, – (without x y z); accelerometer –, – (without x y z)" in out
    assert not any(words in out for words in ("known to 20 %", "data sheet", "Inflate"))


@pytest.mark.parametrize("described", [True, False])
def test_a_session_that_fails_or_a_gyroscope_without_description_is_a_remark_on_its_inflation(described, rests, monkeypatch):
    monkeypatch.setattr(library, "inflations_of_folder", lambda folder, figures: (Inflation("a turn", np.ones(3), np.ones(3)),))
    of = figures() if described else dataclasses.replace(figures(), gyro=misfit(figures().gyro, 0, 2))
    monkeypatch.setattr(library, "estimate_noise", lambda sums, progress=None: estimate(of))
    (rests / "fit").mkdir()
    fit = {"schema": "tinygc-fit/2", "verdict": {"answer": "fail", "headline": "FAIL: held-out turns close to 0.9°"}}
    (rests / "fit" / "fit.json").write_text(json.dumps(fit))
    found = tinygc.estimate_noise(rests)
    assert len(found.figures.inflations) == described
    failed = "rests: fit says FAIL: held-out turns close to 0.9°; the inflation holds what it lacks."
    assert (failed in found.remarks) == described
    assert ("No inflation: it is to N at rest, and the terms do not describe gyroscope x z." in found.remarks) != described
    (rests / "fit" / "fit.json").write_text(json.dumps(fit | {"verdict": {"answer": "pass", "headline": "PASS: 0.01°"}}))
    assert not any("fit says" in each for each in tinygc.estimate_noise(rests).remarks)


def test_the_picture_has_data_model_terms_and_ratio():
    pytest.importorskip("matplotlib")
    figure = Noise(estimate()).plot()
    gyro, accel, ratio, _ = figure.axes
    assert gyro.get_ylabel() == "Allan deviation (°/h)"
    assert accel.get_ylabel() == "Allan deviation (µg)"
    # white noise of x at the first averaging time, 0.01 s: 2.41 °/√h / sqrt(0.01 s)
    x = next(line for line in gyro.lines if line.get_label() == "x")
    assert x.get_ydata()[0] == pytest.approx(2.41 * 60 * 10, rel=0.01)
    assert {text.get_text() for text in gyro.texts} == {"N", "B", "K"}
    assert all(np.abs(np.log(line.get_ydata()[:20])).max() < 0.05 for line in ratio.lines[:3])
    alone = Noise(estimate(figures(accel=None))).plot()
    assert len([axes for axes in alone.axes if axes.axison]) == 2


def test_hostile_names_stay_on_their_line():
    out = Noise(estimate(figures(sensor="A\x1b[2J\nB", serial="\u202e"))).summary()
    assert out.splitlines()[0].startswith("Noise at rest, A\\x1b[2J\\nB \\u202e: 1 log")
    assert "\x1b" not in out
