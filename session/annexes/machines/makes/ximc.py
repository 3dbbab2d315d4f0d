"""Rotary stages on 8SMC controllers through libximc: a controller for each axis, whose ``word`` is its device name.

The library is an extra (``pip install 'tinygc[tables]'``).  ``xi-emu:///PATH`` is its own virtual controller.  [settings]:
``steps_per_deg``, full steps of the motor to a degree of the stage.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from session.annexes.machines.clocks import Clock
from session.annexes.machines.description import Description
from session.annexes.machines.verbs import TableFault, Where
from session.annexes.machines.wire import LineLost
from session.io.errors import FormatError
from session.io.units import DEG

TITLE = "rotary stages on 8SMC controllers (libximc), a controller for each axis"
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


class Ximc:
    """``Table`` over libximc."""

    has_rate_mode = True
    angles_lost = False

    def __init__(self, description: Description, library: Any):
        steps = description.settings.get("steps_per_deg")
        if not isinstance(steps, int | float) or isinstance(steps, bool) or not 0 < steps < 1e9:
            raise FormatError(f"{description.name}: settings.steps_per_deg is {steps!r}, expected full steps of the motor to a degree")
        self.description, self._library = description, library
        self._lock = threading.Lock()
        self._devices: list[Any] = []
        for axis in description.axes:
            with self._naming(axis.word):
                device = library.Axis(axis.word)
                device.open_device()
                self._devices.append(device)
                device.set_calb(1.0 / steps, device.get_engine_settings().MicrostepMode)

    def home(self) -> None:
        """Search the reference marks; the controllers' zeros are there."""
        self._each(lambda device: device.command_home())

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
        """Angles, and whether a command runs."""
        angles, moving = [], False
        for axis, device in zip(self.description.axes, self._devices, strict=True):
            with self._naming(axis.word), self._lock:
                status = device.get_status_calb()
            flags = self._library.StateFlags(status.Flags)
            if raised := [name for name in FAULTS if getattr(self._library.StateFlags, name) in flags]:
                raise TableFault(f"{self.description.name}: {axis.word} reports {', '.join(raised)}; see why, and switch it on again")
            command = self._library.MvcmdStatus(status.MvCmdSts)
            if self._library.MvcmdStatus.MVCMD_ERROR in command:
                raise TableFault(f"{self.description.name}: {axis.word} says that its last command failed")
            angles.append(status.CurPosition * DEG)
            moving = moving or self._library.MvcmdStatus.MVCMD_RUNNING in command
        return Where(np.array(angles), moving)

    def stop(self) -> None:
        """Bring all axes to rest, with their deceleration; the lock of an answer is not waited for."""
        self._each(lambda device: device.command_sstp())

    def close(self) -> None:
        """Close the controllers."""
        self._each(lambda device: device.close_device())

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
            raise LineLost(f"{self.description.name}: {word}: libximc reports {type(error).__name__}: {error}; is it connected?") from None


def open_table(description: Description, clock: Clock) -> Ximc:
    """Open all controllers.  TableFault where the library is missing or does not answer."""
    try:
        import libximc.highlevel as library
    except ImportError as error:
        raise TableFault(
            f"{description.name}: the make ximc needs libximc ({error}); "
            "python -m pip install 'libximc>=3.0.2,!=3.1.2' (3.1.2 runs on Windows alone)"
        ) from None
    return Ximc(description, library)
