"""Explain one session folder, and print the result as JSON: ``python -m tinygc.challenge.worker FOLDER [EFFECTS …]``.

The examiner starts one such process for each session; the folder, and where further
effects are, is all it is told.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from session.common.errors import CalibrationError


def main(folder: Path, effects: list[Path]) -> None:
    """A refusal (a boring cause, for one) is an answer, too."""
    from tinygc.effects import using
    from tinygc.explanation.verdict.explain import explain_session
    from tinygc.explanation.verdict.result import to_json

    began = time.perf_counter()
    try:
        with using(effects):
            result = to_json(explain_session(folder))
    except CalibrationError as error:
        result = {"verdict": "refused", "why": str(error), "effects": []}
    print(json.dumps(result | {"seconds": round(time.perf_counter() - began, 2)}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
