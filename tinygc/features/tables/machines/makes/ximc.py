"""Rotary stages on 8SMC controllers through libximc: a controller for each axis, whose ``word`` is its device name.

The library is an extra (``pip install 'tinygc[tables]'``).  ``xi-emu:///PATH`` is its own virtual controller, which finds no marks.
[settings]: ``steps_per_deg``, full steps of the motor to a degree of the stage.

Zero is where homing ends.  The library's own ``command_homezero`` returns when it has ended, and may count a place where it was stopped
as zero; so its two halves are sent from here: ``command_home``, and ``command_zero`` behind a homing that ended by itself.  An angle is
believed while the controller reports that it is homed (``STATE_IS_HOMED``), or since a person confirmed that the axis stands at its zero.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from session.base.errors import FormatError
from session.base.units import DEG
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.verbs import Table, TableFault, Where

TITLE = "8SMC controllers (libximc), a controller an axis"
#: s within which a controller begins to home; until then its word is of the command before
TAKEN_UP_S = 2.0
#: what libximc raises
ERRORS = (RuntimeError, ValueError, NotImplementedError, OSError)
#: flags of a controller that is not fit to move
FAULTS = (
    "STATE_ALARM",
    "STATE_CTP_ERROR",
    "STATE_POWER_OVERHEAT",
    "STATE_CONTROLLER_OVERHEAT",
    "STATE_H_BRIDGE_FAULT",
    "STATE_ENCODER_FAULT",
)


class Ximc(Table):
    """``Table`` over libximc."""

    has_rate_mode = True

    def __init__(self, description: Description, library: Any, clock: Clock):
        steps = description.settings.get("steps_per_deg")
        if not isinstance(steps, int | float) or isinstance(steps, bool) or not 0 < steps < 1e9:
            raise FormatError(f"{description.name}: settings.steps_per_deg is {steps!r}, expected full steps of the motor to a degree")
        self.description, self._library, self._clock = description, library, clock
        self._lock = threading.Lock()
        self._devices: list[Any] = []
        self._known: list[bool] = []  # which angles mean something
        for axis in description.axes:
            with self._naming(axis.word):
                device = library.Axis(axis.word)
                device.open_device()
                self._devices.append(device)
                device.set_calb(1.0 / steps, device.get_engine_settings().MicrostepMode)
                self._known.append(self._is_homed(device.get_status_calb()))
        self._by_hand = [False] * len(self._known)  # which zeros a person has stated
        self._homing: list[float | None] = [None] * len(self._known)  # since when an axis searches its mark; -inf: it was seen to turn
        self.angles_lost = not all(self._known)

    def home(self) -> None:
        """Search the reference marks; the controllers' zeros are where that ends."""
        count = len(self._known)
        self._known, self._by_hand, self.angles_lost = [False] * count, [False] * count, True
        self._homing = [self._clock.now_s()] * count
        self._each(lambda device: device.command_home())

    def set_zero(self) -> None:
        """A person confirms that every axis stands at its zero: so those that are not homed count from here."""
        for number, device in enumerate(self._devices):
            if not self._known[number]:
                with self._naming(self.description.axes[number].word), self._lock:
                    if self._is_running(device.get_status_calb()):
                        raise TableFault(f"{self.description.name}: it moves; stop it before you state that it stands at zero")
                    device.command_zero()
                self._known[number] = self._by_hand[number] = True

    def turn_to(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """Begin to turn one axis to an angle."""
        with self._naming(self.description.axes[axis].word), self._lock:
            self._set_rate(axis, rate_rps)
            self._devices[axis].command_move_calb(angle_rad / DEG)

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Begin to turn one axis at a rate."""
        with self._naming(self.description.axes[axis].word), self._lock:
            device = self._devices[axis]
            if not rate_rps:
                device.command_sstp()
                return
            self._set_rate(axis, rate_rps)
            (device.command_right if rate_rps > 0 else device.command_left)()

    def where(self) -> Where:
        """Angles, and whether a command runs.  NaN of an axis that is not homed.  TableFault where homing fails, or its zero is lost."""
        angles, moving, homing = [], False, self._homing  # a stop puts another list in its place
        for number, (axis, device) in enumerate(zip(self.description.axes, self._devices, strict=True)):
            with self._naming(axis.word), self._lock:
                status = device.get_status_calb()
                flags = self._library.StateFlags(status.Flags)
                if raised := [name for name in FAULTS if getattr(self._library.StateFlags, name) in flags]:
                    self._fail(f"{axis.word} reports {', '.join(raised)}; see why, and switch it on again")
                running = self._is_running(status)
                if (begin_s := homing[number]) is not None:
                    homing[number] = begin_s = -np.inf if running else begin_s
                    running = running or self._clock.now_s() - begin_s < TAKEN_UP_S
                if not running and self._library.MvcmdStatus.MVCMD_ERROR in self._library.MvcmdStatus(status.MvCmdSts):
                    self._fail(f"{axis.word} reports that its last command failed")
                if begin_s is not None and not running:
                    homing[number] = None
                    self._end_homing(number, status)
                    status = device.get_status_calb()
            if self._known[number] and not self._by_hand[number] and not self._is_homed(status):
                self._known[number], self.angles_lost = False, True
                self._fail(f"{axis.word} is not homed any more (STATE_IS_HOMED): its angle is lost; home it")
            angles.append(status.CurPosition * DEG if self._known[number] else np.nan)
            moving = moving or running
        return Where(np.array(angles), moving)

    def look(self) -> np.ndarray:
        """Angles (K,) rad as they are counted, homed or not: to see whether it rests."""
        angles = []
        for axis, device in zip(self.description.axes, self._devices, strict=True):
            with self._naming(axis.word), self._lock:
                angles.append(device.get_status_calb().CurPosition * DEG)
        return np.array(angles)

    def stop(self) -> None:
        """Bring all axes to rest, with their deceleration; the lock of an answer is not waited for."""
        self._homing = [None] * len(self._known)
        self._each(lambda device: device.command_sstp())

    def close(self) -> None:
        """Close the controllers."""
        self._each(lambda device: device.close_device())

    def _is_homed(self, status: Any) -> bool:
        return self._library.StateFlags.STATE_IS_HOMED in self._library.StateFlags(status.Flags)

    def _is_running(self, status: Any) -> bool:
        return self._library.MvcmdStatus.MVCMD_RUNNING in self._library.MvcmdStatus(status.MvCmdSts)

    def _end_homing(self, number: int, status: Any) -> None:
        """It ended: there is zero.  TableFault where another command ended it, or where it does not count as homed."""
        word, kind = self.description.axes[number].word, self._library.MvcmdStatus
        if kind(status.MvCmdSts) & kind.MVCMD_NAME_BITS != kind.MVCMD_HOME:
            self._fail(f"{word}: its homing was ended by another command; home it again")
        self._devices[number].command_zero()
        if not self._is_homed(status):
            self._fail(f"{word} has ended its homing, and does not report that it is homed (STATE_IS_HOMED): has it a mark?")
        self._known[number] = True

    def _fail(self, why: str) -> None:
        raise TableFault(f"{self.description.name}: {why}")

    def _set_rate(self, axis: int, rate_rps: float) -> None:
        settings = self._devices[axis].get_move_settings_calb()
        settings.Speed = abs(rate_rps) / DEG
        settings.Accel = settings.Decel = self.description.axes[axis].acceleration_rps2 / DEG
        self._devices[axis].set_move_settings_calb(settings)

    def _each(self, command: Callable[[Any], None]) -> None:
        """For every device, also where one fails; then the first failure is raised."""
        failed: list[TableFault] = []
        for axis, device in zip(self.description.axes, self._devices, strict=False):
            try:
                with self._naming(axis.word):
                    command(device)
            except TableFault as fault:
                failed.append(fault)
        if failed:
            raise failed[0]

    @contextmanager
    def _naming(self, word: str) -> Iterator[None]:
        try:
            yield
        except ERRORS as error:
            raise TableFault(
                f"{self.description.name}: {word}: libximc reports {type(error).__name__}: {error}; is it connected?"
            ) from None


def open_table(description: Description, clock: Clock) -> Ximc:
    """Open all controllers.  TableFault where the library is missing or does not answer."""
    try:
        import libximc.highlevel as library
    except ImportError as error:
        raise TableFault(
            f"{description.name}: the make ximc needs libximc ({error}); "
            "python -m pip install 'libximc>=3.0.2,!=3.1.2' (3.1.2 runs on Windows alone)"
        ) from None
    return Ximc(description, library, clock)
