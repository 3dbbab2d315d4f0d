"""What the tool writes, it reads: session.toml of any configuration, and every file of every command by every command that reads it."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from configurations import CONFIGS, GIVEN, TEXTS, difference, maybe, numbers
from hypothesis import given, settings
from hypothesis import strategies as st

from session.bench.events import Info
from session.bench.session_file import NAME, SessionFile, toml_text
from session.detect.accelerometer import with_section
from session.io.config import read_config
from tinygc import CalibrationError

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


#: whatever a frame, or a line of text, may say
SAID = st.builds(
    Info,
    st.integers(0, 65535).map(float) | numbers(1, 4000),
    st.integers(0, 65535).map(float) | numbers(1, 16),
    st.floats(width=32) | numbers(10, 7000),
    st.integers(0, 2**32 - 1).map(str) | TEXTS,
    st.sampled_from(["", "ASM330LHH", "MPU-9250"]) | TEXTS,
)


@pytest.mark.broad
@MANY
@given(SAID, maybe(CONFIGS), st.booleans(), maybe(numbers(0.1, 5e4)), maybe(TEXTS))
def test_whatever_a_board_says_is_refused_or_can_be_read(info, like, physical, odr_hz, serial):
    """With a configuration that it is to be like; and nothing is left of what was refused."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "s"
        if like is not None:
            (Path(name) / "like.toml").write_text(toml_text(like), encoding="utf-8")
        try:
            file = SessionFile(folder, None if like is None else Path(name) / "like.toml", odr_hz, None, None, None, {"who": serial or ""})
            config = file.configure(info, 5.0, physical)
            file.exclude("log0001.csv", 3.25)
        except CalibrationError:
            assert not (folder / NAME).exists() or read_config(folder / NAME)
            return
        again = read_config(folder / NAME)
        assert again.sensor == config.sensor
        assert difference(config, again)[:2] in (["exclude", "notes"], ["exclude"])
        SessionFile(folder, None, None, None, None).configure(info, 5.0, physical)  # as --resume does
