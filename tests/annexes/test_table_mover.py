"""What the movers of a recording send, and when they stop: without a table and without samples, term by term."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from table_recordings import Bench, table_toml

from session.annexes.machines.description import read_description
from session.annexes.machines.dials import write_attitudes
from session.annexes.machines.mover import TableMover
from session.annexes.machines.rates import RateMover, RatesGuide, RateStep
from session.annexes.machines.verbs import Where
from session.bench.closure_guide import Step
from session.bench.messages import AxisMove, Stage
from session.bench.mover import Moment
from session.detect.stills import SessionStills
from session.io.config import Protocol
from session.io.units import DEG
from tinygc import read_session
from tinygc.annexes.machines.planner import TableMoves, plan_of, seconds_of


class Driver:
    """Stands for ``TableDriver``: it keeps what it was told."""

    trouble, fault, busy = None, "", False

    def __init__(self, table, angles_deg):
        self.table, self.where = SimpleNamespace(description=table), Where(np.multiply(angles_deg, DEG), False)
        self.told, self.time_s = [], 100.0

    def now_s(self):
        return self.time_s

    def heard(self, moment):
        pass

    def tick_if_alone(self):
        pass

    def make(self, moves):
        self.told += moves

    def turn_at(self, axis, rate_rps):
        self.told.append((axis, rate_rps))

    def stop(self):
        self.told.append("stop")


@pytest.fixture
def table(tmp_path):
    """A middle axis with limits, and an inner one without."""
    (tmp_path / "table.toml").write_text(table_toml("middle", "inner", limits={"middle": (-90, 270)}))
    return read_description(tmp_path / "table.toml")


def guide(**given):
    taken = SimpleNamespace(stills=[], turns=[], gyro_fs_rps=500 * DEG)
    usual = {"stage": Stage.TURN, "turning": False, "closure": None, "coached": False, "asked_for": SimpleNamespace(advice=None)}
    return SimpleNamespace(taken=taken, now_s=0.0, waits=lambda stage, why: None, **usual | given)


def test_a_move_stays_below_its_share_of_the_sensors_full_scale(table):
    rates = []

    def choose(most_rps):
        rates.append(most_rps)
        return (AxisMove(0, 1.0, most_rps),)

    driver = Driver(table, (0, 0))
    TableMover(driver, SimpleNamespace(angles=None, choose=choose)).step(guide(), None, False)
    assert rates == pytest.approx([300 * DEG])
    assert driver.told == [AxisMove(0, 1.0, rates[0])]


@pytest.mark.parametrize(("silent_s", "told"), [(1.9, []), (2.1, ["stop"])])
def test_a_table_that_moves_unseen_is_stopped(table, silent_s, told):
    driver = Driver(table, (0, 0))
    driver.busy = True
    mover = TableMover(driver, SimpleNamespace(angles=None))
    mover.step(guide(turning=True), Moment("log0001.csv", 0, round((driver.time_s - silent_s) * 1e9)), False)
    assert driver.told == told


@pytest.mark.parametrize(("silent_s", "told"), [(1.9, []), (2.1, ["stop"])])
def test_a_rate_step_that_nobody_sees_is_stopped_and_made_again(table, silent_s, told):
    driver, step = Driver(table, (0, 0)), RateStep(1, 20 * DEG, 4.0)
    of_rates = RatesGuide(Protocol(), 1)
    of_rates.stage = Stage.HOLD_STILL
    mover = RateMover(driver, [step])
    for later_s in (0.0, 0.1, 3.2):  # rest, and the turn begins
        driver.time_s += later_s
        mover.step(of_rates, Moment("rates0001.csv", 0, round(driver.time_s * 1e9)), False)
    assert driver.told == [(1, 20 * DEG)]
    driver.told.clear()
    mover.step(of_rates, Moment("rates0001.csv", 0, round((driver.time_s - silent_s) * 1e9)), False)
    assert driver.told == told
    for later_s in (0.1, 0.1, 3.2):
        driver.time_s += later_s
        mover.step(of_rates, Moment("rates0001.csv", 0, round(driver.time_s * 1e9)), False)
    assert driver.told == told + [(1, 20 * DEG)] * len(told)


@pytest.mark.parametrize(
    ("at_deg", "back_deg"),
    [((0, 0), []), ((90, 0), [(0, 0)]), ((0, 730), [(1, 720)]), ((0, -530), [(1, -360)]), ((200, 360), [(0, 0)])],
)
def test_the_closure_run_ends_on_its_mark_by_the_short_way(table, at_deg, back_deg):
    """Whole turns of an axis without limits stay as they are; one with limits goes all the way back."""
    driver, run = Driver(table, (0, 0)), SimpleNamespace(step=Step.MARK, enough=True, on_the_mark=lambda: None)
    mover, closing = TableMover(driver, SimpleNamespace(angles=None)), guide(stage=Stage.CLOSURE, closure=run)
    mover.step(closing, None, False)
    driver.where, run.step = Where(np.multiply(at_deg, DEG), False), Step.RUN
    mover.step(closing, None, False)
    assert [(move.axis, move.angle_rad / DEG) for move in driver.told] == [(axis, pytest.approx(angle)) for axis, angle in back_deg]


def test_a_move_takes_its_ramps_and_a_plan_its_turns(table):
    """Of 90 deg at 30 dps and 100 dps^2 the ramps add 0.3 s; one of 1 deg never reaches the rate.  A turn has its still besides."""
    assert seconds_of(90 * DEG, 30 * DEG, 100 * DEG) == pytest.approx((3.3, 0.3))
    assert seconds_of(-1 * DEG, 30 * DEG, 100 * DEG) == pytest.approx((0.2, 0.1))
    plan = plan_of(TableMoves(table, np.zeros(2), 1.5), False, 3, False)
    angles, expected_s = np.zeros(2), 0.0
    for turn in plan.turns:
        for move in turn.moves:
            expected_s += abs(move.angle_rad - angles[move.axis]) / (90 * DEG) + 90 / 200
            angles[move.axis] = move.angle_rad
        expected_s += 0.6 + 1.5
    assert plan.seconds == pytest.approx(expected_s)


def test_an_attitude_needs_answers_that_agree_within_the_still(tmp_path):
    """Answers at its ends may be late, 0.2 s; one between them that differs by more than 5 sigma takes the attitude away."""
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    bench.record(segments=1)
    log = read_session(bench.folder).logs[0]
    still = SessionStills(read_session(bench.folder)).of(log).stills[1]
    begin, end = log.samples.t_ns[[still.start, still.stop - 1]] / 1000
    path = bench.folder / "table.csv"
    lines = path.read_text().splitlines()
    at_us = {number: float(line.split(",")[1]) for number, line in enumerate(lines) if line.startswith("log0")}
    within = [number for number, t_us in at_us.items() if begin <= t_us <= end]

    def changed(numbers):
        rows = list(lines)
        for number in numbers:
            cells = rows[number].split(",")
            rows[number] = ",".join([*cells[:-1], f"{float(cells[-1]) + 0.3:.4f}"])
        path.write_text("\n".join(rows) + "\n")
        return write_attitudes(bench.folder)

    assert changed([]) == 2
    assert changed([number for number in within if min(at_us[number] - begin, end - at_us[number]) < 0.19e6]) == 2
    assert changed(within[len(within) // 2 :][:1]) == 1
