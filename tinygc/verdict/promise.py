"""What a sensor's data sheet promises for the turns of a session: the limit of their closure where nobody gives one.

    variance of a turn's tilt, rad^2:   N^2 T  +  2 T^2 C_ii(B)  +  references

N: one-sided density of white noise, of which each of two axes has half; T: the turn's seconds; C(B): covariance of flicker noise of the
stated bias instability at the turns' middles, about their mean; references: the accelerometer's stated noise over the stills at both ends,
or a truth's sigma; errors of a log's stamps are none of it.  Figures of session.toml take the place of the data sheet's.  ST states no
nonlinearity; where a sheet does, as 0.1 or 0.2 % of full scale, it bounds the whole range, of which E takes up all that a session's turns
share: no limit of a turn follows from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.numeric import rms_of
from session.base.units import DEG_PER_HOUR, MDPS, MG
from tinygc.closure.floor import ACCEL_NOISE, GYRO_NOISE, SINGLE_SEGMENTS, STAMPS, wander_covariance
from tinygc.closure.problem import Problem

#: ratio of the noise of a unit to that of its data sheet, above which it is no such unit: units differ by 1.4 at most (``check_noise``)
NOISIER = 1.4
#: figures of a data sheet that a promise is made of
GYRO_DENSITY, ACCEL_DENSITY, INSTABILITY = "gyro_noise_mdps_rthz", "accel_noise_ug_rthz", "gyro_bias_instability_dph"


@dataclass(frozen=True)
class Promise:
    """turn_s: median duration of the turns; tilt_rms, rad, that they close to by ``source``, None where nothing says how much noise the
    sensor has; noisier: how much more this unit has, in words, empty where it has no more than units do."""

    turn_s: float
    tilt_rms: float | None = None
    source: str = ""
    noisier: str = ""


def promise_of(problem: Problem) -> Promise:
    """What is promised for the used segments of a problem."""
    sensor, turn_s = problem.session.config.sensor, float(np.median(problem.batch.duration_s))
    named = problem.session.config.model_given
    typical, accel, drifts = (sensor.typical(name) if named else None for name in (GYRO_DENSITY, ACCEL_DENSITY, INSTABILITY))
    if sensor.gyro_noise_mdps_rthz is not None:
        density, source = sensor.gyro_noise_mdps_rthz, "the noise in session.toml"
    elif typical is not None:
        source, density = f"{'an' if typical[0][0] in 'AEFHILMNORSX' else 'a'} {typical[0]}'s data sheet", typical[1]
    else:
        return Promise(turn_s)
    unit_accel = float(np.mean(problem.noise.accel**2))
    shares = dict.fromkeys((GYRO_NOISE, SINGLE_SEGMENTS, STAMPS), 0.0)
    shares[ACCEL_NOISE] = 1.0 if accel is None else (accel[1] * 1e-3 * MG) ** 2 / unit_accel
    drift = np.zeros(len(problem.used))
    instability = sensor.gyro_bias_instability_dph or (0.0 if drifts is None else drifts[1])
    if instability:
        of_turns = wander_covariance(problem.middle_s, instability_rps=instability * DEG_PER_HOUR)
        drift = np.diag(of_turns) - 2 * of_turns.mean(axis=0) + of_turns.mean()
    tilt = (density * MDPS) ** 2 * problem.batch.duration_s + 2 * problem.batch.duration_s**2 * drift
    for cause, part in problem.floor.parts.items():
        tilt = tilt + shares.get(cause, 1.0) * (part.own[:, 0, 0] + part.own[:, 1, 1])
    unit = rms_of(problem.noise.gyro) / MDPS
    noisier = f"this unit has {unit:.2g} mdps/√Hz of noise, {density:g} there" if unit > NOISIER * density else ""
    return Promise(turn_s, float(np.sqrt(np.mean(tilt))), source, noisier)
