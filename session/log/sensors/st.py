"""ST: the LSM6DSx family with its automotive and industrial siblings, and the LSM9DS1.

Their registers go further than the full scale: 32767 counts of 17.5 mdps are 573 dps at ±500 dps.
"""

from __future__ import annotations

from dataclasses import replace

from session.log.sensors.profile import Figure, Profile, Thermometer, remembered

GYRO: dict[float, float] = {125: 4.375, 250: 8.75, 500: 17.5, 1000: 35.0, 2000: 70.0}
GYRO_4000: dict[float, float] = GYRO | {4000: 140.0}
ACCEL: dict[float, float] = {2: 0.061, 4: 0.122, 8: 0.244, 16: 0.488}
FINE, COARSE = Thermometer(256.0, 25.0), Thermometer(16.0, 25.0)
ODR_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1667.0, 3333.0, 6667.0)
INDUSTRIAL_C, CONSUMER_C = (-40.0, 105.0), (-40.0, 85.0)

_DHCX = "data sheet of its sibling ISM330DHCX (ST, DS13012 Rev 6)"
_OWN_DHCX = "data sheet (ST, DS13012 Rev 6)"


_LSM6DSO = Profile(
    name="LSM6DSO",
    gyro=GYRO,
    accel=ACCEL,
    units="ST's driver lsm6dso_reg.c; data sheet (ST, DS12140 Rev 2)",
    thermometer=FINE,
    odr_hz=ODR_HZ,
    gyro_noise_mdps_rthz=remembered(3.8),
    accel_noise_ug_rthz=remembered(70.0),
    zero_rate_dps=remembered(1.0),
    works_c=CONSUMER_C,
)

PROFILES = (
    Profile(
        name="ASM330LHH",
        gyro=GYRO_4000,
        accel=ACCEL,
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
        accel=ACCEL,
        units="that of the ASM330LHH, whose registers it has",
        also=("ASM330LHB",),
        thermometer=FINE,
        odr_hz=ODR_HZ,
        works_c=INDUSTRIAL_C,
    ),
    Profile(
        name="ISM330DHCX",
        gyro=GYRO_4000,
        accel=ACCEL,
        units="data sheet (ST, DS13012 Rev 6)",
        thermometer=FINE,
        odr_hz=ODR_HZ,
        gyro_noise_mdps_rthz=Figure(5.0, _OWN_DHCX),
        accel_noise_ug_rthz=Figure(60.0, _OWN_DHCX),
        gyro_bias_instability_dph=Figure(3.0, _OWN_DHCX),
        zero_rate_dps=Figure(3.0, _OWN_DHCX),
        accel_zero_mg=Figure(65.0, _OWN_DHCX),
        works_c=INDUSTRIAL_C,
    ),
    Profile(
        name="ISM330DLC",
        gyro=GYRO,
        accel=ACCEL,
        units="the LSM6DSx family's, remembered",
        thermometer=FINE,
        odr_hz=ODR_HZ,
        gyro_noise_mdps_rthz=remembered(3.8),
        accel_noise_ug_rthz=remembered(75.0),
        works_c=CONSUMER_C,
    ),
    _LSM6DSO,
    replace(_LSM6DSO, name="LSM6DSOX", units="that of the LSM6DSO, remembered"),
    Profile(
        name="LSM6DSR",
        gyro=GYRO_4000,
        accel=ACCEL,
        units="the LSM6DSx family's, remembered",
        also=("LSM6DSRX",),
        thermometer=FINE,
        odr_hz=ODR_HZ,
        gyro_noise_mdps_rthz=remembered(5.0),
        accel_noise_ug_rthz=remembered(60.0),
        zero_rate_dps=remembered(1.0),
        works_c=CONSUMER_C,
    ),
    Profile(
        name="LSM6DSL",
        gyro=GYRO,
        accel=ACCEL,
        units="data sheet (ST, LSM6DSM, DocID028165 Rev 7), as ST quotes it",
        also=("LSM6DSM", "LSM6DS3TR-C"),
        thermometer=FINE,
        odr_hz=ODR_HZ,
        gyro_noise_mdps_rthz=remembered(4.0),
        accel_noise_ug_rthz=remembered(80.0),
        zero_rate_dps=remembered(3.0),
        works_c=CONSUMER_C,
    ),
    Profile(
        name="LSM6DS3",
        gyro=GYRO,
        accel=ACCEL,
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
