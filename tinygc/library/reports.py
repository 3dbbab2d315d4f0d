"""``tinygc.report`` and ``tinygc.export``: a calibration for people, and for other programs."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.files import result_folder
from session.base.names import refuse_special
from session.base.options import records
from session.base.progress import Progress
from session.base.records import plain
from session.base.results import write_text_whole
from session.log.folder import Session
from tinygc.deploy import FORMATS, NOISE_FORMATS, ExportError, ExportOptions, exports, feature_exports, format_named
from tinygc.deploy.exports._context import Context, NoiseSource, read_context
from tinygc.estimation.options import FitOptions
from tinygc.library.arguments import chosen, is_fit, public
from tinygc.library.records import Shown
from tinygc.library.sources import session_or_folder
from tinygc.models.model import Model
from tinygc.noise.figures import NoiseFigures
from tinygc.reporting import ReportOptions
from tinygc.reporting.terminal import Group
from tinygc.verdict.acceptance import Acceptance

if TYPE_CHECKING:
    from tinygc.explanation.reported import ReportData
    from tinygc.fitting.results import FitResult

# The report: one HTML file.


@dataclass(frozen=True, eq=False, repr=False)
class Report(Shown):
    """Result of ``tinygc.report``."""

    #: everything that the report shows, in SI
    data: ReportData

    def __repr__(self) -> str:
        return f"<Report of {self.data.fit.session.name}: {self.verdict.word}>"

    @property
    def verdict(self) -> Acceptance:
        """PASS, NOT DECIDED or FAIL (``word``), with its ``headline``, ``rule``, ``reasons`` and ``doubts``."""
        return self.data.decision

    @property
    def page(self) -> Group:
        """The verdict with its reasons, as a rich renderable."""
        from tinygc.reporting.fit_screen import verdict_lines

        return Group(*verdict_lines(self.verdict, reasons=True))

    @cached_property
    def html(self) -> str:
        """The report as one HTML document that needs nothing else."""
        from tinygc.reporting.html.page import page

        return page(self.data)

    def to_json(self) -> dict:
        """``tinygc-report/1`` (docs/formats.md)."""
        from tinygc.reporting.html.page import summary

        return plain(summary(self.data))

    def save(self, path: Path | str, *, pdf: bool = False) -> list[Path]:
        """Write the HTML file, and the same as PDF next to it, which needs Chromium; returns the paths."""
        from tinygc.reporting.html.page import save
        from tinygc.reporting.html.paper import print_pdf, require_browser

        path = Path(path)
        if path.is_dir():
            raise CalibrationError(f"{path}: that is a folder; give a file")
        if pdf:
            require_browser()
        save(self.data, path)
        return [path, *([print_pdf(path, path.with_suffix(".pdf"))] if pdf else [])]


def report_of(
    where: Session | Path,
    options: FitOptions,
    fit: FitResult | None,
    path: Path | str | None,
    how: ReportOptions,
    progress: Progress | None,
) -> Report:
    """Gather what the report of a session, or a session folder, shows, and write it if a path is given; fit: its fit with these options,
    where it was run before."""
    from tinygc.explanation.reported import gather  # with the fit and the search for effects, which an export does not need

    made = Report(gather(where, options, explain=how.explain, limit_deg=how.limit_deg, fit=fit, progress=progress))
    if path is not None:
        made.save(path, pdf=how.pdf)
    return made


@public(ReportOptions, FitOptions)
def report(
    session: Any,
    path: Path | str | None = None,
    options: FitOptions | None = None,
    *,
    progress: Progress | None = None,
    **choices: Any,
) -> Report:
    """Make the calibration report: one HTML file that needs nothing else.

    Parameters
    ----------
    session : Session, Fit, table, str or Path
        The recording, its folder, or its fit, which is not computed again.
    path : str or Path, optional
        The HTML file to write; without it ``save`` writes the report.
    options : FitOptions, optional
        Options of the fit, where none is given.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    Report
        ``verdict``, ``html``, ``to_json()``, ``save(path)``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted, and for a wrong option; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> made = tinygc.report(session, explain=False, methods=("least_squares",))
    >>> made.verdict.word
    'NOT DECIDED'

    """
    (how,) = records(choices, ReportOptions)
    choices = {name: value for name, value in choices.items() if name not in vars(how)}
    if is_fit(session):
        if options is not None or choices:
            raise CalibrationError("report: the options are those of the fit that is given; leave them out, or give the session")
        return session.report(path, progress=progress, **vars(how))
    return report_of(session_or_folder(session), chosen(FitOptions, options, choices), None, path, how, progress)


# Exports: files for other programs.


@dataclass(frozen=True, eq=False, repr=False)
class Exported:
    """Result of ``tinygc.export``: the text of each file by its name; remarks on what the format carries only in part."""

    to: str
    files: dict[str, str]
    remarks: Sequence[str] = ()

    def __repr__(self) -> str:
        return f"<Exported to {self.to}: {', '.join(self.files)}>"

    @classmethod
    def of(cls, to: str, source: Callable[[str], tuple[Model | None, Context]], remarks: Sequence[str]) -> Exported:
        """Export in a format, by any of its names; source: of the format's name gives the model with its context, None for noise alone.

        Raises CalibrationError for an unknown format, and ExportError for a model that the format cannot carry.
        """
        name = format_named(to) if isinstance(to, str) else ""
        if name not in FORMATS:
            raise CalibrationError(f"to is {to!r:.60}, expected one of {', '.join(FORMATS)}")
        module, (model, context) = exports.exporter(name), source(name)
        if context.inflation is not None and name not in NOISE_FORMATS:
            raise ExportError(f"{name} has no noise densities to inflate; --inflation goes with {', '.join(NOISE_FORMATS)}")
        if model is None:
            if name not in NOISE_FORMATS:
                raise ExportError(f"{name} carries a model, and there are noise figures alone; these go to {', '.join(NOISE_FORMATS)}")
            context.remark(f"{name}: there is no model: the noise alone is exported, no calibration")
            return cls(name, module.export_noise(context), remarks)
        try:
            return cls(name, module.export(model, context), remarks)
        except ExportError as error:  # rest logs have a model over temperature, which few formats carry, and noise, which many do
            if context.noise is None or feature_exports(model) is None or name not in NOISE_FORMATS:
                raise
            context.remark(f"{error}: the noise alone is exported, no calibration")
            return cls(name, module.export_noise(context), remarks)

    def save(self, folder: Path | str) -> list[Path]:
        """Write the files into a folder, each whole or not at all; returns their paths."""
        folder = Path(folder)
        with result_folder(folder):
            for name, text in self.files.items():
                write_text_whole(folder / name, text)
        return [folder / name for name in self.files]

    def to_json(self, written: Sequence[Path] = ()) -> dict:
        """``tinygc-export/2`` (docs/formats.md); written: the paths that ``save`` has returned."""
        return {"schema": "tinygc-export/2", "format": self.to, "files": [*map(str, written)], "remarks": [*self.remarks]}


def noise_source(noise: Any) -> NoiseSource:
    """Return noise figures, or the path to them, of an argument.  Raises CalibrationError for anything else."""
    if isinstance(noise, str | os.PathLike):
        return Path(noise)
    if noise is None or isinstance(noise, NoiseFigures):
        return noise
    raise CalibrationError(f"noise is of type {type(noise).__name__}, expected NoiseFigures, noise.json or its folder")


def exported(
    to: str, folder: Path | str | None, choices: dict[str, Any], context_of: Callable[..., tuple[Model | None, Context]]
) -> Exported:
    """Export in a format, and write the files if a folder is given; choices: fields of ``ExportOptions``; context_of: ``read_context`` of a
    folder, or ``context_of_fit`` of a fit."""
    options, remarks = ExportOptions(**choices), list[str]()
    options = replace(options, noise=noise_source(options.noise))
    made = Exported.of(to, lambda name: context_of(options, remarks.append), remarks)
    if folder is not None:
        made.save(folder)
    return made


@public(ExportOptions)
def export(source: Any, to: str, folder: Path | str | None = None, **choices: Any) -> Exported:
    """Make the files of a calibration, or of noise figures, for another program.

    Parameters
    ----------
    source : Fit, str or Path
        A fit, the folder of a fitted session or of noise figures, or ``noise.json``.
    to : str
        ``json``, ``kalibr``, ``openvins``, ``vins``, ``gtsam``, ``ros``, ``xio``, ``px4``, ``ardupilot`` or ``c``.
    folder : str or Path, optional
        Where the files are written; without it ``save`` writes them.

    Returns
    -------
    Exported
        ``files`` (text by name), ``remarks`` on what the format carries only in part, ``save(folder)``.

    Raises
    ------
    CalibrationError
        For a source without a fit, and for a model that the format cannot carry; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> list(tinygc.export(tinygc.fit(session, methods=("least_squares",)), "kalibr").files)
    ['imu.yaml', 'imu-intrinsics.yaml']

    """
    if is_fit(source):
        return source.export(to, folder, **choices)
    if not isinstance(source, str | os.PathLike):
        raise CalibrationError(f"source is of type {type(source).__name__}, expected a Fit, a session folder or noise.json")
    if choices.get("model") is None and os.path.isdir(source):
        refuse_special(Path(source))
    return exported(to, folder, choices, partial(read_context, Path(source)))
