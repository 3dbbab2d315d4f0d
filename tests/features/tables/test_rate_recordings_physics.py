"""Rates from files: points of a CSV, settled means and swings of a recording, and the response of a sweep, exactly."""

import numpy as np
import pytest
from imperfect_tables import AxisTrack
from scipy.special import gammaln
from simulated_tables import DOWN, Swings, record, steps

import tinygc
from session.base.errors import DataError, FormatError
from session.base.units import DEG
from tinygc.features.tables.feature import Columns
from tinygc.features.tables.rates import sweep
from tinygc.features.tables.rates.points import points_of, read_points
from tinygc.features.tables.rates.recording import read_recording
from tinygc.features.tables.rates.sweep import Response, fit_response, read_response, transfer

STEPPED = (-120, -60, 0, 60, 120)


RATES = (-20, -10, 0, 10, 20)


def csv(path, header, rows):
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def plain(path, header="rate_dps,mean_v", mark=","):
    return csv(path, header, [f"{rate}{mark}{0.1 * rate}" for rate in RATES])


@pytest.mark.parametrize(
    ("header", "factor", "unit"),
    [
        ("rate_dps,mean_v", 1.0, "V"),
        ("Rate (deg/s),Output (mV)", 1.0, "mV"),
        ("rate_rad_s,output_lsb", 180 / np.pi, "LSB"),
        ("speed_rpm,voltage_v", 6.0, "V"),
        ("rpm,gz_lsb", 6.0, "LSB"),
        ("rate [°/s],mean [V]", 1.0, "V"),
    ],
)
def test_columns_and_units_by_their_names(tmp_path, header, factor, unit):
    (points,), _ = read_points(plain(tmp_path / "t.csv", header))
    assert points.rate_dps == pytest.approx(factor * np.array(RATES))
    assert points.output == pytest.approx(0.1 * np.array(RATES))
    assert points.unit == unit
    assert points.sensor == "t"


def test_semicolons_comments_and_a_mark_of_utf8(tmp_path):
    path = plain(tmp_path / "t.csv", "# bench 3\nrate_dps;mean_v", mark=";")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(read_points(path)[0][0]) == 5


def test_options_name_columns_unit_and_readings(tmp_path):
    path = csv(tmp_path / "t.csv", "r_dps,y,std", [f"{rate},{rate},0.2" for rate in RATES])
    (points,), remarks = read_points(path, Columns("r_dps", "y", "V", 100))
    assert points.unit == "V"
    assert points.sigma == pytest.approx(np.full(5, 0.02))
    assert not remarks
    assert "--readings" in read_points(path, Columns("r_dps", "y", "V"))[1][0]
    assert "--output-unit" in read_points(path, Columns("r_dps", "y", "", 100))[1][0]
    path = csv(tmp_path / "n.csv", "rate_dps,mean_v,std,n", [f"{rate},{rate},0.2,many" for rate in RATES])
    assert read_points(path, Columns(readings=100))[0][0].sigma == pytest.approx(np.full(5, 0.02))


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("", "empty; expected a header"),
        ("rate_dps,mean_v\n", "empty; expected a header"),
        ("speed,volts\n1,2\n", "no column of output"),
        ("rate,mean_v\n1,2\n2,3\n3,4\n4,5\n", "'rate' states no unit"),
        ("rate_dps,mean_v\n1,2\n2\n", "line 3: 1 columns, expected the 2"),
        ("rate_dps,mean_v\n1,2\n2,abc\n", "line 3: mean_v is 'abc', expected a number"),
        ("rate_dps,mean_v\n1,2\n2,nan\n", "line 3: mean_v is 'nan', expected a number"),
        ("rate_dps,mean_v\n1,2\n2,3\n3,4\n", r"t\.csv: t: 3 rates, expected at least four"),
        ("rate_dps,mean_v\n1,0\n2,0\n3,0\n4,0\n", r"t\.csv: t: the output is 0 V at every rate"),
        ("rate_dps,mean_v\n1,5,1,1\n", "4 columns, expected the 2 of the header; a decimal is written with a point"),
        ("rate_dps;mean_v\n1,5;1\n", "line 2: rate_dps is '1,5', expected a number with a decimal point"),
        ("rate_dps,mean_v,std_v\n1,2,0.1\n2,3,-0.1\n", "line 3: a std below 0"),
        ("rate_dps,mean_v,std_v,n\n1,2,0.1,0\n", "line 2: .*less than one reading"),
    ],
)
def test_what_is_refused(tmp_path, text, reported):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(FormatError, match=reported):
        read_points(path)


def test_a_sensor_with_too_few_rates_is_left_out_alone(tmp_path):
    rows = [f"a,{rate},{rate}" for rate in RATES] + ["b,1,1", "b,2,2"]
    found, remarks = read_points(csv(tmp_path / "t.csv", "sensor,rate_dps,mean_v", rows))
    assert [points.sensor for points in found] == ["a"]
    assert "b: 2 rates, expected at least four, in both senses: left out." in remarks


@pytest.mark.parametrize(("outputs", "quantum"), [([1.5, 2.25, 3], 0.01), ([12, 15, 1e6], 1.0), ([0.1 + 0.2, 1 / 3, 1], 0.0)])
def test_the_step_of_the_last_decimal(outputs, quantum):
    assert points_of("s", "V", [0, 1, 2, 3], [*outputs, 7], ["one"] * 4).quantum == pytest.approx(quantum)


# Recordings.


def read(folder):
    return read_recording(folder, lambda *what: None)


@pytest.fixture(scope="module")
def stepped(tmp_path_factory):
    track, ends_s = steps([*STEPPED, *STEPPED[-2::-1]], 4.0)
    return record(tmp_path_factory.mktemp("stepped"), track, ends_s, scale=1.01)


def test_rates_and_means_of_settled_dwells(stepped):
    (points,), _, _ = read(stepped)
    moved = np.abs(points.rate_dps) > 1
    assert points.rate_dps[moved] == pytest.approx([r for r in (*STEPPED, *STEPPED[-2::-1]) if r], abs=2e-3)
    errors = (points.output - points.output[~moved].mean() - 1.01 * points.rate_dps) / points.sigma
    assert np.sqrt(np.mean(errors**2)) < 2
    assert (points.sigma < 5e-3).all()
    assert (points.rate_dps[~moved] == 0).all()  # within the table's declared sigma it is at rest
    assert points.sensor == "gyroscope z"
    assert set(points.direction) == {-1, 0, 1}


def test_a_way_back_to_a_limit_is_no_dwell(tmp_path):
    """The axis goes from -170 to 150 at its rate, rests, and comes back faster to where it began."""
    track, t_s = AxisTrack(-170 * DEG), 1.0
    for rate in (40.0, 20.0, 10.0):
        track.turn_at(t_s, rate * DEG, DOWN.acceleration_rps2)
        track.turn_at(t_s + 6.0, 0.0, DOWN.acceleration_rps2)
        track.turn_to(t_s + 8.0, -170 * DEG, 80 * DEG, DOWN.acceleration_rps2)
        t_s += 14.0
    record(tmp_path, track, t_s, limits="least_deg = -170\nmost_deg = 170\n")
    (points,), _, _ = read(tmp_path)
    assert sorted(set(points.rate_dps.round())) == [0, 10, 20, 40]


def test_means_are_over_whole_turns(tmp_path):
    """A wave of once a turn, as gravity makes it about a tilted axis, does not enter; half a turn more would."""
    track, ends_s = steps([60.0, 90.0, 120.0, 150.0], 9.5)

    def distort(t_s, rate, force, temp_c):
        return rate + np.deg2rad(2) * np.sin(track.reported(t_s))[:, None] * [0, 0, 1]

    record(tmp_path, track, ends_s, distort=distort, noise=0.5)
    (points,), _, _ = read(tmp_path)
    moved = points.rate_dps > 1
    assert points.output[moved] == pytest.approx(points.rate_dps[moved], abs=0.01)


def test_bandwidth_and_delay_of_a_swing(tmp_path):
    track = Swings([1.0, 2.0, 4.0, 8.0, 12.0], 4.0)
    record(tmp_path, track, track.ends_s, latency_s=0.02)
    (sweep,) = tinygc.estimate_rates(tmp_path).sweeps
    assert sweep.response.frequency_hz == pytest.approx([1, 2, 4, 8, 12], rel=1e-3)
    assert sweep.bandwidth_hz == pytest.approx(33.0, abs=4 * sweep.bandwidth_sigma_hz)  # the simulated sensor's filter
    delay_s, sigma_s = sweep.delay_s
    assert delay_s == pytest.approx(-0.02, abs=4 * sigma_s)
    assert sigma_s < 1e-3
    assert "not declared" in sweep.lines[0]


def test_what_a_recording_lacks(tmp_path, stepped):
    with pytest.raises(FormatError, match=r"table.toml: not found; a recording of rates"):
        read(tmp_path)
    for name in ("table.toml", "table.csv", "session.toml"):
        (tmp_path / name).write_bytes((stepped / name).read_bytes())
    with pytest.raises(FormatError, match=r"no log; expected rates0001\.csv"):
        read(tmp_path)
    (tmp_path / "rates0002.csv").write_bytes((stepped / "rates0001.csv").read_bytes())
    with pytest.raises(FormatError, match=r"no angle of rates0002.csv"):
        read(tmp_path)


# A response by itself.


def response(model, vector, seed=1, sigma=1e-3, f=None):
    f = np.geomspace(0.5, 60, 8) if f is None else f
    rng = np.random.default_rng(seed)
    h = transfer(model, f, np.array(vector)) * (1 + sigma * (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))))
    return Response("r", f, np.abs(h), np.angle(h), sigma * np.abs(h), np.full(len(f), sigma))


@pytest.mark.parametrize(
    ("model", "vector", "band"),
    [("first", [1.02, 0.003, 20.0], 20.0), ("second", [1, 0.001, 25.0, 0.3], 36.30)],
)
def test_models_compete_and_give_the_bandwidth(model, vector, band):
    sweep = fit_response(response(model, vector))
    assert sweep.model == model
    assert np.abs(sweep.vector - vector) == pytest.approx(0, abs=4 * np.sqrt(np.diag(sweep.covariance)).max())
    assert sweep.bandwidth_hz == pytest.approx(band, abs=max(4 * sweep.bandwidth_sigma_hz, 1e-2))


def test_transfer_functions_are_those_of_their_orders():
    f = np.array([5.0, 20, 60])
    late = 1.5 * np.exp(-2j * np.pi * f * 0.004)
    assert transfer("first", f, np.array([1.5, 0.004, 20.0])) == pytest.approx(late / (1 + 1j * f / 20))
    assert transfer("second", f, np.array([1.5, 0.004, 20.0, 0.6])) == pytest.approx(late / (1 + 1.2j * f / 20 - (f / 20) ** 2))


def flat_response(top_hz=60.0):
    return response("flat", [1.0, 0.0], f=np.linspace(top_hz / 60, top_hz, 8))


def test_the_sigma_of_a_bandwidth_of_the_second_order_is_that_of_its_slopes():
    """(f / f0)^2 = a + sqrt(a^2 + 1), a = 1 - 2 zeta^2, where the gain is 0.707."""
    f0, zeta = 30.0, 0.6
    a = 1 - 2 * zeta**2
    band = f0 * np.sqrt(a + np.hypot(a, 1))
    slope = np.array([0, 0, band / f0, f0**2 / (2 * band) * (1 + a / np.hypot(a, 1)) * -4 * zeta])
    covariance = np.diag([9.0, 9.0, 0.5**2, 0.01**2])
    covariance[2, 3] = covariance[3, 2] = 0.002
    found = sweep._bandwidth(flat_response(), "second", np.array([2.0, 1.0, f0, zeta]), covariance)
    assert found == (pytest.approx(band), pytest.approx(np.sqrt(slope @ covariance @ slope), rel=1e-5), None)
    assert np.abs(transfer("second", np.array([band]), np.array([2.0, 0.1, f0, zeta]))) == pytest.approx(np.sqrt(2))


@pytest.mark.parametrize(("band", "top_hz", "shows"), [(183.9, 60.0, True), (184.1, 60.0, False), (1e6, 0.05, False)])
def test_a_bandwidth_shows_where_it_may_be_within_three_times_the_highest_frequency(band, top_hz, shows):
    """In the last case the gain falls by less than rounding."""
    found = sweep._bandwidth(flat_response(top_hz), "first", np.array([1.0, 0.0, band]), np.diag([1.0, 1.0, 4.0 if top_hz > 1 else np.inf]))
    assert found == ((pytest.approx(band), pytest.approx(2.0), None) if shows else (None, None, top_hz))


def test_the_probability_of_a_model_is_that_of_any_noise():
    """A number's prior is as wide as what the flat model leaves; the noise is integrated out."""
    some = response("first", [1.0, 0.0, 200.0], sigma=0.02, seed=5)
    left = [(len(x), chi) for x, _, chi in (sweep._fit(some, name) for name in sweep.MODELS)]
    scores = np.array([(16 - k) * np.log(chi / 2) - 2 * gammaln(8 - k / 2) + k * np.log(left[0][1]) for k, chi in left])
    assert fit_response(some).probability == pytest.approx(1 / np.sum(np.exp((scores.min() - scores) / 2)), rel=1e-9)


def test_sigmas_and_bounds_of_a_csv(tmp_path):
    def read_rows(header, *rows):
        (tmp_path / "sweep.csv").write_text("\n".join([header, *rows]))
        return read_response(tmp_path / "sweep.csv")

    plain = ("1,2,10", "10,1,-90")
    found = read_rows("f_hz,magnitude,phase_deg", *plain)
    assert (found.gain_sigma.tolist(), found.phase_sigma.tolist()) == (pytest.approx([2e-3, 1e-3]), pytest.approx([1e-3, 1e-3]))
    assert found.latency_s is None
    found = read_rows("f_hz,gain,phase_deg,gain_sigma,phase_sigma_deg", "1,2,10,0.1,3", "10,1,-90,0,0")
    assert found.gain_sigma == pytest.approx([0.1, 1e-3])
    assert found.phase_sigma == pytest.approx([3 * DEG, 1e-3])
    for row, words in (("1e-6,1,0", "frequency"), ("100001,1,0", "frequency"), ("1,1000001,0", "gain"), ("1,1e-7,0", "gain")):
        with pytest.raises(FormatError, match=f"a {words} is not between"):
            read_rows("f_hz,gain,phase_deg", *plain, row)
    assert len(read_rows("f_hz,gain,phase_deg", "1e5,1e6,0", "1.1e-5,1.1e-6,0").gain) == 2
    with pytest.raises(FormatError, match="line 3: gain is 'x', expected a number"):
        read_rows("f_hz,gain,phase_deg", plain[0], "2,x,0")
    for header, missing in (("f_hz,gain (dB),phase_deg", "gain"), ("f_hz,gain,phase [rad]", "phase_deg")):
        with pytest.raises(FormatError, match=f"no column {missing} among"):
            read_rows(header, *plain)


def test_what_a_sweep_says():
    f, covariance = np.array([1.0, 2, 4, 8]), np.diag([0.02**2, 0.003**2, 2.0**2])

    def of(delay_s, h):
        given = Response("r", f, np.abs(h), np.angle(h), np.full(4, 0.01), np.full(4, 2 * DEG), 0.004)
        return sweep.Sweep(given, "first", np.array([1.1, delay_s, 20.0]), covariance, 20.0, 2.0, None, 1.0)

    found, later = of(-0.0065, np.ones(4)), of(-0.0055, transfer("first", f, np.array([1.1, -0.0055, 20.0])))
    assert found.gain == pytest.approx((1.1, 0.02))
    assert found.delay_s == pytest.approx((-0.0065, 0.003))
    assert found.rows_deg[1] == pytest.approx((2.0, 1.0, 0.01, 0.0, 2.0))
    ratio = 1 / transfer("first", f, found.vector)
    assert found.left == pytest.approx((np.sqrt(np.mean((np.abs(ratio) - 1) ** 2)), np.sqrt(np.mean(np.angle(ratio) ** 2))))
    reported, besides = " ".join(found.lines), " ".join(later.lines)
    assert "delay -6.5 ± 3.0 ms: the sensor's, the table's declared latency taken off" in reported
    for words in ("a delay below zero", "does not describe these points"):  # a delay by more than two sigmas
        assert words in reported
        assert words not in besides


def test_too_few_frequencies_are_refused():
    with pytest.raises(DataError, match="3 frequencies, expected at least 4"):
        fit_response(response("flat", [1, 0], f=np.array([1.0, 2.0, 3.0])))


def test_what_a_model_leaves_widens_its_sigmas_by_the_freedom_that_is_left():
    """Of a flat response all is linear: K from the logarithms, a delay from the phases; 2 f values less two numbers."""
    f = np.array([0.5, 1, 2, 4, 8, 12.0])
    log_gain, phase = 4e-3 * np.array([1, -1, 1, -1, 1, -1]), 4e-3 * np.array([1, -1, -1, 1, 1, -1])
    sweep = fit_response(Response("r", f, np.exp(log_gain), phase, 1e-3 * np.exp(log_gain), np.full(6, 1e-3)))
    slope = -2 * np.pi * f
    left = np.r_[log_gain - log_gain.mean(), phase - slope * (slope @ phase) / (slope @ slope)]
    assert sweep.model == "flat"
    variance = left @ left / (2 * 6 - 2)
    assert np.diag(sweep.covariance) == pytest.approx(variance * np.array([sweep.vector[0] ** 2 / 6, 1 / (slope @ slope)]), rel=1e-4)
