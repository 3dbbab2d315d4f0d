"""docs/formats/models.md: model files, and ``accelerometer --json``."""

from __future__ import annotations

from .commands import VERSIONS
from .fit import ACCELEROMETER
from .shapes import (
    COUNT,
    HASH,
    INTERVAL,
    MATRIX,
    NUMBER,
    PARAMETERS,
    SHARE,
    SIZE,
    TEXT,
    VECTOR,
    array,
    both,
    by_kind,
    maybe,
    other,
    words,
)

_SENSOR = {
    "model": TEXT,
    "serial": TEXT,
    "odr_hz": SIZE,
    "gyro_fs_dps": SIZE,
    "accel_fs_g?": SIZE,
    "gyro_mdps_per_lsb?": SIZE,
    "accel_mg_per_lsb?": SIZE,
    "temp_lsb_per_c?": NUMBER,
    "temp_at_zero_c?": NUMBER,
}
_ACCELEROMETER = {
    "equation": TEXT,
    "matrix": MATRIX,
    "bias_mps2": VECTOR,
    "source": words("given", "prior", "stills", "none"),
}
_COVARIANCE = array(NUMBER, None, None)
_LINEAR = {"E": MATRIX, "B": VECTOR}
_RATES = words("rad/s in, rad/s out")
_CONVOLUTION = array(NUMBER, None, None, None, None)
_EFFECTS = [{"id": TEXT, "equation": TEXT, "theta_si": [NUMBER], **PARAMETERS}]
_CONDITIONS = {"duration_s": SIZE, "fs_rps": SIZE, "first_temp_c": maybe(NUMBER)}
_NESTED = other("tinygc-model/1")
_KINDS = {
    "linear": {"weights": _LINEAR},
    "tinygc": {"weights": {"W1": MATRIX, "b1": VECTOR, "slope": VECTOR, "W2": MATRIX, "b2": VECTOR}},
    "tinygc_denoised": {
        "calibration": _NESTED,
        "rate_hz": SIZE,
        "delay_s": NUMBER,
        "denoiser": {
            "window": COUNT,
            "dilations": [COUNT],
            "conv1": _CONVOLUTION,
            "conv2": _CONVOLUTION,
            "conv3": _CONVOLUTION,
        },
    },
    "physics": {"linear": _LINEAR, "conditions": _CONDITIONS, "effects": _EFFECTS},
    "tinygc_physics": {"linear": _LINEAR, "conditions": _CONDITIONS, "effects": _EFFECTS, "net": _NESTED},
    "thermal": {
        "thermal": {
            "E": array(NUMBER, None, 3, 3),
            "zero_rps": array(NUMBER, None, 3),
            "lag_s": VECTOR,
            "reference_c": NUMBER,
            "range_c": INTERVAL,
        }
    },
}
_MODEL = {
    "kind": TEXT,
    "units": _RATES,
    "equation": TEXT,
    "method?": TEXT,
    "session?": TEXT,
    "version?": TEXT,
    "sha256?": {"<file>": HASH},
    "clock?": words("board", "arrivals"),
    "began_s?": {"<file>": NUMBER},
    "temperature_c?": maybe(NUMBER),
    "covariance?": maybe(_COVARIANCE),
    "covariance_of?": [TEXT],
    "covariance_units?": TEXT,
    "accelerometer_covariance?": array(NUMBER, 12, 12),
    "joint_covariance?": {"parameters": [TEXT], "matrix": _COVARIANCE, "shared?": _COVARIANCE},
    "accelerometer?": _ACCELEROMETER,
    "lot?": {"file": TEXT, "hash": HASH, "used": TEXT, "belongs_probability": SHARE},
    "unobserved?": [TEXT],
    "accelerometer_spread?": array(SIZE, 9),
    "accelerometer_any_session_sigma?": array(SIZE, 9),
    "bias_sigma_rps?": VECTOR,
    "stored?": maybe({"method": maybe(TEXT), "session": maybe(TEXT), "sha256": maybe({"<file>": HASH})}),
    "remaining_rps?": array(maybe(SIZE), 3),
    "accel_change_mps2?": array(NUMBER, None, 3),
    "versions?": VERSIONS,
    "sensor?": _SENSOR,
    "frame?": TEXT,
    "noise?": {"gyro_dps_rthz": maybe(VECTOR), "accel_g_rthz": maybe(VECTOR)},
    "noise_figures?": {"schema": words("tinygc-noise/1")},
    "self_test?": {
        "rate_hz": SIZE,
        "measured_rps": array(NUMBER, None, 3),
        "specific_force_mps2": maybe(array(NUMBER, None, 3)),
        "temperature_c": maybe([NUMBER]),
        "omega_rps": array(NUMBER, None, 3),
    },
}
TABLES = {
    "tinygc-model/1": both(_MODEL, by_kind("kind", _KINDS)),
    "tinygc-accelerometer/1": {"session": TEXT, "stills": COUNT, **ACCELEROMETER},
}
