"""How far a dial reading, or a turn, may be off before it is left out: just below and just above the stated bars."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, Table, session_of

from session.detect.dials import without_wrong_dials
from session.detect.segments import APART_RAD, APART_SHARE, session_segments
from session.detect.stills import SessionStills

TURNS, DIAL_DEG = 12, 0.6
ROLL, PITCH, YAW = range(3)


@pytest.fixture(scope="module")
def exact():
    """A session of exact readings, its parts, and the angles of its stills in degrees."""
    plan = Table().tumble(TURNS, seed=5)
    session = session_of(plan.samples(odr_hz=52, gyro_mdps=0.1, accel_ug=1.0, registers=False))
    protocol = replace(session.config.protocol, reference="table", dial_sigma_deg=DIAL_DEG)
    session = replace(session, config=replace(session.config, protocol=protocol))
    parts = session_segments(session, SessionStills(session))
    _, attitude = plan.truth(np.array([(start + stop) / 2 for start, stop in plan.rests]))
    return session, parts, attitude.as_euler("ZYX", degrees=True)[:, ::-1]


def left_out(exact, off_deg):
    """Numbers of the rows, and of the turns, that are left out of dial readings that are off by (13, 3) degrees."""
    session, parts, angles = exact
    session, parts, _ = without_wrong_dials(replace(session, attitudes=(angles + off_deg) * DEG), parts)
    assert session.attitudes is not None
    turns = [segment.number for segment in parts[0].segments if not segment.accepted]
    return np.flatnonzero(np.isnan(session.attitudes).any(axis=1)).tolist(), turns


def off(rows, column, by):
    found = np.zeros((TURNS + 1, 3))
    found[rows, column] = by
    return found


def test_exact_dials_stay(exact):
    assert left_out(exact, off([], YAW, 0.0)) == ([], [])


def test_the_bar_of_a_row_against_gravity(exact):
    """Of 13 rows chance alone takes one out once in 1000 sessions, if each is off by the declared error."""
    bar = DIAL_DEG * np.sqrt(2 * np.log(13 / 1e-3))
    assert left_out(exact, off(4, PITCH, 0.98 * bar)) == ([], [])
    assert left_out(exact, off(4, PITCH, 1.02 * bar)) == ([4], [])


def test_the_bar_of_a_turn_that_dials_miss(exact):
    """Two dials err in a turn; a sigma more, since three components are off together.  Turns on both sides of the row miss it."""
    bar = np.sqrt(2) * DIAL_DEG * (np.sqrt(2 * np.log(12 / 1e-3)) + 1)
    assert left_out(exact, off(7, YAW, 0.95 * bar)) == ([], [])
    assert left_out(exact, off(7, YAW, 1.07 * bar)) == ([7], [])


def test_a_turn_alone_is_missed_by_a_movement_of_its_own(exact):
    """From the next row on, all dials agree again."""
    turn = exact[1][0].segments[6]
    bar = APART_RAD / DEG + APART_SHARE * turn.turn_deg
    assert left_out(exact, off(slice(7, None), YAW, 0.95 * bar)) == ([], [])
    assert left_out(exact, off(slice(7, None), YAW, 1.07 * bar)) == ([], [6])
