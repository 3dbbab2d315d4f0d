"""Recordings from a bench that shares no code with this project: what was concealed in them is named, and nothing else is.

``benchmarks/concealed.py`` runs all of them; these are the fast ones, one of each kind.
"""

import json

import numpy as np
import pytest
from conftest import broad

from tinygc.closure.prepared import prepare
from tinygc.estimation.bias import choose, tilt_rms
from tinygc.estimation.options import FitOptions
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json


@pytest.mark.parametrize("case", ["case011", broad("case001"), broad("case020"), broad("case028")], ids=str)
def test_what_was_concealed_is_named_with_its_size_and_nothing_else_is(case, shared):
    """A rate effect; nothing, false readings, a pair.  Undone, it leaves the floor."""
    folder = shared / "concealed"
    if not (folder / "truth.json").exists():
        pytest.skip(f"no concealed recordings: {folder} is not there")
    truth, result = json.loads((folder / "truth.json").read_text())[case]["effects"], to_json(explain_session(folder / case))
    effects = {effect["id"]: effect for effect in result["effects"]}
    assert set(effects) == set(truth)
    assert result["verdict"] == ("explained" if truth else "no_mismatch")
    held = result["fit"]["holdout_closure_rms_deg"]
    assert held["after"] < 1.6 * held["floor"]
    stated = choose(prepare(folder / case).problem, FitOptions(methods=("least_squares",)))[2].held_out
    assert held["before"] == pytest.approx(np.degrees(tilt_rms(stated)))
    assert held["after"] <= held["before"]
    if thermal := effects.get("gyro.thermal_bias"):
        value, std = (np.array(thermal[key]["dps_per_c"]) for key in ("parameters", "std"))
        assert (np.abs(value - truth["gyro.thermal_bias"]["dps_per_c"]) < 3 * std).all()
    if rows := truth.get("data.glitches"):
        assert effects["data.glitches"]["parameters"] == {"at": rows["at"], "samples": rows["samples"]}
