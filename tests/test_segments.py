"""Segments: each turn whole, with stillness at both ends, no sample counted twice; thresholds: test_segments_exact.py."""

import numpy as np
import pytest
from conftest import DEG, Table, config

from session.detect.events import LEAST_RUN
from session.detect.segments import cut_segments
from session.detect.stills import find_stills
from session.io.samples import Samples


def cut(samples, still_s=1.0, segment_s=5.0, **settings):
    made = config(still_s=still_s, segment_s=segment_s)
    stills, _ = find_stills(samples, still_s)
    return stills, cut_segments(samples, stills, made.sensor, made.protocol, **settings)


def keep(samples, chosen):
    temp_c = None if samples.temp_c is None else samples.temp_c[chosen]
    return Samples(samples.t_ns[chosen], samples.gyro[chosen], samples.accel[chosen], temp_c)


@pytest.mark.parametrize("rest_s", [1.2, 4.0])
def test_there_is_one_segment_from_each_still_to_the_next(rest_s):
    table = Table().tumble(8, rest_s=rest_s)
    stills, segments = cut(table.samples())
    assert len(segments) == 8
    for number, (segment, first, last) in enumerate(zip(segments, stills[:-1], stills[1:], strict=True)):
        assert (segment.first, segment.last, segment.number) == (first, last, number)
        assert segment.accepted
        assert segment.note is None


@pytest.mark.parametrize("rest_s", [1.2, 4.0])
def test_the_whole_turn_is_inside_and_starts_and_ends_at_rest(rest_s):
    """Integrating the true rate over the segment gives the whole true turn."""
    table = Table().tumble(8, rest_s=rest_s)
    samples = table.samples()
    rate, _ = table.truth(samples.t_s)
    turns = [vector for _, vector, _ in table.phases if vector.any()]
    for segment, turn in zip(cut(samples)[1], turns, strict=True):
        inside = slice(segment.start, segment.stop)
        np.testing.assert_allclose(np.trapezoid(rate[inside], samples.t_s[inside], axis=0), turn, atol=0.02 * DEG)
        assert np.abs(rate[[segment.start, segment.stop - 1]]).max() == 0.0
        assert segment.turn_deg == pytest.approx(np.linalg.norm(turn) / DEG, rel=0.01)


def test_a_gap_within_a_rest_does_not_cost_a_turn():
    table = Table().tumble(4, rest_s=6.0)
    samples = table.samples()
    start = int((table.rests[2][0] + 2.9) * 208)
    _, segments = cut(keep(samples, np.r_[:start, start + 30 : len(samples)]))
    assert [segment.accepted for segment in segments] == [True] * len(segments)
    assert len(segments) == 4


@pytest.mark.parametrize("level_dps", [500.0, 32767 * 0.0175])
def test_a_turn_that_clips_is_not_used_and_names_the_axis(level_dps):
    table = Table().rest(2).turn(90, (1, 0, 0)).rest(2).turn(1000, (0, 1, 0), 3.0).rest(2).turn(90, (0, 0, 1)).rest(2)
    samples = table.samples()
    level = np.rint(level_dps / 0.0175) * 0.0175 * DEG
    assert (samples.gyro[:, 1] > level).sum() > LEAST_RUN
    clipped = Samples(samples.t_ns, np.clip(samples.gyro, -level, level), samples.accel)
    _, segments = cut(clipped)
    assert [segment.accepted for segment in segments] == [True, False, True]
    assert f"clips at {level_dps:.0f} dps on y" in segments[1].problem
