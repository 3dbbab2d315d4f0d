"""The watch's bars, filters, changes and turns: against closed forms, the textbook's filter, finite differences and direct integration."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import socket
import sys
from types import SimpleNamespace

import numpy as np
import processes
import pytest
from conftest import DEG
from numpy.testing import assert_allclose
from scipy.special import ndtr
from scipy.stats import chi2
from watched import ACCEL_WHITE, COVARIANCE, RATE_HZ, WHITE, G, csv, model_file, samples

from session.base import rotation
from session.base.errors import CalibrationError, DataError, FormatError
from session.detect.accelerometer import BIASES
from tinygc.closure.floor import BiasInstability
from tinygc.deploy.apply import Applicable
from tinygc.deploy.calibration import Surroundings
from tinygc.estimation.spread import ZERO
from tinygc.features.unit.watch import source
from tinygc.features.unit.watch.alarms import AlarmCommand, JsonLines
from tinygc.features.unit.watch.bars import bar_of, run_length, squares_run_length
from tinygc.features.unit.watch.detector import PROCESSES, Detector, Window, WindowResult, ZeroFilter, _response, change_of
from tinygc.features.unit.watch.expectation import (
    BLOCKS,
    CLIP,
    SHIFTS,
    TIMES_S,
    AtRest,
    Expectation,
    _drift,
    expect,
    settings,
)
from tinygc.features.unit.watch.source import RESTART, Remark, SourceOptions, _decoded
from tinygc.features.unit.watch.turns import Turn, TurnTest
from tinygc.fitting.unit_state import read_state, spread_of
from tinygc.models.linear import BIAS, LinearModel
from tinygc.models.model import KnownSensor


def flat(**other):
    """Figures without wander."""
    none = np.zeros(3)
    given = {
        "rate_hz": RATE_HZ,
        "white": np.full(3, WHITE),
        "wander": lambda t, span: none,
        "offset": np.full(3, 0.14 * DEG),
        "attitude": np.full(3, 0.001 * DEG),
        "per_k": np.full(3, 0.01 * DEG),
        "reference_c": None,
        "earth_rps": 0.0,
        "gravity_mps2": G,
        "accel_white": np.full(3, ACCEL_WHITE),
        "accel_wander": lambda t, span: none,
        "accel_offset": np.full(3, 0.02),
        "accel_attitude": 1e-3,
        "accel_per_k": 1e-3,
        "parameters": COVARIANCE,
    }
    given |= other
    gyro, accel = (AtRest(*(given.pop(of + key) for key in ("white", "wander", "offset", "attitude", "per_k"))) for of in ("", "accel_"))
    return Expectation(gyro=gyro, accel=accel, **given)


def chosen(every_windows=1e6, **other):
    """The detector's numbers of ``flat``."""
    return settings(flat(**other), every_windows * 1.92)


def reading(rate, gravity=0.0, warmer=0.0, direction=(0.0, 0.0, -1.0)):
    """A window of normalised rates (3, S)."""
    copies = rate.shape[1]
    along, whole = np.repeat(np.array(direction)[:, None], copies, axis=1), np.ones(copies)
    return Window(rate, gravity * whole, along, warmer * whole, np.ones((2, copies)))


# Bars


def siegmund(shift, bar):
    """Siegmund's closed form (1985, 2.56), L(0) ~ (exp(2 k b) - 2 k b - 1) / (2 k^2) with k = shift / 2 and b = bar / shift + 1.166."""
    b = bar / shift + 1.166
    return float((np.exp(shift * b) - shift * b - 1) / (shift**2 / 2))


@pytest.mark.parametrize("shift", SHIFTS)
def test_run_lengths_have_their_limits(shift):
    """Without a bar the first z beyond half the shift alarms; else it is exp(bar) at least (Lorden), and for small shifts Siegmund's."""
    assert run_length(shift, 1e-9) == pytest.approx(1 / ndtr(-shift / 2), rel=1e-6)
    for length in (1e2, 1e8):
        assert 0 < bar_of(run_length, length, shift) <= np.log(length)
        assert run_length(shift, bar_of(run_length, length, shift)) == pytest.approx(length, rel=1e-4)
        assert shift > 1 or siegmund(shift, bar_of(run_length, length**10, shift)) == pytest.approx(length**10, rel=0.03)


def test_run_lengths_of_squares_have_their_limits():
    assert squares_run_length(2.0, 2, 1e-9) == pytest.approx(1 / chi2.sf(2 * np.log(2.0) / 0.375, 2), rel=1e-6, abs=0)
    low, high, far = (bar_of(squares_run_length, length, 2.0, 2) for length in (1e8, 1e10, 1e100))
    assert (high - low, far - low) == pytest.approx((np.log(1e2), np.log(1e92)), abs=0.01)


# What is a rest


WINDOW_S = 1.92


def windows(detector, *parts):
    """WindowResult windows of readings."""
    return [result for part in parts for _, result in detector.feed(part.gyro, part.accel, part.temp) if result is not None]


NO_SENSOR = Surroundings(KnownSensor(), None, "none", "")


def test_a_rest_gives_its_zero_and_gravity():
    """The Earth's rate is taken off along gravity: level, z down, it turns about -z."""
    zero, earth = np.array([0.05, -0.02, 0.01]), 7.292115e-5 * np.sin(50 * DEG)
    detector = Detector(chosen(earth_rps=earth))
    part = samples(60, 1, zero - [0, 0, earth / DEG])
    exact = dataclasses.replace(part, gyro=np.tile(zero * DEG - [0, 0, earth], (6000, 1)), accel=np.tile([0.0, 0, -G], (6000, 1)))
    for window in (result.window for result in windows(Detector(detector.chosen), exact)):
        assert_allclose(window.rate[:, 0] * detector.chosen.rate_sigma_rps, zero * DEG, rtol=1e-9)
        assert_allclose(window.direction[:, 0], [0, 0, -1], atol=1e-12)
    found = [result.window for result in windows(detector, part)]
    assert len(found) == (60 / 0.12 - 2) // BLOCKS  # but the first block, and the one that shows the end
    of_one = np.std([[*window.rate[:, 0], window.gravity[0]] for window in found], axis=0)
    assert_allclose(of_one, 1, atol=4 / np.sqrt(2 * len(found)))
    other = np.where(np.arange(BLOCKS) % 2, 1.0, -1.0)[:, None] * np.sqrt((BLOCKS - 1) / BLOCKS)  # of variance 1
    c, down = detector.chosen, [0, 0, 0, 0, 0, -G, 0]
    shares = np.array([0.2, 0.3, 0.4, 0.1, 0.5, 0.6, 0.7])
    blocks = down + other * np.sqrt(shares * np.repeat([*c.scatter, 1.0], [3, 3, 1]))
    assert Detector(c)._complete(blocks).window.scatter.ravel() == pytest.approx([0.9, 1.2])


@pytest.mark.parametrize("spoil", ["a NaN", "an infinity", "it turns slowly"])
def test_what_is_no_rest_gives_nothing(spoil):
    part = samples(20, 2)
    if spoil == "it turns slowly":
        part.accel[:, 0] += np.linspace(0, 0.5, len(part.accel))
    elif spoil == "a NaN":
        part.gyro[50::100] = np.nan
    else:
        part.accel[50::100] = np.inf
    assert windows(Detector(chosen()), part) == []


@pytest.mark.parametrize(("share", "quiet"), [(0.999, True), (1.001, False)])
def test_the_bars_of_a_quiet_block(share, quiet):
    """A mean of 10 °/s, gravity by a quarter more or less, and the variances (of n - 1) that the settings have."""
    c = chosen()
    n, still, none = c.samples, np.tile([0.48 * G, 0.6 * G, -0.64 * G], (c.samples, 1)), np.zeros((c.samples, 3))
    other = np.where(np.arange(n) % 2, 1.0, -1.0)[:, None] * np.sqrt((n - 1) / n)  # of variance 1
    for rate, force in (
        (np.add(none, [0, -share * 10 * DEG, 0]), still),
        (none, still * (1 + 0.25 * share)),
        (none, still * (1 - 0.25 * share)),
        (other * np.sqrt(share * c.limit[0] / 2) * [1, 1, 0], still),
        (none, still + other * np.sqrt(share * c.limit[1] / 2) * [0, 1, 1]),
    ):
        ((found, *_),) = Detector(c).feed(rate, force)
        assert found == quiet


def test_a_gap_ends_a_rest_and_lets_time_pass():
    detector, rest = Detector(settings(flat(wander=lambda t, span: np.full(3, 1e-10 * t)), 1e6)), samples(30, 5)
    list(detector.feed(rest.gyro, rest.accel))
    before = detector.filter.rate.P[0, 0, 0]
    detector.gap(round(3600 * RATE_HZ))
    grown = (detector.filter.rate.P[0, 0, 0] - before) * detector.chosen.rate_sigma_rps[0] ** 2
    assert grown == pytest.approx(1e-10 * 3600, rel=0.01)
    assert windows(detector, samples(2, 6)) == []


# The filters


def textbook(decay, drive, P, H, values, anew):
    """z and the covariance of one channel by the textbook's filter; anew: states that begin anew with windows 100 and 200."""
    x, found = np.zeros(len(P)), []
    for number, (h, value) in enumerate(zip(H, values, strict=True)):
        x, P = decay * x, decay[:, None] * P * decay + np.diag(drive)
        for state, variance in anew.items() if number in (100, 200) else ():
            x[state] = P[state] = P[:, state] = 0
            P[state, state] = variance
        S = h @ P @ h + 1
        found.append((value - h @ x) / np.sqrt(S))
        gain = P @ h / S
        x, P = x + gain * (value - h @ x), P - np.outer(gain, gain) * S
    return np.array(found), P


def test_the_filters_are_the_textbooks():
    """Of an axis and of gravity, with wander, temperature, and another attitude every hundred windows."""
    wander = lambda t, span: np.full(3, _drift(t, span, None, BiasInstability(2 * DEG / 3600, ""))[0] + 1e-12 * t)  # noqa: E731
    of_gravity = lambda t, span: np.full(3, 1e-8 * t + 1e-6 * (1 - np.exp(-t / 100)))  # noqa: E731
    c = chosen(1e9, wander=wander, accel_wander=of_gravity)
    of, g = dataclasses.replace(c.rate, per_k=100.0), dataclasses.replace(c.gravity, per_k=50.0)
    c = dataclasses.replace(c, rate=of, gravity=g)
    rng, filters, z = np.random.default_rng(1), ZeroFilter(c), []
    rates, gravity, warmer = 20 + rng.normal(size=300), rng.normal(size=300), np.linspace(0, 3, 300)
    along = np.repeat(rng.normal(size=(3, 3)), 100, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    for k in range(300):
        filters.predict()
        if k in (100, 200):
            filters.new_rest()
        z.append(filters.evaluate(reading(np.full((3, 1), rates[k]), gravity[k], warmer[k], along[k])).z[[0, 3], 0])
    n, one = PROCESSES, np.ones((300, PROCESSES + 1))
    P = np.diag([of.offset, *np.zeros(n), of.attitude, of.per_k])
    H, decay, drive = np.column_stack([one[:, 0], one, warmer]), np.r_[1.0, c.decay, 1.0, 1.0], [of.walk, *of.drive, 0, 0]
    of_rate, P = textbook(decay, drive, P, H, rates, {n + 1: of.attitude})
    Pg = np.diag([*[g.offset] * 3, *np.zeros(n), g.attitude, g.per_k])
    H, drive = np.column_stack([along, one, warmer]), [*[g.walk] * 3, *g.drive, 0, 0]
    of_force, Pg = textbook(np.r_[1.0, 1.0, decay], drive, Pg, H, gravity, {n + 3: g.attitude, n + 4: g.per_k})
    assert_allclose(z, np.column_stack([of_rate, of_force]), atol=1e-9)
    assert_allclose(filters.rate.P[..., 0], P, atol=1e-9 * P.max())
    assert_allclose(filters.gravity.P[..., 0], Pg, atol=1e-9 * Pg.max())


def test_it_runs_as_long_as_stated_to_a_false_alarm():
    """100 windows of white innovations are asked for: no less, and no more than twice that; some 1000 alarms know it to 3 %."""
    filters, rng, alarms = ZeroFilter(chosen(100), 800), np.random.default_rng(8), 0
    for _ in range(150):
        alarm, _ = filters._test(rng.normal(size=(4, 800)))
        filters.cusum[:, :, :, (alarm != 0).any(axis=0)] = 0
        alarms += np.count_nonzero((alarm != 0).any(axis=0))
    assert 100 < 150 * 800 / alarms < 200


@pytest.mark.parametrize(("size", "z"), [(5.0, None), (1e6, CLIP)])
def test_one_window_alone_never_alarms(size, z):
    """However far off: it counts as CLIP sigmas, and changes nothing."""
    filters = ZeroFilter(chosen())
    for number in range(60):
        filters.predict()
        before, gravity = filters.rate.x.copy(), filters.gravity.x.copy()
        off = size if number == 30 else 0.0
        found = filters.evaluate(reading(np.full((3, 1), off), off))
        assert not found.alarm.any()
        if z is not None and number == 30:
            assert ((found.z == z).all(), (filters.rate.x == before).all(), (filters.gravity.x == gravity).all()) == (True, True, True)


@pytest.mark.parametrize(("rate", "gravity", "alarm"), [(500.0, 0.0, [1, 1, 1, 0]), (0.0, -500.0, [0, 0, 0, -1])])
def test_after_an_alarm_the_reading_is_the_new_state(rate, gravity, alarm):
    filters, alarms = ZeroFilter(chosen()), []
    for number in range(200):
        filters.predict()
        found = filters.evaluate(reading(np.full((3, 1), rate * (number >= 100)), gravity * (number >= 100)))
        if found.alarm.any():
            alarms.append(found.alarm[:, 0].tolist())
            number_of_test = found.shift[np.nonzero(alarm), 0].ravel()
    assert alarms == [alarm]
    # The test that as few windows as any of CLIP sigmas take to its bar
    count = np.ceil(filters.chosen.bar / (SHIFTS * CLIP - SHIFTS**2 / 2))
    assert number_of_test.tolist() == [np.argmin(count.ravel())] * np.count_nonzero(alarm)
    assert np.abs(found.whole).max() < 0.1
    assert filters.rate.total(-1)[0][:, 0] == pytest.approx([rate] * 3, abs=1)


def test_an_alarm_opens_the_new_state_by_the_variance_of_the_reading():
    """Of every test at its bar: the innovation is the state's, and gravity may differ as much in any other attitude."""
    filters = ZeroFilter(chosen())
    filters.predict()
    filters.cusum[:] = 100.0
    before, of_gravity = filters.rate.P.copy(), filters.gravity.P.copy()
    found = filters.evaluate(reading(np.full((3, 1), 2.0), -50.0))
    assert found.alarm.all()
    assert filters.rate.x[0, :, 0] == pytest.approx([2.0] * 3)
    assert (filters.rate.P[0, 0] - before[0, 0]) == pytest.approx(found.sigma[0] ** 2)
    assert filters.gravity.P[-2, -2] - of_gravity[-2, -2] == pytest.approx(found.sigma[1] ** 2)
    assert filters.gravity.own == pytest.approx(50.0**2)


@pytest.mark.parametrize(
    ("before", "ratio", "wide"),
    [(1.5, 2.9, 1.5 + 1.4 / 64), (1.5, 3.2, 3.2), (1.5, 0.5, 1.5 - 1 / 64), (0.3, 1.9, 1.0), (0.3, 2.1, 2.1), (0.9, 0.5, 1.0)],
)
def test_a_window_has_the_noise_of_the_last_64_and_its_own_from_twice_that_on(before, ratio, wide):
    c = chosen()
    filters = ZeroFilter(c)
    filters.noise[:] = before
    found = filters.evaluate(dataclasses.replace(reading(np.zeros((3, 1))), scatter=np.full((2, 1), ratio)))
    own = c.rate.offset + c.rate.attitude, c.gravity.offset + c.gravity.attitude
    assert found.sigma[:, 0] ** 2 - own == pytest.approx([wide, wide], rel=1e-6)


# The settings and what lies beside a model


@pytest.mark.parametrize(("B_dph", "K"), [(0.3, 3e-7), (30.0, 0.0)])
def test_the_wander_is_nowhere_below_the_figures(B_dph, K):
    drift = lambda t, span: _drift(t, span, None, BiasInstability(B_dph * DEG / 3600, "")) + K**2 * t  # noqa: E731
    c = chosen(wander=drift)
    for t in np.geomspace(WINDOW_S, 86400, 30):
        processes = sum(2 * c.rate.drive[k] / (1 - c.decay[k] ** 2) * (1 - np.exp(-t / TIMES_S[k])) for k in range(PROCESSES))
        figures = float(drift(t, WINDOW_S)[0] / (WHITE**2 / WINDOW_S))
        assert 0.98 * figures < c.rate.walk * t / WINDOW_S + processes < 1.35 * figures


@pytest.mark.parametrize(
    ("rate_hz", "every_s", "says"), [(20.0, 1e6, "samples a second; expected 32 or more"), (RATE_HZ, 60.0, "a false alarm every 60 s")]
)
def test_what_no_detector_can_do_is_refused(rate_hz, every_s, says):
    with pytest.raises(CalibrationError, match=says):
        settings(flat(rate_hz=rate_hz), every_s)


def test_the_earth_across_the_vertical_is_that_of_the_latitude(tmp_path):
    model = tmp_path / "fit" / "model.json"
    model.parent.mkdir()
    model_file(model)
    sensor = "[sensor]\nodr_hz = 100.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n"
    toml = f'schema = "tinygc-session/1"\n{sensor}[site]\nlatitude_deg = 60.0\ngravity_mps2 = 9.81\n'
    (tmp_path / "session.toml").write_text(toml)
    found = expect(read_state(model), RATE_HZ)
    assert_allclose(found.gyro.attitude, np.hypot(7.292115e-5 * 0.5 / np.sqrt(2), 0.002 * DEG), rtol=1e-6)
    assert found.earth_rps == pytest.approx(7.292115e-5 * np.sqrt(0.75), rel=1e-6)


def test_a_stream_may_differ_from_the_calibration_by_two_draws_of_each_zero(tmp_path):
    """That of the calibration and today's; the covariance of B is beside them."""
    model_file(path := tmp_path / "model.json")
    known = read_state(path)
    spread, found = spread_of(known.config, known.table), expect(known, RATE_HZ)
    assert_allclose(found.accel.offset, np.sqrt(2) * spread.sigma[BIASES])
    own = np.diag(known.covariance)[BIAS]
    assert_allclose(found.gyro.offset**2, 2 * spread.sigma[ZERO] ** 2 + own)


def test_the_temperature_of_the_calibration_is_that_of_the_models_file(tmp_path):
    path = model_file(tmp_path / "model.json")
    table = json.loads(path.read_text())
    path.write_text(json.dumps(table | {"temperature_c": 31.5}))
    found = expect(read_state(path), RATE_HZ)
    assert (found.reference_c, "temperature of the calibration" in found.assumed) == (31.5, False)
    assert settings(found, 1e6, 45.0).reference_c == 31.5  # not that of the stream
    for wrong in ("warm", True, 1e9):
        path.write_text(json.dumps(table | {"temperature_c": wrong}))
        with pytest.raises(FormatError, match=r"temperature_c is .*, expected a number"):
            read_state(path)


# What an alarm is called


COUNT, BEGAN = 40, 25


def records(mean, sigma=1.0):
    """Windows 2 s apart with these innovations of gravity, in sigmas."""
    none = np.zeros((5, 1))
    window, one = reading(np.zeros((3, 1))), np.array([[1.0], [sigma]])
    return [(2.0 * i, WindowResult(window, np.array([[0.0], [0.0], [0.0], [z]]), one, none, none, none, none)) for i, z in enumerate(mean)]


def forms_of(count, ramp, places=200):
    """(K, N) of a change of size one now that begins at any of so many places of each window."""
    since = np.arange(count) - np.arange(0, count - 1e-9, 1 / places)[:, None]
    return np.maximum(since, 0) / np.maximum(since[:, -1:], 1e-9) if ramp else np.clip(since + 1, 0, 1)


def gains(z):
    """Log likelihood ratios (K,) of a step and of a ramp from each moment on, against none."""
    step, ramp = (
        (forms @ z) ** 2 / 2 / np.maximum(np.sum(forms**2, axis=1), 1e-12) for forms in (forms_of(len(z), ramp) for ramp in (False, True))
    )
    return step, ramp


def shape(name):
    after = np.maximum(np.arange(COUNT) - BEGAN, -1.0)
    return np.where(after >= 0, 1.0 if name == "step" else after, 0.0)


@pytest.mark.parametrize("name", ["step", "ramp"])
def test_a_form_is_said_where_it_is_twenty_times_likelier(name):
    step, ramp = gains(shape(name))
    apart = abs(step.max() - ramp.max())
    for odds, said in ((19.0, "step or ramp"), (21.0, name)):
        z = shape(name) * np.sqrt(np.log(odds) / apart)
        assert change_of(records(z), 3, COUNT - 1 - BEGAN, chosen()).kind == said


def integrated(z, forms, best):
    """Mean and sigma of the size now, by direct integration over sizes, moments and forms (a ramp or none), with a normal prior of the
    size, three times the best one wide."""
    size = np.linspace(-12, 12, 1201) * best
    form = np.concatenate([forms_of(len(z), ramp, 20) for ramp in forms])
    misfit = z @ z - 2 * np.outer(form @ z, size) + np.outer(np.sum(form**2, axis=1), size**2)
    density = np.exp(-misfit / 2 - (size / best / 3) ** 2 / 2).sum(axis=0)
    mean = np.sum(density * size) / density.sum()
    return float(mean), float(np.sqrt(np.sum(density * (size - mean) ** 2) / density.sum()))


@pytest.mark.parametrize(
    ("name", "sigmas", "kind", "forms"),
    [("step", 12.0, "step", (False,)), ("ramp", 12.0, "ramp", (True,)), ("ramp", 4.5, "step or ramp", (False, True))],
)
def test_a_size_is_the_mean_over_its_moments_and_over_forms_that_are_not_told_apart(name, sigmas, kind, forms):
    z = sigmas * shape(name) / np.linalg.norm(shape(name)) + 0.3 * np.random.default_rng(2).normal(size=COUNT)
    found = change_of(records(z), 3, COUNT - 1 - BEGAN, chosen())
    assert found.kind == kind
    step, ramp = gains(z)
    form = forms_of(COUNT, bool(ramp.max() > step.max()))[np.argmax(max(step, ramp, key=np.max))]
    best = abs(z @ form / (form @ form))
    assert (found.size, found.sigma) == pytest.approx(integrated(z, forms, best), rel=1e-3)


def test_a_step_within_a_window_has_the_size_of_the_windows_after_it():
    """A strong one: its own window tells the place alone, whatever the size."""
    z = np.r_[np.zeros(25), 0.58 * 50, np.full(14, 50.0)] + 0.3 * np.random.default_rng(2).normal(size=COUNT)
    found = change_of(records(z), 3, COUNT - 1 - BEGAN, chosen())
    assert (found.size, found.sigma) == (pytest.approx(z[26:].mean(), rel=1e-4), pytest.approx(1 / np.sqrt(14), rel=1e-3))


@pytest.mark.parametrize("ramp", [False, True])
def test_the_response_is_what_the_filter_makes_of_a_change(ramp):
    """Of one unit, or one a second, from the 20th window on, with wander and temperature; the 25th window is not followed.  A second
    stream beside it has another rate, noise and temperature."""
    c = chosen(1e9)
    c = dataclasses.replace(c, rate=dataclasses.replace(c.rate, walk=0.01, drive=np.array([0.2, 0.05]), per_k=1.0))
    filters, rows = ZeroFilter(c, 2), []
    for number in range(COUNT):
        value = max(number - 20, -1) * 2e-3 if ramp else 1e-3  # so small that nothing clips
        filters.predict()
        before = filters.rate.x, filters.rate.P
        window = reading(np.outer([value * (number >= 20), 0.0, 0.0], [1, 2]), warmer=np.sin(number) * np.array([1, 2]))
        result = filters.evaluate(dataclasses.replace(window, scatter=np.array([[1.0, 3.0], [1.0, 3.0]])))
        if number == 25:
            filters.rate.x, filters.rate.P = before
            result = dataclasses.replace(result, taken=np.array([False, True]))
        rows.append((2.0 * number, result))
    found = _response(rows, np.array([20]), ramp, 0, c)[:, 0]
    assert found == pytest.approx(1e3 * np.array([each.whole[0, 0] for _, each in rows]), rel=1e-9, abs=1e-9)


def test_a_change_is_looked_for_30_windows_before_the_tests_own_beginning():
    for began in (48, 49):
        found = change_of(records(np.where(np.arange(100) >= began, 5.0, 0.0)), 3, 20, chosen())
        assert (found.kind, found.began_s, found.earlier) == ("step", 2.0 * 48, False)
    # It may be earlier than what is remembered.
    found = change_of(records(np.full(COUNT, 5.0)), 3, COUNT - 1, chosen())
    assert (found.began_s, found.earlier) == (0.0, True)
    assert change_of(records(np.zeros(COUNT)), 3, 10, chosen()).size == 0.0
    # A window whose mean has a quarter of the step: it came after three quarters of it.
    assert change_of(records(np.r_[np.zeros(60), 1.25, np.full(39, 5.0)]), 3, 40, chosen()).began_s == pytest.approx(2.0 * 59.75)


# Turns


def test_a_turn_is_the_product_of_its_steps():
    rng, turn = np.random.default_rng(1), Turn()
    omega, dt = rng.normal(size=(200, 3)), np.full(200, 0.01)
    for part in (slice(0, 1), slice(1, 77), slice(77, 200)):
        turn.add(omega[part], omega[part], dt[part])
    expected = rotation.compose(rotation.steps(omega[None], dt[None, 1:]))[0]
    assert_allclose(np.abs(turn.q @ expected), 1, atol=1e-12)
    assert turn.seconds == pytest.approx(1.99)


def test_its_slope_is_that_of_the_attitude():
    """Against finite differences of each element of E, and of a zero."""
    measured, dt = 2 * np.sin(np.arange(400)[:, None] / [50, 70, 90] + [0, 1, 2]), np.full(400, 0.0025)

    def end(vector):
        turn = Turn()
        turn.add(LinearModel.from_vector(vector)(measured), measured, dt)
        return turn

    ideal, step = np.r_[np.eye(3).ravel(), np.zeros(3)], 1e-6
    base = end(ideal)
    for k, slope in enumerate(np.hstack([base.slope, base.lever]).T):
        moved = rotation.multiply(end(ideal + step * np.eye(12)[k]).q, rotation.conjugate(base.q))
        assert_allclose(rotation.log(moved) / step, slope, atol=0.01 * np.abs(base.slope).max())


@pytest.mark.parametrize("variance", [0.0, 1e-8])
def test_a_turn_states_the_sum_of_its_errors(variance):
    """Without E and a zero of the accelerometer: readings of both rests, white noise, the turn's own, the Earth, the lever of the zero."""
    expected = flat(
        parameters=np.zeros((12, 12)), white=np.array([2e-4, 1e-4, 3e-4]), attitude=np.full(3, 4e-5), turn_rad=5e-4,
        accel_white=np.array([1e-3, 2e-3, 1e-3]), accel_attitude=3e-3, accel_offset=np.zeros(3),
    )  # fmt: skip
    turn, down = Turn(), np.array([0.0, 0.0, -1.0])
    turn.add(np.tile([0.0, 0.0, 0.5], (401, 1)), np.zeros((401, 3)), np.full(401, 0.01))  # 4 s about the vertical, E without a slope
    own = (3e-4**2) * 4.0 + (4e-5 * 4.0) ** 2 + 5e-4**2 + 2 * (3e-3**2 + 2e-3**2 / 2.0) / G**2
    lever2 = (2 * np.sin(0.5 * 4.0 / 2) / 0.5) ** 2  # s^2: |integral of a vector that turns with 0.5 rad/s|
    sigma_rad = TurnTest(expected, 1e6).evaluate(turn, down, down, variance, 2.0).sigma_rad
    assert sigma_rad == pytest.approx(np.sqrt(own + variance * lever2), rel=1e-4)


@pytest.mark.parametrize("alarm", [False, True])
def test_a_turn_is_taken_by_the_textbooks_filter_and_an_alarm_opens_it(alarm):
    """By as much as the turn's square is of what the prior makes of it; a quarter turn about x, with z down before it."""
    none, prior = np.zeros(3), np.diag([1e-4**2 + 2e-4**2] * 9 + [0.02**2] * 3)
    test, turn = TurnTest(flat(white=none, attitude=none, turn_rad=5e-4, accel_white=none, accel_attitude=0.0), 1e6), Turn()
    assert pytest.approx(prior) == test.P
    turn.add(*[np.tile([np.pi / 2, 0, 0], (101, 1))] * 2, np.full(101, 0.01))
    R, down, tilt = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0, 0, -1.0]), np.array([0.0, 2.5e-3, 0])
    test.sum = test.bar * alarm
    _, sigma_rad, found, alarmed = test.evaluate(turn, down, R.T @ (down + np.cross(tilt, down)), 0.0, 2.0)
    y, H = tilt[:2] / np.hypot(1, 2.5e-3), np.zeros((2, 12))
    H[:, :9] = turn.slope[:2]
    H[:, 9:] = np.array([[0.0, 1, 0], [-1, 0, 0]]) @ (R - np.eye(3)) / G  # down x v
    share = alarm * (y @ y) / np.trace(H[:, :9] @ prior[:9, :9] @ H[:, :9].T)

    def scatter(P):
        return H @ P @ H.T + (5e-4**2 + np.trace(turn.slope @ P[:9, :9] @ turn.slope.T) ** 2) * np.eye(2)

    square = y @ np.linalg.solve(scatter(prior), y)
    assert (found, alarmed) == (pytest.approx(square, rel=1e-4), alarm)
    assert sigma_rad == pytest.approx(np.sqrt(np.trace(scatter(prior)) / 2), rel=1e-6)
    assert test.sum == pytest.approx(0.0 if alarm else max(0.0, 0.375 * square - 2 * np.log(2)), rel=1e-4)
    P = (1 + share) * prior
    gain = P @ H.T @ np.linalg.inv(scatter(P))
    assert test.x == pytest.approx(gain @ y, rel=1e-3, abs=1e-9)
    assert pytest.approx(P - gain @ H @ P, rel=1e-6, abs=1e-15) == test.P


# What comes in, and where lines go


def test_damage_and_restarts_of_a_stream_are_items():
    """Lines that a board sends, with what went wrong between."""
    lines = csv(samples(4, 1)).splitlines(keepends=True)
    lines[200:200] = ["what is this\n"] * 3
    again = csv(samples(2, 2)).splitlines(keepends=True)[1:]  # its clock begins again
    decoded = lambda *parts: list(_decoded(iter(parts), SourceOptions(), NO_SENSOR, "a test"))  # noqa: E731
    found = decoded("".join(lines).encode(), b"", "".join(again).encode())
    assert sum(len(item.t_ns) for item in found if isinstance(item, Applicable)) >= 598
    kinds = [item.kind for item in found if isinstance(item, Remark)]
    assert "garbage" in set(kinds) <= {"garbage", "lost", RESTART}
    assert (kinds.count(RESTART), found.count(None)) == (1, 1)
    with pytest.raises(DataError, match="no sample in what came"):
        decoded(b"hello\n" * 100)


class Datagrams:
    """Items of a watched UDP port, and senders of loopback's addresses, each with a port of its own."""

    def __init__(self, monkeypatch):
        monkeypatch.setattr(source, "SILENT_S", 0.3)
        monkeypatch.setattr(source, "IDLE_S", 0.05)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = probe.getsockname()[1]
        self.name = f"udp:127.0.0.1:{self._port}"
        self.items = source.items_of(self.name, SourceOptions(), NO_SENSOR)
        assert next(self.items) is None  # it listens

    def send(self, address, seed, start_s=0.0):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.bind((address, 0))
            sender.sendto(csv(samples(1, seed, start_s=start_s)).encode(), ("127.0.0.1", self._port))

    def until_idle(self):
        return list(itertools.takewhile(lambda item: item is not None, self.items))


@pytest.mark.skipif(sys.platform != "linux", reason="other addresses of loopback")
def test_a_sender_of_datagrams_is_an_address_and_behind_its_silence_another_one(monkeypatch):
    """A board that starts anew sends from another port; what others send meanwhile is counted."""
    udp = Datagrams(monkeypatch)
    udp.send("127.0.0.1", 1)
    udp.send("127.0.0.2", 2)
    udp.send("127.0.0.1", 3, start_s=1.0)  # from another port
    udp.send("127.0.0.1", 4)  # and with a clock that begins again
    first = udp.until_idle()
    said = [item.words for item in first if isinstance(item, Remark) and item.kind == "stranger"]
    assert said == [f"{udp.name}: datagrams came from another sender than 127.0.0.1: left out"]
    assert sum(isinstance(item, Remark) and item.kind == RESTART for item in first) == 1
    assert sum(len(item.t_ns) for item in first if isinstance(item, Applicable)) >= 295

    def is_followed():
        udp.send("127.0.0.2", 5)
        return any(isinstance(item, Remark) and "127.0.0.2 is followed" in item.words for item in udp.until_idle())

    processes.until(is_followed)
    udp.send("127.0.0.2", 6, start_s=1.0)
    assert [type(item) for item in udp.until_idle()] == [Applicable]
    udp.send("127.0.0.1", 7)
    assert [item.kind for item in udp.until_idle()] == ["stranger"]


@pytest.mark.skipif(os.name != "posix", reason="programs of POSIX")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["/no/such/program"], "cannot be run"),
        ([sys.executable, "-c", "raise SystemExit(7)"], "ended with code 7"),
        ([sys.executable, "-c", "import time; time.sleep(1000)"], "did not end within 0.1 s"),
    ],
)
def test_a_command_that_fails_or_hangs_is_said(words, expected):
    said: list[str] = []
    at_alarm = AlarmCommand(words, said.append, most_s=0.1 if "sleep" in words[-1] else 30.0)
    at_alarm("{}")
    at_alarm.wait()
    (line,) = said
    assert expected in line
    assert "the watch goes on" in line


def test_a_full_disk_loses_nothing(tmp_path):
    """A file that takes thirty bytes, and then all."""
    said: list[str] = []
    lines = JsonLines(tmp_path / "out.jsonl", said.append)
    file, room = lines._file, [30]

    def write(data):
        fits = data[: room[0]]
        room[0] -= len(fits)
        return file.write(fits) if fits else 0

    lines._file = SimpleNamespace(write=write, **{name: getattr(file, name) for name in ("flush", "fileno", "close")})
    for k in range(5):
        lines.write({"k": k})
    lines.end()
    assert [json.loads(line)["k"] for line in (tmp_path / "out.jsonl").read_text().splitlines()] == list(range(5))
    assert ["its lines are kept" in said[0], "0 lines were lost" in said[1], len(said)] == [True, True, 2]
