"""Models in use: whole logs, logs in pieces, sample by sample."""

import json

import numpy as np
import pytest
from conftest import broad
from models_in_use import KNOWN, MODELS, RNG, SAMPLES, physics

import tinygc
from session.io.results import write_whole
from session.io.samples import Samples
from session.io.units import G
from tinygc import CalibrationError, models
from tinygc.deploy.calibration import Calibration
from tinygc.effects import catalogue, movement_of

RATE_EFFECTS = [name for name, effect in catalogue().items() if effect.kind == "rate" and not effect.scan and "saturation" not in name]


def whole(model):
    """What the fit itself makes of the log."""
    return model.calibrate(SAMPLES) if not model.rates_only else model(SAMPLES.gyro)


@pytest.mark.parametrize("name", MODELS)
def test_a_log_is_calibrated_as_in_the_fit(name):
    model = MODELS[name]
    omega = Calibration(model, 1 / SAMPLES.period_s)(SAMPLES.gyro, SAMPLES.accel, SAMPLES.temp_c)
    # The log's stamps are whole microseconds, the pieces' an even step: a microsecond of angular acceleration.
    np.testing.assert_allclose(omega, whole(model), rtol=0, atol=1e-6 if not model.rates_only else 1e-12)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("piece", [1, broad(7), 100, broad(5000)])
def test_pieces_join_without_a_seam(name, piece):
    model = MODELS[name]
    calibration = Calibration(model, 1 / SAMPLES.period_s)
    stream, parts = calibration.stream(), []
    for start in range(0, len(SAMPLES), piece):
        part = SAMPLES.between(start, start + piece)
        parts.append(stream.push(part.gyro, part.accel, part.temp_c))
    parts.append(stream.flush())
    expected = calibration(SAMPLES.gyro, SAMPLES.accel, SAMPLES.temp_c)
    assert np.shape(np.concatenate(parts)) == np.shape(expected)
    np.testing.assert_allclose(np.concatenate(parts), expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", ["linear", "net", "denoised", broad("net behind physics")])
def test_sample_by_sample_gives_the_same(name):
    calibration = Calibration(MODELS[name], 1 / SAMPLES.period_s)
    expected = calibration(SAMPLES.gyro, SAMPLES.accel, SAMPLES.temp_c)
    for _ in range(2):  # and again with another stream, whatever the first has remembered
        live = calibration.live()
        one_by_one = [live(*sample) for sample in zip(SAMPLES.gyro, SAMPLES.accel, SAMPLES.temp_c, strict=True)]
        np.testing.assert_allclose(one_by_one, expected, rtol=0, atol=1e-11)


def test_a_single_sample_is_told_where_it_belongs():
    with pytest.raises(CalibrationError, match=r"one sample \(3,\); live\(\)"):
        Calibration(MODELS["linear"])(SAMPLES.gyro[0])
    with pytest.raises(CalibrationError, match=r"raw has shape \(2, 3\), expected \(3,\)"):
        Calibration(MODELS["linear"]).live()(SAMPLES.gyro[:2])


def test_a_saved_model_is_the_file_it_was_read_from(tmp_path):
    path = tmp_path / "linear.json"
    write_whole(path, models.to_dict(MODELS["linear"], covariance=np.eye(12).tolist(), note="kept"))
    again = tinygc.load(path).save(tmp_path / "again.json")
    assert again.read_bytes() == path.read_bytes()
    assert Calibration(MODELS["net"]).save(tmp_path / "net.json").exists()
    assert tinygc.load(tmp_path / "net.json").model.kind == "tinygc"


def test_whole_logs_do_not_disturb_a_live_stream():
    calibration = Calibration(MODELS["denoised"])
    expected = calibration(SAMPLES.gyro[:60])
    live, answers = calibration.live(), []
    for sample in SAMPLES.gyro[:60]:
        answers.append(live(sample))
        calibration(SAMPLES.gyro[200:300])
    np.testing.assert_allclose(answers, expected, atol=1e-12)


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


def test_what_a_model_needs_is_asked_by_name(tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(models.to_dict(physics("gyro.g_sensitivity", "gyro.thermal_bias"))))
    model = tinygc.load(path)
    assert model.needs == ("acc", "temp")
    with pytest.raises(CalibrationError, match="acc"):
        model(SAMPLES.gyro)
    with pytest.raises(CalibrationError, match="temp"):
        model(SAMPLES.gyro, SAMPLES.accel)
    with pytest.raises(CalibrationError, match="shape"):
        model(SAMPLES.gyro, SAMPLES.accel[:-1], SAMPLES.temp_c)
    with pytest.raises(CalibrationError, match=r"\(4,\)"):
        model(np.zeros(4))
    with pytest.raises(CalibrationError, match="rate_hz"):
        Calibration(physics("gyro.bias_drift"))(SAMPLES.gyro)
    with pytest.raises(CalibrationError, match="live"):
        Calibration(physics("gyro.bandwidth"), 208.0)(SAMPLES.gyro[0])


# The command


def test_gravity_unit_is_the_fits():
    """force_g in the effects is the specific force over standard gravity."""
    assert movement_of(SAMPLES, SAMPLES.gyro, KNOWN).force_g[0] == pytest.approx(SAMPLES.accel[0] / G)
