"""One unit over its life: whether a calibration holds, what its numbers do, what they are worth."""
