"""When a log began in the session of a model that follows that session's time; for any other log there is no such moment."""

from __future__ import annotations

from pathlib import Path

from session.common.errors import CalibrationError
from session.log.hashes import sha256_of
from tinygc.deploy.needs import Needs
from tinygc.models.model import Model


def began_in_session(model: Model, table: dict, model_path: Path, log: Path) -> float:
    """Seconds of the model's session at which this log of it began, by the hashes and the moments in the model's file.

    CalibrationError for a log that is none of them: the time of another session says nothing of its drift.
    """
    hashes, began = table.get("sha256"), table.get("began_s")
    if log.is_file() and isinstance(hashes, dict) and isinstance(began, dict):
        digest = sha256_of(log)
        for name, moment in began.items():
            if hashes.get(name) == digest and isinstance(moment, int | float):
                return float(moment)
    bygone = ", ".join(Needs(model).of_one_session)
    raise CalibrationError(
        f"{log}: no log of the session whose time {model_path.name} follows ({bygone}); apply {model_path.stem}_at_end.json beside it, "
        "or fit without physics"
    )
