"""The vibrating element and its loops: what they do to the rate itself."""

from __future__ import annotations

import numpy as np
from scipy.signal import bilinear, lfilter

from session.common.units import DEG
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.discover.laws.shapes import adding, lagged, size_of

# Strong sizes, SI
#: share of the response that goes by a soft suspension, its frequency, Hz, and quality: a board on rubber feet, a die on soft glue
SHARE, SUSPENSION_HZ, QUALITY = 0.15, (5.0, 12.0), (1.5, 5.0)
#: of the sensitivity, where |omega| is the full scale: the Coriolis force of the other axes takes energy out of the drive
DROOP = 0.03
#: of the sensitivity, at full scale: the drive's gain control (Acar & Shkel, MEMS Vibratory Gyroscopes, 2009) with a slow loop
RECOVERY, GAIN_S = 0.15, (0.3, 3.0)
DEAD_ZONE = 0.3 * DEG
ROOT = 0.012  #: of the sensitivity, at full scale
LIMIT = 4.0  #: full scales, where the output bends over, L tanh(omega / L), at strength 1


def resonance(scene: Scene) -> Concealment:
    """A share of the rate comes by a second-order response y'' + (w0/Q) y' + w0² y = w0² omega."""
    share = scene.signed(SHARE)
    frequency = 2 * np.pi * scene.rng.uniform(*SUSPENSION_HZ, 3)
    quality = scene.rng.uniform(*QUALITY, 3)

    def added(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        change = np.empty_like(rate)
        for axis, (w0, q) in enumerate(zip(frequency, quality, strict=True)):
            b, a = bilinear([w0**2], [1.0, w0 / q, w0**2], fs=1 / (t[1] - t[0]))
            change[:, axis] = lfilter(b, a, rate[:, axis] - rate[0, axis]) + rate[0, axis] - rate[:, axis]
        return share * change

    told = {"share": share.tolist(), "hz": (frequency / (2 * np.pi)).tolist(), "quality": quality.tolist()}
    return adding("law.resonance", told, added)


def drive_droop(scene: Scene) -> Concealment:
    """The sensitivity falls with |omega|, of all axes together."""
    size, full_scale = scene.signed(DROOP), scene.options.gyro_fs_dps * DEG
    return adding("law.drive_droop", {"at_fs": size.tolist()}, lambda t, rate, force, temp: -size * rate * size_of(rate) / full_scale)


def drive_recovery(scene: Scene) -> Concealment:
    """The sensitivity follows |omega|² of a moment ago, as a slow gain control lets it."""
    size, tau_s, full_scale = scene.signed(RECOVERY), scene.rng.uniform(*GAIN_S), scene.options.gyro_fs_dps * DEG
    return adding(
        "law.drive_recovery",
        {"at_fs": size.tolist(), "tau_s": tau_s},
        lambda t, rate, force, temp: -size * rate * lagged(t, size_of(rate / full_scale) ** 2, tau_s),
    )


def dead_zone(scene: Scene) -> Concealment:
    """Around zero rate the output does not move."""
    width = np.abs(scene.signed(DEAD_ZONE))
    return adding("law.dead_zone", {"rps": width.tolist()}, lambda t, rate, force, temp: -np.clip(rate, -width, width))


def root_scale(scene: Scene) -> Concealment:
    """The sensitivity moves with the square root of the rate."""
    size, full_scale = scene.signed(ROOT), scene.options.gyro_fs_dps * DEG
    return adding("law.root_scale", {"at_fs": size.tolist()}, lambda t, rate, force, temp: size * rate * np.sqrt(np.abs(rate) / full_scale))


def soft_limit(scene: Scene) -> Concealment:
    """The output bends over, L tanh(omega / L): at these rates nearly the catalogue's cube, which is as good a name."""
    limit = LIMIT * scene.options.gyro_fs_dps * DEG / np.sqrt(np.abs(scene.signed(1.0)))
    return adding("law.soft_limit", {"rps": limit.tolist()}, lambda t, rate, force, temp: limit * np.tanh(rate / limit) - rate)


ELEMENT: dict[str, Maker] = {
    "law.resonance": resonance,
    "law.drive_droop": drive_droop,
    "law.drive_recovery": drive_recovery,
    "law.dead_zone": dead_zone,
    "law.root_scale": root_scale,
    "law.soft_limit": soft_limit,
}
