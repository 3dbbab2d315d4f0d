"""What is known of one model of sensor: what its registers mean, how fast it measures, what a good one does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

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
    """A figure that was not looked up."""
    return Figure(value, "its data sheet, remembered", read=False)


#: by how much the data rate of a MEMS sensor differs from the nominal one, fraction, where its own figure is not known
CLOCK_WITHIN = Figure(0.05, "as of an ASM330LHH, the widest that units in public logs show")


@dataclass(frozen=True)
class Thermometer:
    """The temperature register: LSB per degC, and the temperature at which it reads 0."""

    lsb_per_c: float
    at_zero_c: float


@dataclass(frozen=True)
class Profile:
    """gyro: full scale in dps -> mdps per LSB, accel: full scale in g -> mg per LSB; None: any full scale, at REGISTER_SPAN counts.

    units: where these are from.  thermometer: None where its conversion is not known.  odr_hz: the gyroscope's nominal data rates, Hz;
    divided: those that a divider makes, a base rate, Hz, over n = 1 … most.  clock_within: by how much parts' rates differ from the
    nominal one, fraction.  Typical figures: one-sided noise densities, bias instability, the greatest zero-rate level and
    accelerometer's zero of a good part; works_c: where it works.
    """

    name: str
    gyro: Mapping[float, float] | None
    accel: Mapping[float, float] | None
    units: str
    also: tuple[str, ...] = ()
    thermometer: Thermometer | None = None
    odr_hz: tuple[float, ...] = ()
    divided: tuple[tuple[float, int], ...] = ()
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
        rates = [*self.odr_hz, *(base / min(max(int(base / hz) + step, 1), most) for base, most in self.divided for step in (0, 1))]
        return min(rates, key=lambda rate: abs(rate / hz - 1), default=None)


# TDK InvenSense: MPU-6050, 6500, 9150, 9250, ICM-20948, ICM-42688.
#
# Their sensitivities are rounded in the data sheets, 16.4 LSB per dps for 32768 / 2000; the calibration takes up the 0.1 %.

GYRO: dict[float, float] = {fs: 1000 / lsb for fs, lsb in {250: 131.0, 500: 65.5, 1000: 32.8, 2000: 16.4}.items()}
GYRO_FINE: dict[float, float] = {fs: 1000 / lsb for fs, lsb in {15.625: 2097.2, 31.25: 1048.6, 62.5: 524.3, 125: 262.0}.items()} | GYRO
ACCEL: dict[float, float] = {fs: 1000 / lsb for fs, lsb in {2: 16384.0, 4: 8192.0, 8: 4096.0, 16: 2048.0}.items()}
#: reads -521 at 35 degC
MPU_6050_THERMOMETER = Thermometer(340.0, 35.0 + 521 / 340)
MPU_9250_THERMOMETER = Thermometer(333.87, 21.0)
WORKS_C = (-40.0, 85.0)

_MPU_6050 = "data sheet (InvenSense, PS-MPU-6000A-00 Rev 3.4)"
_MPU_9250 = "data sheet (InvenSense, PS-MPU-9250A-01 Rev 1.0)"
_ICM_20948 = "data sheet (TDK, DS-000189 Rev 1.3)"
_ICM_42688 = "data sheet (TDK, DS-000347)"


_MPU_6050_ITSELF = Profile(
    name="MPU-6050",
    gyro=GYRO,
    accel=ACCEL,
    units=_MPU_6050,
    also=("MPU-6000",),
    thermometer=MPU_6050_THERMOMETER,
    divided=((1000.0, 256), (8000.0, 8)),
    gyro_noise_mdps_rthz=Figure(5.0, _MPU_6050),
    accel_noise_ug_rthz=Figure(400.0, _MPU_6050),
    zero_rate_dps=Figure(20.0, _MPU_6050),
    accel_zero_mg=Figure(80.0, _MPU_6050),
    works_c=WORKS_C,
)
_MPU_9250_ITSELF = Profile(
    name="MPU-9250",
    gyro=GYRO,
    accel=ACCEL,
    units=_MPU_9250,
    also=("MPU-9255",),
    thermometer=MPU_9250_THERMOMETER,
    divided=((1000.0, 256), (8000.0, 8)),
    gyro_noise_mdps_rthz=Figure(10.0, _MPU_9250),
    accel_noise_ug_rthz=Figure(300.0, _MPU_9250),
    zero_rate_dps=Figure(5.0, _MPU_9250),
    works_c=WORKS_C,
)


def _within(whole: Profile, name: str, units: str, how: str) -> Profile:
    """A sensor that is one with another, whose figures it has."""
    figures: dict[str, Any] = {figure: replace(found, source=f"{found.source}, {how}") for figure, found in whole.figures.items()}
    return replace(whole, name=name, also=(), units=units, **figures)


INVENSENSE = (
    _MPU_6050_ITSELF,
    _within(_MPU_6050_ITSELF, "MPU-9150", "that of the MPU-6050, which is in it", "which is in it"),
    _within(_MPU_9250_ITSELF, "MPU-6500", "that of the MPU-9250, which holds it", "which holds it"),
    _MPU_9250_ITSELF,
    Profile(
        name="ICM-20948",
        gyro=GYRO,
        accel=ACCEL,
        units=f"{_ICM_20948}; the thermometer's is remembered",
        thermometer=MPU_9250_THERMOMETER,
        divided=((1125.0, 256), (9000.0, 1)),
        gyro_noise_mdps_rthz=remembered(15.0),
        accel_noise_ug_rthz=Figure(230.0, _ICM_20948),
        zero_rate_dps=remembered(5.0),
        works_c=WORKS_C,
    ),
    Profile(
        name="ICM-42688",
        gyro=GYRO_FINE,
        accel=ACCEL,
        units=f"{_ICM_42688}, as public drivers quote it",
        also=("ICM-42688P", "ICM-42688V"),
        thermometer=Thermometer(132.48, 25.0),
        odr_hz=(12.5, 25.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0, 16000.0, 32000.0),
        gyro_noise_mdps_rthz=Figure(2.8, _ICM_42688),
        accel_noise_ug_rthz=Figure(70.0, _ICM_42688),
        zero_rate_dps=remembered(0.5),
        works_c=WORKS_C,
    ),
)


# Bosch: BMI088, BMI270.  Analog Devices: ADIS16448.  And any sensor whose registers of 16 bits end at its full scale.

_BMI088 = "data sheet (Bosch, BST-BMI088-DS001 Rev 1.3)"
_BMI270 = "data sheet (Bosch, BST-BMI270-DS000 Rev 1.3)"


def _to_span(*full_scales: float) -> dict[float, float]:
    """Full scales at REGISTER_SPAN counts: thousandths of their unit per LSB."""
    return {fs: 1000 * fs / REGISTER_SPAN for fs in full_scales}


OTHERS = (
    Profile(
        name="BMI088",
        gyro=_to_span(125, 250, 500, 1000, 2000),
        accel=_to_span(3, 6, 12, 24),
        units=f"{_BMI088}; its temperature is the 11-bit number, not the two registers as they lie",
        thermometer=Thermometer(8.0, 23.0),
        odr_hz=(100.0, 200.0, 400.0, 1000.0, 2000.0),
        gyro_noise_mdps_rthz=remembered(14.0),
        accel_noise_ug_rthz=remembered(175.0),
        gyro_bias_instability_dph=remembered(2.0),
        zero_rate_dps=remembered(1.0),
        works_c=WORKS_C,
    ),
    Profile(
        name="BMI270",
        gyro=_to_span(125, 250, 500, 1000, 2000),
        accel=_to_span(2, 4, 8, 16),
        units=f"{_BMI270}; the thermometer's is that of the BMI160",
        thermometer=Thermometer(512.0, 23.0),
        odr_hz=(25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0, 6400.0),
        gyro_noise_mdps_rthz=Figure(7.0, _BMI270),
        accel_noise_ug_rthz=Figure(160.0, _BMI270),
        # It states ±0.5 dps, of which users found parts 3 dps away: no bar.
        zero_rate_dps=Figure(0.5, _BMI270, read=False),
        works_c=WORKS_C,
    ),
    Profile(
        name="ADIS16448",
        gyro={250: 10.0, 500: 20.0, 1000: 40.0},
        accel={18: 1000 / 1200},
        units="Linux driver adis16400.c (±1000 dps, ±18 g); the smaller ranges are remembered",
        thermometer=Thermometer(1 / 0.07386, 31.0),
        odr_hz=(819.2, 409.6, 204.8, 102.4, 51.2, 25.6, 12.8, 6.4),
        gyro_noise_mdps_rthz=remembered(13.5),
        accel_noise_ug_rthz=remembered(230.0),
        gyro_bias_instability_dph=remembered(14.5),
        zero_rate_dps=remembered(0.5),
        works_c=WORKS_C,
    ),
    Profile(
        name="generic",
        gyro=None,
        accel=None,
        units="the full scale, at 32768 counts; right for most sensors that are not of ST or Analog Devices",
    ),
)


# ST: the LSM6DSx family with its automotive and industrial siblings, and the LSM9DS1.
#
# Their registers go further than the full scale: 32767 counts of 17.5 mdps are 573 dps at ±500 dps.

ST_GYRO: dict[float, float] = {125: 4.375, 250: 8.75, 500: 17.5, 1000: 35.0, 2000: 70.0}
GYRO_4000: dict[float, float] = ST_GYRO | {4000: 140.0}
ST_ACCEL: dict[float, float] = {2: 0.061, 4: 0.122, 8: 0.244, 16: 0.488}
FINE, COARSE = Thermometer(256.0, 25.0), Thermometer(16.0, 25.0)
ODR_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1667.0, 3333.0, 6667.0)
INDUSTRIAL_C, CONSUMER_C = (-40.0, 105.0), (-40.0, 85.0)

_DHCX = "data sheet of its sibling ISM330DHCX (ST, DS13012 Rev 6)"
_OWN_DHCX = "data sheet (ST, DS13012 Rev 6)"
_REMEMBERED = "the LSM6DSx family's, remembered"


_LSM6DSO = Profile(
    name="LSM6DSO",
    gyro=ST_GYRO,
    accel=ST_ACCEL,
    units="ST's driver lsm6dso_reg.c; data sheet (ST, DS12140 Rev 2)",
    thermometer=FINE,
    odr_hz=ODR_HZ,
    gyro_noise_mdps_rthz=remembered(3.8),
    accel_noise_ug_rthz=remembered(70.0),
    zero_rate_dps=remembered(1.0),
    works_c=CONSUMER_C,
)
_ISM330DHCX = Profile(
    name="ISM330DHCX",
    gyro=GYRO_4000,
    accel=ST_ACCEL,
    units="data sheet (ST, DS13012 Rev 6)",
    thermometer=FINE,
    odr_hz=ODR_HZ,
    gyro_noise_mdps_rthz=Figure(5.0, _OWN_DHCX),
    accel_noise_ug_rthz=Figure(60.0, _OWN_DHCX),
    gyro_bias_instability_dph=Figure(3.0, _OWN_DHCX),
    zero_rate_dps=Figure(3.0, _OWN_DHCX),
    accel_zero_mg=Figure(65.0, _OWN_DHCX),
    works_c=INDUSTRIAL_C,
)

ST = (
    Profile(
        name="ASM330LHH",
        gyro=GYRO_4000,
        accel=ST_ACCEL,
        units="ST's driver asm330lhh_reg.c",
        thermometer=FINE,
        odr_hz=ODR_HZ,
        clock_within=Figure(0.05, "INTERNAL_FREQ_FINE of units in public logs, ST's driver"),
        gyro_noise_mdps_rthz=Figure(5.0, f"{_DHCX}; as in public logs of two units"),
        accel_noise_ug_rthz=Figure(60.0, f"{_DHCX}; as in public logs of two units"),
        gyro_bias_instability_dph=Figure(3.0, _DHCX),
        zero_rate_dps=Figure(3.0, _DHCX),
        accel_zero_mg=Figure(65.0, _DHCX),
        works_c=INDUSTRIAL_C,
    ),
    Profile(
        name="ASM330LHHX",
        gyro=GYRO_4000,
        accel=ST_ACCEL,
        units="that of the ASM330LHH, whose registers it has",
        also=("ASM330LHB",),
        thermometer=FINE,
        odr_hz=ODR_HZ,
        works_c=INDUSTRIAL_C,
    ),
    _ISM330DHCX,
    replace(_LSM6DSO, name="ISM330DLC", units=_REMEMBERED, accel_noise_ug_rthz=remembered(75.0), zero_rate_dps=None),
    _LSM6DSO,
    replace(_LSM6DSO, name="LSM6DSOX", units="that of the LSM6DSO, remembered"),
    replace(
        _LSM6DSO,
        name="LSM6DSR",
        gyro=GYRO_4000,
        units=_REMEMBERED,
        also=("LSM6DSRX",),
        gyro_noise_mdps_rthz=remembered(5.0),
        accel_noise_ug_rthz=remembered(60.0),
    ),
    replace(
        _LSM6DSO,
        name="LSM6DSL",
        units="data sheet (ST, LSM6DSM, DocID028165 Rev 7), as ST quotes it",
        also=("LSM6DSM", "LSM6DS3TR-C"),
        gyro_noise_mdps_rthz=remembered(4.0),
        accel_noise_ug_rthz=remembered(80.0),
        zero_rate_dps=remembered(3.0),
    ),
    Profile(
        name="LSM6DS3",
        gyro=ST_GYRO,
        accel=ST_ACCEL,
        units="ST's driver lsm6ds3_reg.c",
        also=("LSM6DS33",),
        thermometer=COARSE,
        odr_hz=(12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1667.0),
        gyro_noise_mdps_rthz=Figure(7.0, "data sheet (ST, LSM6DS33, Table 3)"),
        accel_noise_ug_rthz=Figure(90.0, "data sheet (ST, LSM6DS33, Table 3)"),
        zero_rate_dps=Figure(10.0, "data sheet (ST, LSM6DS33, Table 3)"),
        works_c=CONSUMER_C,
    ),
    Profile(
        name="LSM9DS1",
        gyro={245: 8.75, 500: 17.5, 2000: 70.0},
        accel={2: 0.061, 4: 0.122, 8: 0.244, 16: 0.732},
        units="data sheet (ST, DocID025715 Rev 3); ±16 g is coarser, which ST confirms",
        thermometer=COARSE,
        odr_hz=(14.9, 59.5, 119.0, 238.0, 476.0, 952.0),
        zero_rate_dps=remembered(30.0),
        works_c=CONSUMER_C,
    ),
)
