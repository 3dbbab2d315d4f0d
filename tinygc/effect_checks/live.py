"""In use: whole logs, pieces, sample by sample; and that it looks no farther than it declares.

Live, the temperature is taken as it comes; so it is in the whole log that live use is compared with.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.common.errors import CalibrationError
from session.log.samples import Samples
from tinygc.deploy.calibration import Calibration
from tinygc.effect_checks.report import NotChecked, Wrong
from tinygc.effect_checks.scene import Trial, log

RATE_HZ = 100.0  #: whose period is whole nanoseconds: no stamp is rounded
PIECE = 300
#: rad/s: a hundred-thousandth of a sensor's noise
WITHIN = 1e-9


def live(trial: Trial) -> str:
    """Sample by sample as whole, or refused in one line where it looks ahead; and no farther around than declared."""
    if trial.effect.kind != "rate":
        raise NotChecked(f"of kind {trial.effect.kind}: no model undoes it")
    samples, calibration = log(RATE_HZ, trial.at), Calibration(trial.model(), RATE_HZ)
    began_s = 0.0 if trial.effect.of_one_session else None
    whole = calibration(samples.gyro, samples.accel, samples.temp_c, began_s=began_s)
    if not np.isfinite(whole).all():
        raise Wrong("the rate is not finite")
    stream, pieces = calibration.stream(began_s), []
    for start in range(0, len(samples), PIECE):
        part = samples.between(start, start + PIECE)
        pieces.append(stream.push(part.gyro, part.accel, part.temp_c))
    _same(np.concatenate([*pieces, stream.flush()]), whole, "in pieces")
    _looks_no_farther(trial, samples)
    if calibration.looks_ahead:
        return f"refused live, since it looks ahead: {_refusal(calibration, trial.effect.id, 'looks ahead')}"
    if trial.effect.of_one_session:
        return f"refused live, since it follows its session's time: {_refusal(calibration, trial.effect.id, 'follows its session')}"
    assert samples.temp_c is not None  # as ``log`` makes them
    try:
        one_at_a_time = calibration.live()
        one_by_one = np.array([one_at_a_time(*sample) for sample in zip(samples.gyro, samples.accel, samples.temp_c, strict=True)])
    except CalibrationError as error:
        raise Wrong(f"cannot go live: {error}") from None
    _same(one_by_one, trial.model().calibrate(samples, live=True), "sample by sample")
    return "sample by sample, in pieces and whole agree"


def _refusal(calibration: Calibration, name: str, why: str) -> str:
    """The one line that refuses to go live, before any sample, and names the effect."""
    try:
        calibration.live()
    except CalibrationError as error:
        says = str(error)
        if name not in says or "\n" in says:
            raise Wrong(f"the refusal to go live is not one line that names {name}: {' '.join(says.split())}") from None
        return says
    raise Wrong(f"it {why}, and yet goes live")


def _same(one: np.ndarray, whole: np.ndarray, how: str) -> None:
    off = np.abs(one - whole).max(axis=1)
    if not off.max() < WITHIN:
        at = int(np.argmax(off))
        raise Wrong(f"{how} it differs from the whole log by {off[at]:.2g} rad/s at sample {at}: does reach say all that it looks at?")


def _looks_no_farther(trial: Trial, samples: Samples) -> None:
    """What lies beyond the declared reach of a sample does not move its rate."""
    middle = len(samples) // 2
    behind, ahead = trial.effect.looks(trial.theta).rows(RATE_HZ)
    model, rng = trial.model(), np.random.default_rng(0)
    base = model.calibrate(samples, live=True)[middle]
    beyond = np.ones(len(samples), dtype=bool)
    beyond[max(middle - behind, 0) : middle + ahead + 1] = False
    if not beyond.any():
        return
    shake = beyond[:, None] * rng.normal(size=(len(samples), 3))
    assert samples.temp_c is not None
    other = replace(samples, gyro=samples.gyro + 0.3 * shake, accel=samples.accel + shake, temp_c=samples.temp_c + 3 * beyond)
    off = float(np.abs(model.calibrate(other, live=True)[middle] - base).max())
    if not off < WITHIN:
        raise Wrong(f"samples farther than {behind} before and {ahead} after move the rate by {off:.2g} rad/s: declare a larger reach")
