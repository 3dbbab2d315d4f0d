"""Units that do not belong to a lot, with reasons: outlying numbers in sigmas of the lot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from session.base.records import Key, Share
from tinygc.features.fleet.estimate import FAMILY_P, LotEstimate
from tinygc.features.fleet.lot import OWN, SENSOR_ERRORS, LotSessions, error_sigmas, jacobian

MOST_REASONS = 5


@dataclass(frozen=True)
class Reason:
    """Reason for an outlier: what, a number's key; value, of the number less the lot's mean in its unit; sigmas of the lot."""

    what: str
    value: float
    sigmas: float


@dataclass(frozen=True)
class Outlier:
    """A unit that does not belong: serial; session, of a unit with one session alone, else empty; p_value over the whole lot; reasons, the
    largest first; says: a sentence."""

    serial: str
    session: str
    p_value: Share
    reasons: tuple[Reason, ...]
    says: Annotated[str, Key("description")]


def outliers(lot: LotSessions, found: LotEstimate) -> list[Outlier]:
    """Return the outliers, the least probable first."""
    made, J, p_values = [], jacobian(found.mean), found.p_values[:, OWN]
    values, sigmas = np.nan_to_num(found.off) @ J.T, error_sigmas(found.off_sigma, J)
    for u in np.flatnonzero(found.excluded):
        order = [n for n in np.argsort(-np.abs(found.off / found.off_sigma)[u, OWN]) if p_values[u, n] < FAMILY_P]
        reasons = [Reason(SENSOR_ERRORS[n].key, float(values[u, n]), float(values[u, n] / sigmas[u, n])) for n in order[:MOST_REASONS]]
        session = lot.names[lot.first[u]] if lot.count[u] == 1 else ""
        serial = lot.serials[u]
        words = []
        for reason in reasons:
            (each,) = (each for each in SENSOR_ERRORS if each.key == reason.what)
            value = f"{reason.value:+.0f}" if abs(reason.value) >= 100 else f"{reason.value:+.3g}"
            words.append(f"{each.name} {value} {each.unit} ({reason.sigmas:+.1f} sigmas)")
        single = f", of the single session {session}," if session else ""
        says = f"unit {serial or '(no serial)'}{single} does not belong to the lot: {', '.join(words)}"
        made.append(Outlier(serial, session, float(p_values[u].min()), tuple(reasons), says))
    return sorted(made, key=lambda each: each.p_value)
