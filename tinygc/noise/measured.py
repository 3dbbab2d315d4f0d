"""Noise figures that were measured at rest (``noise.json``), used for a session of the same unit.

They are the prior of the session's bias drift (``session_instability``), and the session is held against them: its white noise and its
bias drift may contradict them (``compared``).
"""

from __future__ import annotations

from session.io.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, G

#: terms that make a bias drift at random; a ramp is none: a steady drift is taken out of the stills before their drift is estimated
WALKS = ("G", "B", "K")
SENSORS = {"gyro": "gyroscope", "accel": "accelerometer"}
#: units in which people read N, B and K, and their SI values
SHOWN = {
    "gyro": {"N": ("°/√h", DEG_PER_SQRT_HOUR), "B": ("°/h", DEG_PER_HOUR), "K": ("°/h/√h", DEG_PER_HOUR / 60)},
    "accel": {"N": ("m/s/√h", 1 / 60), "B": ("µg", 1e-6 * G), "K": ("µg/√h", 1e-6 * G / 60)},
}
