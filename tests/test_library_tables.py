"""Tables in memory go wherever a session goes: DataFrames of any library, dicts, arrays with named columns or none, read as files are."""

import numpy as np
import pytest
from conftest import DEG

import tinygc
from session.base.units import G
from tinygc import CalibrationError


class Frame:
    """As much of a DataFrame as every library has."""

    def __init__(self, columns):
        self._columns = columns
        self.columns = list(columns)

    def __getitem__(self, name):
        return self._columns[name]

    def to_numpy(self):
        return np.column_stack(list(self._columns.values()))


@pytest.fixture(scope="module")
def samples():
    return tinygc.simulate(segments=14, closure_s=0.0, odr_hz=62.5, seed=4).session.logs[0].samples


def columns_of(samples):
    t_s = (samples.t_ns - samples.t_ns[0]) * 1e-9
    rates = dict(zip(("gx_dps", "gy_dps", "gz_dps"), samples.gyro.T / DEG, strict=True))
    return {"t_s": t_s, **rates, **dict(zip(("ax_g", "ay_g", "az_g"), samples.accel.T / G, strict=True))}


def tables(samples):
    """Each kind of table, by its name."""
    columns = columns_of(samples)
    whole = np.column_stack(list(columns.values()))
    stamps = samples.t_ns.astype("M8[ns]")
    found = {
        "frame": Frame(columns),
        "triads": {"t_s": columns["t_s"], "gyro_rps": samples.gyro, "accel_mps2": samples.accel},
        "stamps": {"time": stamps, **{name: column for name, column in columns.items() if name != "t_s"}},
        "named columns": np.rec.fromarrays(list(columns.values()), names=list(columns)),
        "bare array": whole,
        "units by physics": Frame(dict(zip(("t", "wx", "wy", "wz", "ax", "ay", "az"), whole.T, strict=True))),
    }
    try:
        import pandas as pd
    except ImportError:
        return found
    return found | {
        "pandas": pd.DataFrame(columns),
        "pandas, time as index": pd.DataFrame({**columns, "time": stamps}).drop(columns="t_s").set_index("time"),
    }


def test_every_kind_of_table_is_read_to_the_same_samples(samples):
    for name, table in tables(samples).items():
        log = tinygc.read_log(table)
        np.testing.assert_allclose(log.t_s, columns_of(samples)["t_s"], atol=2e-9, err_msg=name)
        np.testing.assert_allclose(log.gyro_rps, samples.gyro, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(log.accel_mps2, samples.accel, atol=1e-9, err_msg=name)


def test_a_table_goes_wherever_a_session_goes(samples):
    table = Frame(columns_of(samples))
    session = tinygc.read_log(table).session()
    assert [(each.what, each.description) for each in tinygc.check(table)] == [
        (each.what, each.description) for each in tinygc.check(session)
    ]
    fitted = tinygc.fit(table, methods="least_squares")
    np.testing.assert_allclose(fitted.result.linear.linear.vector, tinygc.fit(session, methods="least_squares").result.linear.linear.vector)
    np.testing.assert_array_equal(tinygc.apply(fitted, table).gyro, tinygc.apply(fitted, session.logs[0]).gyro)


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ({}, "^it has no columns"),
        ({"t_s": [1, 2], "gx": [1]}, r"^its columns have different lengths \(t_s 2, gx 1\); expected one"),
        ({"t_s": [1, 2], "gx": ["a", "b"]}, "^gx is not made of numbers"),
        ({"t_s": [1, 2], "gx": [1j, 2j]}, "^gx holds complex numbers, expected real ones"),
        (
            {"t_s": np.arange(50) / 50, "gyro_dps": np.ma.array(np.ones((50, 3)), mask=np.eye(50, 3, -1)), "accel_g": np.ones((50, 3))},
            "^data line 3: gyro_dps_x is nan, expected a finite number",
        ),
        ({"gyro": np.zeros((5, 4))}, r"^gyro has shape \(5, 4\), expected \(N,\) or \(N, 3\)"),
        (
            {"t_s": np.arange(50) / 10, "gyro": np.ones((50, 3)), "accel_g": np.ones((50, 3))},
            r"^data \(other\) does not state the unit of the gyroscope; give gyro_unit= \(.*\), all to tinygc\.read_log\(data, …\)",
        ),
        (5, "^session is a int, expected a tinygc.Session, the path of its folder, or a table"),
    ],
)
def test_what_is_wrong_with_a_table_is_one_line(table, complaint):
    for call in (tinygc.fit, tinygc.check):
        with pytest.raises(CalibrationError, match=complaint) as caught:
            call(table)
        assert "\n" not in str(caught.value)
