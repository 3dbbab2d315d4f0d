"""The guide on simulated streams: what it accepts, what it rejects and why, what it waits for; no clock, no port, no terminal."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import DEG, Table, config

from session.detect.segments import cut_segments
from session.detect.stills import find_stills
from session.guide.coverage import face_up
from session.guide.guide import Guide
from session.guide.messages import Advice, Kind, Stage
from session.guide.stream_check import stream_problem
from session.log.samples import Samples, joined
from session.sensor.registers import accel_mps2_per_lsb, gyro_rps_per_lsb, temperature_c
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulate import simulate_session


def guide_of(segments=40, odr_hz=208.0, **options) -> Guide:
    guide = Guide(config().protocol, segments, **options)
    guide.begin(config(odr_hz=odr_hz).sensor)
    return guide


def play(guide: Guide, samples: Samples, portion: int = 50) -> list:
    changes = []
    for first in range(0, len(samples), portion):
        changes += guide.feed(samples.between(first, first + portion))
    return changes


def said(changes, kind: Kind) -> list[str]:
    return [change.text for change in changes if change.kind is kind]


def simulated(segments=10, **options) -> Samples:
    log = simulate_session(SimulationOptions(segments=segments, closure_s=0.0, **options)).log
    gyro, accel = log.gyro * gyro_rps_per_lsb(500), log.accel * accel_mps2_per_lsb(4)
    return Samples(log.t_us * 1000, gyro, accel, temperature_c(log.temp.astype(float)))


def offline(samples: Samples, odr_hz=208.0):
    stills, _ = find_stills(samples)
    return cut_segments(samples, stills, config(odr_hz=odr_hz).sensor, config().protocol)


def with_hand(samples: Samples, start_s: float, stop_s: float, dps: float = 0.4) -> Samples:
    """A hand that trembles on the table."""
    gyro, inside = samples.gyro.copy(), (samples.t_s >= start_s) & (samples.t_s < stop_s)
    gyro[inside] += np.random.default_rng(1).normal(size=(inside.sum(), 3)) * dps * DEG
    return Samples(samples.t_ns, gyro, samples.accel, samples.temp_c)


@pytest.mark.parametrize(("odr_hz", "seed"), [(104.0, 3), (208.0, 0), (208.0, 1), (416.0, 2), (1667.0, 0)])
def test_what_the_guide_accepts_the_log_holds(odr_hz, seed):
    """Each segment that is accepted live is found, accepted, at the same place by the offline detection of the whole log."""
    samples = simulated(12, odr_hz=odr_hz, seed=seed)
    guide = guide_of(100, odr_hz)
    taken = [change.accepted for change in play(guide, samples) if change.accepted]
    segments = [segment for segment in offline(samples, odr_hz) if segment.accepted]
    assert len(taken) == len(segments) == 12
    for mine, theirs in zip(taken, segments, strict=True):
        first_s = (mine.samples.t_ns[0] - samples.t_ns[0]) * 1e-9
        assert abs(first_s - theirs.start_s) < 0.6  # a still that lasts longer moves its middle
        assert abs(mine.segment.turn_s - theirs.turn_s) < 0.25
        assert abs(mine.segment.turn_deg - theirs.turn_deg) < 1.5


def test_the_portions_do_not_matter():
    samples = simulated(4, seed=5)
    texts = [[(change.text, change.at_s) for change in play(guide_of(), samples, portion)] for portion in (1, 37, 10**9)]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 8


def test_it_goes_through_all_stages_and_ends():
    guide = guide_of(2)
    assert guide.instruction.stage is Stage.FIND_PORT
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(150, (0, 1, 0), 3).rest(2.5).samples()
    stages = []
    for first in range(0, len(samples), 10):
        guide.feed(samples.between(first, first + 10))
        if not stages or guide.stage is not stages[-1]:
            stages.append(guide.stage)
    hold, turn = Stage.HOLD_STILL, Stage.TURN
    assert stages == [Stage.CHECK_STREAM, hold, turn, hold, turn, hold, Stage.DONE]
    assert guide.accepted == 2
    assert guide.feed(samples) == []


def test_the_countdown_runs_down_and_says_what_is_missing():
    guide = guide_of()
    samples = Table().rest(4).samples()
    left = []
    for first in range(0, len(samples), 21):
        guide.feed(samples.between(first, first + 21))
        if guide.stage is Stage.HOLD_STILL:
            now = guide.instruction
            left.append(now.remaining_s)
            assert now.good == (now.remaining_s < guide.hold_s)
    assert left[0] > 0.3  # the first second was looked at as well
    assert left[-1] == pytest.approx(0.0, abs=0.11)
    assert all(a >= b for a, b in pairwise(left))
    assert guide.stage is Stage.TURN


def test_a_hand_on_the_table_is_named_with_number_bar_and_axis():
    guide = guide_of()
    samples = with_hand(Table().rest(12).samples(), 0, 8)
    play(guide, samples.between(0, 6 * 208))
    now = guide.instruction
    assert guide.stage is Stage.HOLD_STILL
    assert not now.good
    words = now.why.split()
    assert " ".join(words[:2]) in ("rate scatter", "it trembles:")
    assert float(words[2]) > float(words[4]) > 0
    assert words[-2:] == ["hands", "off?"]
    play(guide, samples.between(6 * 208, len(samples)))
    assert guide.stage is Stage.TURN


def test_a_hand_that_stays_on_the_table_after_the_turn_is_named():
    """It must not wait in silence for the turn to end: 0.3 s after it has stopped turning it asks for hands off."""
    samples = with_hand(Table().rest(3).turn(120, (1, 0, 0), 3).rest(6).samples(), 5.5, 8.5)
    guide = guide_of()
    play(guide, samples.between(0, 7 * 208))
    now = guide.instruction
    assert now.stage is Stage.HOLD_STILL
    assert "rate scatter" in now.why
    assert now.why.endswith("s: hands off?")
    assert 0.5 < float(now.why.split(" s: hands")[0].split()[-1]) < 1.6
    play(guide, samples.between(7 * 208, len(samples)))
    assert guide.accepted == 1


def test_a_table_that_always_trembles_is_no_dead_end():
    """Four times the sensor's noise, from a fan: after a minute its own calmest blocks are the yardstick."""
    guide = guide_of()
    play(guide, Table().rest(66).samples(gyro_mdps=20.0, accel_ug=60.0))
    assert guide.stage is Stage.TURN


def test_a_steady_turn_is_no_still():
    guide = guide_of()
    play(guide, Table().steady(15, (0, 0, 1), 8).samples())
    assert guide.stage is Stage.HOLD_STILL
    assert "turning at 1" in guide.instruction.why
    assert "about z" in guide.instruction.why


def test_a_creeping_table_is_said_to_creep():
    guide = guide_of()
    play(guide, Table().rest(3).turn(90, (1, 0, 0), 3).steady(0.5, (1, 0, 0), 6).samples())
    assert guide.accepted == 0
    assert "creeps" in guide.instruction.why
    assert "about x" in guide.instruction.why


def reject(samples: Samples) -> str:
    guide = guide_of()
    changes = play(guide, samples)
    assert guide.accepted == 0
    assert guide.rejected == 1
    (text,) = said(changes, Kind.REJECTED)
    segments = [segment for segment in offline(samples) if segment.accepted and segment.turn_deg > 30]
    assert segments == []
    return text


def test_a_clipped_turn_is_rejected():
    samples = Table().rest(3).turn(800, (0, 1, 0), 2.5).rest(2.5).samples()
    limit = 500 * DEG
    text = reject(Samples(samples.t_ns, np.clip(samples.gyro, -limit, limit), samples.accel))
    assert "clips at 500 dps on y" in text


def test_a_gap_in_a_turn_is_rejected_and_counted():
    samples = Table().rest(3).turn(180, (0, 1, 0), 3).rest(2.5).samples()
    lost = (samples.t_s > 4.0) & (samples.t_s < 4.1)
    kept = Samples(samples.t_ns[~lost], samples.gyro[~lost], samples.accel[~lost])
    assert f"{lost.sum()} samples are missing during the turn" in reject(kept)
    guide = guide_of()
    play(guide, kept)
    assert (guide.health.gaps, guide.health.missing) == (1, lost.sum())


def test_no_turn_is_rejected():
    assert "no turn: 10° < 30°" in reject(Table().rest(3).turn(10, (0, 1, 0), 1.5).rest(2.5).samples())


def test_a_turn_without_end_is_rejected():
    table = Table().rest(3)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)):
        table.turn(500, axis, 9)
    assert "too long for a segment" in reject(table.rest(3).samples())


def test_too_short_a_still_joins_two_turns():
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(0.4).turn(90, (0, 1, 0), 3).rest(2.5).samples()
    guide = guide_of()
    changes = play(guide, samples)
    (text,) = said(changes, Kind.WARNING)
    assert "too short a still" in text
    assert "< 0.7 s" in text
    assert guide.accepted == 1
    assert [segment.accepted for segment in offline(samples)] == [True]


def test_a_still_that_was_left_before_the_countdown_may_count_all_the_same():
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(1.0).turn(90, (0, 1, 0), 3).rest(2.5).samples()
    guide = guide_of()
    play(guide, samples)
    assert guide.accepted == 2 == sum(segment.accepted for segment in offline(samples))


def test_a_bump_does_not_end_a_still():
    """A knock that leaves the attitude as it was: 0.2 s of shaking within the countdown."""
    samples = with_hand(Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.4).samples(), 6.6, 6.8, 1.0)
    guide = guide_of()
    changes = play(guide, samples)
    assert guide.accepted == 1
    assert not said(changes, Kind.WARNING)


def test_a_turn_that_nears_the_full_scale_is_said_to():
    guide = guide_of()
    play(guide, Table().rest(3).turn(700, (0, 1, 0), 3).samples().between(0, int(4.6 * 208)))
    now = guide.instruction
    assert not now.good
    assert "> 425 dps: slower, or it clips" in now.why


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


def test_advice_is_shown_and_ends_the_session_where_asked():
    guide = guide_of(40, stop_at_target=True)
    play(guide, Table().rest(3).samples())
    guide.advise(Advice("turn left about the vertical", "scale of z is known worst, 3.0 times its target"))
    assert guide.instruction.do == "turn left about the vertical"
    assert "3.0 times its target" in guide.instruction.why
    (change,) = guide.advise(Advice("", "every parameter has reached its target", reached=True))
    assert change.kind is Kind.DONE
    assert guide.stage is Stage.DONE


def test_coverage_says_what_was_turned_and_what_was_up():
    guide = guide_of()
    play(guide, Table().rest(3).turn(180, (1, 0, 0), 3).rest(2.5).turn(-90, (0, 1, 0), 3).rest(2.5).samples())
    turned, stills = guide.coverage.turned_deg, guide.coverage.stills
    assert turned["+x"] == pytest.approx(180, abs=1)
    assert turned["-y"] == pytest.approx(90, abs=1)
    assert turned["-x"] + turned["+y"] + turned["+z"] + turned["-z"] < 1
    assert stills == {"+x": 1, "-x": 0, "+y": 0, "-y": 0, "+z": 1, "-z": 1, "slanted": 0}
    assert face_up(np.array([1.0, 1.0, 0.0])) is None


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


def test_a_wrong_range_is_waited_out_in_words():
    guide = guide_of()
    samples = Table().rest(4).samples()
    changes = play(guide, samples.with_accel(samples.accel * 2))
    assert guide.stage is Stage.CHECK_STREAM
    assert "was the range really ±4 g?" in guide.instruction.why
    assert len(said(changes, Kind.WARNING)) <= 3


def test_temperature_and_its_slope():
    guide = guide_of()
    samples = Table().rest(40).samples()
    warm = Samples(samples.t_ns, samples.gyro, samples.accel, samples.temp_c + samples.t_s * 0.6 / 60)
    play(guide, warm)
    assert guide.health.temp_slope == pytest.approx(0.6, abs=0.05)
    assert guide.health.warming
    assert guide.health.odr_hz == pytest.approx(208, rel=1e-4)


def test_single_lost_samples_do_not_change_the_rate():
    samples = Table().rest(20).samples()
    kept = np.flatnonzero(np.random.default_rng(0).random(len(samples)) > 0.02)
    guide = guide_of()
    play(guide, Samples(samples.t_ns[kept], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept]))
    assert guide.health.odr_hz == pytest.approx(208, rel=1e-4)


def test_a_long_rest_is_not_kept_in_memory():
    guide = guide_of()
    play(guide, Table().rest(200).turn(120, (1, 0, 0), 3).rest(3).samples(), 2000)
    assert guide.accepted == 1
    assert guide._window.duration_s < 60
