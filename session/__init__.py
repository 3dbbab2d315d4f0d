"""The bench side: logs, stillness, segments.  Never imports ``tinygc``.

Conventions that hold in the whole project
------------------------------------------
Frames
    ``b``  body, forward-right-down.  ``n``  navigation, north-east-down.
    ``t``  table: ``n`` turned about the vertical by the table's heading; down is the same.
Attitude
    ``q_nb`` (..., 4) unit quaternion, Hamilton, scalar first, or ``R_nb`` (..., 3, 3): takes body vectors to ``n``.
    Euler angles are roll, pitch, yaw of ``R_nb = Rz(yaw) Ry(pitch) Rx(roll)``.
Specific force
    ``f = R_bn (a_n - g_n)``: level and still the accelerometer reads ``(0, 0, -g)``.
Rates
    ``m`` is the measured rate (register x sensitivity), ``omega`` the calibrated one: ``omega = E m + B``.
Units
    SI in memory: s, rad, rad/s, m/s^2, degC.  Time stamps are integer nanoseconds until they are a difference.
    Where a person reads or writes another unit, the name says so (``_deg``, ``_dps``, ``_mg``).
Arrays
    The last axis is x, y, z.  Sample ranges are half open: ``start <= i < stop``.
"""

#: the package's version, and what every file that is written says it was made with
VERSION = "0.1.0"
