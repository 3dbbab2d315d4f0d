"""A log's clock is found, or its samples are counted at a nominal rate: then the common scale carries that rate's uncertainty."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, broad
from looks import G, look, of, with_sensor

import tinygc
from session.io.dialects import Answers
from session.io.errors import CalibrationError, FormatError
from session.io.questions import QuestionsError
from session.io.samples import Samples
from session.io.sensors.profile import CLOCK_WITHIN
from session.io.units import TIME
from session.replay.convert import convert
from tinygc import FitOptions, Session, read_session
from tinygc.annexes.budget.quantities import sensor_error_budgets, use_budgets
from tinygc.annexes.budget.use import Use
from tinygc.estimation.assembly import CLOCK
from tinygc.estimation.fit import fit_session
from tinygc.reporting.tables import next_line

TRUE_HZ, NOMINAL_HZ = 105.4, 100.0
LEAST_SQUARES = FitOptions(methods=("least_squares",))
#: of a tumble whose gyro reads 2 % too little
E_TRUE = np.eye(3) * 1.02
HEADER = "ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps"


@pytest.fixture(scope="module")
def samples():
    made = Table().tumble(14, seed=5).samples(odr_hz=TRUE_HZ)
    return replace(made, gyro=made.gyro @ np.linalg.inv(E_TRUE).T)


def log_of(samples, names="", *columns):
    values = [*columns, *np.round(samples.accel / G, 6).T, *np.round(samples.gyro / DEG, 5).T]
    rows = "\n".join(",".join(map(str, row)) for row in zip(*values, strict=True))
    return f"{names}{',' * bool(names)}{HEADER}\n{rows}\n"


def make(folder, text, **answers):
    path = folder / "LOG.CSV"
    path.write_text(text)
    return convert([path], folder / "session", Answers(gyro_fs_dps=500, accel_fs_g=4, **answers))


@pytest.fixture(scope="module")
def counted(samples, tmp_path_factory):
    return make(tmp_path_factory.mktemp("counted"), log_of(samples), odr_hz=NOMINAL_HZ).folder


def ticks(samples, unit_s):
    return np.rint(samples.t_s / unit_s).astype(int)


CLOCKS = {
    "millis": lambda s: [ticks(s, 1e-3)],
    "micros": lambda s: [ticks(s, 1e-6) + 77],
    "time": lambda s: [np.round(s.t_s, 4)],
    "timestamp": lambda s: [ticks(s, 1e-6) + 1_700_000_000_000_000],
    "ts": lambda s: [ticks(s, 1e-9)],
    "us": lambda s: [ticks(s, 1e-6)],
    "Time (ms)": lambda s: [np.round(s.t_s * 1e3, 2)],
    "seq,ms": lambda s: [np.arange(len(s)), ticks(s, 1e-3)],
    "sec,nsec": lambda s: [ticks(s, 1e-9) // 10**9 + 1_700_000_000, ticks(s, 1e-9) % 10**9],
    "stamp.secs,stamp.usecs": lambda s: [ticks(s, 1e-6) // 10**6, ticks(s, 1e-6) % 10**6],
    "datetime": lambda s: [
        [f"2026-11-22 23:59:{30 + t:09.6f}" if t < 30 else f"2026-11-23 00:{int(t - 30) // 60:02d}:{(t - 30) % 60:09.6f}" for t in s.t_s]
    ],
}
QUICK = ("micros", "Time (ms)", "sec,nsec", "datetime")


@pytest.mark.parametrize(
    ("names", "declared_hz"), [("millis", None), *((pytest.param if names in QUICK else broad)(names, NOMINAL_HZ) for names in CLOCKS)]
)
def test_a_clock_that_is_there_is_taken_and_said(names, declared_hz, samples, tmp_path):
    """Whatever it is called; a declared rate is nominal, and does not take its place."""
    made = make(tmp_path, log_of(samples, names, *CLOCKS[names](samples)), odr_hz=declared_hz)
    session = read_session(made.folder)
    assert session.logs[0].samples.duration_s == pytest.approx(samples.duration_s, abs=2e-3)
    assert session.nominal_rate is None
    assert session.config.sensor.odr_hz == pytest.approx(declared_hz or TRUE_HZ, rel=1e-3)
    assert any("taken for the clock" in note for note in made.notes)


@pytest.mark.parametrize("name", ["foo", broad("time"), broad("SampleTimeFine")])
def test_a_column_that_may_be_the_clock_is_named_and_not_passed_over(name, samples, tmp_path):
    """Of no clock's name, or in a unit that no declared rate confirms."""
    text = log_of(samples, name, ticks(samples, 1e-4))
    with pytest.raises(FormatError, match=f"column {name!r}, which rises steadily by 94.8.* a row.*--time-unit.*--odr HZ"):
        make(tmp_path, text, odr_hz=NOMINAL_HZ)
    assert read_session(make(tmp_path, text, time_unit="100us").folder).nominal_rate is None


@pytest.mark.parametrize(
    ("names", "columns"),
    [
        broad("", lambda s: []),
        ("seq", lambda s: [np.arange(len(s))]),
        broad("n,mx", lambda s: [np.arange(len(s)) + 9, np.sin(s.t_s)]),
        ("mx", lambda s: [8096 + ticks(s, 2.0)]),
    ],
)
def test_what_is_no_clock_asks_for_the_rate(names, columns, samples, tmp_path):
    text = log_of(samples, names, *columns(samples))
    with pytest.raises(FormatError, match="no time stamps"):
        make(tmp_path, text)
    assert read_session(make(tmp_path, text, odr_hz=NOMINAL_HZ).folder).nominal_rate.hz == NOMINAL_HZ


def test_a_clock_may_be_left_aside_and_then_the_rate_is_nominal(samples, tmp_path):
    made = make(tmp_path, log_of(samples, "millis", ticks(samples, 1e-3)), odr_hz=NOMINAL_HZ, time_unit="none")
    assert read_session(made.folder).nominal_rate.hz == NOMINAL_HZ


# A unit that nothing names: known by the rate that it gives, a date, the header or gravity's movement; else asked for.


@pytest.fixture(scope="module")
def slow():
    """A logger of 9.4 Hz, which is 9400 Hz in a unit that is a thousandth."""
    return Table().tumble(4, seed=3, turn_s=5.0).samples(odr_hz=9.4)


def at_rest(odr_hz=9.4, rows=600):
    t_ns, none = np.rint(np.arange(rows) / odr_hz * 1e9).astype(np.int64), np.random.default_rng(0).normal(0, 1e-3, (rows, 3))
    return Samples(t_ns, none, none + np.array([0, 0, G]))


@pytest.mark.parametrize("unit", ["s", broad("ms"), "us"])
def test_gravitys_movement_tells_a_unit_that_two_rates_would_suit(unit, slow, tmp_path):
    text = log_of(slow, "time", np.round(slow.t_s * 1e9 / TIME[unit], 3 if unit == "s" else 0))
    made = make(tmp_path, text)
    assert made.took[2].startswith(f"clock: time in {unit} (by gravity's movement); 9.4 Hz")
    assert any(f"in {unit} by gravity's movement" in note for note in made.notes)


@pytest.mark.parametrize(("odr_hz", "unit"), [(5.0, "ms"), (7.0, "s"), broad(1.2, "ms"), broad(28.0, "ms"), (2300.0, "us")])
def test_at_rest_such_a_unit_is_asked_for(odr_hz, unit, tmp_path):
    rest = at_rest(odr_hz)
    text = log_of(rest, "time", np.round(rest.t_s * 1e9 / TIME[unit], 4))
    with pytest.raises(QuestionsError, match=rf"the unit of its clock 'time', which rises by .*{odr_hz:g} Hz in {unit}.*--time-unit"):
        make(tmp_path, text)
    for told in ({"time_unit": unit}, {"odr_hz": odr_hz * 1.3}):
        path = tmp_path / f"{len(told)}{next(iter(told))}"
        path.mkdir()
        assert read_session(make(path, text, **told).folder).logs[0].samples.period_s == pytest.approx(1 / odr_hz, rel=2e-3)


@pytest.mark.parametrize(
    ("before", "begins_ms", "known"),
    [("# Update Rate: 9.5 Hz\n", 0, "as 9.5 Hz stand before its rows"), ("", 1_700_000_000_000, "by its date")],
)
def test_a_rate_in_the_header_or_a_date_tells_it_too(before, begins_ms, known, tmp_path):
    rest = at_rest()
    made = make(tmp_path, before + log_of(rest, "time", ticks(rest, 1e-3) + begins_ms))
    assert made.took[2].startswith(f"clock: time in ms ({known}); 9.4")


@pytest.mark.parametrize("lost", [[], [50, 51, 200]])
@pytest.mark.parametrize("name", ["t", "time", "tick"])
def test_a_column_that_rises_by_one_numbers_the_rows(name, lost, samples, tmp_path):
    text = log_of(samples.pick(np.delete(np.arange(len(samples)), lost)), name, np.delete(np.arange(len(samples)), lost))
    with pytest.raises(QuestionsError, match=rf"'{name}', which rises by 1 a row, numbers the rows or is the clock; give --odr HZ"):
        make(tmp_path, text)
    assert read_session(make(tmp_path, text, odr_hz=NOMINAL_HZ).folder).nominal_rate.hz == NOMINAL_HZ


@pytest.mark.parametrize(
    ("name", "unit", "known"),
    [
        ("dt_ns", "ns", "by its name"),
        ("delta_us", "us", "by its name"),
        ("dT [ms]", "ms", "by its name"),
        ("dt", "s", "by the sensors' rates"),
    ],
)
def test_intervals_are_added_up(name, unit, known, samples, tmp_path):
    steps = np.diff(samples.t_ns, prepend=samples.t_ns[0] - 9_500_000) + np.random.default_rng(1).integers(-9000, 9000, len(samples))
    made = make(tmp_path, log_of(samples, name, steps / TIME[unit]))
    assert f"{name}, intervals that are added up, in {unit} ({known})" in made.took[2]
    t_ns = read_session(made.folder).logs[0].samples.t_ns
    np.testing.assert_allclose(np.diff(t_ns), steps[1:], atol=2)


def test_intervals_that_are_named_as_the_time_are_added_up_too(samples, tmp_path):
    columns = "t_us=dt,gx_dps=gx_dps,gy_dps=gy_dps,gz_dps=gz_dps,ax_g=ax_g,ay_g=ay_g,az_g=az_g"
    made = make(tmp_path, log_of(samples, "dt", np.diff(samples.t_ns, prepend=-9_500_000) / 1000), columns=columns)
    assert "clock: dt, intervals that are added up, in us (as you say); 105.4 Hz" in made.took[2]


@pytest.mark.parametrize(
    ("name", "stamps", "says"),
    [
        ("timestamp", lambda s: [f"{t:.6g}" for t in 1.7e9 + s.t_s], "1.7e\\+09 stands for"),
        ("time", lambda s: (1.7e9 + s.t_s).astype(np.float32).astype(int), "steps of 128 s"),
        ("t_s", lambda s: (1.7e9 + s.t_s).astype(np.float32).astype(float), "steps of 128 s"),
        ("time_ms", lambda s: (1.7e12 + s.t_s * 1e3).astype(np.float32).astype(int), "steps of 131072 ms"),
    ],
)
def test_stamps_with_too_few_digits_are_named(name, stamps, says, samples, tmp_path):
    with pytest.raises(CalibrationError, match=rf"too few digits.*{says}.*write at least milliseconds"):
        make(tmp_path, log_of(samples, name, stamps(samples)))


# What a nominal rate is worth.


def test_the_rate_is_as_uncertain_as_the_sensors_profile_or_session_toml_says(counted, tmp_path):
    """Half of a rectangular width, over the root of three; and nothing at all where it was measured."""
    session = read_session(counted)
    assert session.nominal_rate.sigma == pytest.approx(CLOCK_WITHIN.value / np.sqrt(3))
    own = replace(session.config.sensor, model="ASM330LHH")
    assert own.nominal_rate.sigma == pytest.approx(own.profile.clock_within.value / np.sqrt(3))
    for given, found in ((0.01, 0.01), (0.0, None)):
        rate = replace(session.config.sensor, odr_sigma=given).nominal_rate
        assert (rate and rate.sigma) == found


def test_check_warns_of_a_nominal_rate(counted):
    session = read_session(counted)
    finding = of(look(session), "sample rate")
    assert finding.level == "warning"
    assert "100 Hz, nominal, not measured: ± 2.9 %" in finding.says
    measured = with_sensor(session, odr_sigma=0.0)
    assert of(look(measured), "sample rate").level == "ok"
    assert measured.nominal_rate is None


@pytest.mark.broad
def test_all_parameters_scale_with_the_clock():
    """d(E, B) / de = -(E, B), by two fits to the same readings under clocks that differ by 2 e.  No latitude is given: the Earth's
    rotation alone would not scale."""
    quiet, e, found = Table().tumble(14, seed=5).samples(gyro_mdps=0.05, accel_ug=0.6, registers=False), 0.01, []
    for factor in (1 - e, 1 + e):
        session = Session.from_arrays(quiet.t_s * factor, quiet.gyro, quiet.accel)
        found.append(fit_session(session, LEAST_SQUARES).linear.model.vector)
    slope, middle = (found[1] - found[0]) / (2 * e), (found[0] + found[1]) / 2
    np.testing.assert_allclose(slope, -middle, atol=2e-3 * np.abs(middle).max())


@pytest.fixture(scope="module")
def fitted(counted):
    return fit_session(read_session(counted), LEAST_SQUARES)


def test_the_common_scale_carries_the_rates_uncertainty(fitted, counted):
    """By exactly one rank, along (E, B): a ratio of two scale factors stays as well known as ever, and the truth is covered."""
    known = fit_session(with_sensor(read_session(counted), odr_sigma=0.0), LEAST_SQUARES)
    more, vector = fitted.covariance - known.covariance, fitted.linear.model.vector
    np.testing.assert_allclose(more, fitted.nominal_rate.sigma**2 * np.outer(vector, vector), atol=1e-12)
    if fitted.joint_covariance is not None:
        np.testing.assert_allclose((fitted.joint_covariance - known.joint_covariance)[9:, 9:], more, atol=1e-12)
        np.testing.assert_allclose(fitted.joint_covariance[:9, :9], known.joint_covariance[:9, :9], atol=1e-15)
    off = vector[:9].reshape(3, 3) - E_TRUE
    sigma = np.sqrt(np.diag(fitted.covariance))[:9].reshape(3, 3)
    assert np.all(np.abs(np.diag(off)) < 2.5 * np.diag(sigma))
    assert np.all(np.abs(np.diag(off)) > 20 * np.sqrt(np.diag(known.covariance))[[0, 4, 8]])  # which nothing else would have told


def test_a_nominal_rate_is_at_best_not_decided(fitted):
    decision = fitted.verdict()
    assert decision.answer == "not decided"
    assert fitted.nominal_rate.doubt in decision.doubts


@pytest.mark.broad
def test_fit_and_report_say_that_the_rate_is_nominal(counted, run):
    _, said, _ = run("fit", counted, "--methods", "least_squares")
    assert "nominal, not measured" in " ".join(said.split())
    assert json.loads((counted / "fit" / "fit.json").read_text())["nominal_rate"]["hz"] == NOMINAL_HZ
    run("report", counted, "--methods", "least_squares")
    page = next(counted.rglob("report.html")).read_text()
    assert "100 Hz, nominal, not measured" in page
    assert "True data rate" not in page


# A clock that stamps the logs.


@pytest.fixture(scope="module")
def stamped():
    return tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=3).session


def with_stamps(session, ratio):
    fast = [replace(log, samples=replace(log.samples, t_ns=np.rint(log.samples.t_ns * ratio).astype(np.int64))) for log in session.logs]
    return replace(session, logs=tuple(fast))


def test_a_clock_that_is_known_to_so_many_ppm_moves_all_scales_by_as_many(stamped):
    """Stamps that run fast by one sigma move E and B as the source says; the rest of the covariance is as without it."""
    ppm, bare = 400.0, fit_session(stamped, LEAST_SQUARES)
    known = fit_session(with_sensor(stamped, clock_sigma_ppm=ppm), LEAST_SQUARES)
    moved = fit_session(with_stamps(stamped, 1 + ppm * 1e-6), LEAST_SQUARES).linear.model.vector - bare.linear.model.vector
    part = next(source for source in known.sources if source.name == CLOCK)
    assert (part.kind, part.freedom) == ("B", np.inf)
    np.testing.assert_allclose(np.outer(moved, moved)[:9, :9], part.covariance[:9, :9], atol=0.03 * part.covariance[0, 0])
    np.testing.assert_allclose(known.covariance - bare.covariance, part.covariance, atol=1e-3 * part.covariance[0, 0])
    assert known.nominal_rate is None  # measured all the same, so that nothing is in doubt
    assert known.verdict().answer == bare.verdict().answer


def test_a_clock_that_nobody_knows_stands_beside_the_scales(stamped):
    def beside(session):
        result = fit_session(session, LEAST_SQUARES)
        return {each.name: CLOCK in [row.what for row in each.beside] for each in sensor_error_budgets(result)}

    bare = beside(stamped)
    assert {name for name, there in bare.items() if there} == {f"scale factor error {axis}" for axis in "xyz"}
    for stated in ({"clock_sigma_ppm": 20.0}, {"clock_sigma_ppm": 0.0}, {"odr_sigma": 0.001}):
        assert not any(beside(with_sensor(stamped, **stated)).values()), stated
    motion = use_budgets(fit_session(stamped, LEAST_SQUARES), Use())[1]
    assert CLOCK in [row.what for row in motion[-1].beside]
    assert CLOCK not in [row.what for row in use_budgets(fit_session(stamped, LEAST_SQUARES), Use("rest"))[1][-1].beside]


def test_a_clock_is_kept_and_counted_logs_have_their_own(stamped, counted, tmp_path):
    again = read_session(with_sensor(stamped, clock_sigma_ppm=30.0).save(tmp_path / "s"))
    assert (again.config.sensor.clock_sigma_ppm, again.clock.sigma) == (30.0, pytest.approx(30e-6))
    even = with_sensor(stamped, even_sigma_ppm=12.0)
    assert (even.clock.sigma, even.clock_known) == (pytest.approx(12e-6), False)  # a line through stamps says nothing of their clock
    both = with_sensor(stamped, even_sigma_ppm=12.0, clock_sigma_ppm=5.0)
    assert (both.clock.sigma, both.clock_known) == (pytest.approx(13e-6), True)
    nominal = with_sensor(read_session(counted), clock_sigma_ppm=30.0)
    assert nominal.clock == nominal.nominal_rate is not None


def test_a_ratio_that_was_measured_is_a_sigma_until_it_is_taken_out(stamped, tmp_path):
    """Stamps that run 0.45 % fast: the ratio is in the sigma of all scales; divided by it, the fit is that of the true stamps."""
    ratio, sigma_ppm = 1.0045, 30.0
    folder = with_sensor(with_stamps(stamped, ratio), clock_ratio=ratio, clock_sigma_ppm=sigma_ppm).save(tmp_path / "s")
    session, by_arrivals = read_session(folder), replace(LEAST_SQUARES, clock="arrivals")
    assert session.clock.sigma == pytest.approx(np.hypot(4500e-6, 30e-6))
    finding = of(tinygc.check(session), "clock")
    assert finding.level == "warning"
    assert "4500 ± 30 ppm fast" in finding.says
    true, mended = fit_session(with_sensor(stamped, clock_sigma_ppm=sigma_ppm), LEAST_SQUARES), fit_session(folder, by_arrivals)
    np.testing.assert_allclose(mended.linear.model.vector, true.linear.model.vector, atol=1e-6)
    np.testing.assert_allclose(mended.covariance, true.covariance, rtol=1e-3, atol=1e-13)
    assert mended.session.clock.sigma == pytest.approx(30e-6)
    assert "divided by 1.0045 ± 30 ppm" in mended.session.logs[0].notes[-1]
    assert next_line(folder, tinygc.check(folder)).plain.endswith(f"fit {folder} --clock arrivals")
    (folder / "log_broken.csv").write_text("t_s,gx_dps\n")  # is one finding among those of the others, by that clock, too
    findings = tinygc.check(folder, clock="arrivals")
    assert of([each for each in findings if each.where == "log_broken.csv"], "reading").level == "error"
    assert any("divided by 1.0045 ± 30 ppm" in each.says for each in findings)
    (folder / "log_broken.csv").unlink()
    stated = [replace(log, comments={"odr_hz": "103.5"}) for log in session.logs]
    by_computer = replace(session, logs=tuple(stated)).on_clock("arrivals").logs[0]  # a rate that the board states is by its own seconds
    assert by_computer.number("odr_hz") == pytest.approx(103.5 * ratio)
    with pytest.raises(FormatError, match=r"sensor.clock_ratio is not given; `record` measures it; leave --clock arrivals out"):
        fit_session(stamped, by_arrivals)
