"""A hand at a simulated table, and the guide that watches it: for tests, and for pictures and figures of the page."""

from __future__ import annotations

import json

import numpy as np
from conftest import DEG, GRAVITY, config
from scipy.spatial.transform import Rotation

from session.bench.guide import Guide
from session.bench.messages import Stage
from session.bench.page.state import PageView
from session.detect.segments import cut_segments
from session.detect.stills import find_stills
from session.log.samples import Samples
from tinygc.planning.coach import Coach


def guide_of(segments=40, odr_hz=208.0, **options):
    guide = Guide(config().protocol, segments, **options)
    guide.begin(config(odr_hz=odr_hz).sensor)
    return guide


def play(guide, samples, portion=50):
    changes = []
    for first in range(0, len(samples), portion):
        changes += guide.feed(samples.between(first, first + portion))
    return changes


def said(changes, kind):
    return [change.text for change in changes if change.kind is kind]


def offline(samples, odr_hz=208.0):
    stills, _ = find_stills(samples)
    return cut_segments(samples, stills, config(odr_hz=odr_hz).sensor, config().protocol)


def with_hand(samples, start_s, stop_s, dps=0.4):
    """A hand that trembles on the table."""
    gyro, inside = samples.gyro.copy(), (samples.t_s >= start_s) & (samples.t_s < stop_s)
    gyro[inside] += np.random.default_rng(1).normal(size=(inside.sum(), 3)) * dps * DEG
    return Samples(samples.t_ns, gyro, samples.accel, samples.temp_c)


ERRORS = np.eye(3) + 1e-3 * np.array([[4.0, 1.5, -2.0], [-1.0, -6.0, 2.5], [2.0, -1.5, 5.0]])


BIAS_DPS = np.array([0.5, -0.3, 0.6])


class Silent:
    """A screen that shows nothing."""

    def change(self, change): ...

    def show(self, guide): ...


class Kept:
    """A server without browsers: the newest of each kind."""

    def __init__(self):
        self.last = {}

    def publish(self, event, content):
        self.last[event] = json.loads(json.dumps(content, allow_nan=False))


class CoachedHand:
    """``until`` a moment of a session of so many turns; attitude: how the board truly lies, body to a frame with z up."""

    def __init__(self, server=None, segments=40, odr_hz=208.0, seed=0):
        self.server = server or Kept()
        self.page, self.coach = PageView(Silent(), self.server), Coach()
        self.guide = guide_of(segments, odr_hz)
        self.guide.coached = True
        self.attitude = Rotation.identity()
        self._rng, self._odr_hz, self._number = np.random.default_rng(seed), odr_hz, 0
        self.received: list[Samples] = []
        self._moments = self._session()

    def until(self, true):
        """To the first moment at which true(guide), by portions of 0.1 s."""
        for _ in self._moments:
            if true(self.guide):
                return self.guide
        assert true(self.guide), "the session ended before that"
        return self.guide

    def _session(self):
        yield from self._move(np.zeros(3), 3.2)
        while self.guide.stage is not Stage.DONE:
            vectors = self._asked()
            for vector in vectors:
                yield from self._move(vector, max(0.1, float(np.linalg.norm(vector)) / self.rate_rps(vectors)))
            yield from self._move(np.zeros(3), 2.5)

    def _asked(self):
        """What the coach asks for, or any turn."""
        advice = self.guide.advice
        if advice is None or not advice.movements:
            axis = self._rng.normal(size=3)
            return [self._rng.uniform(1.5, 3.0) * axis / np.linalg.norm(axis)]
        vectors = [movement.angle_rad * np.array(movement.axis) for movement in advice.movements]
        return vectors if advice.up is None else [self._straightening(np.array(advice.up)), *vectors]

    def _straightening(self, up):
        """The shortest way, in the body, to where ``up`` of it points up."""
        lies = self.attitude.inv().apply([0.0, 0.0, 1.0])
        axis = np.cross(up, lies)
        length = float(np.linalg.norm(axis))
        return axis / length * np.arctan2(length, up @ lies) if length > 1e-9 else np.zeros(3)

    def _move(self, vector, seconds):
        """About an axis of the body, from rest to rest."""
        began, step = self.attitude, max(1, round(0.1 * self._odr_hz))
        count = round(seconds * self._odr_hz)
        seconds, part = count / self._odr_hz, np.arange(1, count + 1) / count
        way = part - np.sin(2 * np.pi * part) / (2 * np.pi)
        rate = ((1 - np.cos(2 * np.pi * part)) / seconds)[:, None] * vector
        attitudes = began * Rotation.from_rotvec(way[:, None] * vector)
        gyro, temp_c = self.measured(rate, attitudes, (self._number + np.arange(count)) / self._odr_hz)
        wide = np.sqrt(self._odr_hz / 2)
        gyro = gyro + 0.005 * DEG * wide * self._rng.normal(size=rate.shape)
        force = attitudes.inv().apply([0, 0, GRAVITY]) + 6e-4 * wide * self._rng.normal(size=rate.shape)
        t_ns = np.rint((self._number + np.arange(count)) * 1e9 / self._odr_hz / 1000).astype(np.int64) * 1000
        self._number += count
        samples = Samples(t_ns, gyro, force, temp_c)
        self.received.append(samples)
        for first in range(0, count, step):
            self.attitude = attitudes[min(first + step, count) - 1]
            self._take(samples.between(first, first + step))
            yield
        self.attitude = began * Rotation.from_rotvec(vector)

    def rate_rps(self, vectors):
        """The mean rate of a turn of these movements."""
        return 60 * DEG

    def measured(self, rate, attitudes, t_s):
        """What a gyroscope without noise reads (N, 3), and its temperature (N,), of rates (N, 3) rad/s against the table."""
        return (rate + BIAS_DPS * DEG) @ ERRORS.T, np.full(len(t_s), 31.4)

    def _take(self, samples):
        for change in self.guide.feed(samples):
            self.page.change(change)
            if change.accepted is not None:
                self.guide.advise(self.coach(self.guide.taken.progress))
        self.page._sent_s = 0.0  # here no 40 ms pass between two portions
        self.page.watch(self.guide, samples)
        self.page.show(self.guide)
