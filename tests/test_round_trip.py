"""What the tool writes, it reads: session.toml of any configuration."""

from __future__ import annotations

import tempfile
from pathlib import Path

from configurations import CONFIGS, difference
from hypothesis import given, settings

from session.bench.session_file import NAME, toml_text
from session.io.config import read_config

MANY = settings(max_examples=60)


def written(text: str):
    """What is read of a session.toml."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / NAME
        path.write_text(text, encoding="utf-8")
        return read_config(path)


@MANY
@given(CONFIGS)
def test_any_configuration_that_is_written_is_read_as_it_was(config):
    assert difference(config, written(toml_text(config))) == []
