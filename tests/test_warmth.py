"""Waiting for a warm board: said with what it gains, while that matters, never for ever; nothing without a thermometer."""

import io
from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from coached_hand import guide_of, play
from conftest import DEG, Table, broad
from rich.console import Console
from test_page_state import Kept, Silent

from session.bench.live import BAR_RPS, SEGMENT_S, TYPICAL_RPS_PER_C, WarmUp, rps_per_c, settling
from session.bench.page.state import PageView
from session.bench.screen import view
from session.io.samples import Samples
from session.io.units import MDPS

RNG_NOISE_C = 0.003
PER_C = 15 * MDPS  #: of a board whose bias moves much


@dataclass
class Still:
    temp_c: float
    gyro_mean: np.ndarray


def warm_up(to_come_c, settles_s, t_s, start_c=25.0):
    noise = RNG_NOISE_C * np.random.default_rng(0).standard_normal(len(t_s))
    return start_c - to_come_c * np.expm1(-t_s / settles_s) + noise


def stills_of(temps, per_c=PER_C):
    rng = np.random.default_rng(1)
    return [Still(temp, np.array([0.0, per_c, 0.0]) * temp + 3 * MDPS * rng.uniform(-1, 1, 3)) for temp in temps]


def turns_at(stills) -> list:
    """Between each two stills a turn that counts."""
    return [SimpleNamespace(segment=SimpleNamespace(stills=pair)) for pair in pairwise(stills)]


def told(t_s, temps, stills, left) -> list:
    """What it says at each moment."""
    warmth, said = WarmUp(), []
    for at_s, temp_c in zip(t_s, temps, strict=True):
        warmth.feed(at_s, temp_c)
        said.append(warmth.wait(turns_at(stills), stills, left))
    return said


@pytest.mark.parametrize(("to_come_c", "settles_s"), [(8.0, 150.0), broad(6.0, 300.0), broad(10.0, 90.0), (-7.0, 200.0)])
def test_how_the_temperature_settles_is_seen_in_its_last_minutes(to_come_c, settles_s):
    t_s = np.arange(0, 120, 2.0)
    found = settling(np.stack([t_s, warm_up(to_come_c, settles_s, t_s)], axis=1))
    left_c = to_come_c * np.exp(-t_s[-1] / settles_s)
    assert found.to_come_c == pytest.approx(left_c, rel=0.1)
    assert found.settles_s == pytest.approx(settles_s, rel=0.15)
    assert found.at(np.array([0.0]))[0] == pytest.approx(25 + to_come_c - left_c, abs=0.02)


@pytest.mark.parametrize("settles_s", [broad(90.0), 150.0, broad(240.0)])
def test_it_says_how_long_to_wait_and_is_silent_after_so_long(settles_s):
    """From 30 s on: the minutes are those after which the true warm-up drifts by less than the bar.  Then it says nothing any more."""
    t_s = np.arange(0, 700, 2.0)
    temps = warm_up(9.0, settles_s, t_s)
    said = told(t_s, temps, [], 40)
    assert all(wait is None for at_s, wait in zip(t_s, said, strict=True) if at_s < 20)

    def drift(begin_s):
        later_s = begin_s + SEGMENT_S * np.arange(1, 41)
        return TYPICAL_RPS_PER_C * np.std(-9.0 * np.expm1(-later_s / settles_s))

    needed_s = next(at_s for at_s in t_s if drift(at_s) < BAR_RPS)
    for at_s in (30.0, 60.0):
        wait = said[int(at_s / 2)]
        assert wait.now_rps == pytest.approx(drift(at_s), rel=0.15)
        assert wait.then_rps < BAR_RPS < wait.now_rps
        assert abs(at_s + 60 * wait.minutes - needed_s) < 90  # whole minutes, and a forecast
        assert wait.left_min == pytest.approx(40 * SEGMENT_S / 60)
    last_s = max(at_s for at_s, wait in zip(t_s, said, strict=True) if wait)
    assert abs(last_s - needed_s) < 30


def test_one_segment_left_or_a_session_that_is_recorded_cold_is_gone_on_with():
    """Half of it recorded cold: a warm second half spreads the bias further, and waiting costs besides."""
    t_s = np.arange(0, 40, 2.0)
    temps = warm_up(3.0, 150.0, t_s)
    fresh = told(t_s, temps, stills_of(25 + np.zeros(1)), 40)[-1]
    assert fresh is None  # 1.8 mdps at a typical 5 mdps/°C
    cold = stills_of(np.linspace(25, 26.5, 20))
    strong = told(t_s, temps + 1.5, cold, 20)[-1]
    assert rps_per_c(cold) > 2 * TYPICAL_RPS_PER_C
    assert strong is None
    assert told(t_s, warm_up(9.0, 150.0, t_s), [], 1)[-1] is None


def test_what_a_degree_does_is_taken_from_the_stills():
    assert rps_per_c([]) == pytest.approx(TYPICAL_RPS_PER_C)
    assert rps_per_c(stills_of(np.linspace(25, 30, 15))) == pytest.approx(PER_C, rel=0.15)
    calm = rps_per_c(stills_of(np.linspace(25, 30, 15), per_c=0.0))
    assert calm < 0.3 * TYPICAL_RPS_PER_C
    t_s = np.arange(0, 100, 2.0)
    temps = warm_up(9.0, 150.0, t_s, start_c=29.0)
    assert told(t_s, temps, [], 40)[-1] is not None
    assert told(t_s, temps, stills_of(np.linspace(29, 33, 15), per_c=0.0), 40)[-1] is None


@pytest.mark.parametrize("c_per_min", [broad(0.0), 0.25, broad(-0.5), 1.0])
def test_a_room_that_warms_steadily_is_not_waited_for(c_per_min):
    """However long: waiting would gain nothing.  It was said for ever when the slope alone was looked at."""
    t_s = np.arange(0, 900, 2.0)
    temps = 25 + c_per_min * t_s / 60 + RNG_NOISE_C * np.random.default_rng(3).standard_normal(len(t_s))
    said = told(t_s, temps, stills_of(np.linspace(25, 25.2, 5)), 35)
    assert not any(wait for at_s, wait in zip(t_s, said, strict=True) if at_s > 240)


def test_a_new_log_begins_anew():
    warmth = WarmUp()
    for at_s in np.arange(0, 60, 1.0):
        warmth.feed(at_s, 25 + 9 * (1 - np.exp(-at_s / 150)))
    assert warmth.wait([], [], 40) is not None
    warmth.new_log()
    assert warmth.wait([], [], 40) is None


def seen(samples) -> tuple[str, dict]:
    guide, server = guide_of(), Kept()
    page = PageView(Silent(), server)
    play(guide, samples)
    page.show(guide)
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None, highlight=False)
    console.print(view(guide, "title", []))
    assert len(console.file.getvalue().splitlines()) <= 22
    return " ".join(console.file.getvalue().split()), server.last["state"]


def test_the_screen_and_the_page_say_it_in_minutes_and_mdps():
    samples = Table().rest(60).samples()
    warm = Samples(samples.t_ns, samples.gyro, samples.accel, 25 + 9 * (1 - np.exp(-samples.t_s / 150)))
    text, state = seen(warm)
    assert "wait 2 min, and the bias drifts by" in text
    assert "going on now (5 min), by" in text
    assert state["wait"] in text
    text, state = seen(Samples(samples.t_ns, samples.gyro, samples.accel, samples.temp_c))
    assert "wait " not in text
    assert state["wait"] is None


@pytest.mark.broad
def test_without_a_thermometer_nobody_waits():
    samples = Table().rest(40).samples()
    text, state = seen(Samples(samples.t_ns, samples.gyro, samples.accel, None))
    assert "warmth –" in text
    assert "wait " not in text
    assert state["wait"] is None
    guide = guide_of()
    play(guide, Samples(samples.t_ns, samples.gyro + 1e-3 * DEG, samples.accel, None))
    assert guide.wait is None
