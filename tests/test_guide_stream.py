"""The guide and its stream: unplugged, silent, of a wrong range or rate, warming up, with losses."""

import numpy as np
import pytest
from coached_hand import guide_of, play, said
from conftest import Table

from session.bench.live import stream_problem
from session.bench.messages import Kind, Stage
from session.io.samples import Samples, joined

pytestmark = pytest.mark.broad


@pytest.mark.parametrize("at_s", [0.5, 1.5, 2.9, 4.5, 6.3, 9.0])
def test_unplugged_in_any_state_it_goes_on_and_keeps_what_it_has(at_s):
    """Before the check is over, while the first still is held, before the turn, in it, in the still after it, and afterwards."""
    guide = guide_of(3)
    before = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(120, (1, 0, 0), 3).rest(2).samples()
    play(guide, before.between(0, int(at_s * 208)))
    had = guide.accepted
    assert had == int(at_s == 9.0)
    guide.waits(Stage.FIND_PORT, "/dev/ttyACM0: unplugged")
    assert guide.instruction.why == "/dev/ttyACM0: unplugged"
    guide.new_log()
    assert guide.instruction.why == "0.0 of 1.0 s of samples seen"
    after = (
        Table().rest(3).turn(150, (0, 1, 0), 3).rest(2.5).turn(90, (0, 0, 1), 3).rest(2.5).turn(90, (1, 1, 0), 3).rest(2.5).samples(seed=4)
    )
    changes = play(guide, after)
    assert guide.stage is Stage.DONE
    assert guide.accepted == 3
    assert len([change for change in changes if change.accepted]) == 3 - had
    assert all(change.accepted.log == 1 for change in changes if change.accepted)


def test_silence_within_a_log_costs_the_turn_in_it_only():
    """A stall of the host: the stamps go on, 1.5 s are missing in the middle of a turn."""
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(3.5).turn(120, (0, 1, 0), 3).rest(3).samples()
    kept = (samples.t_s < 4.0) | (samples.t_s > 5.5)
    first, second = (
        Samples(samples.t_ns[part], samples.gyro[part], samples.accel[part]) for part in (samples.t_s < 4.0, samples.t_s > 5.5)
    )
    guide = guide_of()
    changes = play(guide, first)
    guide.waits(Stage.CHECK_STREAM, "no samples for 2 s")
    changes += play(guide, second)
    assert "missing" in said(changes, Kind.REJECTED)[0]
    assert guide.accepted == 1
    assert len(joined([first, second])) == kept.sum()


@pytest.mark.parametrize(
    ("factor", "odr_hz", "says"), [(1.0, 208, ""), (2.0, 208, "specific force 2.00 g"), (0.5, 208, "0.50 g"), (1.0, 416, "--odr 208")]
)
def test_the_first_second_tells_a_wrong_range_and_a_wrong_rate(factor, odr_hz, says):
    samples = Table().rest(1.5).samples()
    problem = stream_problem(samples.with_accel(samples.accel * factor), odr_hz, 4.0)
    assert says in problem
    assert bool(says) == bool(problem)
    dead = Samples(samples.t_ns, samples.gyro * [1, 0, 1], samples.accel)
    assert "gyro's y does not change" in stream_problem(dead, 208, 4.0)


def test_single_lost_samples_do_not_change_the_rate():
    samples = Table().rest(20).samples()
    kept = np.flatnonzero(np.random.default_rng(0).random(len(samples)) > 0.02)
    guide = guide_of()
    play(guide, Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept]))
    assert guide.health.odr_hz == pytest.approx(208, rel=1e-4)
