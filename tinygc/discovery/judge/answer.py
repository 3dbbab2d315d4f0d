"""What the search for an equation answers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.effects import Effect

VERDICTS = ("found", "ambiguous", "none")


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Of what the search never saw: closure (tilt, rms) rad with the names alone, with the law as well, and the noise's; removed: share of
    the excess over the noise that the law takes away, None where there was none to speak of; p_value: of chance improving it as much;
    noise_p: of the sensor's own noise leaving as much as the law leaves; segments: how
    many; recording: the log that was left out whole, None where these are parts of each."""

    before_rad: float
    after_rad: float
    floor_rad: float
    removed: float | None
    p_value: float
    noise_p: float
    segments: int
    recording: str | None = None


@dataclass(frozen=True, eq=False)
class RunnerUp:
    """A form that was weighed in the law's place, or a name of the catalogue: equation; worse: -2 log evidence by which it is worse, with
    the price of descriptions or without, whichever is less; correlation of the rate that it adds with the law's, beside what a
    calibration takes up; splits: what would tell them apart."""

    form: Form | None
    effect: Effect
    worse: float
    correlation: float
    splits: str


@dataclass(frozen=True, eq=False)
class Law:
    """One law: form, and as an effect with its id and equation; theta (P,) and covariance (P, P) SI, of all rows; constants_sigma: of the
    form's constants, in their order; bits: of the form among all; gain: chi-square that it takes up; better: -2 log evidence by which it
    is better than without it; chance_p: of the best form of all doing as much in noise; held_out: parts of each recording, and the whole
    recording that was left out, where there are several; same: forms that are the same in this recording; runners_up: others, best first;
    learnable_from: factor on its size from which this search finds it here in 19 of 20 draws of noise, None: not at any."""

    form: Form
    effect: Effect
    theta: np.ndarray
    covariance: np.ndarray
    constants_sigma: tuple[float, ...]
    bits: float
    gain: float
    better: float
    chance_p: float
    held_out: tuple[HeldOut, ...]
    same: tuple[Form, ...] = ()
    runners_up: tuple[RunnerUp, ...] = ()
    learnable_from: float | None = None


@dataclass(frozen=True, eq=False)
class Beside:
    """An effect of the catalogue that stands beside the laws: id; parameters and their std as docs/formats.md names them."""

    id: str
    parameters: dict
    std: dict


@dataclass(frozen=True, eq=False)
class Discovery:
    """verdict: "found": the laws are said; "ambiguous": they stand, but a rival of another rate is as good, or too little is seen of them,
    or they leave more than noise; "none": no equation of this grammar; why: one line, of the last two.

    laws; beside: the catalogue's effects that stand with them, or alone; forms: how many were enumerated, distinct: how many of them differ
    in this recording; chance_promise: what the best form of all promises in noise alone, 95 % of the time less;
    best_promise: of the recording itself; learnable: quantity -> size, rms rad/s, from which a law of it alone is found here in 19 of 20
    draws of noise, None where not at all.
    """

    verdict: str
    why: str
    laws: tuple[Law, ...]
    beside: tuple[Beside, ...]
    forms: int
    distinct: int
    chance_promise: float
    best_promise: float
    learnable: dict[str, float | None] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Ids of the catalogue's effects that stand beside the laws."""
        return tuple(each.id for each in self.beside)
