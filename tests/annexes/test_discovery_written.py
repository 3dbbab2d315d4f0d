"""What is written of a law: a file that passes the proof of an effect unedited, and is the same law in any session; its C."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import broad
from discovery_answers import LAWS, law_of

from session.io.units import DEG
from tinygc.annexes.discovery.effect_file import Where, written
from tinygc.annexes.discovery.equivalence import as_effect
from tinygc.annexes.discovery.form import Factor, LawForm
from tinygc.annexes.discovery.law_code import device_code
from tinygc.annexes.discovery.words import constants_of
from tinygc.effects import ReferenceConditions, StageC, load_folder, using
from tinygc.effects.catalogue import short_movement
from tinygc.effects.testing import check

RATE, WARMTH = Factor("rate"), Factor("temperature")
#: laws that a device can undo: of each axis, with constants of two quantities, of neighbours, and matrices
ON_A_DEVICE = {
    "temperature": LawForm((WARMTH,)),
    "beyond both": LawForm((Factor("rate", "excess", 0.3), Factor("temperature", "dead_zone", 2.0))),
    "two clippings": LawForm((Factor("rate", "within", 0.2), Factor("rate", "dead_zone", 0.1)), "leant"),
    "another threshold": LawForm((Factor("rate", "excess", 0.3),)),
    "next": LawForm((Factor("rate", "size_cube"), RATE), "next"),
    "matrix": LawForm((Factor("rate", "size"), WARMTH), "full"),
}


@pytest.mark.parametrize("name", ON_A_DEVICE)
def test_a_law_of_sums_and_products_has_c_that_does_what_the_law_says(name, tmp_path):
    """The C is its NumPy bit for bit, and in single precision what the effect corrects."""
    form = ON_A_DEVICE[name]
    dps = np.random.default_rng(3).uniform(0.3, 1.0, form.size)
    (tmp_path / "law.py").write_text(written(law_of(form, dps), Where("here")), encoding="utf-8")
    with using([]):
        (effect,) = load_folder(tmp_path)
        assert isinstance(effect.device, StageC)
        report = check(effect, parts=("c",), value=None if effect.scan is None else 0.15)
    assert report.ok, str(report)


@pytest.mark.parametrize(
    ("form", "why"),
    [
        (LawForm((Factor("force"), RATE)), "samples belong that are yet to come"),
        (LawForm((Factor("rate", "beyond", 0.1),)), "a reading may belong to two rates"),
        (LawForm((Factor("rate", "root"),)), "last bits differ"),
        (LawForm((Factor("temperature", "itself", None, 2.0),)), "lag"),
        (LawForm((Factor("sense"),)), "from the beginning"),
    ],
)
def test_a_law_without_c_says_why(form, why):
    code = device_code(form, constants_of(form), "law").source
    assert code.startswith("NoC(")
    assert why in code


def loaded(text: str, folder: Path):
    """The effect of a file's text."""
    (folder / "law.py").write_text(text, encoding="utf-8")
    with using([]):
        return load_folder(folder)[0]


@pytest.mark.parametrize("name", ["dead zone", "cross", "warm", "warm rate"])
def test_a_written_law_adds_the_same_in_a_session_of_another_full_scale_that_begins_warmer(name, tmp_path):
    """Full scale and first temperature are those of the session where it was found, in every session."""
    form, dps = LAWS[name]
    effect = loaded(written(law_of(form, dps), Where("here", full_scale_dps=500.0, first_temp_c=25.0)), tmp_path)
    here = short_movement()
    there = replace(here, fs_rps=2 * here.fs_rps, first_temp_c=here.first_temp_c + 11)
    assert here.fs_rps == pytest.approx(500 * DEG)
    theta = np.array(dps) * DEG
    added = effect.distort(here, theta) - here.rate
    assert np.abs(added).max() > 1e-4
    assert effect.distort(there, theta) - there.rate == pytest.approx(added, abs=1e-15)
    assert added == pytest.approx(as_effect(form).distort(here, theta) - here.rate, abs=1e-12)
    assert np.abs(as_effect(form).distort(there, theta) - there.rate - added).max() > 1e-5
    assert ("T₀ = 25 °C" in effect.equation) if "warm" in name else ("ω / (500 dps)" in effect.equation)


@pytest.mark.broad
@pytest.mark.parametrize("full_scale", [125.0, broad(2000.0)])
def test_the_proof_tries_a_law_at_the_full_scale_and_temperature_where_it_was_found(full_scale, tmp_path):
    """A threshold at 600 dps does nothing on a hand's usual movement, nor one at 65 °C on a sensor that begins at 25."""
    form = LawForm((Factor("rate", "dead_zone", 0.3), Factor("temperature", "hinge", 4.0)))
    effect = loaded(written(law_of(form, [0.9, -0.8, 0.7]), Where("here", full_scale_dps=full_scale, first_temp_c=61.0)), tmp_path)
    assert effect.reference_conditions == ReferenceConditions(full_scale * DEG, 61.0)
    assert check(effect, parts=("columns", "undo", "live")).ok


def test_a_strong_law_passes_the_proof_as_it_is_written(tmp_path):
    """Clipped rates through a full matrix: a third of the rate in sum; its C takes as many passes as that needs."""
    form = LawForm((Factor("rate", "within", 0.2),), "full")
    text = written(law_of(form, [40, -30, 20, 25, 45, -30, 20, 30, -50]), Where("here", full_scale_dps=500.0))
    report = check(loaded(text, tmp_path), parts=("undo", "c"))
    assert report.ok, str(report)
    assert "pass < 3;" not in text


def test_a_law_too_strong_to_be_undone_says_so_in_its_file():
    form = LawForm((Factor("acceleration", "size"),))
    assert "Undoing" in (text := written(law_of(form, [9.0, -8.0, 9.0]), Where("here", full_scale_dps=500.0)))
    assert "30 passes of substitution do not take it off" in " ".join(text.split())
    assert "Undoing" not in written(law_of(form, [0.5, -0.4, 0.6]), Where("here", full_scale_dps=500.0))
