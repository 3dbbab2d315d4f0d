"""What is known of one model of sensor: what its registers mean, how fast it measures, what a good one does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

#: a register of 16 bits holds -32768 to 32767; all sensors here have such registers, two's complement
REGISTER_MAX = 32767
REGISTER_SPAN = 32768


@dataclass(frozen=True)
class Figure:
    """A typical figure and where it is from.

    read: whether it was read there.  One that is only remembered is shown, and nothing is held against it.
    """

    value: float
    source: str
    read: bool = True


def remembered(value: float) -> Figure:
    """A figure that nobody looked up."""
    return Figure(value, "its data sheet, remembered", read=False)


#: by how much the data rate of a MEMS sensor differs from the nominal one, fraction, where its own figure is not known
CLOCK_WITHIN = Figure(0.05, "as of an ASM330LHH, the widest that units in public logs show")


@dataclass(frozen=True)
class Thermometer:
    """The temperature register: LSB per degC, and the temperature at which it reads 0."""

    lsb_per_c: float
    at_zero_c: float


@dataclass(frozen=True)
class Divided:
    """Data rates ``base_hz / n``, n = 1 … most."""

    base_hz: float
    most: int = 256

    def nearest_hz(self, hz: float) -> float:
        """The one nearest to a rate."""
        n = self.base_hz / hz
        whole = {min(max(int(n) + step, 1), self.most) for step in (0, 1)}
        return min((self.base_hz / one for one in whole), key=lambda rate: abs(rate / hz - 1))


@dataclass(frozen=True)
class Profile:
    """gyro: full scale in dps -> mdps per LSB, accel: full scale in g -> mg per LSB; None: any full scale, at REGISTER_SPAN counts.

    units: where these are from.  thermometer: None where its conversion is not known.  odr_hz: the gyroscope's nominal data rates, Hz;
    divided: those that a divider makes.  clock_within: by how much parts' rates differ from the nominal one, fraction.
    Typical figures: one-sided noise densities, bias instability, the greatest zero-rate level and accelerometer's zero of a good part;
    works_c: where it works.
    """

    name: str
    gyro: Mapping[float, float] | None
    accel: Mapping[float, float] | None
    units: str
    also: tuple[str, ...] = ()
    thermometer: Thermometer | None = None
    odr_hz: tuple[float, ...] = ()
    divided: tuple[Divided, ...] = ()
    clock_within: Figure | None = None
    gyro_noise_mdps_rthz: Figure | None = None
    accel_noise_ug_rthz: Figure | None = None
    gyro_bias_instability_dph: Figure | None = None
    zero_rate_dps: Figure | None = None
    accel_zero_mg: Figure | None = None
    works_c: tuple[float, float] | None = None

    @property
    def figures(self) -> dict[str, Figure]:
        """Those of its typical figures that are known, by name."""
        names = ("gyro_noise_mdps_rthz", "accel_noise_ug_rthz", "gyro_bias_instability_dph", "zero_rate_dps", "accel_zero_mg")
        return {name: figure for name in names if (figure := getattr(self, name)) is not None}

    def yardstick(self, name: str) -> float | None:
        """A typical figure that measurements may be held against: one that was read in its source; else None."""
        figure = self.figures.get(name)
        return figure.value if figure is not None and figure.read else None

    def nearest_hz(self, hz: float) -> float | None:
        """Its data rate that is nearest to one; None where its rates are not known."""
        rates = [*self.odr_hz, *(divided.nearest_hz(hz) for divided in self.divided)]
        return min(rates, key=lambda rate: abs(rate / hz - 1), default=None)
