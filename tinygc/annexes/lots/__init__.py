"""Many units of one kind: spread, drift, repeatability, and what that tells of the next one."""
