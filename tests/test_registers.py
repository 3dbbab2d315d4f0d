"""False readings, losses and ceilings in the registers: none is invented."""

import pytest
from conftest import Table
from spoilt_registers import FS, RATES, clean

from tinygc.explanation.clipped_turns import find_ceiling
from tinygc.explanation.faulty_readings import find_glitches, find_jumps, find_losses


@pytest.mark.parametrize("odr_hz", RATES)
def test_a_clean_movement_has_no_jumps_and_no_ceiling(odr_hz):
    for seed in range(12):
        samples, _ = clean(odr_hz, seed, turns=3)
        jumps = find_jumps(samples)
        assert len(jumps.rows) == 0, (seed, jumps.rows, jumps.size)
        assert find_glitches(samples) is None
        assert len(find_losses(jumps, samples.duration_s)) == 0
        assert find_ceiling(samples, FS) is None


def test_a_turn_that_starts_at_once_is_no_jump():
    """A short strong turn after a long rest: its neighbourhood's scatter is that of the rest until it begins."""
    samples = Table().rest(5).turn(90, (1, 2, 0), 0.6).rest(5).samples(odr_hz=208)
    assert len(find_jumps(samples).rows) == 0


def test_a_short_recording_has_no_jumps():
    samples = Table().rest(0.5).samples(odr_hz=104)
    assert len(find_jumps(samples).rows) == 0
    assert find_glitches(samples) is None
