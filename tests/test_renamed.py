"""Names of 0.1.0 that users import: they lead to the same things, and state the new name in one line."""

import importlib
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import processes
import pytest

from session.io import renamed
from session.io.renamed import RENAMED, with_new_keys
from session.io.results import Keys, Text, read_required
from tinygc.effects import CommonDelay, PerAxisC, effect_of, using


@pytest.mark.parametrize("name", sorted(RENAMED))
def test_an_old_name_leads_to_the_module_of_today(name):
    assert importlib.import_module(RENAMED[name]) is importlib.import_module(name)


def test_the_new_name_is_stated_in_one_line():
    code = "from session.common.units import DEG; from tinygc.effects.picture import SCALE_LAW; from session.common.units import G"
    done = processes.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stderr.splitlines() == [
        "session.common.units is now session.io.units; the old name goes with version 0.3",
        "tinygc.effects.picture is now tinygc.effects.effect; the old name goes with version 0.3",
    ]


def test_what_never_was_is_still_not_found():
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("session.common.nothing")


OLD_EFFECT = """
from tinygc.effects import CommonDelay, Effect, FoundAt, Parameter, PerAxisC, diagonal

EFFECT = Effect(
    id="gyro.old",
    equation="w += k w^2",
    parameter=Parameter("k", (3,), "s", plausible=1e-3),
    seen_in=("turn",),
    columns=lambda movement: diagonal(movement.rate**2),
    says=lambda theta: f"{theta[0]:.3g} s",
    splits="turn both ways",
    regime=("rate", "dps"),
    gauge=CommonDelay((0, 1, 2)),
    found_at=FoundAt(fs_rps=1.0),
    device=PerAxisC(name="K", says="r -= k r^2", term="K[i] * w * w", numpy=None, cost=None),
)
"""


def test_an_effect_file_of_0_1_0_works_and_names_what_is_new(tmp_path, capsys):
    """Each line comes once in a process, whatever other tests have printed before: names are counted, not lines."""
    (tmp_path / "old.py").write_text(OLD_EFFECT)
    with using([tmp_path]):
        effect = effect_of("gyro.old")
    assert effect.describe(np.ones(3)) == effect.says(np.ones(3)) == "1 s"
    assert (effect.observable_in, effect.discriminating_motion, effect.conditions) == (("turn",), "turn both ways", ("rate", "dps"))
    assert effect.gauge_convention == CommonDelay((0, 1, 2))
    assert effect.reference_conditions.fs_rps == 1.0
    assert effect.device.formula == "r -= k r^2"
    moved = replace(effect, splits="turn one way")
    assert moved.discriminating_motion == moved.splits == "turn one way"
    with pytest.raises(AttributeError, match="no attribute 'gauges'"):
        effect.gauges  # noqa: B018
    with pytest.raises(TypeError, match="regimes"):
        replace(effect, regimes=None)
    for line in capsys.readouterr().err.splitlines():
        assert re.fullmatch(r"[A-Za-z._]+ is now [A-Za-z_.]+; the old name goes with version 0.3", line)


def test_an_old_field_is_announced_once_with_its_new_name(monkeypatch, capsys):
    monkeypatch.setattr(renamed, "_announced", set())
    for _ in range(2):
        assert PerAxisC(name="K", says="r", term="", numpy=None, cost=None).says == "r"
    assert capsys.readouterr().err == "PerAxisC.says is now formula; the old name goes with version 0.3\n"


def test_results_of_0_1_0_are_read_by_their_new_names(tmp_path):
    path = tmp_path / "explain.json"
    law = {"runners_up": [{"id": "gyro.misalignment", "splits": "turn both ways"}]}
    old = {"schema": "tinygc-explain/1", "next": None, "discovery": {"laws": [law], "beside": []}, "effects": [{"says": "1 s"}]}
    path.write_text(json.dumps(old))
    read = read_required(path, Keys({"schema": Text(("tinygc-explain/2",))}))
    assert read["effects"] == [{"description": "1 s"}]
    assert read["discovery"]["catalogue_effects"] == []
    assert read["discovery"]["laws"][0]["runners_up"] == [{"id": "gyro.misalignment", "discriminating_motion": "turn both ways"}]


@pytest.mark.parametrize("table", [{"schema": "tinygc-model/1", "says": 1}, {"schema": ["tinygc-fit/1"]}, {"says": 1}, [], "tinygc-fit/1"])
def test_other_files_keep_their_keys(table):
    assert with_new_keys(table) == table


def test_an_old_module_does_not_hide_the_function_of_its_package():
    """``tinygc.fleet`` was a package, and is a function; what asks for a module that was in it must leave it one."""
    code = (
        "import tinygc, tinygc.fleet.results, tinygc.lot.report, tinygc.array.ages.ages\n"
        "from tinygc.fleet.results import unit_results\n"
        "for name in ('fleet', 'lot', 'array'):\n"
        "    try:\n"
        "        getattr(tinygc, name)(nothing=1)\n"
        "    except tinygc.CalibrationError as error:\n"
        "        print(error)\n"
        "print(tinygc.lot.report.LotReport.__name__)"
    )
    lines = processes.check_output([sys.executable, "-c", code], text=True, stderr=subprocess.DEVNULL).splitlines()
    assert [line.split(":")[0] for line in lines] == ["fleet", "lot", "array", "LotReport"]
    assert all("no option 'nothing'" in line for line in lines[:3])
