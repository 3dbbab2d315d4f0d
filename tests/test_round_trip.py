"""What the tool writes, it reads: session.toml of any configuration."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from configurations import CONFIGS, GIVEN, difference
from hypothesis import given, settings

from session.bench.session_file import NAME, toml_text
from session.detect.accelerometer import with_section
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


@pytest.mark.broad
@MANY
@given(CONFIGS, GIVEN)
def test_the_calibrated_copy_of_any_configuration_is_read(config, accelerometer):
    again = written(with_section(toml_text(config), accelerometer, "From the stills."))
    np.testing.assert_allclose(again.accelerometer.matrix, accelerometer.matrix, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.accelerometer.bias_mps2, accelerometer.bias_mps2, rtol=0, atol=1e-8)
    assert (again.sensor, again.site, again.notes) == (config.sensor, config.site, config.notes)
