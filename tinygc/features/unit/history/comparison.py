"""Several sessions of one sensor side by side: does the calibration agree within its stated uncertainty, and if not, what changed?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError
from session.base.records import plain, table_of
from session.base.texts import measured, probability, significant
from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.detect.accelerometer import PARAMETERS
from tinygc.deploy.calibration import in_frame_of
from tinygc.estimation.spread import ACCELEROMETER, USUAL
from tinygc.features.unit.history.sessions import GYROSCOPE, KEPT, NUMBERS, ZERO
from tinygc.fitting.unit_state import (
    DIFFERS_P,
    MODES,
    UnitState,
    all_given_the_same,
    fitted_state,
    in_one_frame,
    refuse_same,
    state_of,
)
from tinygc.inference.choose import Agreement, agreement, chance_of_any, normal_above
from tinygc.library.arguments import is_fit, is_path, public
from tinygc.library.records import Listed, Shown
from tinygc.models.linear import BIAS, MATRIX, field_jacobian, field_vector
from tinygc.reporting.facts import Table
from tinygc.reporting.terminal import Group, Text, one_line

# Stable and unstable parameters
#
# E, the scale factors and misalignments, is stable.  B changes with each switch-on, and with temperature.
# The verdict is therefore on E's nine parameters, with B free in every session (the covariance includes that).  B is compared separately,
# with the drift that the fit's covariance already includes; ``bias=True`` includes it in the verdict, for sessions between which the
# sensor was never switched off.
#
# The sessions' errors are assumed independent.  Shared errors cancel in the difference: the table's, and those of the accelerometer's
# calibration, where all sessions were given the same.  A calibration estimated in each session is not shared.  E maps into the body
# frame that the accelerometer's matrix defines; where the frames differ, all are transformed into the first one's.
#
# The statistic is the weighted scatter about the weighted mean (``inference.choose.agreement``); with two sessions it is the difference's
# d^T (P_1 + P_2)^-1 d.

SCHEMA = "tinygc-compare/2"
#: what E's nine parameters give, then B's three
QUANTITIES = NUMBERS[:GYROSCOPE]
#: least share of the information from the data (a sigma of ten prior sigmas) for a parameter to be observed.  Simulated sessions of 30
#: turns have 0.04 and more, except for the common scale of all axes, which is gravity's length: 1e-7
LEAST_SHARE = 0.01
#: a change of at least so many sigmas is marked
MARKED = 3.0


@dataclass(frozen=True)
class Moved:
    """A quantity that differs in one session from the rest: by how much, in unit, and by how many sigmas; p_value is corrected for the
    number of quantities and sessions compared."""

    session: str
    name: str
    component: str
    unit: str
    by: float
    sigmas: float
    p_value: float


@dataclass(frozen=True, eq=False, repr=False)
class Compared(Shown):
    """Result of ``tinygc.compare``.

    agreement of E (lasting), of B (bias) and of both (all); values and sigmas (sessions, quantities) of the sensor errors; sigmas_off
    (sessions, quantities): each session against the rest; moved: significant changes, largest first; with_bias: whether the verdict
    includes B; triads: agreement of the accelerometers that were estimated, in the parameters observed in all; None where fewer than two
    were.
    """

    sessions: tuple[UnitState, ...]
    lasting: Agreement
    bias: Agreement
    all: Agreement
    values: np.ndarray
    sigmas: np.ndarray
    sigmas_off: np.ndarray
    moved: Listed[Moved]
    notes: tuple[str, ...]
    with_bias: bool
    triads: Agreement | None

    def __repr__(self) -> str:
        return f"<Compared {len(self.sessions)} sessions: {'agree' if self.agree else 'differ'}, {probability(self.p_value)}>"

    @property
    def verdict(self) -> Agreement:
        """The requested agreement."""
        return self.all if self.with_bias else self.lasting

    @property
    def p_value(self) -> float:
        """Probability of at least this difference where nothing has changed."""
        return self.verdict.p_value

    @property
    def agree(self) -> bool:
        """Whether they agree: p is at least 0.01."""
        return self.p_value >= DIFFERS_P

    @property
    def page(self) -> Group:
        """The command's output as a rich renderable."""
        return self.screen()

    def screen(self, everything: bool = False) -> Group:
        """The same; everything: with the accelerometers' numbers where they differ."""
        notes = [one_line(f"Note: {note}.", "yellow") for note in self.notes]
        return Group(*_verdict(self), *notes, _table(self), *_triads(self, everything))

    def to_json(self) -> dict:
        """``tinygc-compare/2`` (docs/formats.md)."""
        rows = zip(QUANTITIES, self.values.T, self.sigmas.T, self.sigmas_off.T, strict=True)
        triads = dict.fromkeys(Agreement.written) if self.triads is None else table_of(self.triads)
        return plain(
            {
                "schema": SCHEMA,
                "sessions": [session.name for session in self.sessions],
                "agree": self.agree,
                "verdict_on": "E and B" if self.with_bias else "E",
                "lasting": self.lasting,
                "bias": self.bias,
                "all": self.all,
                "moved": self.moved,
                "quantities": [table_of(q) | {"values": v, "sigmas": s, "sigmas_from_the_rest": off} for q, v, s, off in rows],
                "accelerometer": {
                    "modes": [s.triad.mode for s in self.sessions],
                    **triads,
                    "quantities": [
                        dict(zip(("name", "component", "unit", "values", "sigmas"), row, strict=True))
                        for row in _side_by_side(self.sessions, [s.triad.rows() for s in self.sessions])
                    ],
                },
                "notes": self.notes,
            }
        )


def compare_calibrated(sessions: list[UnitState], bias: bool = False) -> Compared:
    """Compare two sessions or more.  Raises DataError where two of them are the same recording."""
    refuse_same(sessions)
    vectors, _, covariances = in_one_frame(sessions, sessions[0].triad.calibration)
    si = np.array([each.si for each in QUANTITIES])
    # One Jacobian at the mean for all, so that equal differences are equal everywhere.
    jacobian = field_jacobian(vectors.mean(axis=0))[KEPT] / si[:, None]
    values = np.array([field_vector(vector) for vector in vectors])[:, KEPT] / si
    spread = np.einsum("pi,sij,qj->spq", jacobian, covariances, jacobian)
    # Each value less the weighted mean of the other sessions', (sessions, quantities), in sigmas and in units.
    variances = np.diagonal(spread, axis1=1, axis2=2)
    weights = 1 / variances
    others = weights.sum(axis=0) - weights
    rest = ((weights * values).sum(axis=0) - weights * values) / others
    off, by = (values - rest) / np.sqrt(variances + 1 / others), values - rest
    sigmas = np.sqrt(variances)
    return Compared(
        sessions=tuple(sessions),
        lasting=agreement(vectors[:, MATRIX], covariances[:, MATRIX, MATRIX]),
        bias=agreement(vectors[:, BIAS], covariances[:, BIAS, BIAS]),
        all=agreement(vectors, covariances),
        values=values,
        sigmas=sigmas,
        sigmas_off=off,
        moved=_moved(sessions, by, off, len(QUANTITIES) if bias else ZERO.start),
        notes=(*_notes(sessions), *_frame_notes(sessions, sigmas)),
        with_bias=bias,
        triads=compare_triads(sessions),
    )


def _moved(sessions: list[UnitState], by: np.ndarray, off: np.ndarray, count: int) -> Listed[Moved]:
    """Return significant changes in the first ``count`` quantities, corrected for the number of comparisons (Sidak); of two sessions only
    the second is named."""
    looks = count * (len(sessions) if len(sessions) > 2 else 1)
    found = []
    for s in range(len(sessions)) if len(sessions) > 2 else [1]:
        for q, each in enumerate(QUANTITIES[:count]):
            p_value = chance_of_any(2 * normal_above(abs(off[s, q])), looks)
            found.append(Moved(sessions[s].name, each.name, each.component, each.unit, float(by[s, q]), float(off[s, q]), p_value))
    found = [moved for moved in found if moved.p_value < DIFFERS_P]
    return Listed(sorted(found, key=lambda moved: -abs(moved.sigmas)))


def _notes(sessions: list[UnitState]) -> tuple[str, ...]:
    notes = [f"{session.name}: {note}" for session in sessions for note in session.notes]
    notes += [f"{session.name}: not observed there: {', '.join(session.unobserved)}" for session in sessions if session.unobserved]
    first = sessions[0].settings
    for session in sessions[1:]:
        sensor = session.settings.sensor
        if (sensor.model, sensor.serial) != (first.sensor.model, first.sensor.serial):
            one, other = (f"{s.model} {s.serial}".strip() for s in (first.sensor, sensor))
            notes.append(f"{session.name} is of another sensor by its session.toml ({other}, not {one})")
        if sensor.gyro_fs_dps != first.sensor.gyro_fs_dps:
            notes.append(f"{session.name} has another full scale ({sensor.gyro_fs_dps:g}, not {first.sensor.gyro_fs_dps:g} dps)")
        if session.triad.mode != sessions[0].triad.mode:
            one, other = (MODES[s.triad.mode] for s in (sessions[0], session))
            notes.append(f"{session.name}: accelerometer {other}; {sessions[0].name}: {one}")
        given = all(s.triad.mode != "fit" for s in (sessions[0], session))
        if given and not session.settings.accelerometer.is_as(first.accelerometer):
            notes.append(f"{session.name} was given another accelerometer calibration: E differs by it")
    return tuple(notes)


def _frame_notes(sessions: list[UnitState], sigmas: np.ndarray) -> list[str]:
    """Return notes on sessions in another body frame, where it differs by more than a misalignment's sigma."""
    smallest = sigmas[:, [each.name == "misalignment" for each in QUANTITIES]].min() * 1e-3
    angles = [in_frame_of(sessions[0].triad.calibration, session.triad.calibration)[1] for session in sessions]
    return [
        f"{session.name} is turned by {significant(1e3 * angle, 2)} mrad into the body frame of {sessions[0].name}"
        for session, angle in zip(sessions, angles, strict=True)
        if angle > smallest
    ]


# The accelerometers.
#
# The force is M (m - b), M = Q U: U upper triangular is the sensor's triad, Q a rotation of the body frame against it, where a full matrix
# was given.  omega = E m + B is in that frame.


def compare_triads(sessions: list[UnitState]) -> Agreement | None:
    """Agreement of the triads; it excludes the error of a calibration that was given to all."""
    estimated = [s for s in sessions if s.triad.covariance is not None]
    seen = np.array([not any(name in s.triad.unobserved for s in sessions) for name in ACCELEROMETER_NAMES])
    if len(estimated) < 2 or not seen.any():
        return None
    vectors = np.array([s.triad.values for s in estimated])[:, seen]
    whole = apart = np.array([s.triad.covariance for s in estimated])
    if all_given_the_same(sessions):
        apart = whole - np.array([np.zeros((PARAMETERS, PARAMETERS)) if s.triad_of_given is None else s.triad_of_given for s in estimated])
    slope = np.array([s.triad.jacobian for s in estimated])[:, seen]
    whole, apart = (slope @ each @ slope.transpose(0, 2, 1) for each in (whole, apart))
    between = np.diag(USUAL.at(ACCELEROMETER).sigma[seen] ** 2)  # each session is one draw of what a switch-on does
    whole, apart = whole + between, apart + between
    kept = _observed(whole.sum(axis=0), apart.sum(axis=0))
    return agreement(vectors @ kept, kept.T @ apart @ kept) if kept.shape[1] else None


def _observed(whole: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Return the combinations (k, j) of the parameters that the recordings observe, not only the given calibration.

    Where data contribute a share s of the information, and the given calibration 1 - s, ``apart`` is s times ``whole``.
    """
    from scipy.linalg import eigh

    share, directions = eigh(apart, whole)
    return directions[:, share > LEAST_SHARE]


Row = tuple[str, str, str, list[float | None], list[float | None]]


def _side_by_side(sessions: tuple[UnitState, ...], tables: list) -> list[Row]:
    """Rows of the accelerometers' corrections or errors: word, component, unit, and for each session the value, None where it is not
    observed, and the sigma, None where it was given."""
    found = []
    for parts in zip(*tables, strict=True):
        key, unit, _, _, names = parts[0]
        for i, name in enumerate(names):
            seen = [name not in s.triad.unobserved and s.triad.calibration.source != "none" for s in sessions]
            values = [float(part[2][i]) if known else None for part, known in zip(parts, seen, strict=True)]
            sigmas = [None if part[3] is None or not known else float(part[3][i]) for part, known in zip(parts, seen, strict=True)]
            found.append((key.removesuffix(f"_{unit}").replace("_", " "), name.split()[-1], unit, values, sigmas))
    return found


# Its page, and the function.


def _table(found: Compared) -> Table:
    rows = []
    for each, values, sigmas, offs in zip(QUANTITIES, found.values.T, found.sigmas.T, found.sigmas_off.T, strict=True):
        off = np.abs(offs).max()
        cells = map(measured, values, sigmas)
        rows.append([f"{each.words}, {each.unit}", *cells, Text(f"{off:.1f}", "bold red" if off > MARKED else "")])
    names = [session.name for session in found.sessions]
    return Table("Value ± one sigma; the largest difference in sigmas", ["", *names, "sigmas"], rows, minor=range(2, len(names) + 1))


def _triads(found: Compared, everything: bool) -> list[Text | Table]:
    """Whether the accelerometers agree, and where not, their numbers or how they are shown."""
    if found.triads is None:
        return [Text("The accelerometers were not both estimated, and are not compared.")]
    if found.triads.p_value >= DIFFERS_P:
        return [Text(f"Accelerometers agree ({probability(found.triads.p_value)}).")]
    differ = Text(f"ACCELEROMETERS DIFFER ({probability(found.triads.p_value)}).", "bold red")
    if not everything:
        return [differ, Text("next: --all shows their numbers")]
    rows = []
    for word, component, unit, values, sigmas in _side_by_side(found.sessions, [s.triad.errors() for s in found.sessions]):
        cells = ["not observed" if value is None else measured(value, sigma) for value, sigma in zip(values, sigmas, strict=True)]
        rows.append([f"{word} {component}, {unit}", *cells])
    header = ["", *(s.name for s in found.sessions)]
    table = Table("Accelerometers: value ± one sigma", header, rows, minor=range(2, len(header)))
    return [differ, table]


def verdict_line(found: Compared) -> Text:
    """State whether the calibrations agree."""
    what, p = "scale factors, misalignments" + ", biases" * found.with_bias, probability(found.p_value)
    if found.agree:
        return Text(f"AGREE: {what} ({p}).", "bold green")
    if found.moved:
        moved, more = found.moved[0], len(found.moved) - 1
        of = f" of {moved.session}" * (len(found.sessions) > 2)
        what = f"{moved.name} {moved.component}{of} by {'+' if moved.by > 0 else ''}{significant(moved.by)} {moved.unit}"
        what += f", {abs(moved.sigmas):.0f} sigmas" + f", and {more} more" * bool(more)
    return one_line(f"DIFFER: {what} ({p}).", "bold red")


def _verdict(found: Compared) -> list[Text]:
    lines = [verdict_line(found)]
    if not found.agree and not found.moved:
        lines.append(Text("  no single one stands out: several moved a little, together"))
    if not found.with_bias:
        differs, p = found.bias.p_value < DIFFERS_P, probability(found.bias.p_value)
        lines.append(Text(f"Bias differs, as after a switch-on ({p}): re-estimate it before use." if differs else f"Bias agrees ({p})."))
    return lines


@public()
def compare(sessions: Any, *, bias: bool = False) -> Compared:
    """Compare the calibrations of several sessions of one sensor: whether they agree.

    Parameters
    ----------
    sessions : sequence of Fit, str or Path
        Two or more fits, or folders of fitted sessions.
    bias : bool, optional
        The bias counts, too: the sensor was never switched off in between.

    Returns
    -------
    Compared
        ``agree``, ``p_value``, ``moved``, ``summary()``, ``to_json()``; the numbers of all sessions.

    Raises
    ------
    CalibrationError
        For fewer than two sessions, for the same recording twice, and for a session without a fit.

    Examples
    --------
    >>> import tinygc
    >>> simulated = [tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=seed, unit_seed=1) for seed in (1, 2)]
    >>> tinygc.compare([tinygc.fit(each.session, methods=("least_squares",)) for each in simulated]).agree
    True

    """
    given: list[Any] = list(sessions) if isinstance(sessions, list | tuple) else [sessions]
    for each in given:
        if not is_fit(each) and not is_path(each):
            raise CalibrationError(f"sessions holds {each!r:.60}, expected a Fit or the path of a fitted session")
    if len(given) < 2:
        raise CalibrationError("--compare needs two sessions or more")
    read = [state_of(each.result, each.config) if is_fit(each) else fitted_state(Path(each)) for each in given]
    return compare_calibrated(read, bias)
