"""The methods by name, their results, and the options of a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from session.io.errors import CalibrationError

if TYPE_CHECKING:
    import numpy as np

    from tinygc.models.model import Model

# The methods by name, in the order of the report.  A new method needs a line here, and the module that it names.
#
# Nothing heavy is imported before a method runs: the command line takes its names from here.

#: callback with the number of steps done and their total
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Method:
    """A method of fitting a model to a problem.

    name: in the JSON and on the command line; title: in tables; function: ``module:name`` of a function that returns the ``MethodFit`` from
    (problem, options, progress, before), ``before`` being the methods fitted already, by name; None for named physics, which
    is an argument of ``fit_session``;
    parameters: number of fitted parameters, None for as many as its model has; chosen: whether ``--methods`` may name it (the others have
    an option of their own); trained: whether AdamW can train it.
    """

    name: str
    title: str
    function: str | None = None
    parameters: int | None = None
    chosen: bool = True
    trained: bool = False


METHODS = {
    method.name: method
    for method in (
        Method("raw", "raw", "tinygc.estimation.raw:run", parameters=0),
        Method("raw_bias_removed", "raw, first still's bias off", "tinygc.estimation.raw:run_bias_removed", parameters=3),
        Method("least_squares", "least squares", "tinygc.estimation.least_squares:run"),
        Method("pso", "PSO", "tinygc.estimation.particle_swarm:run"),
        Method("tinygc", "TinyGC-Net", "tinygc.estimation.network:run", trained=True),
        Method("tinygc_denoised", "TinyGC-Net, denoised", "tinygc.estimation.denoiser:run", trained=True),
        Method("tinygc_conditions", "TinyGC-Net with conditions", "tinygc.estimation.conditions:run", chosen=False),
        Method("physics", "linear model with physics", chosen=False),
        Method("tinygc_physics", "TinyGC-Net with physics", chosen=False),
    )
}
#: methods that ``--methods`` may name, and its default
CHOSEN = tuple(method.name for method in METHODS.values() if method.chosen)


# The result of a method: a model, and its closure error.


@dataclass(frozen=True, eq=False)
class MethodFit:
    """One method's model; its error angles (S, d) rad on the segments it was fitted to, and held_out (S, d) on held-out segments;
    seconds that the fit to all segments took; notes on how it was found; fold_models: the model of each fold."""

    name: str
    model: Model
    angles: np.ndarray
    held_out: np.ndarray
    seconds: float
    notes: dict = field(default_factory=dict)
    fold_models: tuple[Model, ...] = ()

    @property
    def parameters(self) -> int:
        """Number of fitted parameters."""
        own = METHODS[self.name].parameters
        return self.model.parameters if own is None else own


# Options of the denoiser.

DENOISE_LOSSES = ("endpoint", "still", "neighbours")


@dataclass(frozen=True)
class DenoiseOptions:
    """Options of the denoiser: loss; delay in samples and noise reduction factor at rest that ``neighbours`` aims at; slope of the leaky
    ReLUs (AdamW only, if not 1); optimizer, epochs, seed of the start."""

    loss: str = "neighbours"
    delay: int = 12
    reduction: float = 3.2
    slope: float = 1.0
    optimizer: str = "second-order"
    epochs: int = 400
    seed: int = 0


# The checkpoint of a training: only its path is part of the options; ``minimise`` reads and writes the file.

NAME = "checkpoint_{}.json"


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint file: its path; resume: whether to continue from it if it exists."""

    path: Path
    resume: bool = False


# Options of a fit.

INTEGRATORS, OPTIMIZERS = ("exact", "first-order"), ("second-order", "adamw")
BIASES = ("auto", "ends", "stills")
ACCELEROMETERS = ("auto", "given", "fit", "prior")
LOSSES, VARIANTS, CONDITIONS = ("squared", "distance"), ("paper", "published"), ("temperature", "force")


@dataclass(frozen=True)
class FitOptions:
    """Options that determine a fit's numbers.  Raises CalibrationError for invalid ones; one name may replace a tuple of one.

    methods: some of ``CHOSEN``, in the order of the report;
    folds: of the held-out closure, 2 or more;
    seed: of the swarm, 0 or more;
    still_rates: whether the mean rate in each still is also data;
    integrator: ``exact``, or the paper's ``first-order``;
    optimizer: of the nets, ``second-order``, or the paper's ``adamw``;
    epochs: of adamw;
    loss: of the net, ``squared``, or the paper's ``distance``, not squared;
    earth: whether the Earth's rotation is subtracted;
    physics: ids of effects to fit as well, ("auto",) for those that `explain` would report, None for none;
    exclude: numbers of segments to leave out;
    denoise: options of tinygc_denoised;
    variant: of the calibration subnet, ``paper`` (27 parameters) or ``published`` (26);
    parts: segments over which the net's training propagates the attitude;
    conditions: inputs of a further net, some of ``temperature``, ``force``;
    checkpoints: folder of AdamW's checkpoints, and resume: whether it continues from them;
    bias_per_log: whether each log has a bias of its own, of which the median is kept;
    bias: from the ``ends`` of the turns, as all other parameters, from the ``stills`` around each, or ``auto``: the source with the
        smaller closure error on held-out segments.
    accelerometer: its calibration is the one ``given``, that of a ``fit``, or a given one is a ``prior``; ``auto``: a prior where one is
        given and agrees with the data, else a fit;
    lot: file of a production lot, the prior of least squares; other methods are fitted without it.
    """

    methods: tuple[str, ...] = CHOSEN
    folds: int = 5
    seed: int = 0
    still_rates: bool = False
    integrator: str = "exact"
    optimizer: str = "second-order"
    epochs: int = 2000
    loss: str = "squared"
    earth: bool = True
    physics: tuple[str, ...] | None = None
    exclude: tuple[int, ...] = ()
    denoise: DenoiseOptions = field(default_factory=DenoiseOptions)
    variant: str = "paper"
    parts: int = 1
    conditions: tuple[str, ...] = ()
    checkpoints: Path | None = None
    resume: bool = False
    bias_per_log: bool = False
    bias: str = "auto"
    accelerometer: str = "auto"
    lot: Path | None = None

    def __post_init__(self) -> None:
        for name in ("methods", "physics", "conditions"):
            if isinstance(getattr(self, name), str):
                object.__setattr__(self, name, (getattr(self, name),))
        self._require(bool(self.methods) and set(self.methods) <= set(CHOSEN), "methods", f"some of {', '.join(CHOSEN)}")
        for name, known in (
            ("integrator", INTEGRATORS),
            ("optimizer", OPTIMIZERS),
            ("loss", LOSSES),
            ("variant", VARIANTS),
            ("bias", BIASES),
            ("accelerometer", ACCELEROMETERS),
        ):
            self._require(getattr(self, name) in known, name, f"one of {', '.join(known)}")
        self._require(set(self.conditions) <= set(CONDITIONS), "conditions", f"some of {', '.join(CONDITIONS)}")
        for name, least in (("folds", 2), ("seed", 0), ("epochs", 1), ("parts", 1)):
            value = getattr(self, name)
            self._require(isinstance(value, int) and value >= least, name, f"a whole number of {least} or more")

    def _require(self, fine: bool, name: str, expected: str) -> None:
        if not fine:
            raise CalibrationError(f"{name} is {getattr(self, name)!r}, expected {expected}")

    def checkpoint(self, name: str) -> Checkpoint | None:
        """Return the checkpoint of one training, or None."""
        if self.checkpoints is None or self.optimizer != "adamw":
            return None
        return Checkpoint(self.checkpoints / NAME.format(name), self.resume)
