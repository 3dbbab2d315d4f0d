"""Python interface of ``noise``: the noise figures of one unit, of logs, sessions and arrays, or of an Allan curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from session import VERSION
from session.base.errors import CalibrationError
from session.base.progress import Progress, no_report
from session.base.records import Key, Size, table_of
from session.base.results import Keys, Maybe, Number
from session.log.folder import Session
from tinygc.features.noise.curve import estimate_of_curve
from tinygc.features.noise.estimate import estimate_noise as estimate_of
from tinygc.features.noise.inputs import Input, read_inputs
from tinygc.features.noise.options import NoiseOptions
from tinygc.features.noise.output import (
    KALIBR,
    OpenTerm,
    SheetFigure,
    against_data_sheet,
    kalibr_figures,
    noise_page,
    open_terms,
    picture_of,
)
from tinygc.library.arguments import is_number, is_path, public
from tinygc.library.records import Kept
from tinygc.noise.figures import FILE, Inflation, NoiseFigures
from tinygc.reporting.terminal import Group

PICTURE = "noise.svg"
#: in a session's folder, where it was fitted
FITTED = "fit/fit.json"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Noise(NoiseFigures, Kept):
    """Result of ``tinygc.estimate_noise``, and ``noise.json`` as it is written: the figures in SI, and ``allan``, the Allan deviation of
    ``gyro`` and ``accel`` with 68 % bounds; remarks: what was left out, repaired, assumed or is to be known, one sentence each."""

    FILES: ClassVar = (FILE, PICTURE)
    version: Annotated[str, Key(absent="")] = VERSION
    left_out_s: Size
    remarks: tuple[str, ...]
    kalibr: Annotated[Mapping[str, float | None], Keys(dict.fromkeys(KALIBR.values(), Maybe(Number(0))))]
    open_terms: tuple[OpenTerm, ...]
    data_sheet: tuple[SheetFigure, ...]

    def __repr__(self) -> str:
        return f"<Noise of {self.sensor or 'a sensor'}: {self.duration_s:.0f} s of rest>"

    @classmethod
    def of(cls, figures: NoiseFigures, remarks: Sequence[str], left_out_s: float) -> Noise:
        """Figures with what follows from them."""
        sheet = tuple(against_data_sheet(figures))
        more: dict[str, Any] = {"kalibr": kalibr_figures(figures), "open_terms": tuple(open_terms(figures)), "data_sheet": sheet}
        return cls(**vars(figures), left_out_s=left_out_s, remarks=tuple(remarks), **more)

    @property
    def page(self) -> Group:
        """The command's first screen, as a rich renderable."""
        return self.pages()

    def pages(self, verbose: bool = False) -> Group:
        """The command's output; verbose: with every term, and all remarks."""
        return noise_page(self, self.remarks, self.left_out_s, verbose)

    def to_json(self) -> dict:
        """``tinygc-noise/1`` (docs/formats/noise.md)."""
        return table_of(self)

    figure = picture_of


def noise_of(inputs: Sequence[Input], sensor: str, serial: str, progress: Progress) -> Noise:
    """Estimate the noise of one unit.  Raises CalibrationError, in one line, for inputs that cannot be read or are of several units."""
    rests = read_inputs(inputs, sensor, serial, progress)
    figures, found_remarks, left_out_s = estimate_of(rests.sums, progress)
    rests.sums.clear()  # of a day as large as its logs, which are fitted next
    figures = replace(figures, logs=tuple(rests.logs), sensor=rests.sensor, serial=rests.serial)
    remarks = [*found_remarks, *rests.remarks]
    found: list[Inflation] = []
    folders = [Path(each) for each in inputs if isinstance(each, Path | str) and (Path(each) / FITTED).is_file()]
    if folders and not figures.gyro.is_described:
        axes = " ".join(name for name, axis in zip("xyz", figures.gyro.axes, strict=True) if not axis.is_described)
        remarks.append(f"No inflation: it is to N at rest, and the terms do not describe gyroscope {axes}.")
        folders = []
    if folders:  # what fits is loaded where there is a fit
        from tinygc.features.noise.inflation import inflations_of_folder
        from tinygc.fitting.fit_file import read_fit
    for number, folder in enumerate(folders):
        progress("what filters need", number, len(folders))
        try:
            found += inflations_of_folder(folder, figures)
            verdict = read_fit(folder / FITTED).get("verdict") or {}
            if verdict.get("answer") == "fail":
                remarks.append(f"{folder.name}: the fit fails ({verdict.get('headline', 'FAIL')}); the factor covers its misfit.")
        except CalibrationError as error:
            remarks.append(f"No inflation of {folder.name}: {error}")
    # Each session has the same inflation at rest.
    figures = replace(figures, inflations=tuple({each.motion: each for each in found}.values()))
    return Noise.of(figures, remarks, left_out_s)


@public(NoiseOptions)
def estimate_noise(logs: Any = None, *, progress: Progress | None = None, **choices: Any) -> Any:
    """Estimate the noise of one unit at rest: the terms of IEEE 952 of each axis, with their sigmas.

    Parameters
    ----------
    logs : str, Path, Session, tuple of arrays, or sequence of them
        Session folders, folders of rest logs, standard logs, sessions, or ``(t_s, gyro_rps, accel_mps2)``: (N,) s, (N, 3) rad/s,
        (N, 3) m/s².  Several are one estimate of one unit.  Of a log that moves, its stills are used.
    progress : callable, optional
        Called with what is done, how far, and of how much.

    Returns
    -------
    Noise
        ``gyro`` and ``accel`` in SI, ``allan``, ``remarks``, ``summary()``, ``to_json()``, ``save(folder)``, ``plot(path)``.

    Raises
    ------
    CalibrationError
        For what cannot be read, for logs of two units or data rates; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> found = tinygc.estimate_noise(["rest0001.csv", "rest0002.csv"])  # doctest: +SKIP
    >>> found.gyro.values("N")  # doctest: +SKIP

    """
    options = NoiseOptions(**choices)
    if options.curve is None:
        inputs = [_input(each) for each in (logs if isinstance(logs, list) else [logs])]
        return noise_of(inputs, options.sensor, options.serial, progress or no_report)
    if logs is not None:
        raise CalibrationError("estimate_noise: give logs or curve, not both")
    figures, remarks = estimate_of_curve(options.curve, options.curve_units, options.duration_s, options.odr_hz)
    return Noise.of(replace(figures, sensor=options.sensor, serial=options.serial), remarks, 0.0)


def _input(given: Any) -> Any:
    """A path, a session, or three arrays; CalibrationError for anything else."""
    if is_path(given):
        return Path(given)
    if isinstance(given, Session) or (isinstance(given, tuple) and len(given) == 3 and not any(map(is_number, given))):
        return given
    raise CalibrationError(
        f"logs is of type {type(given).__name__}, expected the path of a log or folder, a tinygc.Session, a tuple of three arrays "
        "(t_s, gyro_rps, accel_mps2), or a list of these"
    )
