"""What a person may set of a fit."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from session.common.errors import CalibrationError
from tinygc.methods.checkpoint import NAME, Checkpoint
from tinygc.methods.denoise_options import DenoiseOptions
from tinygc.methods.registry import CHOSEN

INTEGRATORS, OPTIMIZERS = ("exact", "first-order"), ("second-order", "adamw")
BIASES = ("auto", "ends", "stills")
ACCELEROMETERS = ("auto", "given", "fit", "prior")
LOSSES, VARIANTS, CONDITIONS = ("squared", "distance"), ("paper", "published"), ("temperature", "force")


@dataclass(frozen=True)
class FitOptions:
    """What decides a fit's numbers.  CalibrationError for what cannot be; one name may stand for a tuple of one.

    methods: in the order of the report, those that ``tinygc/methods/registry.py`` lets a person choose;
    folds: of the held-out closure, 2 or more;
    seed: of the swarm, 0 or more;
    still_rates: whether the mean rate in each still is data, too;
    integrator: ``exact``, or the paper's ``first-order``;
    optimizer: of the nets, ``second-order``, or the paper's ``adamw``;
    epochs: of adamw;
    loss: of the net, ``squared``, or the paper's ``distance``, not squared;
    earth: whether the Earth's rotation is taken off;
    physics: ids of effects to fit as well, ("auto",) for what `explain` would name, None for none;
    exclude: numbers of segments to leave out;
    denoise: options of tinygc_denoised;
    variant: of the calibration subnet, ``paper`` (27 parameters) or ``published`` (26);
    parts: segments that the net's training carries the attitude through;
    conditions: what a further net is told, some of ``temperature``, ``force``;
    checkpoints: folder where AdamW leaves what it can go on from, and resume: whether it does;
    bias_per_log: whether each log has a bias of its own, of which the median is kept;
    bias: from the ``ends`` of the turns, as everything else, from the ``stills`` around each, or ``auto``: what closes held-out
        segments better.
    accelerometer: its calibration is the one ``given``, that of a ``fit``, or a given one is a ``prior``; ``auto``: a prior where one is
        given and holds, else a fit;
    lot: file of a lot of units, the prior of least squares; other methods are fitted without it.
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
        """Of one training, or None."""
        if self.checkpoints is None or self.optimizer != "adamw":
            return None
        return Checkpoint(self.checkpoints / NAME.format(name), self.resume)
