"""What a command may load, and how often it may walk through the turns: counts that no machine changes."""

from __future__ import annotations

import json
import sys

import processes

import tinygc

#: commands in one process, in this order; each has loaded what those before it have
RUN = """
import calibrate, collections, json, sys
folder, log = sys.argv[1:]
COUNTED = {"_steps": "residual.py", "end_and_sensitivity": "residual.py", "_cost": "noise.py"}
counts = collections.Counter()
def count(frame, event, arg):
    code = frame.f_code
    if event == "call" and code.co_name in COUNTED and code.co_filename.endswith(COUNTED[code.co_name]):
        counts[code.co_name] += 1
found = {}
for command in (
    ["check", folder], ["fit", folder, "--methods", "least_squares"],
    ["apply", folder + "/fit/model_least_squares.json", log, "-o", folder + "/out.csv"], ["explain", folder],
):
    counts.clear()
    sys.setprofile(count)
    code = calibrate.main([*command, "--quiet"])
    sys.setprofile(None)
    names = [name.split(".") for name in sys.modules]
    rooms = {name[1] for name in names if name[0] == "scipy" and len(name) > 2 and name[1][0] != "_"}
    own = sum(name[0] in ("session", "tinygc") for name in names)
    found[command[0]] = {"code": code, "scipy": sorted(rooms), "own": own, "torch": "torch" in sys.modules, **counts}
print(json.dumps(found))
"""
#: SciPy's rooms, and modules of ours at most, that are loaded by it and those above; walks through all turns or some of them, those
#: with a Jacobian among them, and likelihoods of a noise
BUDGET = {
    "check": ([], 121, {"_steps": 12, "end_and_sensitivity": 5}),
    "fit": ([], 190, {"_steps": 70, "end_and_sensitivity": 23, "_cost": 58}),
    "apply": ([], 202, {}),
    "explain": (["ndimage", "special"], 235, {"_steps": 103, "end_and_sensitivity": 30, "_cost": 99}),
}


def test_commands_load_and_compute_no_more_than_their_budgets(tmp_path):
    folder = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).save(tmp_path / "session")
    done = processes.run([sys.executable, "-c", RUN, folder, next(folder.glob("log*"))], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    for command, (scipy, own, counts) in BUDGET.items():
        seen = found[command]
        assert (command, seen["code"], seen["scipy"], seen["torch"]) == (command, 0, scipy, False)
        assert seen["own"] <= own, command
        for name, most in counts.items():
            assert seen[name] <= most, (command, name)
