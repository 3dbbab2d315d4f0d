"""Where effects come from: this package, folders that the user names; and from nowhere else."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from session.base.units import DEG
from tinygc import models
from tinygc.effects import AppliedEffect, Conditions, Effect, EffectError, Parameter, catalogue, effect_of, load_folder, using
from tinygc.effects.catalogue import having, loaded_folders
from tinygc.models.linear import LinearModel
from tinygc.models.physics import PhysicsModel

FOREIGN = Path(__file__).parent / "foreign_effects"
FOREIGN_IDS = {"gyro.rate_memory", "gyro.shock_recovery", "gyro.thermal_curvature"}
MADE_UP = 'EFFECT = replace(EFFECT, id="gyro.made_up")\n'
HEAD = "from dataclasses import replace\nfrom tinygc.effects.entries.bias_drift import EFFECT\n"


@pytest.fixture(autouse=True)
def forgets():
    """Whatever a test loads is gone after it."""
    with using([]):
        yield


@pytest.fixture
def effects(tmp_path):
    """A folder with one effect, which a test may spoil."""
    folder = tmp_path / "effects"
    folder.mkdir()
    (folder / "made_up.py").write_text(HEAD + MADE_UP)
    return folder


def test_a_file_in_a_folder_is_an_effect_as_it_is_now(effects):
    """A helper is none, and may be imported; what fails to load leaves what was loaded."""
    before = set(catalogue())
    (loaded,) = load_folder(effects)
    assert set(catalogue()) == before | {"gyro.made_up"}
    assert catalogue()["gyro.made_up"] is loaded
    assert list(catalogue()) == sorted(catalogue())
    (effects / "_numbers.py").write_text("PLAUSIBLE = 0.25\n")
    parameter = "replace(EFFECT.parameter, plausible=PLAUSIBLE)"
    text = f'{HEAD}from ._numbers import PLAUSIBLE\nEFFECT = replace(EFFECT, id="gyro.another_name", parameter={parameter})\n'
    (effects / "made_up.py").write_text(text)
    (loaded,) = load_folder(effects)
    assert loaded.parameter.plausible == 0.25
    assert set(catalogue()) == before | {"gyro.another_name"}
    (effects / "made_up.py").write_text("EFFECT = 3\n")
    with pytest.raises(EffectError):
        load_folder(effects)
    assert set(catalogue()) == before | {"gyro.another_name"}


def test_folders_are_known_only_while_they_are_used(effects):
    with using([effects, FOREIGN]):
        assert {"gyro.made_up", *FOREIGN_IDS} <= set(catalogue())
        assert loaded_folders() == [effects.resolve(), FOREIGN.resolve()]
    assert not {"gyro.made_up", *FOREIGN_IDS} & set(catalogue())
    drift = replace(catalogue()["gyro.bias_drift"], id="gyro.far")
    with having(drift):  # one effect may stand in the catalogue for a while
        assert effect_of("gyro.far") is drift
    with pytest.raises(EffectError, match=r"'gyro\.far' is not on this machine"):
        effect_of("gyro.far")


BROKEN = {
    "syntax": ("EFFECT = (\n", r"broken\.py: cannot be loaded: SyntaxError: .*\(line 1\); correct it"),
    "an error of its own": ("import numpy\n\nnumpy.no_such\n", r"broken\.py: cannot be loaded: AttributeError: .*\(line 3\)"),
    "no effect": ("X = 1\n", r"broken\.py: defines no EFFECT"),
    "of a wrong type": ("EFFECT = {'id': 'gyro.x'}\n", r"broken\.py: EFFECT is of type dict, expected tinygc\.effects\.Effect"),
    "a doubled id of the package": (HEAD, r"broken\.py: its id 'gyro\.bias_drift' is already that of an effect of TinyGC"),
    "a doubled id in the folder": (HEAD + MADE_UP, r"made_up\.py: its id 'gyro\.made_up' is already that of .*broken\.py"),
    "an input that nobody has": (HEAD + 'EFFECT = replace(EFFECT, inputs=("humidity",))\n', r"broken\.py: .*inputs is \('humidity',\)"),
    "a wrong shape": (
        HEAD + 'EFFECT = replace(EFFECT, id="gyro.b", columns=lambda m: m.rate)\n',
        r"broken\.py: gyro\.b: columns gives shape \(64, 3\) .*expected \(64, 3, 3\)",
    ),
    "an error when it is used": (
        HEAD + 'EFFECT = replace(EFFECT, id="gyro.b", columns=lambda m: m.rate / nothing)\n',
        r"broken\.py: gyro\.b fails on a movement of 64 samples: NameError",
    ),
    "an input that it does not declare": (
        HEAD + 'EFFECT = replace(EFFECT, id="gyro.b", columns=lambda m: m.temp_c[:, None, None] * m.rate[..., None])\n',
        r'broken\.py: gyro\.b: reads movement\.temp_c, which it does not declare; add inputs=\("temperature",\)',
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_named_in_one_line(name, effects):
    text, says = BROKEN[name]
    (effects / "broken.py").write_text(text)
    with pytest.raises(EffectError, match=says) as caught:
        load_folder(effects)
    assert "\n" not in str(caught.value)


def test_no_python_in_a_session_folder_is_run(folder, tmp_path, run):
    """Nor beside a model."""
    ran = tmp_path / "ran"
    for place in (folder, folder / "effects", folder / "fit"):
        place.mkdir(exist_ok=True)
        (place / "made_up.py").write_text(f"open({str(ran)!r}, 'w').close()\n" + HEAD + MADE_UP)
    assert run("fit", folder, "--methods", "raw")[0] == 0
    assert not ran.exists()


def test_a_model_whose_effect_is_missing_says_so(tmp_path, run, simulated):
    with using([FOREIGN]):
        effect, known = effect_of("gyro.thermal_curvature"), Conditions(100.0, 500 * DEG, 25.0)
        table = models.to_dict(PhysicsModel(LinearModel(np.eye(3), np.zeros(3)), (AppliedEffect(effect, np.zeros(3)),), known))
    path, log = tmp_path / "model.json", simulated() / "log0001.csv.gz"
    path.write_text(json.dumps(table))
    code, _, err = run("apply", path, log, "-o", tmp_path / "out.csv")
    says = f"calibrate: {re.escape(str(path))}: effects\\[0\\]: effect 'gyro.thermal_curvature' is not on this machine; .*--effects DIR.*\n"
    assert code == 2
    assert re.fullmatch(says, err)
    assert run("apply", path, log, "-o", tmp_path / "out.csv", "--effects", FOREIGN)[0] == 0


def test_what_is_declared_must_be_possible():
    good = {
        "id": "gyro.x",
        "equation": "",
        "parameter": Parameter("k", (3,), "dps"),
        "observable_in": ("turn",),
        "columns": lambda m: m.rate,
        "describe": str,
        "discriminating_motion": "",
    }
    Effect(**good)
    for name, value in {
        "id": 3,
        "parameter": "k",
        "observable_in": ("space",),
        "kind": "wish",
        "inputs": "force",
        "reach": 3,
        "columns": None,
        "scan": lambda values: [],
        "gauge_convention": "common delay",
        "device": "float x;",
        "picture": "a nice one",
        "linear_in": "force",  # which nine parameters are
    }.items():
        with pytest.raises(EffectError, match=rf"'?{good['id'] if name != 'id' else 3}'?: .* expected "):
            Effect(**(good | {name: value}))
    step = catalogue()["gyro.bias_step"]
    for wrong in (3, catalogue()["gyro.bias_drift"]):  # a scan must give the same effect
        broken = replace(step, scan=replace(step.scan, make=lambda value, wrong=wrong: wrong))
        with pytest.raises(EffectError, match=r"gyro\.bias_step: scan\.make must give"):
            broken.at(1.0)
