"""Outages of a truth file: where it loses the body, freezes or comes back; and a gyro that is wrong instead."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from scipy.spatial.transform import Rotation
from truth_sessions import Wrong, made

from tinygc.features.truth.check import with_aligned_truth
from tinygc.features.truth.outages import _runs, _usual, without_outages
from tinygc.features.truth.reading import changed
from tinygc.features.truth.segments import cut_at_truth

DENSE = Wrong(turns=8, every_s=0.02, sigma_deg=0.01)


def spoilt(turned_deg=None, *, at_s=None, frozen=None, gyro_dps=None, wrong=DENSE, seed=3):
    """The session whose truth is turned by turned_deg(t) (K, 3) in the spans at_s, or frozen in a span; gyro_dps(t) (N, 3) is added."""
    session, _ = made(wrong, seed)
    (log,), (truth,) = session.logs, session.reference.truths
    t_s = truth.t_ns * 1e-9
    q = Rotation.from_quat(truth.q_nb, scalar_first=True)
    if turned_deg is not None:
        inside = (t_s >= at_s[0]) & (t_s <= at_s[1])
        q = q * Rotation.from_rotvec(np.where(inside[:, None], turned_deg(t_s), 0.0) * DEG)
    cells = q.as_quat(scalar_first=True)
    if frozen is not None:
        inside = (t_s >= frozen[0]) & (t_s <= frozen[1])
        cells[inside] = cells[np.flatnonzero(inside)[0]]
    gyro = log.samples.gyro + (0.0 if gyro_dps is None else gyro_dps(log.samples.t_s) * DEG)
    logs = (replace(log, samples=replace(log.samples, gyro=gyro)),)
    return changed(replace(session, logs=logs), truths=(replace(truth, q_nb=cells),))


def astray(t_s):
    """Degrees: a wandering rate of some 100 dps."""
    steps = np.random.default_rng(0).normal(size=(len(t_s) // 8 + 1, 3)).repeat(8, axis=0)[: len(t_s)] * 100 * 0.02
    return np.cumsum(steps, axis=0)


def outages_of(session):
    (truth,) = without_outages(session).reference.truths
    return truth.outages


def test_a_truth_that_goes_astray_is_found_until_its_last_moment():
    at_s = (14.0, 16.0)
    session = spoilt(astray, at_s=at_s)
    aligned, findings = with_aligned_truth(session)
    (log,), (truth,) = aligned.logs, aligned.reference.truths
    (outage,) = truth.outages
    assert outage.sure
    # Spans of 0.1 s; the truth ends 0.3 s within the log.
    assert outage.from_s == pytest.approx(at_s[0], abs=0.11)
    assert outage.to_s == pytest.approx(15.7, abs=0.13)
    # No moment is sound that was spoilt, though the last ones of a file make no span of 0.1 s any more.
    t_s = truth.t_ns * 1e-9
    assert not truth.sound[(t_s >= at_s[0] + 0.02) & (t_s <= at_s[1])].any()
    assert abs(aligned.reference.alignment.offset_s) < 4 * aligned.reference.alignment.offset_sigma_s < 0.4e-3
    cut = cut_at_truth(log.samples, truth, session.config.sensor, session.config.protocol)
    assert cut
    assert all(truth.sound[ends.first] and truth.sound[ends.last] for _, ends in cut)
    assert [finding.what for finding in findings].count("truth's outages") == 1


def test_what_is_usual_follows_the_movement():
    rng = np.random.default_rng(1)
    rate = np.concatenate([np.zeros(600), rng.uniform(0, 5, 400)])
    size = np.abs(rng.normal(size=1000)) * (0.1 + 0.4 * rate)
    usual = _usual(size, np.column_stack([np.ones(1000), rate]))
    # The mean of a half-normal is 0.80 of its sigma, its median 0.67; 400 of them know it to some percent.
    assert 0.6 < usual[0] / 0.1 < 0.9
    assert 0.6 < (usual[600:] / (0.1 + 0.4 * rate[600:])).mean() < 0.9


def test_runs_join_over_a_pause_and_need_three_spans_or_an_end():
    begin = np.arange(100) * 0.1
    level = np.exp(0.45 * np.random.default_rng(0).uniform(-1, 1, 100))

    def runs(*rows):
        times = level.copy()
        times[list(rows)] = 100.0
        return _runs(times, begin, begin + 0.1)

    assert runs(50, 51) == []
    assert runs(50, 51, 54) == [(50, 55)]
    assert runs(50, 51, 56) == []
    assert runs(99) == [(99, 100)]
    assert runs(*range(50, 95)) == []


def test_what_is_no_outage_and_what_freezes():
    """A single wrong moment, a step of the gyro's bias; a frozen one is told by its repeated values."""
    moment = {"turned_deg": lambda t: np.full((len(t), 3), 4.0), "at_s": (7.99, 8.01)}
    assert not outages_of(spoilt(**moment, gyro_dps=lambda t: (t > 5)[:, None] * np.array([3.0, -2.0, 4.0])))
    (outage,) = outages_of(spoilt(frozen=(13.0, 16.0), wrong=replace(DENSE, force=False)))
    assert outage.sure
