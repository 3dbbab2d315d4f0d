"""Recordings from a bench that shares no code with this project: what was concealed in them is named, and nothing else is.

``benchmarks/concealed.py`` runs all of them; these are the fast ones, one of each kind.
"""

import json

import numpy as np
import pytest

from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json

CASES = ["case001", "case011", "case020", "case028"]  # nothing, a rate effect, false readings, a pair


@pytest.fixture(scope="module")
def concealed(shared):
    folder = shared / "concealed"
    if not (folder / "truth.json").exists():
        pytest.skip(f"no concealed recordings: {folder} is not there")
    return folder


@pytest.fixture(scope="module")
def truth(concealed):
    return json.loads((concealed / "truth.json").read_text())


@pytest.fixture(scope="module")
def results(concealed):
    made = {}

    def explain(case: str) -> dict:
        if case not in made:
            made[case] = to_json(explain_session(concealed / case))
        return made[case]

    return explain


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_exactly_what_was_concealed_is_named(results, truth, case):
    result = results(case)
    assert {effect["id"] for effect in result["effects"]} == set(truth[case]["effects"])
    assert result["verdict"] == ("explained" if truth[case]["effects"] else "no_mismatch")


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_closure_comes_down_to_its_floor(results, case):
    held = results(case)["fit"]["holdout_closure_rms_deg"]
    assert held["after"] < 1.6 * held["floor"]


@pytest.mark.slow
def test_thermal_bias_is_right(results, truth):
    for case in ("case011", "case028"):
        (effect,) = [effect for effect in results(case)["effects"] if effect["id"] == "gyro.thermal_bias"]
        value, std = (np.array(effect[key]["dps_per_c"]) for key in ("parameters", "std"))
        assert (np.abs(value - truth[case]["effects"]["gyro.thermal_bias"]["dps_per_c"]) < 3 * std).all()


@pytest.mark.slow
def test_false_readings_are_found_row_by_row(results, truth):
    (effect,) = results("case020")["effects"]
    true = truth["case020"]["effects"]["data.glitches"]
    assert effect["parameters"] == {"at": true["at"], "samples": true["samples"]}
