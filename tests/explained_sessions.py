"""Small simulated sessions with something concealed in them, or nothing, and their explanations."""

import copy
import gzip
import re
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from session.io.units import DEG, G
from tinygc import SimulationOptions
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json
from tinygc.simulation.write import write_session

G_SENSITIVITY = [[0.05, -0.03, 0.02], [0.04, 0.06, -0.05], [-0.07, 0.02, 0.03]]
LAG_S = [0.005, 0.012, 0.022]
ASYMMETRY = [0.003, -0.004, 0.0035]


def g_sensitive(t_s, rate, force, temp_c):
    return rate + force / G @ (np.array(G_SENSITIVITY) * DEG).T


def warm(t_s, rate, force, temp_c):
    return rate + np.outer(temp_c - 25, [0.02, -0.03, 0.015]) * DEG


def asymmetric(t_s, rate, force, temp_c):
    return rate + np.abs(rate) * ASYMMETRY


def lagging(t_s, rate, force, temp_c):
    share = 1 - np.exp(-(t_s[1] - t_s[0]) / np.array(LAG_S))
    return np.stack([lfilter([k], [1, k - 1], rate[:, i], zi=[rate[0, i] * (1 - k)])[0] for i, k in enumerate(share)], axis=-1)


def stepping(t_s, rate, force, temp_c):
    return rate + (t_s >= 60)[:, None] * np.array([0.1, -0.15, 0.05]) * DEG


def weakly_skewed(t_s, rate, force, temp_c):
    return np.stack([np.interp(t_s - late, t_s, rate[:, i]) for i, late in enumerate((0.0, 0.0008, 0.0012))], axis=-1)


def late_gyro(t_s, rate, force, temp_c):
    return np.stack([np.interp(t_s - 0.015, t_s, axis) for axis in rate.T], axis=-1)


def both(t_s, rate, force, temp_c):
    """What the element feels of asymmetry comes first, then the zero."""
    return asymmetric(t_s, rate, force, temp_c) + g_sensitive(t_s, rate, force, temp_c) - rate


def oscillating(t_s, rate, force, temp_c):
    """In no catalogue: a zero that goes up and down every 30 s."""
    return rate + np.outer(np.sin(2 * np.pi * t_s / 30), [0.08, 0.05, -0.065]) * DEG


def rewritten(folder: Path, change) -> None:
    """Registers (N, 8) of the log, changed."""
    path = folder / "log0001.csv.gz"
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    head = [line for line in lines if not line[0].isdigit()]
    table = change(np.array([[int(word) for word in line.split(",")] for line in lines if line[0].isdigit()]))
    rows = [",".join(map(str, row)) for row in table.tolist()]
    path.write_bytes(gzip.compress("\n".join([*head, *rows, ""]).encode()))


def clipped(table: np.ndarray) -> np.ndarray:
    """The output stops at 180 dps, 10286 registers of 17.5 mdps."""
    table[:, 1:4] = np.clip(table[:, 1:4], -10286, 10286)
    return table


FALSE_ROWS = [700, 1900, 3300, 5000, 6400, 7700, 9100, 10500, 11900]


def glitched(table: np.ndarray) -> np.ndarray:
    for row in FALSE_ROWS:
        table[row : row + 3, 1:4] += [2600, -1900, 2300]
    return table


def without_latitude(folder: Path) -> None:
    path = folder / "session.toml"
    path.write_text(re.sub(r"latitude_deg = .*\n", "", path.read_text()))


#: name -> what is concealed, options of the simulation, what is done to the folder afterwards
SESSIONS = {
    "nothing": (None, {}, None),
    "nothing else": (None, {"seed": 6}, None),
    "g_sensitivity": (g_sensitive, {}, None),
    "thermal_bias": (warm, {"warm_up_c": 8.0}, None),
    "scale_asymmetry": (asymmetric, {}, None),
    "bandwidth": (lagging, {}, None),
    "bias_step": (stepping, {"segments": 32}, None),
    "accelerometer": (None, {"accel_calibration_error_mg": 6.0}, None),
    "gyro_accel_offset": (late_gyro, {}, None),
    "earth": (None, {"segments": 40, "latitude_deg": 60.0}, without_latitude),
    "saturation": (None, {"segments": 40}, lambda folder: rewritten(folder, clipped)),
    "glitches": (None, {}, lambda folder: rewritten(folder, glitched)),
    "both": (both, {}, None),
    "oscillating": (oscillating, {}, None),
    "weakly skewed": (weakly_skewed, {}, None),
}


def make_session(tmp_path_factory):
    """``session(name)``: the folder of one of ``SESSIONS``, made once.  Read only: copy to write."""
    made = {}

    def make(name: str) -> Path:
        if name not in made:
            distort, options, change = SESSIONS[name]
            chosen = SimulationOptions(**{"segments": 24, "closure_s": 0.0, "seed": 5, "odr_hz": 104.0, **options})
            made[name] = write_session(chosen, tmp_path_factory.mktemp("explain") / name.replace(" ", "_"), distort=distort)
            if change:
                change(made[name])
        return made[name]

    return make


def make_explained(session):
    """``explained(name)``: the explanation and its JSON."""
    made = {}

    def make(name: str):
        if name not in made:
            explanation = explain_session(session(name))
            made[name] = explanation, to_json(explanation)
        return made[name][0], copy.deepcopy(made[name][1])

    return make


def effect_of(result: dict, name: str) -> dict:
    (effect,) = [effect for effect in result["effects"] if effect["id"] == name]
    return effect


def pulls(effect: dict, name: str, truth) -> np.ndarray:
    """(found - true) / std, flat."""
    return (np.ravel(effect["parameters"][name]) - np.ravel(truth)) / np.ravel(effect["std"][name])


def named(result: dict) -> list[str]:
    return sorted(effect["id"] for effect in result["effects"])
