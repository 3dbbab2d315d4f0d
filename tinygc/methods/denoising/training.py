"""Train the denoising subnet, calibration frozen: second order in NumPy where it is linear, the paper's AdamW in PyTorch.

Three losses.  ``endpoint`` is the paper's: the closure of the segments.  It hardly rewards smoothing, since what it integrates hides noise.
``still`` adds the variance in the stills: it smooths as far as it can, and loses the movement.  ``neighbours`` adds that and the expected
error in motion (risk.py), weighed so that noise at rest falls by a stated factor at a stated delay: the default.

Linear (slope 1), the closure is linear in the taps to first order, and the other losses are quadratic in them.  What all samples have
to say is therefore a matrix of 49 x 49 an axis, and training is Levenberg-Marquardt on 168 weights: a fraction of a second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from session.common.errors import FitError
from tinygc.methods.denoise_options import LOSSES, DenoiseOptions
from tinygc.methods.denoising.material import REACH, Material
from tinygc.methods.denoising.second_order import train_second_order
from tinygc.methods.denoising.start import DenoiserTraining
from tinygc.methods.registry import Progress
from tinygc.models.denoiser import Denoiser
from tinygc.models.model import Model

if TYPE_CHECKING:
    from tinygc.methods.checkpoint import Checkpoint


def train_denoiser(
    material: Material,
    calibration: Model,
    options: DenoiseOptions,
    progress: Progress = lambda step, steps: None,
    checkpoint: Checkpoint | None = None,
    near: Denoiser | None = None,
) -> DenoiserTraining:
    """The whole net with this calibration, frozen; checkpoint (``Checkpoint``) where AdamW trains it; near: what ``train_smoothing`` found,
    where the second order may begin, and then soon ends.

    Raises FitError where the loss is not finite, or there is nothing to smooth.
    """
    if options.loss not in LOSSES:
        raise ValueError(f"loss is {options.loss!r}, expected one of {', '.join(LOSSES)}")
    if not 0 <= options.delay <= REACH:
        raise FitError(f"a delay of {options.delay} samples is not within the denoiser's reach of {REACH}")
    if not _is_second_order(options):
        from tinygc.methods.denoising.adamw_denoiser import train_adamw

        return train_adamw(material, calibration, options, progress, checkpoint)
    return train_second_order(material, calibration, options, progress, near)


def train_smoothing(material: Material, calibration: Model, options: DenoiseOptions) -> Denoiser | None:
    """The weights best for all of the loss but the closure, from rates alone; None where the closure is all of it, and for AdamW."""
    if options.loss == "endpoint" or not _is_second_order(options):
        return None
    return train_second_order(material, calibration, options, closing=False).model.denoiser


def _is_second_order(options: DenoiseOptions) -> bool:
    return options.optimizer != "adamw" and options.slope == 1
