"""The report for other programs: ``tinygc-report/1``."""

from __future__ import annotations

from math import isfinite

from session.common.units import DEG
from tinygc.fitting.figures import run_figures
from tinygc.report.html.evidence import Evidence
from tinygc.report.html.numbers import tilt_rms

SCHEMA = "tinygc-report/1"


def summary(evidence: Evidence) -> dict:
    """JSON-ready: decision, closure, every number of the parameter tables with its expanded uncertainty (k = 2), hashes, versions."""
    adopted, decision = evidence.adopted, evidence.decision
    return {
        "schema": SCHEMA,
        "session": evidence.fit.session.name,
        "passed": None if decision.answer == "not decided" else decision.passed,
        "answer": decision.answer,
        "doubts": decision.doubts,
        "rule": decision.rule,
        "limit_deg": evidence.limit_deg,
        "calibration": adopted.name,
        "effects": [claim.effect.id for claim in adopted.claims],
        "closure": {
            "holdout_tilt_rms_deg": tilt_rms(adopted.angles) / DEG,
            "floor_rms_deg": adopted.floor_rms / DEG,
            "p_value": adopted.closure_p,
            "degrees_of_freedom": adopted.closure_freedom,
            "runs": [
                {"file": run.file, **run_figures(error), "p_value": p}
                for run, error, p in zip(evidence.fit.runs, adopted.run_errors, adopted.run_p, strict=True)
            ],
        },
        "verdict": evidence.verdict,
        "parameters": [
            {
                "parameter": q.word,
                "component": q.component,
                "unit": q.unit,
                "value": q.value if q.observed else None,
                "expanded_uncertainty": q.expanded if q.observed else None,
                "coverage_factor": 2,
                "at_most": q.at_most if isfinite(q.at_most) else None,
            }
            for q in evidence.quantities
        ],
        "accelerometer": evidence.fit.accelerometer.to_json(),
        "inputs": evidence.hashes,
        "versions": evidence.versions,
        "made": evidence.made,
    }
