"""Every reader on the inputs that fuzzing kept: good ones, those that reach most of its lines, and all on which something fell.

What counts as a finding is in ``fuzz_targets/rules.py``.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzz_targets import NAMES, target
from fuzz_targets.rules import Finding, attempt

CORPUS = Path(__file__).parent / "corpus"


@pytest.mark.parametrize("name", NAMES)
def test_no_input_that_was_kept_is_a_finding(name, tmp_path):
    reader = target(name)
    fell, accepted = [], 0
    for path in sorted((CORPUS / name).glob("*")):
        try:
            accepted += attempt(reader, path.read_bytes(), tmp_path / "one")
        except Finding as finding:
            fell.append(f"{path.name}: {finding} ({finding.place})")
    assert not fell, "\n".join(fell)
    assert accepted  # what is refused at its first byte tries nothing


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("raise ValueError('no line')", "ValueError: no line"),
        ("warnings.warn('overflow', RuntimeWarning)", "RuntimeWarning: overflow"),
        ("raise OSError('two\\nlines')", "that is no line"),
        ("finite(float('nan'))", "not finite"),
    ],
)
def test_what_falls_is_noticed(what, says, tmp_path):
    """A rule that cannot fail holds nothing."""

    class Reader:
        @staticmethod
        def run(data, folder):
            exec(f"import time\nimport warnings\nfrom fuzz_targets.rules import finite\n{what}")

    with pytest.raises(Finding, match=says):
        attempt(Reader, b"", tmp_path / "one")
