"""What the core asks of truth files (``session/log/reference.py``); what is heavy is imported where it is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from session.base.errors import CalibrationError, DataError
from session.base.files import write_new
from session.base.toml import toml_line
from session.detect.findings import Finding
from session.detect.stills import SessionStills
from session.log.config import Config
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc.features.truth.reading import (
    TRUTH_ARRAYS,
    Truth,
    TruthAlignment,
    TruthReading,
    given_in,
    read_truth,
    truth_path,
    truth_text,
    truths_of_arrays,
)

if TYPE_CHECKING:
    from tinygc.closure.problem import Problem
    from tinygc.estimation.physics import PhysicsFit
    from tinygc.features.truth.evidence import TruthExplanation
    from tinygc.noise.components import Component
    from tinygc.noise.twin import Twin
    from tinygc.reporting.explanation_text import ExplanationReport
    from tinygc.reporting.html.markup import Section


@dataclass(frozen=True, eq=False)
class TruthFiles:
    """A truth for each log; sigma_deg: one sigma of each of their angles; alignment: how they are read, where that was found out."""

    word: ClassVar[str] = "truth"
    title: ClassVar[str] = "truth file"
    body: ClassVar[str] = "the truth's body"
    accelerometer: ClassVar[bool] = True
    truths: tuple[Truth, ...]
    sigma_deg: float
    alignment: TruthAlignment | None = None

    # Files and arrays.

    @staticmethod
    def paths(logs: Sequence[Path]) -> list[Path]:
        """The file beside each log.  Raises FormatError where there is none."""
        return list(map(truth_path, logs))

    @classmethod
    def read(cls, paths: Sequence[Path], config: Config) -> TruthFiles:
        """Read the files as session.toml states.  Raises FormatError."""
        reading = TruthReading.of(given_in(config))
        return cls(tuple(read_truth(path, reading) for path in paths), config.protocol.truth_sigma_deg)

    @classmethod
    def of_arrays(cls, name: str, given: Sequence[Any], logs: int, config: Config) -> TruthFiles:
        """Truths of arrays, for each of so many logs; name: of the session.  Raises DataError, which names the array."""
        if len(given) != logs:
            raise DataError(f"truth has {len(given)} entries, expected {logs}, one {TRUTH_ARRAYS} for each log")
        return cls(truths_of_arrays(name, given), config.protocol.truth_sigma_deg)

    @property
    def arrays(self) -> list[tuple[Path, tuple[tuple[np.ndarray | None, str], ...]]]:
        """Path of each file, and what is in it, each array with the type that it is hashed as."""
        return [(truth.path, ((truth.t_ns, "<i8"), (truth.q_nb, "<f8"), (truth.window, "<i8"))) for truth in self.truths]

    def toml(self, config: Config) -> str:
        """``[truth]`` of session.toml; nothing where the recording determines how the files are read."""
        stated = {name: value for name, value in vars(given_in(config)).items() if value is not None}
        lines = [toml_line(name, value.tolist() if isinstance(value, np.ndarray) else value) for name, value in stated.items()]
        return "".join(["\n[truth]\n", *lines]) if lines else ""

    def save(self, folder: Path, config: Config) -> None:
        """Write the files for logs that are numbered from 1, at the stamps and in the convention that session.toml states."""
        reading = TruthReading.of(given_in(config)) if self.alignment is None else self.alignment.reading
        for number, truth in enumerate(self.truths, start=1):
            write_new(folder / f"truth{number:04d}.csv", truth_text(truth.reread(reading, TruthReading())))

    # The first look.

    @property
    def said(self) -> tuple[str, ...]:
        """What ``fit`` and ``explain`` say as well, where it is more than ok."""
        from tinygc.features.truth.check import SAID

        return SAID

    def examined(self, session: Session) -> tuple[Session, list[Finding]]:
        """The session with its truths read as the recording shows, and the findings."""
        from tinygc.features.truth.check import with_aligned_truth

        return with_aligned_truth(session)

    def check(self, session: Session, log: Log) -> list[Finding]:
        """The truth of one log against its gyroscope; a ceiling of the gyroscope, which another finding names, may be why they differ."""
        from tinygc.features.truth.check import check_truth

        limited = self.alignment is not None and bool(np.isfinite(self.alignment.ceiling_rps).any())
        return check_truth(log, self.truths[session.logs.index(log)], session.config, limited)

    # The fit.

    def problem(self, session: Session, found: SessionStills, **how: Any) -> Problem:
        """As ``build_problem``."""
        from tinygc.features.truth.problem import build_truth_problem

        return build_truth_problem(session, found, **how)

    def attitudes(self, number: int, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
        """Rows (K,) of a log at which its attitude is known, and ``q_nb`` (K, 4) there."""
        from tinygc.features.truth.segments import moments_inside

        return moments_inside(samples, self.truths[number])

    def rests(self, samples: Samples) -> list[tuple[np.ndarray, float]]:
        """Mean rate (3,) and duration, s, of each rest of a log, in which motors may run."""
        from tinygc.features.truth.segments import find_rests

        return [(rest.gyro_mean, (rest.stop - rest.start) * samples.period_s) for rest in find_rests(samples)]

    def components(self, twin: Twin, sizes: tuple[int, int, int]) -> list[Component]:
        """Variance components of the truth's errors."""
        from tinygc.features.truth.physics import truth_components

        return truth_components(twin, sizes)

    def physics(self, problem: Problem, *how: Any) -> PhysicsFit:
        """Fit named physics: ``fit_beside_truth``."""
        from tinygc.features.truth.physics import fit_beside_truth

        return fit_beside_truth(problem, *how)

    @property
    def table(self) -> dict | None:
        """How the files were read, for fit.json; None where that was not found out."""
        from tinygc.features.truth.alignment import alignment_table

        return None if self.alignment is None else alignment_table(self.alignment)

    @property
    def words(self) -> str:
        """The same, for the terminal; empty where that was not found out."""
        from tinygc.features.truth.check import frame_text, mounting_text, offset_text

        if (found := self.alignment) is None:
            return ""
        return f"Truth: clock {offset_text(found)}; {frame_text(found)}; gyro to truth {mounting_text(found)}."

    # The explanation.

    @staticmethod
    def explain(session: Session | Path, idle: Sequence[str] = (), **how: Any) -> TruthExplanation:
        """As ``explain_session``; idle: options of the catalogue's search that were given.  Raises CalibrationError for these."""
        if idle:
            raise CalibrationError(f"{', '.join(idle)}: of no use where the reference is a truth file; leave it out")
        from tinygc.features.truth.engine import explain_truth

        return explain_truth(session, **how)

    @staticmethod
    def report(explanation: TruthExplanation) -> ExplanationReport:
        """The report of an explanation."""
        from tinygc.features.truth.text import TruthReport

        return TruthReport(explanation)

    @staticmethod
    def report_section(explanation: TruthExplanation) -> Section:
        """The section of a report on an explanation."""
        from tinygc.features.truth.section import section

        return section(explanation)
