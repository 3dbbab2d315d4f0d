"""Segments: each turn whole, with stillness at both ends, no sample counted twice; thresholds: test_segments_exact.py."""

import numpy as np
import pytest
from conftest import DEG, Table, config

from session.detect.segments import cut_segments
from session.detect.stills import find_stills


def cut(samples, still_s=1.0, segment_s=5.0, **settings):
    made = config(still_s=still_s, segment_s=segment_s)
    stills, _ = find_stills(samples, still_s)
    return stills, cut_segments(samples, stills, made.sensor, made.protocol, **settings)


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
