"""What lies beside the file that is tried: a log of a sensor that lies still, and its header."""

from __future__ import annotations

COUNT = 12
PERIOD_US = 9600
UNIT_HEADER = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"
UNIT_LINES = "".join(f"{4_000_000 + PERIOD_US * k},{0.5 + 0.01 * (k % 3)},-0.3,0.6,0,0.001,-1\n" for k in range(COUNT))
