"""A form as an effect: for the search, and with its numbers as a written law, so that all code that fits and draws effects accepts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from session.base.numeric import rms_of
from session.base.units import DEG
from tinygc.effects import (
    Convention,
    Effect,
    Movement,
    NoC,
    Parameter,
    ReferenceConditions,
    Scan,
    StatedNumbers,
    axis_of,
    largest,
)
from tinygc.effects.device import PASSES
from tinygc.effects.effect import SCALE_LAW
from tinygc.effects.inversion import JUMPS_REACH, undone_with_jumps
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_on_device import device_of
from tinygc.features.discovery.words import coefficient_unit, constants_of, follows, jumps, known_to, observable_in, regime, splits
from tinygc.features.discovery.words import equation as equation_of

#: rad/s rms: no working gyroscope has a larger error
PLAUSIBLE_RPS = 5 * DEG


def columns_of(form: LawForm, movement: Movement) -> np.ndarray:
    """Rate added by one rad/s of each coefficient, (N, 3, P)."""
    values = {factor: factor.values(movement) for factor in form.factors}
    terms = form.terms()
    found = np.zeros((len(movement.rate), 3, len(terms)))
    for number, (axis, parts) in enumerate(terms):
        product = np.ones(len(movement.rate))
        for factor, component in parts:
            product = product * values[factor][:, component]
        found[:, axis, number] = product
    return found


def distorted(form: LawForm, movement: Movement, theta: np.ndarray) -> np.ndarray:
    """Rate with the law, (N, 3) rad/s; as ``columns_of`` times theta (P,), without the zeros."""
    values = {factor: factor.values(movement) for factor in form.factors}
    found = movement.rate.copy()
    for (axis, (first, *others)), coefficient in zip(form.terms(), theta, strict=True):
        product = coefficient * values[first[0]][:, first[1]]
        for factor, component in others:
            product *= values[factor][:, component]
        found[:, axis] += product
    return found


def added(effect: Effect, theta: np.ndarray, movements: Sequence[Movement]) -> np.ndarray:
    """Rate added by an effect, (N, 3) rad/s over all logs concatenated."""
    return np.concatenate([effect.columns(effect.shown(movement)) @ theta for movement in movements])


def as_effect(form: LawForm, name: str = "discovered.law", rms: float = 1.0, equation: str = "") -> Effect:
    """The form as an effect; rms: of its products in the recording, which sets its plausible size."""
    unit, said = form.coefficient_unit, equation or equation_of(form)
    return Effect(
        id=name,
        equation=said,
        parameter=Parameter("coefficients", (form.size,), unit, DEG, plausible=PLAUSIBLE_RPS / max(rms, 1e-12)),
        observable_in=("still", "turn"),
        columns=lambda movement: columns_of(form, movement),
        describe=lambda theta: f"follows {said} (up to {np.abs(theta).max() / DEG:.3g} {unit})",
        discriminating_motion=splits(form),
        conditions=regime(form),
        inputs=form.inputs,
        reach=form.reach,
        exact_distort=lambda movement, theta: distorted(form, movement, theta),
        device=NoC("no C has been written for it"),
    )


# A law with its numbers, as its file states them (``effect_file.py``).

#: plausible size over the size found: a proof (``tinygc.effects.testing``) injects a twentieth of it
PLAUSIBLE = 20.0
#: factors on the constant found, at which another unit's own constant is searched
GRID = np.array([0.5, 0.63, 0.8, 1, 1.25, 1.6, 2])


def law_effect(
    name: str,
    form: LawForm,
    theta: np.ndarray,
    covariance: np.ndarray,
    *,
    sigmas: Sequence[float] = (),
    full_scale_dps: float | None = None,
    first_temp_c: float | None = None,
    passes: int = PASSES,
    passes_in_c: int | None = PASSES,
    not_observed: Sequence[Sequence[float]] = (),
) -> Effect:
    """A law as an effect.

    theta (P,) and covariance (P, P) SI: what a session gave, with which another of the unit must agree; sigmas: of the form's constants, in
    their own units; full_scale_dps, first_temp_c: what the law calls FS and T0, in every session, those of each session where None;
    passes: of substitution that undo it, passes_in_c: in C, None where none do; not_observed (q, P): combinations of the coefficients that
    the session did not observe, and that the law is without.
    """
    fs_rps = None if full_scale_dps is None else full_scale_dps * DEG
    known = {key: value for key, value in {"fs_rps": fs_rps, "first_temp_c": first_temp_c}.items() if value is not None}
    seen, jumping, (unit, parameter) = np.eye(form.size), jumps(form), coefficient_unit(form)
    if len(not_observed):
        seen = seen - np.linalg.pinv(np.array(not_observed)) @ np.array(not_observed)

    def at(form: LawForm) -> Effect:
        """What the law does, with these constants."""

        def distort(movement: Movement, theta: np.ndarray) -> np.ndarray:
            return distorted(form, replace(movement, **known), seen @ theta)

        def correct(measured: np.ndarray, movement: Movement, theta: np.ndarray) -> np.ndarray:
            """Where it jumps, a reading may belong to two rates: the one that goes on smoothly."""
            return undone_with_jumps(measured, movement, lambda moved: distort(moved, theta) - moved.rate, passes)

        # Each pass of an inversion that jumps looks back once more; a reach to the log's beginning does not grow.
        reach = form.reach if not jumping else form.reach.times(1 if form.remembers else passes + 2) + JUMPS_REACH
        device = device_of(form, name.partition(".")[2], passes_in_c, fs_rps, first_temp_c)
        return replace(
            as_effect(form, name),
            columns=lambda movement: columns_of(form, replace(movement, **known)) @ seen,
            exact_distort=distort,
            exact_correct=correct if jumping else None,
            reach=reach,
            device=NoC("part of it was not observed, and its C would apply that part") if len(not_observed) else device,
        )

    def anywhere(text: str) -> str:
        """Reword text about one session so that it holds in any."""
        if full_scale_dps is not None:
            text = text.replace("ω / FS", f"ω / ({full_scale_dps:.6g} dps)").replace("of full scale", f"of {full_scale_dps:.6g} dps")
        if first_temp_c is not None:
            text = text.replace("T in °C", f"T in °C, T₀ = {first_temp_c:g} °C")
            text = text.replace("since the session's beginning", f"above {first_temp_c:g} °C")
        return text

    scan, stated = None, None
    if len(form.constants) == 1:
        (constant,), (own,) = constants_of(form, sigmas), form.constants
        stated = None if constant.sigma is None else (own, constant.sigma * constant.si)
        scan = Scan(
            constant.json,
            constant.unit or "fraction",
            make=lambda value: replace(found, **_action(at(form.with_constants((value,))))),
            si=constant.si,
            grid=lambda movements: own * GRID,
            smooth=True,
        )
    found = replace(
        at(form),
        equation=anywhere(equation_of(form)),
        parameter=Parameter(parameter, form.parameter_shape, unit, DEG, plausible=float(f"{PLAUSIBLE * rms_of(theta) / DEG:.2g}") * DEG),
        observable_in=observable_in(form),
        describe=lambda theta: f"{abs(largest(theta)) / DEG:.3g} {unit} on {axis_of(theta)}: {anywhere(follows(form))}",
        passes=None if jumping or passes == PASSES else passes,
        scan=scan,
        reference_conditions=ReferenceConditions(**known),
        gauge_convention=Convention(lambda theta: seen @ theta, lambda theta: seen) if len(not_observed) else None,
        stated=StatedNumbers(np.array(theta), np.array(covariance), stated),
        known_to=known_to(form),
        picture=SCALE_LAW if form.is_scale_law else None,
    )
    return found


def _action(effect: Effect) -> dict:
    return {name: getattr(effect, name) for name in ("columns", "exact_distort", "exact_correct", "reach", "device")}
