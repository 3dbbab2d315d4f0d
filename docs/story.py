"""The whole story in Python, cell by cell: ``# %%`` begins a cell in most editors, and ``python docs/story.py`` runs them all.

A session is simulated that hides something.  It is fitted, explained, fitted again with what was named, and the model is put to use.
"""

# %% A session: here a simulated one, from a folder with tinygc.read_session("data/session1"), or from arrays of your own (below)
import tempfile
from pathlib import Path

import numpy as np

import tinygc

hidden = {"gyro.g_sensitivity": {"matrix_dps_per_g": [[0.10, 0.0, 0.0], [0.0, -0.08, 0.0], [0.0, 0.02, 0.06]]}}
simulated = tinygc.simulate(segments=24, closure_s=30.0, seed=5, effects=hidden)
session = simulated.session
print(session)

# %% The first look: units, rates, gaps, axes, stills
worst = max(tinygc.check(session), key=lambda finding: ("ok", "note", "warning", "error").index(finding.level))
print(worst.level, worst.what, worst.description)

# %% The main job: two of the methods; progress=print would tell how far it is
result = tinygc.fit(session, methods=("raw_bias_removed", "least_squares"))
print(result.summary())
print(result.parameters["E_xy"].value, "±", result.parameters["E_xy"].sigma)

# %% It closes far above its floor: why?
why = tinygc.explain(session)
print(why.summary())
for effect in why.effects:
    print(effect.id, effect.parameters, effect.std)

# %% The pictures (SVG)
figure = why.plot()

# %% Once more, with the physics that was named
better = tinygc.fit(session, methods=("least_squares",), physics=("auto",))
print(better.closure["least_squares"]["tilt_rms_deg"], "->", better.closure["physics"]["tilt_rms_deg"], "degrees rms, held out")

# %% The model as a file, and in use: arrays are never remembered, a live stream is an object of its own
path = better.models["physics"].save(Path(tempfile.mkdtemp()) / "gyro.json")
model = tinygc.load(path)
samples = session.calibrated(session.logs[0])  # with the accelerometer's pre-calibration
omega = model(samples.gyro, acc=samples.accel)
live = model.live()
first = live(samples.gyro[0], acc=samples.accel[0])
print(model, model.needs, np.abs(first - omega[0]).max())

# %% A session of arrays: time in s, rates in rad/s, specific force in m/s², body axes forward-right-down
log, run = session.logs[0].samples, session.closures[0].samples
same = tinygc.Session.from_arrays(
    log.t_ns * 1e-9,
    log.gyro,
    log.accel,
    log.temp_c,
    closures=[(run.t_ns * 1e-9, run.gyro, run.accel, run.temp_c)],
    gyro_fs_dps=500,
    accel_fs_g=4,
    model="ASM330LHH",
    accelerometer=session.config.accelerometer,
    site=session.config.site,
    protocol=session.config.protocol,
)
again = tinygc.fit(same, methods=("least_squares",))
print(again)
