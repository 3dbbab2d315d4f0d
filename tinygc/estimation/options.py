"""The methods by name, their results, and the options of a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

from session.base.errors import CalibrationError
from session.base.features import extended
from session.base.names import CLOCKS

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
    an option of their own); trained: whether it is a net, which ``--as-in-paper`` trains otherwise.
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
        Method("raw", "raw", "tinygc.methods.raw:run", parameters=0),
        Method("raw_bias_removed", "raw, first still's bias off", "tinygc.methods.raw:run_bias_removed", parameters=3),
        Method("least_squares", "least squares", "tinygc.methods.least_squares:run"),
        Method("pso", "PSO", "tinygc.methods.particle_swarm:run"),
        Method("tinygc", "TinyGC-Net", "tinygc.methods.network:run", trained=True),
        Method("tinygc_denoised", "TinyGC-Net, denoised", "tinygc.methods.denoiser:run", trained=True),
        Method("physics", "linear model with physics", chosen=False),
        Method("tinygc_physics", "TinyGC-Net with physics", chosen=False),
    )
}
#: methods that ``--methods`` may name, and its default
CHOSEN = tuple(method.name for method in METHODS.values() if method.chosen)
#: methods that ``as_in_paper`` trains with PyTorch
NETS = tuple(method.name for method in METHODS.values() if method.trained)


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


# The checkpoint of a training: only its path is part of the options; ``minimise`` reads and writes the file.

NAME = "checkpoint_{}.json"


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint file: its path; resume: whether to continue from it if it exists."""

    path: Path
    resume: bool = False


def device() -> str:
    """Return the available device: an accelerator with double precision, or the processor.  Whoever imports torch asks for it first.

    Raises CalibrationError where PyTorch is not installed: nothing else needs it.
    """
    try:
        import torch
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise CalibrationError(
            "training as in the paper needs PyTorch: python -m pip install 'tinygc[torch]', or leave out --as-in-paper"
        ) from None

    return "cuda" if torch.cuda.is_available() else "cpu"


def forget(folder: Path) -> None:
    """Remove the checkpoints of a complete fit."""
    for path in folder.glob(NAME.format("*")):
        path.unlink(missing_ok=True)


# Options of a fit.

BIASES = ("auto", "ends", "stills")
ACCELEROMETERS = ("auto", "given", "fit", "prior")


@extended("options of a fit")
@dataclass(frozen=True)
class FitOptions:
    """Options that determine a fit's numbers; features have further ones.

    Parameters
    ----------
    methods : tuple of str, optional
        Some of ``CHOSEN``, in the order of the report; one name may replace a tuple of one.
    folds : int, optional
        Folds of the held-out closure, 2 or more.
    seed : int, optional
        Seed of the swarm, 0 or more.
    still_rates : bool, optional
        Whether the mean rate in each still is also data.
    as_in_paper : bool, optional
        Whether the nets are trained as in the paper: AdamW (PyTorch) on the distance at the ends, which the first-order integrator gives.
    earth : bool, optional
        Whether the Earth's rotation is subtracted.
    physics : tuple of str, optional
        Ids of effects to fit as well, ``("auto",)`` for those that ``explain`` would report.
    exclude : tuple of int, optional
        Numbers of segments to leave out.
    checkpoints : str or Path, optional
        Folder of the checkpoints of a training as in the paper.
    resume : bool, optional
        Whether that training continues from its checkpoints.
    bias_per_log : bool, optional
        Whether each log has a bias of its own, of which the median is kept.
    bias : {"auto", "ends", "stills"}, optional
        From the ends of the turns, as all other parameters, or from the stills around each; ``auto``: the source with the smaller closure
        error on held-out segments.
    accelerometer : {"auto", "given", "fit", "prior"}, optional
        Its calibration is the one given, that of a fit, or a given one is a prior; ``auto``: a prior where one is given and agrees with
        the data, else a fit.
    history : tuple of str or Path, optional
        Fitted session folders of the same unit, whose spread of the bias is that between sessions.
    noise : str or Path, optional
        Noise figures of the unit, measured at rest; ``fit/noise.json`` of the session's folder by default.
    clock : {"board", "arrivals"}, optional
        Times as the board stamped them, or divided by ``sensor.clock_ratio``, which ``record`` measured by the arrivals.
    requirements : str or Path, optional
        File of limits and a decision rule, in place of session.toml's ``[requirements]``; it changes no number of the fit.

    Raises
    ------
    CalibrationError
        For an invalid option; its message names the option and what was expected.

    Examples
    --------
    >>> import tinygc
    >>> tinygc.FitOptions(methods="least_squares", folds=3).methods
    ('least_squares',)
    >>> tinygc.FitOptions(folds=1)
    Traceback (most recent call last):
    session.base.errors.CalibrationError: folds is 1, expected a whole number of 2 or more

    """

    methods: tuple[str, ...] = CHOSEN
    folds: int = 5
    seed: int = 0
    still_rates: bool = False
    as_in_paper: bool = False
    earth: bool = True
    physics: tuple[str, ...] | None = None
    exclude: tuple[int, ...] = ()
    checkpoints: Path | None = None
    resume: bool = False
    bias_per_log: bool = False
    bias: str = "auto"
    accelerometer: str = "auto"
    history: tuple[Path, ...] = ()
    noise: Path | None = None
    clock: str = CLOCKS[0]
    requirements: Path | None = None

    def __post_init__(self) -> None:
        for name in ("methods", "physics"):
            if isinstance(getattr(self, name), str):
                object.__setattr__(self, name, (getattr(self, name),))
        self._require(bool(self.methods) and set(self.methods) <= set(CHOSEN), "methods", f"some of {', '.join(CHOSEN)}")
        self._require(not self.as_in_paper or self.by_torch, "methods", f"a net ({', '.join(NETS)}) for --as-in-paper to train")
        for each in fields(self):
            if each.type == "Path | None" and (path := getattr(self, each.name)) is not None:
                object.__setattr__(self, each.name, Path(path))
        object.__setattr__(self, "history", tuple(map(Path, self.history)))
        for name, known in (("bias", BIASES), ("accelerometer", ACCELEROMETERS), ("clock", CLOCKS)):
            self._require(getattr(self, name) in known, name, f"one of {', '.join(known)}")
        for name, least in (("folds", 2), ("seed", 0)):
            value = getattr(self, name)
            self._require(isinstance(value, int) and value >= least, name, f"a whole number of {least} or more")

    def _require(self, fine: bool, name: str, expected: str) -> None:
        if not fine:
            raise CalibrationError(f"{name} is {getattr(self, name)!r}, expected {expected}")

    @property
    def integrator(self) -> str:
        """The integrator of every method's attitudes: the paper's is of first order."""
        return "first-order" if self.as_in_paper else "exact"

    @property
    def by_torch(self) -> bool:
        """Whether PyTorch trains any of the methods."""
        return self.as_in_paper and not set(NETS).isdisjoint(self.methods)

    def checkpoint(self, name: str) -> Checkpoint | None:
        """Return the checkpoint of one training, or None."""
        if self.checkpoints is None or not self.as_in_paper:
            return None
        return Checkpoint(self.checkpoints / NAME.format(name), self.resume)
