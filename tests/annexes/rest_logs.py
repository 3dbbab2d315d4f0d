"""Rest logs for the tests: simulated ones as records, and as files."""

from session.io.registers import DEFAULT, RegisterUnits, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.io.rests import RestLog, rest_from_samples
from session.io.samples import Samples
from tinygc.annexes.temperature.options import RestOptions
from tinygc.annexes.temperature.rest_simulation import Chip, simulate_rest
from tinygc.simulation.options import SimulationOptions

#: slow enough that a test of hours costs little
CHIP = Chip(odr_hz=13.0, gyro_fs_dps=500.0, accel_fs_g=4.0, gyro_noise_dps_rthz=0.005, accel_noise_ug_rthz=60.0, bias_instability_dph=3.0)
SESSION = SimulationOptions(odr_hz=62.5)


def rest_samples(seed: int = 0, chip: Chip = CHIP, **options) -> Samples:
    made = simulate_rest(RestOptions(**{"cycles": 3.0, "cycle_s": 1800.0, **options}), chip, seed)
    gyro, accel = made.gyro * gyro_rps_per_lsb(chip.gyro_fs_dps), made.accel * accel_mps2_per_lsb(chip.accel_fs_g)
    return Samples(made.t_us * 1000, gyro, accel, RegisterUnits(DEFAULT, None, None).temperature_c(made.temp))


def rest_log(seed: int = 0, name: str = "rest0001.csv", chip: Chip = CHIP, **options) -> RestLog:
    """Block means of a simulated rest log."""
    return rest_from_samples(rest_samples(seed, chip, **options), name)
