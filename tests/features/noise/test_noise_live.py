"""How long a rest is enough, while it is recorded: when estimates run, what they say, and that no failure of theirs ends a recording."""

import threading
from itertools import pairwise

import numpy as np
import pytest
from conftest import DEG
from noise_records import axis_of, figures_of
from processes import until

from session.base.errors import DataError
from session.bench.rest_guide import RestAnswer
from session.log.samples import Samples
from tinygc.features.noise import live
from tinygc.features.noise.estimate import NoiseEstimate
from tinygc.features.noise.live import LiveNoise, answer_of
from tinygc.noise.figures import SensorNoise

DPH, G = DEG / 3600, 9.80665
N, B, K = DEG / 60, DPH, DPH / 60


def samples(seconds, start_s=0.0, rate_hz=50.0):
    t_ns = np.rint((start_s + np.arange(round(seconds * rate_hz)) / rate_hz) * 1e9).astype(np.int64)
    return Samples(t_ns, np.zeros((len(t_ns), 3)), np.zeros((len(t_ns), 3)), None)


class Sums:
    """Stand for the statistics of a log."""

    def __init__(self, rate_hz):
        self.rate_hz, self.count = rate_hz, 0

    def add(self, samples):
        self.count += len(samples)


def sensor(axis, *others):
    return SensorNoise((axis, *(others or (axis, axis))))


KNOWN = figures_of(sensor(axis_of(N=(0.3 * N, 0.003 * N), B=(3 * B, 0.3 * B), limits={"K": K})))


def after(figures, kind, axis, name, relative):
    return {"N": 600.0, "B": 11_160.0, "K": 40_000.0}[name]


def finished(noise):
    """The answer of the estimate that runs."""
    until(lambda: noise._thread is None or not noise._thread.is_alive())
    return noise.answer()


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Estimates take no share of this computer's time, and what they take in and find is these."""
    monkeypatch.setattr(live, "SHARE", 1e9)
    monkeypatch.setattr(live, "RestSums", Sums)
    monkeypatch.setattr(live, "known_after_s", after)


def test_what_is_known_and_what_will_be():
    """Value and limit of each axis; the wait is the longest over the axes."""
    found = answer_of(KNOWN, 720.0, 0.2)
    assert found == RestAnswer(
        (
            "12 min, gyroscope: N and B known to 20 %",
            "gyroscope: N 7.07 mdps/√Hz, B 3.00 °/h, K < 1.0 °/h/√h (worst axis)",
        ),
        True,
    )
    assert not answer_of(KNOWN, 720.0, 0.05).known
    assert answer_of(KNOWN, 720.0, 0.05).lines[0] == "12 min, gyroscope: N known to 5 %; B will be after 3.1 h"


def test_a_drift_that_does_not_show_yet_is_awaited(monkeypatch):
    """On one axis of three, and of the accelerometer; the term that comes first counts."""
    plain = axis_of(N=(0.3 * N, 0.1 * N), limits={"B": 4 * B})
    shown = KNOWN.gyro.axes[0]
    figures = figures_of(sensor(shown, shown, plain), sensor(axis_of(N=(G * 1e-4, G * 1e-6), K=(G * 1e-7, G * 1e-8))))
    found = answer_of(figures, 720.0, 0.2)
    assert not found.known
    assert found.lines[0] == "12 min, gyroscope: B known to 20 %; N will be after 12 min; B or K not before 3.1 h"
    assert found.lines[1].endswith("B < 4.0 °/h, K ? (worst axis)")
    assert found.lines[2] == "12 min, accelerometer: N and K known to 20 %"
    hidden = axis_of(B=(3 * B, 0.3 * B), limits={"N": N})
    assert answer_of(figures_of(sensor(hidden)), 300.0, 0.2).lines[0] == "5 min, gyroscope: B known to 20 %; N not before 10 min"
    monkeypatch.setattr(live, "known_after_s", lambda *of: np.inf)
    never = answer_of(figures, 720.0, 0.2)
    assert "B or K will not be, however long it rests" in never.lines[0]


def test_an_estimate_runs_each_minute_and_then_each_tenth_of_the_rest(monkeypatch):
    ran = []

    def estimate(sums):
        ran.append(sum(each.count for each in sums) / 50)
        return NoiseEstimate(KNOWN, [], 0.0)

    monkeypatch.setattr(live, "estimate_noise", estimate)
    noise = LiveNoise(0.2)
    answers = []
    for second in range(0, 1500, 2):
        noise.add(samples(2.0, second))
        if noise.answer() is None and noise._thread is not None:
            answers.append(finished(noise))
    assert ran[:4] == [60, 120, 180, 240]
    assert all(later - former == pytest.approx(max(60, 0.1 * former), abs=2) for former, later in pairwise(ran))
    assert answers[0].known
    assert all(answer != other for answer, other in pairwise(answers))


def test_the_recording_does_not_wait_and_the_sums_of_an_estimate_stay(monkeypatch):
    going, seen = threading.Event(), []

    def estimate(sums):
        going.wait()
        seen.append(sums[0].count)
        return NoiseEstimate(KNOWN, [], 0.0)

    monkeypatch.setattr(live, "estimate_noise", estimate)
    noise = LiveNoise(0.2)
    noise.add(samples(70.0))
    assert noise.answer() is None
    noise.add(samples(70.0, 70.0))
    assert noise.answer() is None  # while it runs
    going.set()
    assert finished(noise).known
    assert seen == [3500]


@pytest.mark.parametrize(
    ("error", "says", "again"),
    [
        (DataError("rest of 60 s, expected a rest of minutes"), "no noise figures yet: rest of 60 s, expected a rest of minutes", True),
        (ValueError("no idea"), "the noise figures have failed (ValueError: no idea); the rest is recorded without them", False),
    ],
)
def test_what_fails_is_said_once_and_ends_nothing(error, says, again, monkeypatch):
    runs = []

    def estimate(sums):
        runs.append(1)
        raise error

    monkeypatch.setattr(live, "estimate_noise", estimate)
    noise = LiveNoise(0.2)
    noise.add(samples(61.0))
    noise.answer()
    assert finished(noise) == RestAnswer((says,))
    noise.add(samples(200.0, 61.0))
    noise.answer()
    assert finished(noise) is None  # nothing new
    assert len(runs) == 1 + again
