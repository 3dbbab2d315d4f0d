"""Failed readings of a thermometer are left out, and counted; its steps are found; whole degrees without a unit are degrees."""

import numpy as np
import pytest
from conftest import SESSION_TOML

from session.log.config import Sensor
from session.log.logfile import read_log
from session.log.rests import read_rest
from session.log.thermometer import _EXCURSION_C, _FENCE, _MOST_AT_ONCE, Sound, degrees_by, failed, grid_with
from tinygc import read_session

SENSOR = Sensor("ASM330LHH", "42", 13.0, 500.0, 4.0)


def with_failures(temp_c, at, value, length=1, held=1):
    """Readings, each for ``held`` rows, of which those at ``at`` and after are another."""
    out = np.array(temp_c, dtype=float)
    for place in at:
        out[place : place + length] = value
    return np.repeat(out, held)


@pytest.mark.parametrize("held", [1, 7])
@pytest.mark.parametrize("at", [[0], [50], [99], [10, 12, 14], [49, 50]])
def test_a_reading_that_jumps_away_and_back_has_failed(at, held):
    temp_c = with_failures(np.linspace(20, 25, 100), at, 85.0, held=held)
    assert failed(temp_c).tolist() == (temp_c == 85).tolist()


@pytest.mark.parametrize(("length", "is_out"), [(5, True), (6, False)])
def test_what_stays_away_for_longer_is_a_bodys(length, is_out):
    held = 4
    temp_c = with_failures(np.tile([20.0, 20.1], 50), [40], 85.0, length, held)
    assert failed(temp_c).sum() == length * held * is_out


@pytest.mark.parametrize(("beyond", "is_out"), [(-1e-6, False), (1e-6, True)])
@pytest.mark.parametrize(("way", "apart"), [(-1, 1.0), (1, 1.0), (1, 0.0)])
def test_the_fence_is_by_the_quartiles_around(way, apart, beyond, is_out):
    """Of two readings in turn, which are the quartiles; of a coarse thermometer, which are alike, two steps are left."""
    temp_c = np.tile([0.0, apart], 50)
    temp_c[50] = max(way, 0) * apart + way * (_FENCE * apart + _EXCURSION_C + beyond)
    assert failed(temp_c).sum() == is_out


def test_a_body_may_jump_and_warm_and_cool():
    """Into a bath; under a breath of two seconds, read ten times a second; noise of a register, of a bad thermometer, and none."""
    rng, t = np.random.default_rng(0), np.arange(20_000)
    warming = [20 + 5 * t / len(t) + sigma * rng.standard_normal(len(t)) for sigma in (0.05, 0.5, 20.0)]
    bath, breath = np.where(t < 10_000, 20.0, 40.0), 20 + 10 * np.exp(-(((t - 5000) / 10) ** 2))
    for temp_c in (bath, breath, *warming, *np.rint(warming), np.array([]), np.array([20.0]), np.array([20.0, 85.0])):
        assert not failed(temp_c).any()


def test_the_last_sound_reading_stands_for_one_that_failed():
    sound = Sound()
    temp_c = with_failures(np.linspace(20, 25, 51), [0, 30, 31], 85.0)
    expected = temp_c.copy()
    expected[[0, 30, 31]] = temp_c[[1, 29, 29]]
    assert np.array_equal(sound(temp_c), expected)
    assert sound.notes == ["3 readings of the thermometer jump away and back (85 °C), as no body does: left out"]
    written, expected_written = np.arange(51), np.arange(51)
    expected_written[[0, 30, 31]] = [1, 29, 29]
    assert np.array_equal(sound(with_failures(temp_c, [0, 30, 31], -40.0), written), expected_written)
    assert sound.notes == ["6 readings of the thermometer jump away and back (-40 to 85 °C), as no body does: left out"]
    sound = Sound()
    assert sound(None, written) is written
    assert sound(None) is None
    assert sound(expected) is expected
    assert sound.notes == []
    sound(with_failures(expected, [9], 99.0))
    assert sound.notes == ["1 reading of the thermometer jumps away and back (99 °C), as no body does: left out"]


@pytest.mark.parametrize(
    ("known", "temps", "grid"),
    [
        ((0.0, 0.0), None, (0, 0)),
        ((0.5, 3.0), [20.0, np.nan], (0.5, 3)),
        ((0.0, 0.0), [20.0, 20.0], (0, 20)),
        ((0.0, 0.0), [20.0, 21.0, 20.5], (0.5, 20)),
        ((0.5, 20.0), [23.0, 24.0], (0.5, 23)),
    ],
)
def test_the_grid_is_the_smallest_step(known, temps, grid):
    assert grid_with(known, None if temps is None else np.array(temps)) == grid


def rows_of(temps, in_units=True):
    """A log's text: a rest at 13 Hz."""
    header = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp" if in_units else "t_us,gx,gy,gz,ax,ay,az,temp"
    k = np.arange(len(temps))
    values = [k * 76_923, k % 3, -(k % 2), k % 4, 0 * k, 0 * k, 0 * k - 1, np.asarray(temps)]
    lines = (",".join([str(row[0]), *(f"{value:g}" for value in row[1:])]) for row in zip(*values, strict=True))
    return "\n".join([header, *lines]) + "\n"


def logged(folder, text, name="log0001.csv"):
    (folder / "session.toml").write_text(SESSION_TOML)
    (folder / name).write_text(text)
    return folder / name


def test_a_sessions_log_is_without_them(tmp_path):
    temps = with_failures(np.linspace(20, 25, 200).round(2), [20, 90], 85.0)
    path = logged(tmp_path, rows_of(temps).replace(",temp", ",temp_c"))
    log = read_session(tmp_path).logs[0]
    assert log.samples.temp_c[:].max() == 25
    assert log.samples.temp_c[90] == temps[89]
    assert log.notes == ("2 readings of the thermometer jump away and back (85 °C), as no body does: left out",)
    rest = read_rest(path, SENSOR)
    assert rest.temp_c.max() <= 25
    assert rest.notes == log.notes
    assert rest.grid[0] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("cells", "are_degrees"),
    [
        ("20 20 21 21 22", True),
        ("-40 -40 -41", True),
        ("20", True),
        ("20 85 20 20 20 20", True),
        ("20 22 18 25 21", False),
        ("20 22 20 22 20", False),
        ("-1280 -1280 -1281", False),
        ("200 200 200", False),
        ("20.5 20.5", False),
        ("", False),
    ],
)
def test_whole_degrees_go_one_by_one(cells, are_degrees):
    assert (degrees_by(cells.split()) is not None) == are_degrees


def test_a_column_temp_without_a_unit(tmp_path):
    """Beside columns with units, whole numbers that go one by one are degrees; beside registers they are the register."""
    temps = np.rint(np.linspace(18, 41, 400)).astype(int)
    log = read_log(logged(tmp_path, rows_of(temps)), SENSOR)
    assert (log.samples.temp_c[:].min(), log.samples.temp_c[:].max()) == (18, 41)
    assert log.notes == ("temp states no unit, where all other columns do: whole degrees, taken as °C",)
    raw = read_log(logged(tmp_path, rows_of(temps, in_units=False)), SENSOR)
    assert raw.samples.temp_c[0] == 25 + 18 / 256
    assert raw.notes == ()
    register = read_log(logged(tmp_path, rows_of(temps * 50 - 1280)), SENSOR)
    assert register.samples.temp_c[0] == 25 + (18 * 50 - 1280) / 256
    assert register.notes == ()


@pytest.mark.parametrize("step", [0.01, 1.0])
def test_one_in_twenty_fails(step):
    rng = np.random.default_rng(1)
    temp_c = np.rint(np.linspace(20, 45, _MOST_AT_ONCE + 5000) / step) * step
    out = rng.random(len(temp_c)) < 0.05
    temp_c[out] = rng.choice([-40.0, 0.0, 85.0, 128.0], size=out.sum())
    np.testing.assert_array_equal(failed(temp_c), out)
