"""Several units on one rigid body: clocks, mountings and parameters together, and all units as one gyroscope."""
