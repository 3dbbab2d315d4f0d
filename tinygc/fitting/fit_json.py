"""A fit as ``tinygc-fit/1``."""

from __future__ import annotations

import numpy as np

from session.alignment.table import alignment_table
from session.common.units import DEG, G
from session.common.version import VERSION
from tinygc.fitting.figures import closure_figures, run_figures
from tinygc.fitting.known_turns import known_turns_json
from tinygc.fitting.result import FitResult

SCHEMA = "tinygc-fit/1"


def to_json(result: FitResult) -> dict:
    """``tinygc-fit/1`` (docs/formats.md)."""
    problem = result.problem
    rejected = [segment for segment in problem.segments if not segment.accepted]
    earth = problem.earth
    return {
        "schema": SCHEMA,
        "session": result.session.name,
        "stills": len(problem.stills),
        "segments": {
            "found": len(problem.segments),
            "used": len(problem.used),
            "rejected": [{"segment": segment.number, "why": segment.problem} for segment in rejected],
            "notes": [{"segment": s.number, "note": s.note} for s in problem.segments if s.accepted and s.note],
            "widened": [each.to_json() for each in problem.widened],
        },
        "rests_not_used": [
            {"log": log, "at_s": round(rest.start_s, 3), "duration_s": round(rest.duration_s, 3), "cause": rest.cause, "why": rest.why}
            for log, rest in problem.unused_rests
        ],
        "noise": {
            "gyro_dps_rthz": (problem.noise.gyro / DEG).tolist(),
            "accel_g_rthz": (problem.noise.accel / G).tolist(),
            **problem.instability.to_json(),
            "closure_floor_rms_deg": problem.floor.tilt_rms / DEG,
            "closure_all_rms_deg": None if result.noise is None else result.noise.tilt_rms / DEG,
            "components": [] if result.noise is None else result.noise.to_json(),
            **({} if result.physics is None else {"closure_floor_mended_rms_deg": result.physics.problem.floor.tilt_rms / DEG}),
        },
        "accelerometer": result.accelerometer.to_json(),
        "goodness": vars(result.goodness),
        "bias_from": result.bias_from.to_json(),
        "lot": None if result.lot is None else result.lot.to_json(),
        "known_turns": known_turns_json(result),
        "truth": None if result.session.alignment is None else alignment_table(result.session.alignment),
        "unobserved": result.linear.notes.get("unobserved", []),
        "earth": {
            "source": earth.source,
            "heading_deg": None if earth.heading_rad is None or earth.source == "unknown" else earth.heading_rad / DEG,
            "heading_sigma_deg": earth.heading_sigma_rad / DEG if earth.source == "estimated" else None,
        },
        "methods": {
            name: {
                "parameters": fit.parameters,
                "seconds": round(fit.seconds, 3),
                "train": closure_figures(fit.angles),
                "holdout": closure_figures(fit.held_out),
                **({"denoiser": fit.notes["denoiser"]} if "denoiser" in fit.notes else {}),
            }
            for name, fit in result.methods.items()
        },
        "use": {**result.use.to_json(), "model": result.file_to_use},
        "against_raw": result.against_raw.to_json(),
        "closure_runs": [
            {
                "file": run.file,
                "duration_s": run.duration_s,
                "floor_rmse_deg": float(np.sqrt(np.mean(run.floor_rad**2))) / DEG,
                "earth": run.earth.source,
                **({} if result.physics is None else {"lost_at_s": np.round(result.lost_s[number], 3).tolist()}),
                **{name: run_figures(error) for name, error in errors.items()},
            }
            for number, (run, errors) in enumerate(zip(result.runs, result.run_errors, strict=True))
        ],
        "still_rates": {"used": result.options.still_rates, "other_choice_holdout": closure_figures(result.other_choice.held_out)},
        "options": {
            "seed": result.options.seed,
            "folds": min(result.options.folds, len(problem.used)),
            "integrator": result.options.integrator,
            "optimizer": result.options.optimizer,
            "loss": result.options.loss,
            "variant": result.options.variant,
            "parts": result.options.parts,
            "conditions": list(result.options.conditions),
            "bias_per_log": result.options.bias_per_log,
            "bias": result.options.bias,
            "accelerometer": result.options.accelerometer,
        },
        "version": VERSION,
    }
