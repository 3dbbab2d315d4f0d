"""What a rest log says of the noise, in constant memory: statistics of block means at each scale."""

from __future__ import annotations

from session.io.samples import Samples


class RestSums:
    """Statistics of one rest log or of one still, piece by piece in the order of time; ``add`` takes rates and forces in SI."""

    def __init__(self, rate_hz: float):
        self.rate_hz = rate_hz

    def add(self, samples: Samples) -> None:
        """Add the next samples (stamps, gyro rad/s, accel m/s^2, temp degC or None)."""
        raise NotImplementedError
