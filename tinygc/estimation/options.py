"""The methods by name, their results, and the options of a fit."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, cast

from session.base.features import extended
from session.base.names import CLOCKS
from session.base.options import Record, documented, option

if TYPE_CHECKING:
    import numpy as np

    from tinygc.models.linear import LinearModel
    from tinygc.models.model import Model

# The methods by name, in the order of the report.  A new method needs a line here, and the module that it names.
#
# Nothing heavy is imported before a method runs: the command line takes its names from here.


@dataclass(frozen=True)
class Method:
    """A method of fitting a model to a problem.

    name: in the JSON and on the command line; title: in tables; function: ``module:name`` of a function that returns the ``MethodFit`` from
    (problem, options, progress, before), ``before`` being the methods fitted already, by name; None for named physics, which
    is an argument of ``fit_session``;
    parameters: number of fitted parameters, None for as many as its model has; chosen: whether ``--methods`` may name it (the others have
    an option of their own).
    """

    name: str
    title: str
    function: str | None = None
    parameters: int | None = None
    chosen: bool = True


METHODS = {
    method.name: method
    for method in (
        Method("raw", "raw", "tinygc.methods.raw:run", parameters=0),
        Method("raw_bias_removed", "raw, first still's bias off", "tinygc.methods.raw:run_bias_removed", parameters=3),
        Method("least_squares", "least squares", "tinygc.methods.least_squares:run"),
        Method("pso", "PSO", "tinygc.methods.particle_swarm:run"),
        Method("tinygc", "TinyGC-Net", "tinygc.methods.network:run"),
        Method("tinygc_denoised", "TinyGC-Net, denoised", "tinygc.methods.denoiser:run"),
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
    def linear(self) -> LinearModel:
        """The model of least squares."""
        return cast("LinearModel", self.model)

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Names of the parameters that the session does not observe."""
        return tuple(self.notes.get("unobserved", ()))

    @property
    def parameters(self) -> int:
        """Number of fitted parameters."""
        own = METHODS[self.name].parameters
        return self.model.parameters if own is None else own


# Options of a fit, and those that other commands and functions have as well.

LARGEST_SEED = 2**63 - 1  #: accepted by every random generator

BIASES = ("auto", "ends", "stills")
ACCELEROMETERS = ("auto", "given", "fit", "prior")
OF_ACCELEROMETER = "the accelerometer's calibration: as given, fitted, or given as a prior; auto: a prior while it holds, else fitted"


@dataclass(frozen=True)
class Seed(Record):
    """Options of what draws."""

    seed: int = option(0, "of every random draw", least=0, most=LARGEST_SEED, rare=True)


@dataclass(frozen=True)
class Earth(Record):
    """Options of what takes rates of a session."""

    earth: bool = option(True, "subtract the Earth's rotation from the rates", off="leave the Earth's rotation in the rates", rare=True)


@dataclass(frozen=True)
class AtRest(Earth):
    """Options of what weighs the residuals of a session."""

    noise: Path | None = option(
        None,
        "noise figures of the unit, measured at rest: the prior of its bias drift (fit/noise.json in the session folder, if it is there)",
        rare=True,
    )


@dataclass(frozen=True)
class Clock(Record):
    """Options of what reads the times of a session."""

    clock: str = option(
        CLOCKS[0],
        "arrivals: divide the stamps by sensor.clock_ratio, the board's clock against the computer's as record measured it",
        choices=CLOCKS,
        rare=True,
    )


@dataclass(frozen=True)
class Exclude(Record):
    """Options of what closes the segments of a session."""

    exclude: tuple[int, ...] = option((), "numbers of segments to leave out")


@dataclass(frozen=True)
class Limit(Record):
    """Options of what passes or fails a calibration."""

    limit_deg: float | None = option(
        None,
        "pass only if the held-out tilt of the segments and each closure run's RMSE are at most this; exit 1 if not",
        unit="deg",
        above=0,
        flags=("--limit",),
        default_key="limits.closure_deg",
    )


@documented
@extended("options of a fit")
@dataclass(frozen=True)
class FitOptions(AtRest, Clock, Exclude):
    """Options that determine a fit's numbers; features have further ones.

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
    session.base.options.OptionError: folds is 1, expected a whole number of 2 or more

    """

    methods: tuple[str, ...] = option(CHOSEN, f"methods, in the order of the report, among {', '.join(CHOSEN)}", some=CHOSEN, rare=True)
    folds: int = option(5, "folds of the held-out closure", least=2, cli=False)
    seed: int = option(0, "seed of the swarm", least=0, cli=False)
    physics: tuple[str, ...] | None = option(
        None, "fit what explain names as well (auto), or effects by id, with commas", metavar="auto|IDS"
    )
    bias: str = option(
        "auto",
        "from the ends of the turns, from the stills around each, or whichever closes held-out segments better",
        choices=BIASES,
        rare=True,
    )
    accelerometer: str = option(
        "auto",
        OF_ACCELEROMETER,
        choices=ACCELEROMETERS,
    )
    history: tuple[Path, ...] = option(
        (),
        "a fitted session of the same unit; of two or more, the spread of their biases is that of any session",
        repeated=True,
        rare=True,
    )
