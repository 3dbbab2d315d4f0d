"""The detector: what is a rest, whether its innovations are white, how long it runs to a false alarm, what it finds."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from conftest import DEG
from watched import ACCEL_WHITE, RATE_HZ, WHITE, G, chosen, flat, known, model_file, reading, samples

from session.io.errors import CalibrationError, FormatError
from tinygc.annexes.watch.detector import PROCESSES, STATES, Detector, Window, ZeroFilter
from tinygc.annexes.watch.expectation import ModelInUse, _drift, expect
from tinygc.annexes.watch.settings import BLOCKS, CLIP, TIMES_S, settings
from tinygc.closure.floor import BiasInstability

WINDOW_S = 1.92


def windows(detector: Detector, *parts) -> list:
    """Judged windows of readings."""
    return [
        (window, judged)
        for part in parts
        for *_, window, judged in detector.feed(part.gyro, part.accel, part.temp_c)
        if window is not None and judged is not None
    ]


# What is a rest


def test_a_rest_gives_its_zero_and_gravity():
    detector, zero = Detector(chosen()), (0.05, -0.02, 0.01)
    found = windows(detector, samples(60, 1, zero))
    assert len(found) == (60 / 0.12 - 2) // BLOCKS  # but the first block, and the one that shows the end
    c = detector.chosen
    mean = np.mean([window.rate[:, 0] for window, _ in found], axis=0) * c.rate_sigma_rps / DEG
    np.testing.assert_allclose(mean, zero, atol=5 * WHITE / DEG / np.sqrt(60))
    scatter = np.std([window.rate[:, 0] for window, _ in found], axis=0)
    np.testing.assert_allclose(scatter, 1, atol=4 / np.sqrt(2 * len(found)))
    np.testing.assert_allclose(np.mean([window.direction[:, 0] for window, _ in found], axis=0), [0, 0, -1], atol=1e-4)
    assert np.std([window.gravity[0] for window, _ in found]) == pytest.approx(1, abs=4 / np.sqrt(2 * len(found)))
    assert np.mean([window.scatter for window, _ in found], axis=0).ravel() == pytest.approx([1, 1], abs=0.15)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda rate, force: (rate + np.array([11 * DEG, 0, 0]), force),
        lambda rate, force: (rate, force * 1.3),
        lambda rate, force: (rate, force * 0.7),
        lambda rate, force: (rate + 0.2 * DEG * np.sin(np.arange(len(rate)))[:, None], force),
        lambda rate, force: (rate, force + 0.1 * np.sin(np.arange(len(rate)))[:, None]),
        lambda rate, force: (np.where(np.arange(len(rate))[:, None] % 100 == 50, np.nan, rate), force),
        lambda rate, force: (rate, np.where(np.arange(len(rate))[:, None] % 100 == 50, np.inf, force)),
        lambda rate, force: (rate, force + np.linspace(0, 0.5, len(rate))[:, None] * [1, 0, 0]),  # it turns slowly
    ],
)
def test_what_is_no_rest_gives_nothing(spoil):
    part = samples(20, 2)
    rate, force = spoil(part.gyro, part.accel)
    assert windows(Detector(chosen()), dataclasses.replace(part, gyro=rate, accel=force)) == []


@pytest.mark.parametrize("bar", ["rate", "heavy", "light", "rate's scatter", "force's scatter"])
def test_the_bars_of_a_quiet_block(bar):
    """A mean of 10 °/s, gravity by a quarter more or less, and the variances (of n - 1) that the settings have."""
    c = chosen()
    n, other = c.samples, np.where(np.arange(c.samples) % 2, 1.0, -1.0)[:, None] * np.sqrt((c.samples - 1) / c.samples)  # of variance 1
    for share, quiet in ((0.999, True), (1.001, False)):
        rate, force = np.zeros((n, 3)), np.tile([0.0, 0.0, -G], (n, 1))
        if bar == "rate":
            rate[:, 1] = -share * 10 * DEG
        elif bar in ("heavy", "light"):
            force *= 1 + (0.25 if bar == "heavy" else -0.25) * share
        elif bar == "rate's scatter":
            rate[:, :2] = other * np.sqrt(share * c.gyro_limit / 2)
        else:
            force[:, 1:] += other * np.sqrt(share * c.accel_limit / 2)
        ((found, *_),) = Detector(c).feed(rate, force)
        assert found == quiet


def test_the_earth_is_taken_off_along_gravity():
    rate = 7.292115e-5 * np.sin(50 * DEG)
    detector = Detector(settings(flat(earth_rps=rate), 1e6))
    part = samples(400, 4, zero_dps=np.array([0, 0, -rate / DEG]))  # level, z down: the Earth turns about -z
    mean = np.mean([window.rate[2, 0] for window, _ in windows(detector, part)])
    assert mean * detector.chosen.rate_sigma_rps[2] == pytest.approx(0, abs=4 * WHITE / np.sqrt(400))


def test_a_gap_ends_a_rest_and_lets_time_pass():
    detector = Detector(settings(flat(wander=lambda t, span: np.full(3, 1e-10 * t)), 1e6))
    list(detector.feed(*(getattr(samples(30, 5), name) for name in ("gyro", "accel"))))
    before = float(detector.filter.P[0, 0, 0])
    detector.gap(round(3600 * RATE_HZ))
    grown = (float(detector.filter.P[0, 0, 0]) - before) * detector.chosen.rate_sigma_rps[0] ** 2
    assert grown == pytest.approx(1e-10 * 3600, rel=0.01)
    assert windows(detector, samples(2, 6)) == []


def test_each_rest_begins_anew_and_each_sixteenth_block_is_a_window_of_time(monkeypatch):
    detector, calls = Detector(chosen()), []
    for name in ("new_rest", "predict"):
        monkeypatch.setattr(detector.filter, name, lambda name=name: calls.append(name))
    rest = samples(0.12 * BLOCKS * 10, 1)
    for part in (rest, dataclasses.replace(rest, gyro=rest.gyro + 1.0), rest):
        windows(detector, part)
    assert (calls.count("new_rest"), calls.count("predict")) == (2, 30)


# The filters


def reference(c, rates: np.ndarray, warmer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z and the last covariance of one axis, by the textbook's filter."""
    decay = np.r_[1.0, c.decay, 1.0, 1.0]
    P = np.diag([c.offset, *np.zeros(PROCESSES), c.attitude, c.per_k])
    drive = np.diag([c.walk, *c.drive, 0.0, 0.0])
    x, found = np.zeros(STATES), []
    for rate, warm in zip(rates, warmer, strict=True):
        x, P = decay * x, decay[:, None] * P * decay + drive
        h = np.r_[np.ones(STATES - 1), warm]
        S = h @ P @ h + 1
        found.append((rate - h @ x) / np.sqrt(S))
        gain = P @ h / S
        x, P = x + gain * (rate - h @ x), P - np.outer(gain, gain) * S
    return np.array(found), P


def test_the_filter_is_the_textbooks():
    wander = lambda t, span: np.full(3, _drift(t, span, None, BiasInstability(2 * DEG / 3600, ""))[0] + 1e-12 * t)  # noqa: E731
    c = chosen(wander=wander, per_k=np.full(3, 0.01 * DEG))
    c = dataclasses.replace(c, per_k=100.0)
    rng, filters = np.random.default_rng(1), ZeroFilter(c)
    rates, warmer = 20 + rng.normal(size=300), np.linspace(0, 3, 300)
    z = []
    for rate, warm in zip(rates, warmer, strict=True):
        filters.predict()
        z.append(float(filters.judge(reading(np.full((3, 1), rate), warmer=warm)).z[0, 0]))
    expected, P = reference(c, rates, warmer)
    np.testing.assert_allclose(z, expected, atol=1e-9)
    np.testing.assert_allclose(filters.P[..., 0], P, atol=1e-9 * P.max())


def simulated(c, count: int, copies: int, seed: int, rest: int | None = None):
    """Windows of sensors that do as the settings say."""
    rng = np.random.default_rng(seed)
    zero = rng.normal(size=(3, copies)) * np.sqrt(c.offset)
    accel = rng.normal(size=(3, copies)) * np.sqrt(c.accel_offset)
    slow, slow_g = np.zeros((PROCESSES, 3, copies)), np.zeros((PROCESSES, copies))
    for number in range(count):
        new = rest is not None and number % rest == 0 and number > 0
        if number == 0 or new:
            own, own_g = rng.normal(size=(3, copies)) * np.sqrt(c.attitude), rng.normal(size=copies) * np.sqrt(c.accel_attitude)
            along = rng.normal(size=(3, copies))
            along /= np.linalg.norm(along, axis=0)
        zero = zero + rng.normal(size=zero.shape) * np.sqrt(c.walk)
        accel = accel + rng.normal(size=accel.shape) * np.sqrt(c.accel_walk)
        for k in range(PROCESSES):
            slow[k] = c.decay[k] * slow[k] + rng.normal(size=slow[k].shape) * np.sqrt(c.drive[k])
            slow_g[k] = c.decay[k] * slow_g[k] + rng.normal(size=copies) * np.sqrt(c.accel_drive[k])
        rate = zero + slow.sum(axis=0) + own + rng.normal(size=zero.shape)
        gravity = np.sum(along * accel, axis=0) + slow_g.sum(axis=0) + own_g + rng.normal(size=copies)
        yield new, Window(rate, gravity, along, np.zeros(copies), np.ones((2, copies)))


#: wander that is as large as the white noise of a window
WANDERING = {
    "wander": lambda t, span: np.full(3, (WHITE**2 / WINDOW_S) * (0.01 * t / WINDOW_S + 1 - np.exp(-t / 100))),
    "accel_wander": lambda t, span: np.full(3, (ACCEL_WHITE**2 / WINDOW_S) * (0.01 * t / WINDOW_S + 1 - np.exp(-t / 100))),
}


@pytest.mark.parametrize("rest", [None, 4])
def test_innovations_are_white_and_of_one_sigma(rest):
    """While the sensor does as its figures say: means, variances and correlations of all channels within five of their sigmas."""
    c = chosen(1e9, **WANDERING)
    filters, z = ZeroFilter(c, 300), []
    for new, window in simulated(c, 150, 300, 7, rest):
        filters.predict()
        if new:
            filters.new_rest()
        z.append(filters.judge(window).z)
    z = np.array(z, dtype=float)
    many = np.sqrt(z[:, 0].size)
    np.testing.assert_allclose(z.mean(axis=(0, 2)), 0, atol=5 / many)
    np.testing.assert_allclose(z.std(axis=(0, 2)), 1, atol=5 / many)
    for lag in (1, 2, 10):
        np.testing.assert_allclose(np.mean(z[lag:] * z[:-lag], axis=(0, 2)), 0, atol=5 / many * 1.1)
    np.testing.assert_allclose(np.mean(z[:, 0] * z[:, 1]), 0, atol=5 / many)


def test_it_runs_as_long_as_stated_to_a_false_alarm():
    """100 windows are asked for: no less, and no more than twice that; some 1000 alarms know their mean distance to 3 %."""
    c, count, copies = chosen(100, **WANDERING), 150, 800
    filters, alarms = ZeroFilter(c, copies), 0
    for _, window in simulated(c, count, copies, 8):
        filters.predict()
        alarms += int((filters.judge(window).alarm != 0).any(axis=0).sum())
    assert 100 < count * copies / alarms < 200


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_is_found_on_its_axis_with_its_sign(axis, sign):
    c = chosen()
    filters, rng = ZeroFilter(c, 50), np.random.default_rng(9)
    delays = np.zeros(50)
    for number in range(120):
        rate = rng.normal(size=(3, 50)) + 10
        rate[axis] += sign * 4 * (number >= 100)
        filters.predict()
        alarm = filters.judge(reading(rate)).alarm
        assert (np.delete(alarm, axis, axis=0) == 0).all()
        if number < 100:
            assert (alarm == 0).all()
        hit = (alarm[axis] == sign) & (delays == 0)
        delays[hit] = number - 99
        if hit.any():
            assert (alarm[axis][hit] == sign).all()
    assert (delays >= 2).all()
    assert delays.mean() < 5


def test_gravity_is_a_channel_of_its_own():
    filters, rng, first = ZeroFilter(chosen()), np.random.default_rng(10), None
    for number in range(140):
        filters.predict()
        alarm = filters.judge(reading(rng.normal(size=(3, 1)), rng.normal(size=1) - 5.0 * (number >= 100))).alarm[:, 0]
        assert not alarm[:3].any()
        if alarm[3] and first is None:
            first = number, alarm[3]
    assert first is not None
    assert first[1] == -1
    assert 101 <= first[0] < 106


@pytest.mark.parametrize("size", [5.0, 8.0, 1e3, 1e6])
def test_one_window_alone_never_alarms(size):
    """However far off: it counts as CLIP sigmas, and changes nothing."""
    filters = ZeroFilter(chosen())
    for number in range(60):
        filters.predict()
        before = filters.x.copy()
        found = filters.judge(reading(np.full((3, 1), size if number == 30 else 0.0)))
        assert (found.alarm == 0).all()
        if number == 30 and size > 6:
            assert found.z[0, 0] == CLIP
            np.testing.assert_array_equal(filters.x, before)


def test_after_an_alarm_the_reading_is_the_new_state():
    filters, alarms = ZeroFilter(chosen()), []
    for number in range(200):
        filters.predict()
        found = filters.judge(reading(np.full((3, 1), 500.0 if number >= 100 else 0.0)))
        if found.alarm.any():
            alarms.append(number)
    assert len(alarms) == 1
    assert filters.zero[0][:, 0] == pytest.approx([500] * 3, abs=1)


def test_a_zero_that_a_switch_on_allows_is_no_alarm():
    """Of two sigmas of the prior; one of twelve is."""
    c = chosen()
    for size, expected in ((2.0, False), (12.0, True)):
        filters, alarmed = ZeroFilter(c), False
        for _ in range(30):
            filters.predict()
            alarmed |= bool(filters.judge(reading(np.full((3, 1), size * np.sqrt(c.offset)))).alarm.any())
        assert alarmed is expected


def test_noise_that_is_larger_than_stated_is_taken_as_it_is():
    """Twice the variance: z becomes one sigma again as the average follows."""
    filters, rng, z = ZeroFilter(chosen(1e9), 40), np.random.default_rng(11), []
    for _ in range(400):
        filters.predict()
        window = reading(rng.normal(size=(3, 40)) * np.sqrt(2), rng.normal(size=40) * np.sqrt(2))
        z.append(filters.judge(dataclasses.replace(window, scatter=np.full((2, 40), 2.0))).z)
    np.testing.assert_allclose(np.std(z[300:], axis=(0, 2)), 1, atol=5 / np.sqrt(2 * 40 * 100))


@pytest.mark.parametrize(
    ("before", "ratio", "wide"),
    [(1.5, 2.9, 1.5 + 1.4 / 64), (1.5, 3.2, 3.2), (1.5, 0.5, 1.5 - 1 / 64), (0.3, 1.9, 1.0), (0.3, 2.1, 2.1), (0.9, 0.5, 1.0)],
)
def test_a_window_has_the_noise_of_the_last_64_and_its_own_from_twice_that_on(before, ratio, wide):
    c = chosen()
    filters = ZeroFilter(c)
    filters.noise[:] = before
    found = filters.judge(dataclasses.replace(reading(np.zeros((3, 1))), scatter=np.full((2, 1), ratio)))
    own = c.offset + c.attitude, c.accel_offset + c.accel_attitude
    assert found.sigma[:, 0] ** 2 - own == pytest.approx([wide, wide], rel=1e-6)


# The settings


@pytest.mark.parametrize("B_dph", [0.3, 3.0, 30.0])
@pytest.mark.parametrize("K", [0.0, 3e-7])
def test_the_wander_is_nowhere_below_the_figures(B_dph, K):
    drift = lambda t, span: _drift(t, span, None, BiasInstability(B_dph * DEG / 3600, "")) + K**2 * t  # noqa: E731
    c = chosen(wander=drift)
    for t in np.geomspace(WINDOW_S, 86400, 30):
        processes = sum(2 * c.drive[k] / (1 - c.decay[k] ** 2) * (1 - np.exp(-t / TIMES_S[k])) for k in range(PROCESSES))
        model = c.walk * t / WINDOW_S + processes
        figures = float(drift(t, WINDOW_S)[0] / (WHITE**2 / WINDOW_S))
        assert 0.98 * figures < model < 1.35 * figures


@pytest.mark.parametrize("rate_hz", [5.0, 20.0])
def test_a_rate_that_shows_no_rest_is_refused(rate_hz):
    with pytest.raises(CalibrationError, match="samples a second; expected 32 or more"):
        settings(flat(rate_hz=rate_hz), 1e6)


def test_a_false_alarm_every_minute_is_refused():
    with pytest.raises(CalibrationError, match="a false alarm every 60 s"):
        settings(flat(), 60.0)


def rested(c, gravity_of, rests: int, seed: int, length: int = 6) -> list[int]:
    """Numbers of the rests, in random attitudes, in which gravity alarmed; gravity_of: direction (3,) -> normalised length."""
    rng, filters, found = np.random.default_rng(seed), ZeroFilter(c), []
    for number in range(rests):
        along = rng.normal(size=3)
        along /= np.linalg.norm(along)
        filters.new_rest()
        for _ in range(length):
            filters.predict()
            gravity = gravity_of(number, along) + rng.normal(size=1)
            judged = filters.judge(reading(rng.normal(size=(3, 1)), gravity, direction=along))
            assert np.isfinite(filters.gravity_P).all()
            if judged.alarm[3, 0]:
                found.append(number)
    return found


@pytest.mark.parametrize("size_mg", [10.0, 30.0, 200.0])
@pytest.mark.parametrize("form", ["zero", "scale"])
def test_an_accelerometer_that_has_changed_alarms_a_few_times(size_mg, form):
    """A zero or a scale of another size from the tenth rest on: the watch goes on from what it has seen, in every attitude."""
    c = chosen()
    size = size_mg * 1e-3 / c.gravity_sigma
    change = lambda number, along: (number >= 10) * size * (along[0] if form == "zero" else 1.0)  # noqa: E731
    found = rested(c, change, 150, 13)
    assert 10 <= found[0] < 16
    assert len(found) <= 4


def test_after_a_gravity_alarm_a_change_within_a_rest_is_still_found():
    c = chosen()
    filters, rng, alarms = ZeroFilter(c), np.random.default_rng(14), []
    for number in range(300):
        filters.predict()
        gravity = rng.normal(size=1) + 500.0 * (number >= 100) + 10.0 * (number >= 200)
        if filters.judge(reading(rng.normal(size=(3, 1)), gravity)).alarm[3, 0]:
            alarms.append(number)
    assert [number // 100 for number in alarms] == [1, 2]


# What a model and what lies beside it give


def test_the_figures_that_nobody_measured_are_the_usual_ones():
    """Zero of the accelerometer 2 mg, zero's change 0.01 dps/K, the Earth across the vertical, of each of two components."""
    found = expect(known(), RATE_HZ)
    np.testing.assert_allclose(found.accel_offset, 2e-3 * G, rtol=0.01)
    np.testing.assert_allclose(found.per_k / DEG, 0.01, rtol=0.01)
    np.testing.assert_allclose(found.attitude, np.hypot(7.292115e-5 / np.sqrt(3), 0.002 * DEG), rtol=1e-6)
    assert "change of the zero with temperature" in found.assumed
    assert "temperature of the calibration" in found.assumed


def test_the_earth_across_the_vertical_is_that_of_the_latitude(tmp_path):
    model = tmp_path / "fit" / "model.json"
    model.parent.mkdir()
    model_file(model)
    sensor = "[sensor]\nodr_hz = 100.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n"
    toml = f'schema = "tinygc-session/1"\n{sensor}[site]\nlatitude_deg = 60.0\ngravity_mps2 = 9.81\n'
    (tmp_path / "session.toml").write_text(toml)
    found = expect(ModelInUse.read(model), RATE_HZ)
    np.testing.assert_allclose(found.attitude, np.hypot(7.292115e-5 * 0.5 / np.sqrt(2), 0.002 * DEG), rtol=1e-6)
    assert found.earth_rps == pytest.approx(7.292115e-5 * np.sqrt(0.75), rel=1e-6)


def test_the_temperature_of_the_calibration_is_that_of_the_models_file(tmp_path):
    path = model_file(tmp_path / "model.json")
    table = json.loads(path.read_text())
    path.write_text(json.dumps(table | {"temperature_c": 31.5}))
    used = ModelInUse.read(path)
    found = expect(used, RATE_HZ)
    assert found.reference_c == 31.5
    assert "temperature of the calibration" not in found.assumed
    assert settings(found, 1e6, 45.0).reference_c == 31.5  # not that of the stream
    for wrong in ("warm", True, 1e9, [1.0]):
        path.write_text(json.dumps(table | {"temperature_c": wrong}))
        with pytest.raises(FormatError, match=r"temperature_c is .*, expected a number"):
            ModelInUse.read(path)
