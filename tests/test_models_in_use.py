"""Models in use: whole logs, logs in pieces, sample by sample, and whatever somebody asks of them."""

import json

import numpy as np
import pytest
from models_in_use import MODELS, RNG, physics
from models_in_use import SAMPLES as WHOLE

import tinygc
from session.base.units import G
from session.log.samples import Samples
from tinygc import CalibrationError, models
from tinygc.deploy.calibration import Calibration
from tinygc.effects import catalogue

RATE_EFFECTS = [name for name, effect in catalogue().items() if effect.kind == "rate" and not effect.scan and "saturation" not in name]
SAMPLES = WHOLE.between(0, 500)
LOG = (SAMPLES.gyro, SAMPLES.accel, SAMPLES.temp_c)


@pytest.mark.parametrize("name", MODELS)
def test_a_log_is_calibrated_as_in_the_fit_whole_in_pieces_and_sample_by_sample(name):
    model = MODELS[name]
    calibration = Calibration(model, 1 / SAMPLES.period_s)
    omega = calibration(*LOG)
    # The log's stamps are whole microseconds, the pieces' an even step: a microsecond of angular acceleration.
    expected = model(SAMPLES.gyro) if model.rates_only else model.calibrate(SAMPLES)
    np.testing.assert_allclose(omega, expected, rtol=0, atol=1e-12 if model.rates_only else 1e-6)
    for piece in (1, 7, 100):
        stream = calibration.stream()
        parts = [stream.push(*(part[start : start + piece] for part in LOG)) for start in range(0, len(SAMPLES), piece)]
        np.testing.assert_allclose(np.concatenate([*parts, stream.flush()]), omega, rtol=0, atol=1e-11)
    if calibration.looks_ahead:
        return
    live, other, answers = calibration.live(), calibration.live(), []
    for sample in zip(*(part[:100] for part in LOG), strict=True):
        answers.append(live(*sample))
        other(*(-part for part in sample))  # another stream, and a whole log, disturb none
        calibration(*(part[200:210] for part in LOG))
    np.testing.assert_allclose(answers, omega[:100], rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", RATE_EFFECTS)
def test_what_effects_declare_that_they_look_at_is_true(name):
    """Neighbours, force, temperature and time move a sample's rate just where the effect says so."""
    model = physics(name)
    middle = len(SAMPLES) // 2
    base = model.calibrate(SAMPLES)[middle]
    calibration = Calibration(model)
    around, needs = bool(calibration.looks_ahead), calibration.needs

    def moved(**changes):
        parts = {"t_ns": SAMPLES.t_ns, "gyro": SAMPLES.gyro, "accel": SAMPLES.accel, "temp_c": SAMPLES.temp_c, **changes}
        return np.abs(model.calibrate(Samples(**parts))[middle] - base).max() > 1e-12

    others = np.arange(len(SAMPLES)) != middle
    shaken = SAMPLES.gyro + 0.3 * RNG.normal(size=SAMPLES.gyro.shape) * others[:, None]
    jolted = SAMPLES.accel + RNG.normal(size=SAMPLES.accel.shape) * others[:, None]
    assert (moved(gyro=shaken) or moved(accel=jolted)) == around
    assert moved(accel=SAMPLES.accel + RNG.normal(size=SAMPLES.accel.shape)) == ("acc" in needs)
    assert moved(temp_c=SAMPLES.temp_c + 3) == ("temp" in needs)
    later = np.abs(model.calibrate(SAMPLES, began_s=10.0)[middle] - base).max() > 1e-12
    assert (later or around) == ("rate_hz" in needs)


def test_a_saved_model_is_the_file_it_was_read_from_and_the_unit_of_force_is_the_fits(tmp_path):
    path, model = tmp_path / "g.json", physics("gyro.g_sensitivity")
    path.write_text(json.dumps(models.to_dict(model, covariance=np.eye(21).tolist(), note="kept")))
    again = tinygc.load(tinygc.load(path).save(tmp_path / "again.json"))
    assert json.loads((tmp_path / "again.json").read_text()) == json.loads(path.read_text())
    K = np.reshape(model.claims[0].theta, (3, 3))  # rad/s per g
    linear = MODELS["linear"](SAMPLES.gyro[:9])
    np.testing.assert_allclose(again(SAMPLES.gyro[:9], SAMPLES.accel[:9]), linear - SAMPLES.accel[:9] / G @ K.T, rtol=1e-12)


@pytest.mark.parametrize(
    ("effects", "given", "says"),
    [
        ((), (SAMPLES.gyro[0],), r"one sample \(3,\); live\(\)"),
        ((), (np.zeros(4),), r"\(4,\)"),
        (("gyro.g_sensitivity", "gyro.thermal_bias"), (SAMPLES.gyro,), "acc"),
        (("gyro.g_sensitivity", "gyro.thermal_bias"), (SAMPLES.gyro, SAMPLES.accel), "temp"),
        (("gyro.g_sensitivity",), (SAMPLES.gyro, SAMPLES.accel[:-1]), "shape"),
        (("gyro.bias_drift",), (SAMPLES.gyro,), "rate_hz"),
        (("gyro.bandwidth",), (SAMPLES.gyro[0],), "live"),
    ],
)
def test_what_a_model_needs_is_asked_by_name(effects, given, says):
    with pytest.raises(CalibrationError, match=says):
        Calibration(physics(*effects), 208.0 if "gyro.bandwidth" in effects else None)(*given)
    with pytest.raises(CalibrationError, match=r"raw has shape \(2, 3\), expected \(3,\)"):
        Calibration(MODELS["linear"]).live()(SAMPLES.gyro[:2])
