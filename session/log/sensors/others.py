"""Bosch: BMI088, BMI270.  Analog Devices: ADIS16448.  And any sensor whose registers of 16 bits end at its full scale."""

from __future__ import annotations

from session.log.sensors.profile import REGISTER_SPAN, Figure, Profile, Thermometer, remembered

WORKS_C = (-40.0, 85.0)

_BMI088 = "data sheet (Bosch, BST-BMI088-DS001 Rev 1.3)"
_BMI270 = "data sheet (Bosch, BST-BMI270-DS000 Rev 1.3)"


def _to_span(*full_scales: float) -> dict[float, float]:
    """Full scales at REGISTER_SPAN counts: thousandths of their unit per LSB."""
    return {fs: 1000 * fs / REGISTER_SPAN for fs in full_scales}


PROFILES = (
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
