"""Explain one session folder, and print the result as JSON: ``python -m tinygc.annexes.challenge.worker [--discover] FOLDER [EFFECTS …]``.

The examiner starts one such process for each session; its only inputs are the folder, the folders of further effects, and whether to
search for laws outside the catalogue.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from session.io.errors import CalibrationError

if TYPE_CHECKING:
    from tinygc.explanation.engine import Explanation

DISCOVER = "--discover"
SEED = 0


def main(folder: Path, effects: list[Path], discover: bool = False) -> None:
    """Print the answer; a refusal (such as for a trivial cause) is an answer, too."""
    from tinygc.effects import using
    from tinygc.explanation.engine import explain_session
    from tinygc.explanation.result import to_json

    began = time.perf_counter()
    try:
        with using(effects):
            explanation = explain_session(folder)
            result = to_json(explanation) | (discovered(explanation) if discover else {})
    except CalibrationError as error:
        result = {"verdict": "refused", "why": str(error), "effects": []}
    print(json.dumps(result | {"seconds": round(time.perf_counter() - began, 2)}))


def discovered(explanation: Explanation) -> dict:
    """The result of the law search, with its files written into the session folder; ``discovery`` of ``tinygc-explain/2``.

    Nothing else in the blind test depends on the search.
    """
    from tinygc.annexes.discovery.engine import discover
    from tinygc.annexes.discovery.report import DiscoveryReport

    report = DiscoveryReport(explanation, discover(explanation, seed=SEED))
    report.save(pictures=False)
    return {"discovery": report.to_json()["discovery"]}


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != DISCOVER]
    main(Path(words[0]), [Path(name) for name in words[1:]], DISCOVER in sys.argv[1:])
