"""The guide's example, taken out of the page: it passes the proof, and is found again through ``--effects``."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from feature import feature

from tinygc.effects import Effect, load_folder, using
from tinygc.effects.effect import PAIRS
from tinygc.effects.movement import INPUTS
from tinygc.effects.testing import check
from tinygc.noise.twin import READ

PAGE = (Path(__file__).parents[1] / "docs" / "writing-an-effect.md").read_text(encoding="utf-8")
needs_proofs = pytest.mark.skipif(feature("tinygc.features.challenge") is None, reason="the feature that proves effects is not there")
TRUTH = np.array([0.01, -0.006, 0.008])


@pytest.fixture
def effects(tmp_path):
    """The folder that the page tells to make."""
    (block,) = (block for block in re.findall(r"```python\n(.*?)```", PAGE, re.S) if "EFFECT = Effect(" in block)
    (path,) = re.findall(r"Save it as `my_effects/(\w+\.py)`", PAGE)
    folder = tmp_path / "my_effects"
    folder.mkdir()
    (folder / path).write_text(block, encoding="utf-8")
    return folder


@needs_proofs
def test_the_example_is_proved_but_for_its_sessions(effects):
    with using([]):
        (effect,) = load_folder(effects)
    assert effect.id == "gyro.scale_quadratic"
    report = check(effect, parts=("columns", "inverse", "units", "live", "c"))
    assert report.ok, str(report)


def test_the_session_that_hides_the_example_is_made_as_the_page_says(effects, tmp_path, monkeypatch):
    (block,) = (block for block in re.findall(r"```python\n(.*?)```", PAGE, re.S) if "tinygc.simulate(" in block)
    monkeypatch.chdir(tmp_path)
    with using([]):
        exec(block, {})
    truth = json.loads((tmp_path / "hidden" / "truth.json").read_text(encoding="utf-8"))
    assert truth["effects"] == {"gyro.scale_quadratic": {"quadratic_at_fs": TRUTH.tolist()}}


def test_the_page_names_every_variable_that_an_effect_can_be_drawn_against():
    (row,) = re.findall(r"^- `conditions`:.*$", PAGE, re.M)
    assert set(re.findall(r'`"([a-z ]+)"`', row)) == set(READ)


def test_the_page_names_every_field_and_input():
    fields = set(Effect.__dataclass_fields__) - {"shape", "occurs"}  # not for effects from outside
    assert not [name for name in fields if not re.search(rf"\b{name}\b", PAGE)]
    assert not [name for name in INPUTS if f'`"{name}"`' not in PAGE]
    assert "tinygc.effects.effect.PAIRS" in PAGE
    assert PAIRS
