"""Where effects come from: this package, installed packages, folders that the user names; and from nowhere else."""

import importlib.metadata
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import broad

from session.io.units import DEG
from tinygc import models
from tinygc.effects import AppliedEffect, Conditions, Effect, EffectError, Parameter, catalogue, effect_of, entries, load_folder, using
from tinygc.effects.catalogue import _installed, having, loaded_folders
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


def test_a_file_in_a_folder_is_an_effect(effects):
    before = set(catalogue())
    (loaded,) = load_folder(effects)
    assert set(catalogue()) == before | {"gyro.made_up"}
    assert catalogue()["gyro.made_up"] is loaded
    assert list(catalogue()) == sorted(catalogue())


def test_a_helper_is_no_effect_and_may_be_imported(effects):
    (effects / "_numbers.py").write_text("PLAUSIBLE = 0.25\n")
    (effects / "made_up.py").write_text(
        HEAD + "from ._numbers import PLAUSIBLE\n"
        'EFFECT = replace(EFFECT, id="gyro.made_up", parameter=replace(EFFECT.parameter, plausible=PLAUSIBLE))\n'
    )
    (loaded,) = load_folder(effects)
    assert loaded.parameter.plausible == 0.25


def test_loading_again_takes_the_files_as_they_are_now(effects):
    load_folder(effects)
    (effects / "made_up.py").write_text(HEAD + 'EFFECT = replace(EFFECT, id="gyro.another_name")\n')
    load_folder(effects)
    assert "gyro.another_name" in catalogue()
    assert "gyro.made_up" not in catalogue()


def test_what_fails_to_load_leaves_what_was_loaded(effects):
    load_folder(effects)
    (effects / "made_up.py").write_text("EFFECT = 3\n")
    with pytest.raises(EffectError):
        load_folder(effects)
    assert "gyro.made_up" in catalogue()


def test_folders_are_known_only_while_they_are_used(effects):
    with using([effects, FOREIGN]):
        assert {"gyro.made_up", *FOREIGN_IDS} <= set(catalogue())
        assert loaded_folders() == [effects.resolve(), FOREIGN.resolve()]
    assert not {"gyro.made_up", *FOREIGN_IDS} & set(catalogue())


BROKEN = {
    "syntax": ("EFFECT = (\n", r"broken\.py: cannot be loaded: SyntaxError: .*\(line 1\); mend it"),
    "an error of its own": ("import numpy\n\nnumpy.no_such\n", r"broken\.py: cannot be loaded: AttributeError: .*\(line 3\)"),
    "it leaves": ("raise SystemExit('out')\n", r"broken\.py: cannot be loaded: SystemExit: out"),
    "no effect": ("X = 1\n", r"broken\.py: defines no EFFECT"),
    "of a wrong type": ("EFFECT = {'id': 'gyro.x'}\n", r"broken\.py: EFFECT is of type dict, expected tinygc\.effects\.Effect"),
    "a doubled id of the package": (HEAD, r"broken\.py: its id 'gyro\.bias_drift' is already that of an effect of TinyGC"),
    "a doubled id in the folder": (HEAD + MADE_UP, r"made_up\.py: its id 'gyro\.made_up' is already that of .*broken\.py"),
    "an id that is none": (HEAD + 'EFFECT = replace(EFFECT, id="My Effect")\n', r"broken\.py: effect 'My Effect': id is .*, expected"),
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
def test_a_broken_file_is_named_in_one_line(name, effects, run, simulated):
    text, says = BROKEN[name]
    (effects / "broken.py").write_text(text)
    with pytest.raises(EffectError, match=says) as caught:
        load_folder(effects)
    assert "\n" not in str(caught.value)
    code, out, err = run("explain", simulated(), "--effects", effects)
    assert (code, out, err) == (2, "", f"calibrate: {caught.value}\n")


def test_a_folder_that_is_none_or_empty_is_said(tmp_path, run, simulated):
    assert run("fit", simulated(), "--effects", tmp_path / "nowhere")[0::2] == (
        2,
        f"calibrate: {tmp_path / 'nowhere'}: no such folder; --effects names a folder of files that define EFFECT\n",
    )
    code, _, err = run("fit", simulated(), "--effects", tmp_path)
    assert code == 2
    assert "no effect in it" in err


def test_a_file_in_the_place_of_its_folder_is_said(effects, run, simulated):
    file = effects / "mine.py"
    file.write_text(HEAD + MADE_UP)
    assert run("fit", simulated(), "--effects", file) == (2, "", f"calibrate: {file}: that is a file; give its folder, {effects}\n")


@pytest.mark.broad
def test_no_python_in_a_session_folder_is_run(folder, tmp_path, run):
    """Nor beside a model."""
    ran = tmp_path / "ran"
    spoil = f"open({str(ran)!r}, 'w').close()\n" + HEAD + MADE_UP
    for place in (folder, folder / "effects", folder / "fit"):
        place.mkdir(exist_ok=True)
        (place / "made_up.py").write_text(spoil)
    assert run("fit", folder, "--methods", "raw")[0] == 0
    assert run("explain", folder, "--no-pictures")[0] == 0
    assert not ran.exists()


class _Point:
    """What importlib.metadata gives of an installed package."""

    def __init__(self, given, name="far"):
        self.given, self.name, self.value = given, name, f"package.{name}:EFFECT"

    def load(self):
        if isinstance(self.given, Exception):
            raise self.given
        return self.given


@pytest.fixture
def installed(monkeypatch):
    """``installed(point, …)``: the entry points of other packages."""

    def install(*points):
        _installed.cache_clear()
        monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points if group == "tinygc.effects" else ())

    yield install
    _installed.cache_clear()


def far(**changes) -> Effect:
    from dataclasses import replace

    return replace(catalogue()["gyro.bias_drift"], **{"id": "gyro.far", **changes})


def test_effects_of_installed_packages_are_found(installed):
    effect = far()
    installed(_Point(effect))
    assert catalogue()["gyro.far"] is effect
    assert importlib.metadata.entry_points(group="tinygc.effects") is not None  # the call that is replaced here exists


def test_an_installed_effect_that_is_broken_is_named(installed):
    effect, taken = far(), far(id="gyro.bias_drift")
    for given, says in (
        (ImportError("no moon"), "installed effect 'far' .*cannot be loaded: ImportError: no moon"),
        (3, "installed effect 'far' .*EFFECT is of type int"),
        (taken, "its id 'gyro.bias_drift' is already"),
    ):
        installed(_Point(given))
        with pytest.raises(EffectError, match=says):
            catalogue()
    installed(_Point(effect), _Point(effect, "again"))
    with pytest.raises(EffectError, match=r"'again'.*is already"):
        catalogue()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("syntax", ("fit", "--methods", "least_squares")),
        ("no effect", ("simulate", "--effect", 'gyro.bias_step={"dps": [1, 0, 0], "at_s": 9}', "--out")),
        broad("an error when it is used", ("report", "--methods", "least_squares")),
    ],
)
def test_a_broken_file_of_the_package_is_named_in_one_line(name, words, tmp_path, monkeypatch, run, simulated):
    text, says = BROKEN[name]
    (tmp_path / "broken.py").write_text(text)
    monkeypatch.setattr(entries, "__path__", [str(tmp_path)])
    _installed.cache_clear()
    try:
        code, _, err = run(*words, simulated() if words[0] != "simulate" else tmp_path / "made", "--quiet")
    finally:
        _installed.cache_clear()
        sys.modules.pop(f"{entries.__name__}.broken", None)
    assert code == 2
    assert err.count("\n") == 1, err
    assert re.search(says, err)


def test_a_model_whose_effect_is_missing_says_so(tmp_path, run, simulated):
    with using([FOREIGN]):
        effect = effect_of("gyro.thermal_curvature")
        known = Conditions(100.0, 500 * DEG, 25.0)
        table = models.to_dict(PhysicsModel(LinearModel(np.eye(3), np.zeros(3)), (AppliedEffect(effect, np.zeros(3)),), known))
    path = tmp_path / "model.json"
    path.write_text(json.dumps(table))
    log = simulated() / "log0001.csv.gz"
    code, _, err = run("apply", path, log, "-o", tmp_path / "out.csv")
    assert code == 2
    assert err.count("\n") == 1
    assert err.startswith(f"calibrate: {path}: effects[0]: effect 'gyro.thermal_curvature' is not on this machine; ")
    assert "--effects DIR" in err
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


def test_a_scan_must_give_the_same_effect():
    step = catalogue()["gyro.bias_step"]
    from dataclasses import replace

    for wrong in (3, far()):
        broken = replace(step, scan=replace(step.scan, make=lambda value, wrong=wrong: wrong))
        with pytest.raises(EffectError, match=r"gyro\.bias_step: scan\.make must give"):
            broken.at(1.0)


def test_one_effect_may_stand_in_the_catalogue_for_a_while():
    with having(far()):
        assert effect_of("gyro.far").id == "gyro.far"
    with pytest.raises(EffectError, match=r"'gyro\.far' is not on this machine"):
        effect_of("gyro.far")
