"""What decides a still, a turn, a closure run, the wait for a warm board, and the board's clock, on streams with truth."""

import re
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from coached_hand import guide_of, offline, play, said, with_hand
from conftest import DEG, GRAVITY, Table, config
from scipy import stats

from session.base.units import MDPS, MG, G
from session.bench import clocks, live
from session.bench import guide as guide_module
from session.bench.clocks import LEAST, ClockComparison, ClockRatio
from session.bench.events import Event
from session.bench.guide import BEGIN, MARK, RUN, SETTLING_S, ClosureGuide, Guide
from session.bench.live import (
    _BAR_RPS,
    _SEGMENT_S,
    _TYPICAL_RPS_PER_C,
    STILL_SIGMA_RPS,
    UNKNOWN_ZERO_RPS,
    MotionBlock,
    Settling,
    Stillness,
    StreamHealth,
    TurnInProgress,
    _scatter,
    rps_per_c,
    settling,
    stream_problem,
    worth_waiting,
)
from session.bench.messages import Advice, Kind, RequestedTurn, Stage
from session.bench.progress import LiveAccelerometerFit, Window, accepted_turn, fastest_ns
from session.bench.rawfile import raw_event
from session.log.samples import Samples

TWICE = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(90, (0, 1, 0), 3).rest(2.5)

# Stills and turns.


def test_what_the_guide_accepts_the_log_holds():
    """Each segment that is accepted live is found, accepted, at the same place by the offline detection of the whole log."""
    odr_hz = 104.0
    samples = Table().tumble(4, 2.2, 2.0, seed=3).samples(odr_hz)
    guide = guide_of(100, odr_hz)
    taken = [change.accepted for change in play(guide, samples) if change.accepted]
    segments = [segment for segment in offline(samples, odr_hz) if segment.accepted]
    assert len(taken) == len(segments) == 4
    for mine, theirs in zip(taken, segments, strict=True):
        first_s = (mine.samples.t_ns[0] - samples.t_ns[0]) * 1e-9
        assert abs(first_s - theirs.start_s) < 0.6  # a still that lasts longer moves its middle
        assert abs(mine.segment.turn_s - theirs.turn_s) < 0.25
        assert abs(mine.segment.turn_deg - theirs.turn_deg) < 1.5


def test_turns_have_the_numbers_that_a_fit_gives_them():
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(20, (0, 1, 0), 1).rest(2.5).turn(90, (0, 1, 0), 3).rest(2.5).samples()
    changes = play(guide_of(), samples)
    texts = [change.text.split(":")[0] for change in changes if change.kind in (Kind.ACCEPTED, Kind.REJECTED)]
    assert texts == ["turn 0 accepted", "turn 1 rejected", "turn 2 accepted"]
    assert [(s.number, s.turn_deg > 30) for s in offline(samples)] == [(0, True), (1, False), (2, True)]


def test_two_turns_go_through_all_stages_and_are_counted():
    """The countdown of the first still runs down; what was turned, and what was up, is said."""
    guide = guide_of(2)
    assert guide.instruction.stage is Stage.FIND_PORT
    samples = Table().rest(3).turn(180, (1, 0, 0), 3).rest(2.5).turn(-90, (0, 1, 0), 3).rest(2.5).samples()
    stages, left = [], []
    for first in range(0, len(samples), 10):
        guide.feed(samples.between(first, first + 10))
        if not stages or guide.stage is not stages[-1]:
            stages.append(guide.stage)
        if stages[1:] == [Stage.HOLD_STILL]:
            left.append(guide.instruction.remaining_s)
            assert guide.instruction.good == (left[-1] < guide.hold_s)
    assert left == sorted(left, reverse=True)
    assert left[0] > 0.3  # the first second was looked at as well
    assert left[-1] == pytest.approx(0.0, abs=0.11)
    hold, turn = Stage.HOLD_STILL, Stage.TURN
    assert stages == [Stage.CHECK_STREAM, hold, turn, hold, turn, hold, Stage.DONE]
    assert (guide.accepted, guide.feed(samples)) == (2, [])
    assert guide.taken.turned_deg == pytest.approx({"+x": 180, "-x": 0, "+y": 0, "-y": 90, "+z": 0, "-z": 0}, abs=1)
    assert guide.taken.stills_up == {"+x": 1, "-x": 0, "+y": 0, "-y": 0, "+z": 1, "-z": 1, "slanted": 0}


def test_a_hand_on_the_table_is_named_with_number_bar_and_axis():
    guide, samples = guide_of(), with_hand(Table().rest(12).samples(), 0, 8)
    play(guide, samples.between(0, 6 * 208))
    assert (guide.stage, guide.instruction.good) == (Stage.HOLD_STILL, False)
    number, bar = re.match(r"(?:rate scatter|it trembles:) (\S+) \S+ (\S+) .* hands off\?$", guide.instruction.why).groups()
    assert float(number) > float(bar) > 0
    play(guide, samples.between(6 * 208, len(samples)))
    assert guide.stage is Stage.TURN


@pytest.mark.parametrize(
    ("variance", "says"),
    [
        ([1.0, 3.9, 1.0], ""),
        ([1.0, 4.0, 1.0], "shakes 2.00 > 2.00 dps on y"),
        ([0.0, 0.0, 9.0], "shakes 3.00 > 2.00 dps on z"),  # of one axis twice the bar
        ([3.0, 3.01, 2.99], "shakes 1.73 > 1.42 dps on y"),  # of all on average the bar itself
    ],
)
def test_what_scatters_more_than_its_noise_is_said_of_the_worst_axis(variance, says):
    assert _scatter(np.array(variance) * DEG**2, np.full(3, DEG**2), 2.0, DEG, "shakes", "dps") == says


@pytest.mark.parametrize("steps", [0, 20])
def test_a_rate_that_moves_by_more_sigmas_than_a_mean_scatters_is_no_still(steps):
    """From the median of the blocks before; by twice the white noise of a block, or, of twenty steps, by what these scatter."""
    still, noise = Stillness(1 / 208), np.full(3, (0.1 * DEG) ** 2)
    still._noise, still._blocks, still.zero_rps = (noise, noise), 51, np.array([0.5, 0.0, 0.0])
    still._run = [np.array([0.5, y, 0.0]) * [1, DEG, 1] for y in (0.0, 0.2, 0.21)]
    still._steps.extend([np.full(3, 0.03 * DEG)] * steps)
    sigma = live.sigma_of(np.full((20, 3), 0.03 * DEG)) / np.sqrt(2) if steps else 2 * np.sqrt(noise / still.size)
    bar = live.MEAN_SIGMAS * sigma[1]
    for share in (0.99, 1.01):
        rate = np.array([0.5, 0.2 * DEG - share * bar, 0.0])
        says = still._why_not_quiet(rate, noise, noise)
        assert says == ("" if share < 1 else f"rate moved by {1.01 * bar / DEG:.3f} > {bar / DEG:.3f} dps on y")


@pytest.mark.parametrize(("zero_rps", "bar"), [(None, UNKNOWN_ZERO_RPS), (np.array([0.0, 0.1, 0.0]), live.TURNING_RPS)])
def test_a_rate_beyond_the_zero_is_a_turn(zero_rps, bar):
    still, noise = Stillness(1 / 208), np.ones(3)
    still._noise, still._blocks, still.zero_rps = (noise, noise), 51, zero_rps
    for share in (0.99, 1.01):
        says = still._why_not_quiet(np.array([0.0, share * bar + (0.0 if zero_rps is None else 0.1), 0.0]), noise, noise)
        assert says == ("" if share < 1 else f"turning at {1.01 * bar / DEG:.1f} > {bar / DEG:.0f} dps about y")


def test_a_table_that_always_trembles_is_no_dead_end():
    """Four times the sensor's noise, from a fan: after a minute its own calmest blocks are the yardstick."""
    guide = guide_of()
    play(guide, Table().rest(66).samples(gyro_mdps=20.0, accel_ug=60.0))
    assert guide.stage is Stage.TURN


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (Table().steady(15, (0, 0, 1), 8), ("turning at 1", "about z")),
        (Table().rest(3).turn(90, (1, 0, 0), 3).steady(0.5, (1, 0, 0), 6), ("creeps", "about x")),
        (Table().rest(3).turn(700, (0, 1, 0), 3).rest(3), ("> 425 dps: slower, or it clips",)),
    ],
    ids=["turning", "creeping", "near the full scale"],
)
def test_what_is_no_still_and_what_is_too_fast_is_said_with_its_number(table, says):
    guide, samples = guide_of(), table.samples()
    play(guide, samples if len(says) > 1 else samples.between(0, int(4.6 * 208)))
    assert guide.accepted == 0
    for words in says:
        assert words in guide.instruction.why


def endless():
    table = Table().rest(3)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)):
        table.turn(500, axis, 9)
    return table.rest(3).samples()


def turned(degrees, seconds, clip_dps=1e3, lost=()):
    samples = Table().rest(3).turn(degrees, (0, 1, 0), seconds).rest(2.5).samples()
    kept = np.delete(np.arange(len(samples)), lost)
    return Samples(samples.t_ns[kept], np.clip(samples.gyro, -clip_dps * DEG, clip_dps * DEG)[kept], samples.accel[kept])


@pytest.mark.parametrize(
    ("samples", "missing", "says"),
    [
        (turned(800, 2.5, clip_dps=500), 0, "clips at 500 dps on y"),
        (turned(180, 3, lost=range(832, 853)), 21, "21 samples are missing during the turn"),
        (turned(10, 1.5), 0, "no turn: 10° < 30°"),
        (endless(), 0, "too long for a segment"),
    ],
    ids=["clipped", "gap", "too small", "too long"],
)
def test_a_turn_that_no_fit_takes_is_rejected_with_the_reason(samples, missing, says):
    """The offline detection of the whole log takes none either."""
    guide = guide_of()
    (text,) = said(play(guide, samples), Kind.REJECTED)
    assert says in text
    assert (guide.accepted, guide.rejected, guide.health.missing) == (0, 1, missing)
    assert [segment for segment in offline(samples) if segment.accepted and segment.turn_deg > 30] == []


def test_too_short_a_still_joins_two_turns():
    samples = Table().rest(3).turn(120, (1, 0, 0), 3).rest(0.4).turn(90, (0, 1, 0), 3).rest(2.5).samples()
    guide = guide_of()
    (text,) = said(play(guide, samples), Kind.WARNING)
    assert re.search("too short a still.* < 0.7 s", text)
    assert guide.accepted == len(offline(samples)) == 1


SIGMAS = (("scale of x", 3.25), ("bias of x", 0.5))


def test_turns_without_their_targets_are_not_done():
    guide = guide_of(2)
    guide.advise(Advice("turn on", "it helps", missing=("scale of x",), sigmas=SIGMAS))
    changes = play(guide, TWICE.samples())
    assert guide.stage is Stage.DONE  # what was asked for has been recorded
    assert said(changes, Kind.DONE) == ["ended: 1 of 2 numbers are good enough after 2 turns"]
    assert guide.instruction.do == "the turns are made, but some numbers need more of them"
    assert not guide.instruction.good


@pytest.mark.parametrize("stops", [False, True])
def test_when_all_numbers_are_good_enough_it_stops_or_the_operator_finishes(monkeypatch, stops):
    """Not before a verdict has turns enough, here two."""
    monkeypatch.setattr(guide_module, "USUAL_TURNS", 2)
    guide, reached = guide_of(9, stop_at_target=stops), Advice("", "there", reached=True, sigmas=SIGMAS[1:])
    samples, once = TWICE.samples(), round(9.0 * 208)
    changes = play(guide, samples.between(0, once)) + guide.advise(reached)
    assert (guide.accepted, guide.enough, guide.stage) == (1, False, Stage.TURN)
    changes += play(guide, samples.between(once, len(samples)))
    if stops:
        changes += guide.advise(reached)
    else:
        assert guide.stage is Stage.TURN
        assert guide.instruction.do == "enough: finish now"
        changes += guide.decided(Event("finish"))
    assert said(changes, Kind.DONE) == ["done: 1 of 1 numbers are good enough after 2 turns"]
    assert guide.stage is Stage.DONE


@pytest.mark.parametrize("twice", [False, True])
def test_between_two_movements_a_short_rest_does_not_end_the_turn(twice):
    """The second movement stays on the screen for as long as a rest is no still; and after it the turn is over as always."""
    pair = (RequestedTurn((1.0, 0.0, 0.0), np.pi / 2), RequestedTurn((0.0, 0.0, 1.0), np.pi))
    samples = Table().rest(3).turn(90, (1, 0, 0), 1.5).rest(0.5).turn(180, (0, 0, 1), 2).rest(3).samples()
    guide, stages = guide_of(), []
    for first in range(0, len(samples), 10):
        changes = guide.feed(samples.between(first, first + 10))
        if any(change.kind is Kind.READY for change in changes):
            guide.advise(Advice("first this; then that", "why", movements=pair * twice))
        stages.append(((first + 10) / 208, guide.stage, guide.instruction.do))
    assert guide.accepted == 1
    end_s = next(at_s for at_s, stage, _ in stages if stage is Stage.HOLD_STILL and at_s > 3)
    if twice:
        assert {do for at_s, _, do in stages if 3.5 < at_s < 6.9} == {"first this; then that"}
        assert end_s == pytest.approx(7 + SETTLING_S, abs=0.25)
    else:
        assert end_s < 5  # in the rest between


# The stream.


@pytest.mark.parametrize(("at_s", "had"), [(0.5, 0), (9.0, 1)])
def test_unplugged_in_any_state_it_goes_on_and_keeps_what_it_has(at_s, had):
    guide = guide_of(2)
    play(guide, Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(120, (1, 0, 0), 3).samples().between(0, int(at_s * 208)))
    assert guide.accepted == had
    guide.waits(Stage.FIND_PORT, "/dev/ttyACM0: unplugged")
    assert guide.instruction.why == "/dev/ttyACM0: unplugged"
    guide.new_log()
    assert guide.instruction.why == "0.0 of 1.0 s of samples seen"
    changes = play(guide, TWICE.samples(seed=4))
    assert (guide.stage, guide.accepted) == (Stage.DONE, 2)
    assert [change.accepted.log for change in changes if change.accepted] == [1] * (2 - had)


@pytest.mark.parametrize(
    ("of_gyro", "of_accel", "odr_hz", "says"),
    [
        ([1, 1, 1], 1.0, 208, "^$"),
        ([1, 1, 1], 2.0, 208, "specific force 2.00 g"),
        ([1, 1, 1], 0.5, 208, "0.50 g"),
        ([1, 1, 1], 1.0, 416, "--odr 208"),
        ([1, 0, 1], 1.0, 208, "gyro's y does not change"),
    ],
)
def test_the_first_second_tells_a_wrong_range_a_wrong_rate_and_a_dead_axis(of_gyro, of_accel, odr_hz, says):
    samples = Table().rest(1.5).samples()
    assert re.search(says, stream_problem(Samples(samples.t_ns, samples.gyro * of_gyro, samples.accel * of_accel), odr_hz, 4.0))
    for no_stamps in (samples.between(0, 1), Samples(samples.t_ns // 10**10, samples.gyro, samples.accel)):
        assert stream_problem(no_stamps, odr_hz, 4.0).startswith("the stamps do not increase")


# The closure run.


PLANNED_S = 12.0


def to_the_mark(rest_s=5.0):
    """A segment, then onto the mark."""
    return Table().rest(2).turn(120, (1, 0, 0), 2).rest(2.5).turn(90, (0, 1, 0), 2).rest(rest_s)


def run(table):
    """Out and back again."""
    for degrees, axis in ((110, (1, 0.3, 0)), (110, (0, 1, 0.4)), (-110, (0, 1, 0.4)), (-110, (1, 0.3, 0))):
        table.turn(degrees, axis, PLANNED_S / 4)
    return table


def led_home(table, spoil=lambda samples: None):
    """The guide, its changes, what was decided and at which second: as a recording does it; spoil: what happens to the readings."""
    guide, samples = guide_of(1, closure_s=PLANNED_S), table.samples()
    spoil(samples)
    changes, decided, at_s = [], [], []
    for first in range(0, len(samples), 50):
        changes += play(guide, samples.between(first, first + 50))
        if guide.wants:
            decided.append(raw_event(guide.wants))
            at_s.append((first + 50) / 208)
            changes += guide.decided(guide.wants)
    return guide, changes, decided, at_s


BEGUN, KEPT = "begin unclosed", "keep closure"


def test_onto_the_mark_still_turn_back_still():
    guide, changes, decided, at_s = led_home(run(to_the_mark()).rest(4))
    assert (guide.stage, guide.accepted, decided) == (Stage.DONE, 1, [BEGUN, KEPT])
    assert said(changes, Kind.ACCEPTED)[-1].startswith("closure run: 12 s, back within 0.0")
    assert said(changes, Kind.DONE) == ["done: 1 turn and a closure run"]
    assert not said(changes, Kind.WARNING)
    # The file begins in the still, and the still goes on in it for as long as is asked.
    assert 8.5 + guide.closure.hold_s <= at_s[0] < 13.5 - guide.closure.hold_s


def test_away_from_the_mark_is_said_and_may_be_set_right():
    table = run(to_the_mark()).turn(4.0, (0, 1, 0), 1.0).rest(4)
    guide, changes, *_ = led_home(table)
    assert guide.stage is Stage.CLOSURE
    # y stands 30° from the vertical: of 4° about it, half are tilt.
    assert said(changes, Kind.WARNING) == ["2.0° from where the run began, 0.5° at most: set it back onto the mark"]
    assert "from where the run began" in guide.instruction.why
    guide, _, decided, _ = led_home(table.turn(-4.0, (0, 1, 0), 1.0).rest(4))
    assert (guide.stage, decided) == (Stage.DONE, [BEGUN, KEPT])
    guide, changes, decided, _ = led_home(run(to_the_mark()).turn(4.0, (0, 1, 0), 1.0).rest(14))
    assert said(changes, Kind.WARNING)[1:] == ["it stays there: that is the mark now, and the run restarts"]
    assert decided == [BEGUN, BEGUN]


def test_who_moves_too_early_begins_again():
    guide, changes, decided, _ = led_home(run(to_the_mark(rest_s=2.2).turn(60, (1, 0, 0), 2).rest(5)).rest(4))
    assert any("too short a still" in text for text in said(changes, Kind.WARNING))
    assert (guide.stage, decided[-2:]) == (Stage.DONE, [BEGUN, KEPT])


def test_a_run_that_cannot_be_integrated_begins_again():
    def spoil(samples):
        samples.gyro[(samples.t_s > 17.5) & (samples.t_s < 17.6), 0] = 573 * DEG

    guide, changes, decided, _ = led_home(run(run(to_the_mark()).rest(5)).rest(4), spoil)
    (rejected,) = said(changes, Kind.REJECTED)
    assert rejected.startswith("this closure run is not complete: ")
    assert (guide.stage, decided) == (Stage.DONE, [BEGUN, BEGUN, KEPT])


def with_noise(temps, seed=0):
    return temps + 0.003 * np.random.default_rng(seed).standard_normal(len(temps))


def told(t_s, temps, stills, left):
    """What it says at each moment, with a turn that counts between each two stills."""
    warmth, said = StreamHealth(), []
    turns = [SimpleNamespace(segment=SimpleNamespace(stills=pair)) for pair in pairwise(stills)]
    for at_s, temp_c in zip(t_s, temps, strict=True):
        warmth.warms(at_s, temp_c)
        said.append(warmth.wait(turns, stills, left))
    return said


@pytest.mark.parametrize(("to_come_c", "settles_s"), [(8.0, 150.0), (-7.0, 200.0)])
def test_how_the_temperature_settles_is_seen_in_its_last_minutes(to_come_c, settles_s):
    t_s = np.arange(0, 120, 2.0)
    now_c, left, tau_s = settling(np.stack([t_s, with_noise(25 - to_come_c * np.expm1(-t_s / settles_s))], axis=1))
    left_c = to_come_c * np.exp(-t_s[-1] / settles_s)
    assert left == pytest.approx(left_c, rel=0.1)
    assert tau_s == pytest.approx(settles_s, rel=0.15)
    assert now_c == pytest.approx(25 + to_come_c - left_c, abs=0.02)


def test_it_says_how_long_to_wait_and_is_silent_after_so_long():
    """From 30 s on: the minutes are those after which the true warm-up drifts by less than the bar.  Then it says nothing any more."""
    t_s, settles_s = np.arange(0, 700, 2.0), 150.0
    said = dict(zip(t_s, told(t_s, with_noise(25 - 9.0 * np.expm1(-t_s / settles_s)), [], 40), strict=True))
    assert not any(said[at_s] for at_s in t_s if at_s < 20)
    assert not any(told(t_s[:40], 25 - 9.0 * np.expm1(-t_s[:40] / settles_s), [], 0))

    def drift(begin_s):
        later_s = begin_s + _SEGMENT_S * np.arange(1, 41)
        return _TYPICAL_RPS_PER_C * np.std(-9.0 * np.expm1(-later_s / settles_s))

    needed_s = next(at_s for at_s in t_s if drift(at_s) < _BAR_RPS)
    for at_s in (30.0, 60.0):
        wait = said[at_s]
        assert wait.now_rps == pytest.approx(drift(at_s), rel=0.15)
        assert wait.then_rps < _BAR_RPS < wait.now_rps
        assert abs(at_s + 60 * wait.minutes - needed_s) < 90  # whole minutes, and a forecast
    assert abs(max(at_s for at_s in t_s if said[at_s]) - needed_s) < 30


def test_temperatures_of_the_last_five_minutes_are_kept_two_seconds_apart():
    warmth = StreamHealth()
    for t_s in np.arange(0, 400, 0.5):
        warmth.warms(t_s, 25.0)
    assert [t_s for t_s, _ in warmth._temps] == [*np.arange(100.0, 400, 2)]


def test_the_zero_per_degree_is_the_posterior_of_the_axis_that_moves_most():
    """Two stills two degrees apart: the typical value is the prior of each axis, a still's rate is known to its sigma."""
    stills = [SimpleNamespace(temp_c=25.0 + side, gyro_mean=side * np.array([3.0, -9.0, 1.0]) * MDPS) for side in (1, -1)]
    information, prior = 2 / STILL_SIGMA_RPS**2, _TYPICAL_RPS_PER_C**-2.0
    expected = np.hypot(9 * MDPS * information / (information + prior), (information + prior) ** -0.5)
    assert rps_per_c([*stills, SimpleNamespace(temp_c=np.nan, gyro_mean=np.ones(3))]) == pytest.approx(expected)
    assert rps_per_c([]) == pytest.approx(_TYPICAL_RPS_PER_C)


@pytest.mark.parametrize(("each_mdps", "limit"), [(10, _BAR_RPS), (1000, None)])
def test_the_wait_is_the_first_minute_that_brings_the_drift_below_the_bar_or_halves_it(each_mdps, limit):
    left, each = 8.0 * np.arange(1, 6), each_mdps * MDPS

    def drift(minutes):
        return each * np.std(10 * np.exp(-(60 * minutes + left) / 150))

    wait = worth_waiting(Settling(25.0, 10.0, 150.0), np.array([np.nan]), each, 5)
    assert (wait.now_rps, wait.then_rps) == pytest.approx((drift(0), drift(wait.minutes)))
    assert wait.minutes == next(minutes for minutes in range(1, 11) if drift(minutes) <= (limit or drift(0) / 2))
    assert worth_waiting(Settling(25.0, 10.0, 150.0), np.array([24.0]), each, 5) is None  # of which one is cold


def test_a_window_holds_the_present_still_and_of_a_long_one_the_last_part():
    window = Window(config().sensor, config().protocol, 1 / 208)
    window.feed(Table().rest(3).turn(90, (1, 0, 0), 3).samples().between(0, 4 * 208))
    found = window.examine()
    assert (found.still, found.why[:19]) == (None, "still for less than")
    samples = Table().rest(42).samples()
    for seconds, rested_s, left_s in ((30, 41, 30), (41, 39, 41), (41, 41, 20)):
        window = Window(config().sensor, config().protocol, 1 / 208)
        window.feed(samples.between(0, seconds * 208 + 1))
        found = window.examine()
        window.accept(found.samples, found.still)
        window.rest(rested_s)
        assert window.duration_s == pytest.approx(left_s, abs=1e-6 if left_s > 20 else 0.11)  # whole blocks


def test_a_turn_has_its_middle_and_its_fastest_moment_less_the_zero():
    gyro = np.zeros((10, 3))
    gyro[2:5, 0] = 2.0, -2.0, 5.5
    samples = Samples(10**9 * np.arange(10), gyro, np.zeros((10, 3)))
    stills = tuple(SimpleNamespace(gyro_mean=np.array([zero, 0.0, 0.0])) for zero in (1.0, 3.0))
    segment, examined = SimpleNamespace(start=2, stop=5, stills=stills), SimpleNamespace(samples=samples, noise=object())
    turn = accepted_turn(segment, examined, 0, 100.0, 500_000_000)
    assert (turn.middle_s, fastest_ns(turn)) == (102.5, 3 * 10**9)


def test_a_room_that_warms_steadily_is_not_waited_for():
    """However long, of a board whose bias moves much: waiting would gain nothing, and the slope alone would say it for ever."""
    t_s, rng = np.arange(0, 600, 2.0), np.random.default_rng(1)
    zeros = [np.array([0.0, 15 * MDPS * temp_c, 0.0]) + 3 * MDPS * rng.uniform(-1, 1, 3) for temp_c in np.linspace(25, 25.2, 5)]
    stills = [SimpleNamespace(temp_c=temp_c, gyro_mean=zero) for temp_c, zero in zip(np.linspace(25, 25.2, 5), zeros, strict=True)]
    said = told(t_s, with_noise(25 + t_s / 60, 3), stills, 35)
    assert not any(wait for at_s, wait in zip(t_s, said, strict=True) if at_s > 240)


def test_a_zero_of_half_a_g_gets_through():
    """An MPU-9250's z: level it reads 0.5 or 1.5 g, which a calibrated accelerometer must not, and an uncalibrated one may."""
    samples, off = Table().tumble(10, turn_s=1.5, seed=3).samples(seed=3), np.array([0.0, 0.0, 0.5 * G])
    samples = samples.with_accel(samples.accel + off)
    refused, guide = guide_of(), Guide(config().protocol, 10)
    play(refused, samples.between(0, 600))
    assert refused.stage is Stage.CHECK_STREAM
    guide.begin(config().sensor, LiveAccelerometerFit(GRAVITY))
    changes = play(guide, samples)
    assert (guide.accepted, said(changes, Kind.WARNING)) == (10, [])
    (known,) = (text for text in said(changes, Kind.STAGE) if "the accelerometer is known" in text)
    assert "10 attitudes: gravity spreads by" in known
    assert guide.taken.own.spread_mg[1] < 0.3
    np.testing.assert_allclose(guide.taken.own.accelerometer.bias_mps2, off, atol=0.5 * MG)


def test_there_is_no_result_of_a_few_seconds_and_one_of_both_sides_of_a_reset():
    rng, clock = np.random.default_rng(0), ClockComparison()
    for begins_s in (0.0, 40.0):
        for k in range(3000):
            host_s = begins_s + 0.01 * k
            clock.add(round((host_s + rng.exponential(0.005)) * 1e9), round(1.003 * 0.01 * k * 1e6))
            assert k > 900 or begins_s or clock.measured is None
        clock.restart()
    assert clock.measured.ratio == pytest.approx(1.003, abs=3 * clock.measured.sigma)
    assert clock.measured.over_s == pytest.approx(60.0, abs=2.0)


def test_a_clock_that_stands_or_is_hardly_seen_tells_nothing():
    clock = ClockComparison()
    for k in range(3000):
        clock.add(round(1e7 * k), 12345)
    assert clock.measured is None
    for ratio, sigma, tells in (1.0005, 4e-4, False), (1.00001, 2e-5, True), (1.005, 1e-3, True):
        assert ClockRatio(ratio, sigma, 12.0).is_informative == tells


def test_a_clock_is_the_line_through_the_least_late_of_each_stretch():
    """By a closed form: arrivals that are late by a known triangle in all but one of each stretch of half a second."""
    clock, ratio = ClockComparison(), 1.002
    for k in range(4000):
        host_s, late_s = 0.01 * k, 0.004 * (k % 50 != 7)
        clock.add(round((host_s + late_s) * 1e9), round(ratio * 1e6 * host_s))
    found = clock.measured
    assert found.ratio == pytest.approx(ratio, abs=2e-8)
    assert found.over_s == pytest.approx(39.5, abs=0.01)  # from the first to the last stretch's
    assert found.sigma == pytest.approx(1e-3 / np.sqrt(3) / found.over_s, rel=0.01)  # a frame of USB, whatever scatters less


def test_stretches_become_longer_where_there_are_too_many(monkeypatch):
    monkeypatch.setattr(clocks, "MOST", 30)
    clock = ClockComparison()
    for k in range(4000):
        host_s, late_s = 0.01 * k, 0.004 * (k % 50 != 7)
        clock.add(round((host_s + late_s) * 1e9), round(1.002e6 * host_s))
    assert [host_ns // 2_000_000_000 for host_ns, _ in clock._earliest] == [*range(20)]
    assert clock.measured.ratio == pytest.approx(1.002, abs=1e-7)


def test_a_delay_that_wanders_slowly_is_in_sigma_as_the_fewest_blocks_show_it():
    clock, at_s = ClockComparison(), 0.1 + 0.5 * np.arange(80)
    late_s = 0.005 * np.cos(2 * np.pi * at_s / 40)
    for t_s, late in zip(at_s, late_s, strict=True):
        clock.add(round((t_s + late) * 1e9), round(t_s * 1e6))
    least = [[part[np.argmin(late_s[part])] for part in np.array_split(np.arange(80), count)] for count in (5, 10, 20)]
    scatter = max(stats.linregress(at_s[rows], late_s[rows]).stderr for rows in least)
    assert clock.measured.sigma == pytest.approx(np.hypot(scatter, 1e-3 / np.sqrt(3) / 39.5), rel=0.01)


@pytest.mark.parametrize("at_once", [7.25, 7.0075])
def test_an_adapter_that_holds_samples_back_leaves_open_what_their_ages_leave_open(at_once):
    """Three arrivals of 7 samples to one of 8: ages of quarters of a period, which a period in forty arrivals of a block may shift."""
    clock, numbers = ClockComparison(), np.round(at_once * np.arange(401), 6).astype(int).tolist()
    for before, sample in pairwise(numbers):
        clock.add(sample * 10_000_000, sample * 10_000, sample - before)
    ages = np.sort((at_once + np.array([-1.0, 0.0, 1.0])[:, None] / 400) * np.arange(40) % 1.0)
    left_open_s = np.diff(ages, append=1 + ages[:, :1]).max() * 0.01
    found = clock.measured
    assert found.ratio == pytest.approx(1.0, abs=1e-9)
    assert found.sigma == pytest.approx(left_open_s / np.sqrt(3) / found.over_s, rel=0.01)


def test_several_comparisons_are_their_weighted_mean():
    two = ClockRatio.of([ClockRatio(1.001, 1e-4, 20.0), ClockRatio(1.002, 2e-4, 30.0)])
    weights = np.array([1e8, 0.25e8])
    mean = weights @ [1.001, 1.002] / weights.sum()
    assert two.ratio == pytest.approx(mean, rel=1e-12)
    assert two.over_s == 50.0
    assert two.sigma == pytest.approx(np.sqrt(weights @ np.square(np.array([1.001, 1.002]) - mean) / weights.sum()), rel=1e-9)
    alike = ClockRatio.of([ClockRatio(1.001, 1e-4, 20.0)] * 3)
    assert alike.sigma == pytest.approx(1e-4 / np.sqrt(3), rel=1e-12)  # no less than theirs together
    assert ClockRatio.of([]) is None
    assert ClockRatio.written(1.001, ClockRatio(1.001, 3e-5, 9.0).sigma_ppm).sigma == pytest.approx(3e-5, rel=1e-9)
    assert ClockRatio.written(1.0, 0.0).sigma == LEAST


def moved(seconds, rate_dps=0.0, quiet=False):
    return MotionBlock(seconds, np.array([0.0, 0.0, rate_dps * DEG]), abs(rate_dps) * DEG, quiet, "")


@pytest.mark.parametrize(("rested", "step"), [(5, MARK), (6, RUN), (9, RUN)])
def test_a_still_before_a_closure_run_is_counted_and_may_end_early(rested, step):
    """Its length is that of its blocks; ended behind the part that a still needs it stands, before that the run begins anew."""
    says, turn = [], TurnInProgress()
    guide = ClosureGuide(config().sensor, config().protocol, 1.0, 12.0, lambda kind, text: says.append(text))
    assert (guide.hold_s, guide.enough) == (1.0, False)

    def feed(block):
        turn.feed(block, np.zeros(3))
        guide.feed(Table().rest(0.1).samples(), block.duration_s, turn)

    guide.decided(BEGIN)
    for _ in range(rested):
        feed(moved(0.125, quiet=True))
    assert guide.instruction(turn).remaining_s == (12.0 if rested == 9 else 1.0 - 0.125 * rested)
    feed(moved(1.5, 50.0))
    assert guide.step is step
    assert bool(says) == (rested != 6)
    if step == MARK:
        assert "too short a still, 0.6 of 1.0 s" in says[0]


def test_a_still_before_a_long_closure_run_is_five_seconds():
    assert ClosureGuide(config().sensor, config().protocol, 1.0, 100.0, print).hold_s == pytest.approx(5.0)


def test_the_slope_of_the_temperature_and_the_data_rate_are_those_of_the_stamps():
    health, t_ns = StreamHealth(), np.arange(0, 20_000, 10) * 1_000_000
    pace = Samples(t_ns, np.zeros((2000, 3)), np.zeros((2000, 3))).pace
    keep = np.ones(2000, dtype=bool)
    keep[500:507] = keep[1201] = False
    for first in range(0, 2000, 100):
        rows = np.arange(first, first + 100)[keep[first : first + 100]]
        health.feed(Samples(t_ns[rows], *[np.zeros((len(rows), 3))] * 2, 20 + 1.5e-9 / 60 * t_ns[rows]), pace)
        assert (health.temp_slope is None) == (first < 1000)  # ten seconds
    assert (health.missing, health.gaps, health.samples) == (8, 1, 1992)  # one that is missing is no gap
    assert health.odr_hz == pytest.approx(100.0, rel=1e-9)
    assert health.temp_slope == pytest.approx(1.5, rel=0.02)


def test_the_temperature_is_that_of_the_last_readings_smoothed():
    health, zeros, pace = StreamHealth(), np.zeros((300, 3)), Table().rest(3).samples().pace
    for begin, end in ((0, 300), (300, 600), (600, 601)):
        stamps = np.arange(begin, end)
        health.feed(Samples(stamps * 10_000_000, zeros[: len(stamps)], zeros[: len(stamps)], 1.0 * stamps**2), pace)
    first, second = (np.mean(np.arange(end - 200.0, end) ** 2) for end in (300, 600))
    assert health.temp_c == pytest.approx(0.9 * (0.9 * first + 0.1 * second) + 0.1 * 600**2, rel=1e-12)


def test_the_path_of_a_turn_is_the_sum_of_its_blocks():
    """A bump that comes back is of the still; one that does not begins the turn with its own angle."""
    turn, still = TurnInProgress(), moved(0.1, quiet=True)
    for block in (still, still, moved(0.1, 1.5), moved(0.1, -1.5), still):
        assert turn.feed(block, np.zeros(3)) == 0.0
    assert (turn.still_s, turn.path_rad, turn.moving) == (pytest.approx(0.5), 0.0, False)
    ended = [turn.feed(moved(0.1, rate), np.array([0.0, 0.0, 1.0 * DEG])) for rate in (3.0, 41.0, 51.0)]
    found = sum(ended), turn.path_rad, turn.peak_rps, turn.moving_s, turn.restless_s
    assert found == pytest.approx((0.5, (0.2 + 4.0 + 5.0) * DEG, 51.0 * DEG, 0.3, 0.0))
