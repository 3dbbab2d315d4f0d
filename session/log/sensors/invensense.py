"""TDK InvenSense: MPU-6050, 6500, 9150, 9250, ICM-20948, ICM-42688.

Their sensitivities are rounded in the data sheets, 16.4 LSB per dps for 32768 / 2000; the calibration takes up the 0.1 %.
"""

from __future__ import annotations

from session.log.sensors.profile import Divided, Figure, Profile, Thermometer, remembered

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


PROFILES = (
    Profile(
        name="MPU-6050",
        gyro=GYRO,
        accel=ACCEL,
        units=_MPU_6050,
        also=("MPU-6000",),
        thermometer=MPU_6050_THERMOMETER,
        divided=(Divided(1000.0), Divided(8000.0, 8)),
        gyro_noise_mdps_rthz=Figure(5.0, _MPU_6050),
        accel_noise_ug_rthz=Figure(400.0, _MPU_6050),
        zero_rate_dps=Figure(20.0, _MPU_6050),
        accel_zero_mg=Figure(80.0, _MPU_6050),
        works_c=WORKS_C,
    ),
    Profile(
        name="MPU-9150",
        gyro=GYRO,
        accel=ACCEL,
        units="that of the MPU-6050, which is in it",
        thermometer=MPU_6050_THERMOMETER,
        divided=(Divided(1000.0), Divided(8000.0, 8)),
        gyro_noise_mdps_rthz=Figure(5.0, f"{_MPU_6050}, which is in it"),
        accel_noise_ug_rthz=Figure(400.0, f"{_MPU_6050}, which is in it"),
        zero_rate_dps=Figure(20.0, f"{_MPU_6050}, which is in it"),
        accel_zero_mg=Figure(80.0, f"{_MPU_6050}, which is in it"),
        works_c=WORKS_C,
    ),
    Profile(
        name="MPU-6500",
        gyro=GYRO,
        accel=ACCEL,
        units="that of the MPU-9250, which holds it",
        thermometer=MPU_9250_THERMOMETER,
        divided=(Divided(1000.0), Divided(8000.0, 8)),
        gyro_noise_mdps_rthz=Figure(10.0, f"{_MPU_9250}, which holds it"),
        accel_noise_ug_rthz=Figure(300.0, f"{_MPU_9250}, which holds it"),
        zero_rate_dps=Figure(5.0, f"{_MPU_9250}, which holds it"),
        works_c=WORKS_C,
    ),
    Profile(
        name="MPU-9250",
        gyro=GYRO,
        accel=ACCEL,
        units=_MPU_9250,
        also=("MPU-9255",),
        thermometer=MPU_9250_THERMOMETER,
        divided=(Divided(1000.0), Divided(8000.0, 8)),
        gyro_noise_mdps_rthz=Figure(10.0, _MPU_9250),
        accel_noise_ug_rthz=Figure(300.0, _MPU_9250),
        zero_rate_dps=Figure(5.0, _MPU_9250),
        works_c=WORKS_C,
    ),
    Profile(
        name="ICM-20948",
        gyro=GYRO,
        accel=ACCEL,
        units=f"{_ICM_20948}; the thermometer's is remembered",
        thermometer=MPU_9250_THERMOMETER,
        divided=(Divided(1125.0), Divided(9000.0, 1)),
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
