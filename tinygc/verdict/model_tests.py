"""Whether a recording contradicts the model, tested once, for ``fit``, ``explain`` and every page.

turns     closure of the fitted segments against all noise that has a cause (``stated_goodness``)
noise     components larger than such a sensor has (``SessionNoise.beyond``): what turns and stills have beyond it is no noise of a sensor
effect    odds of one effect of the catalogue against none (``systematic``)
gravity   a given calibration of the accelerometer against gravity in the stills
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from session.base.results import Maybe, Number, Text
from session.base.texts import probability
from tinygc.closure.joint import REFUTED_P
from tinygc.closure.uncertainty import GoodnessOfFit
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.stated_noise import StatedNoise
from tinygc.estimation.systematic import Systematic
from tinygc.inference.choose import MISMATCH_P, PRIOR_ODDS, SURE, SUSPECTED

TURNS, RUN, NOISE, EFFECT, GRAVITY = "turns", "run", "noise", "effect", "gravity"
#: id of an effect that a latitude removes, and what is reported of it
EARTH_ROTATION, EARTH_SHOWS = "earth.rotation", "the Earth's rotation shows; give your latitude"


@dataclass(frozen=True)
class ModelTest:
    """One test: p_value, the probability of as much without a contradiction, or of EFFECT that no effect is missing; least_p, below which
    it contradicts the model; description: a sentence."""

    written = ("name", "p_value", "contradicts", "description")
    name: Annotated[str, Text((TURNS, RUN, NOISE, EFFECT, GRAVITY))]
    p_value: Annotated[float, Maybe(Number(0, 1))]
    least_p: float
    description: str

    @property
    def contradicts(self) -> bool:
        """Whether the recording contradicts the model."""
        return self.p_value < self.least_p

    @property
    def leaves_open(self) -> bool:
        """Whether the recording neither contradicts the model nor supports it: an effect is more probably missing than not."""
        return self.name == EFFECT and self.least_p <= self.p_value < none_missing(SUSPECTED)


def model_tests(
    goodness: GoodnessOfFit,
    runs: Mapping[str, float],
    noise: StatedNoise | None,
    allowed: Systematic | None,
    accelerometer: AccelerometerFit | None,
    latitude_deg: float | None = None,
) -> tuple[ModelTest, ...]:
    """Return the tests of a linear model that can be made; runs: p-value by file; noise and allowed: None where the noise is not
    estimated; latitude_deg of the site, None where it is not known."""
    p = goodness.p_value
    found = [ModelTest(TURNS, p, MISMATCH_P, f"closure of the fitted turns, {goodness.freedom} degrees of freedom: {probability(p)}")]
    found += [ModelTest(RUN, p, MISMATCH_P, f"{file}: {probability(p)}") for file, p in runs.items()]
    if noise is not None:
        p, beyond = noise.unusual_p, noise.noise.beyond_words
        more = "turns or stills differ by more than such a sensor's noise"
        differs = more if p < MISMATCH_P else "the noise may be that of such a sensor"
        found.append(ModelTest(NOISE, p, MISMATCH_P, f"{differs} ({probability(p)}){beyond and f': {beyond}'}"))
    if allowed is not None:
        none, named = none_missing(allowed.log_odds_of_any), " or ".join(allowed.suspected)
        p = none + (1 - none) * allowed.share_of_zero  # a drift of the zero is part of the fit's noise, and moves neither scale nor axes
        missing = f"an effect is probably missing: {named}" if named else "no effect of the catalogue is probable"
        if named and p >= none_missing(SUSPECTED):
            missing = f"the zero drifts ({named}); no effect on scale or axes is probable"
        if latitude_deg is None and allowed.suspected[:1] == [EARTH_ROTATION]:
            missing = EARTH_SHOWS
        found.append(ModelTest(EFFECT, p, none_missing(SURE), missing))
    return (*found, *([] if accelerometer is None else gravity_test(accelerometer)))


def gravity_test(accelerometer: AccelerometerFit) -> list[ModelTest]:
    """Return the test of a given calibration of the accelerometer; empty where none was given, or it was not tested."""
    p = accelerometer.p_value
    if accelerometer.mode not in ("given", "prior") or p is None:
        return []
    held = "no longer holds" if p < REFUTED_P else "agrees with gravity in the stills"
    return [ModelTest(GRAVITY, p, REFUTED_P, f"accelerometer: the given calibration {held} ({probability(p)})")]


def none_missing(log_odds: float) -> float:
    """Probability that no effect is missing, by the odds of any of the most probable ones against none, and the prior odds."""
    return float(1 / (1 + PRIOR_ODDS * np.exp(min(log_odds, 700.0))))


def contradictions(tests: Sequence[ModelTest]) -> list[ModelTest]:
    """Return those that contradict the model, the least probable first."""
    return sorted((test for test in tests if test.contradicts), key=lambda test: test.p_value)


def least_p(tests: Sequence[ModelTest]) -> list[float]:
    """Return the least p-value, in a list, empty without tests.  The probability that no effect is missing is none, and counts where it
    decides alone."""
    return sorted(test.p_value for test in tests if test.contradicts or test.name != EFFECT)[:1]
