"""What a real table does when it is told to turn: the errors between its word and the truth.

The angle that a machine says of axis k, alpha, and the true one, with the sense s of its last motion (+1, -1, 0 before any):

    alpha_true = alpha + i1 sin alpha + i2 cos alpha + i3 sin 2 alpha + i4 cos 2 alpha      index: an encoder's eccentricity
                 + r sin(n alpha + phase)                                                   rate ripple: a motor's steps, a worm
                 - s backlash / 2 + lost                                                    play; steps that the motor lost

Tilt, skew and wobble are those of ``machines.description``.  The angle is said ``latency_s`` late.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tinygc.features.tables import board
from tinygc.features.tables.machines import description, virtual_motion

#: a play too small for any encoder: its whole way is one step
NO_PLAY_RAD = 1e-9


@dataclass(frozen=True, eq=False)
class AxisErrors(description.AxisErrors):
    """Further errors of one axis, rad: index (4,), ripple and its cycles a turn and phase, backlash."""

    index: np.ndarray = field(default_factory=lambda: np.zeros(4))
    ripple: float = 0.0
    ripple_cycles: int = 0
    ripple_phase: float = 0.0
    backlash: float = 0.0

    def true_angle(self, reported, sense):
        """(N,) rad, of what the machine reports (N,) rad and the sense (N,) of its last motion."""
        return reported + self.periodic(reported, sense)

    def periodic(self, reported, sense):
        """(N,) rad by which it lies beside what the machine reports."""
        i1, i2, i3, i4 = self.index
        index = i1 * np.sin(reported) + i2 * np.cos(reported) + i3 * np.sin(2 * reported) + i4 * np.cos(2 * reported)
        return index + self.ripple * np.sin(self.ripple_cycles * reported + self.ripple_phase) - sense * self.backlash / 2 + self.lost


@dataclass(frozen=True, eq=False)
class TableErrors(description.TableErrors):
    """Errors of a table, with the latency of its word."""

    axes: tuple[AxisErrors, ...]
    latency_s: float = 0.0

    @classmethod
    def none(cls, table):
        """A perfect table."""
        return cls(tuple(AxisErrors() for _ in table.axes))


def true_attitudes(table, errors, reported, sense):
    """``R_tb`` (N, 3, 3) with all errors, of angles said (N, K) rad and the senses (N, K) of the axes' last motions."""
    axes = tuple(description.AxisErrors(of.periodic(reported[:, k], sense[:, k]), of.skew, of.wobble) for k, of in enumerate(errors.axes))
    return description.true_attitudes(table, description.TableErrors(axes, errors.tilt), reported)


class AxisTrack(virtual_motion.AxisTrack):
    """A motor with a play of ``backlash`` rad between it and its stage."""

    def __init__(self, angle_rad=0.0, backlash=0.0):
        super().__init__(angle_rad)
        self._backlash = backlash

    def said_and_sense(self, t_s):
        """Angle said (N,) rad and sense (N,) at times (N,) s: the sense is where in its play the stage hangs, -1 to 1."""
        begins = [begin_s for begin_s, *_ in self._pieces]
        ways = [0.0, *np.diff([self._pieces[0][1], *self.reported(np.array(begins[1:]))])]
        senses = [0.0]
        for way in ways[1:]:
            senses.append(self._hangs(senses[-1], way))
        at = np.searchsorted(begins, t_s, side="right") - 1
        reported, begun = self.reported(t_s), np.array([self._pieces[0][1], *self.reported(np.array(begins[1:]))])
        return reported, self._hangs(np.array(senses)[at], reported - begun[at])

    def _hangs(self, sense, way):
        return np.clip(sense + 2 * way / max(self._backlash, NO_PLAY_RAD), -1.0, 1.0)


def motion_on(table, errors, tracks, options, unit):
    """Motion of a sensor on a table with errors; of a track without play no sense is known, and none matters."""

    def body(t_s):
        reported = np.stack([track.reported(t_s) for track in tracks], axis=-1)
        return true_attitudes(table, errors, reported, np.zeros_like(reported))

    return board.motion_on(body, options, unit)
