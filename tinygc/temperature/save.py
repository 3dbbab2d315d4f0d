"""A fit over temperature as files: the model, the figures, the picture."""

from __future__ import annotations

from pathlib import Path

from session.common.version import VERSION
from session.files.results import write_whole
from session.files.writing import result_folder
from tinygc import models
from tinygc.explanation.pictures.canvas import can_draw
from tinygc.models.accelerometer import accelerometer_table
from tinygc.temperature.thermal_fit import ThermalFit
from tinygc.temperature.thermal_json import to_json
from tinygc.temperature.thermal_terms import zero_terms

#: beside the models of the other methods
MODEL, FIGURES, PICTURE = "model_thermal.json", "temperature.json", "temperature.png"
UNITS = "E: 1/degC^n, zero: rad/s/degC^n, lag: s; product of the two parameters' units"


def save_thermal(fit: ThermalFit, folder: Path, pictures: bool = True) -> Path:
    """Write the model, the figures and, where matplotlib is installed, the picture into a folder; returns it.

    StorageError for what cannot be written.
    """
    with result_folder(folder):
        write_whole(folder / MODEL, model_table(fit))
        write_whole(folder / FIGURES, to_json(fit))
        if pictures and can_draw():
            from tinygc.temperature.picture import draw

            draw(fit, folder / PICTURE)
    return folder


def model_table(fit: ThermalFit) -> dict:
    """``tinygc-model/1`` with the covariance; and of the accelerometer the calibration in whose body frame E is, and its change."""
    more = {
        "method": "thermal",
        "session": fit.name,
        "sha256": fit.sha256,
        "version": VERSION,
        "covariance": fit.covariance.tolist(),
        "covariance_of": list(fit.names),
        "covariance_units": UNITS,
        "remaining_rps": [None if value != value else value for value in fit.remaining_rps.tolist()],
    }
    if fit.sessions is not None:
        # That of the first session, into whose frame all were turned.  Where nothing was turned, E is the identity, and in no frame.
        more["accelerometer"] = accelerometer_table(fit.sessions.points[0].accelerometer)
    if fit.rests is not None and fit.rests.accel:
        # The attitude was one: a change of scale and of zero are one there, and the constant is gravity's.
        more["accel_change_mps2"] = zero_terms(fit.rests.accel)[1:].tolist()
    return models.to_dict(fit.model, **more)
