"""What the core asks of truth files (``REFERENCE`` of session/base/features.py); what is heavy is imported where it is needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from session.base.errors import DataError
from session.base.files import write_new
from session.log.config import Config
from session.log.samples import Samples
from tinygc.features.truth.reading import (
    REPORTED,
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


def _late(place: str) -> Any:
    """What is at ``module:name`` of this folder, imported when it is called."""
    module, name = place.split(":")

    def call(*given: Any, **more: Any) -> Any:
        return getattr(import_module(f"tinygc.features.truth.{module}"), name)(*given, **more)

    call.__doc__ = f"As ``tinygc.features.truth.{module}.{name}``."
    return staticmethod(call)


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
        """The file of each log.  Raises FormatError where there is none."""
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

    def save(self, folder: Path, config: Config) -> None:
        """Write the files for logs that are numbered from 1, at the stamps and in the convention that session.toml states."""
        reading = TruthReading.of(given_in(config)) if self.alignment is None else self.alignment.reading
        for number, truth in enumerate(self.truths, start=1):
            write_new(folder / f"truth{number:04d}.csv", truth_text(truth.reread(reading, TruthReading())))

    # The fit and the explanation.

    reported: ClassVar[tuple[str, ...]] = REPORTED
    examined = _late("check:with_aligned_truth")
    check = _late("check:check_truth")
    problem = _late("problem:build_truth_problem")
    rests = _late("segments:find_rests")
    twin = _late("twin:TruthTwin")
    components = _late("errors:truth_components")
    repaired = _late("errors:repaired")
    shown = _late("shown:TruthShown")

    def attitudes(self, number: int, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
        """Rows (K,) of a log at which its attitude is known, and ``q_nb`` (K, 4) there."""
        return _late("segments:moments_inside")(samples, self.truths[number])

    @property
    def table(self) -> dict | None:
        """How the files were read, for fit.json; None where that was not found out."""
        return None if self.alignment is None else _late("alignment:alignment_table")(self.alignment)

    @property
    def words(self) -> str:
        """The same, for the terminal; empty where that was not found out."""
        return "" if self.alignment is None else _late("check:words")(self.alignment)
