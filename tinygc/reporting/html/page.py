"""The HTML document, with its head, contents and sections; and the report as JSON."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

from session.base.files import result_folder
from session.base.results import write_text_whole
from session.base.units import DEG
from session.log.config import NO_SERIAL
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.choice import run_figures
from tinygc.explanation.reported import ReportData
from tinygc.reporting.facts import document
from tinygc.reporting.html.markup import render
from tinygc.reporting.html.sections import modules
from tinygc.reporting.html.sections.front import recorded

# The report for other programs: ``tinygc-report/1``.

SCHEMA = "tinygc-report/1"


def summary(evidence: ReportData) -> dict:
    """JSON-ready summary: decision, closure, all parameters with their expanded uncertainties (95 %), hashes, versions."""
    adopted, decision = evidence.adopted, evidence.decision
    return {
        "schema": SCHEMA,
        "session": evidence.fit.session.name,
        "passed": None if decision.answer in ("not decided", "no limit") else decision.passed,
        "answer": decision.answer,
        "doubts": decision.doubts,
        "rule": decision.rule.replace("\n", " "),
        "limit_deg": decision.limit_deg,
        "conformity": [each.to_json() for each in decision.conformities],
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
                "coverage_factor": q.factor,
                "by_one_effect": 2 * q.moved if q.observed and isfinite(q.moved) else None,
                "at_most": q.at_most if isfinite(q.at_most) else None,
            }
            for q in evidence.quantities
        ],
        "accelerometer": evidence.fit.accelerometer.to_json(),
        "inputs": evidence.hashes,
        "versions": evidence.versions,
        "made": evidence.made,
    }


# The whole page: head, list of contents, sections.


def page(evidence: ReportData) -> str:
    """The report as one HTML document."""
    sections = [made for part in modules() if (made := part.section(evidence)) is not None]
    title, sensor = f"Calibration report: {evidence.fit.session.name}", evidence.fit.session.config.sensor
    date = recorded(evidence)
    serial = "" if sensor.serial in NO_SERIAL else sensor.serial
    named = "Sensor without a name" if sensor.model == "unknown" else sensor.model  # as an import calls it
    running = (f"{named} · {serial or 'no serial number'}", f"recorded {date}" if date else f"made {evidence.made}")
    head = render("head.html", e=evidence, named=named, serial=serial)
    return document(title, head, sections, render("foot.html", e=evidence, serial=serial), running)


def save(evidence: ReportData, path: Path) -> Path:
    """Write the page atomically; returns its path."""
    text = page(evidence)
    with result_folder(path.parent):
        write_text_whole(path, text)
    return path
