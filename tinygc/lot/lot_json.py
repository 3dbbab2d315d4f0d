"""A lot's report as JSON: the file that ``fit --lot`` reads, with all that people see of the lot beside it (docs/formats.md)."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from session.files.results import write_whole
from tinygc.lot.capability import Capability, Indices
from tinygc.lot.control import Chart
from tinygc.lot.files import lot_table
from tinygc.lot.gauge import Gauge
from tinygc.lot.outliers import Outlier
from tinygc.lot.report import LotReport, Quantity

#: alarms and outliers that a file holds; how many there are stands beside them
MOST_ALARMS, MOST_OUTLIERS = 20, 1000


def to_json(report: LotReport) -> dict:
    """``tinygc-lot/1``."""
    drift = report.hierarchy
    return lot_table(
        report.lot,
        appraisers=report.appraisers or None,
        drift_p_value=drift.drift_p,
        drifts=drift.drifts,
        off_share=drift.off,
        settled=drift.settled,
        notes=list(report.notes),
        quantities=[_quantity(each) for each in report.quantities if each.units],
        charts={key: _chart(each, report) for key, each in report.charts.items()},
        gauges={key: _gauge(each) for key, each in report.gauges.items()},
        capabilities={key: _capability(each) for key, each in report.capabilities.items()},
        outliers_found=len(report.outliers),
        outliers=[_outlier(each) for each in report.outliers[:MOST_OUTLIERS]],
    )


def save(report: LotReport, path: Path | str) -> None:
    """Write it, whole or not at all.  Raises StorageError for a full disk."""
    write_whole(Path(path), to_json(report))


def _quantity(each: Quantity) -> dict:
    return {
        "key": each.seen.key,
        "unit": each.seen.unit,
        "units": each.units,
        "mean": each.mean,
        "mean_sigma": each.mean_sigma,
        "spread": each.spread,
        "spread_interval": list(each.spread_interval),
        "noise": each.noise,
        "repeatability": each.repeatability,
        "repeatability_interval": list(each.repeatability_interval),
        "drift_per_1000": each.drift,
        "drift_sigma": each.drift_sigma,
        "drift_p_value": each.drift_p,
        "stated_ratio": each.ratio,
        "stated_p_value": each.ratio_p,
    }


def _chart(each: Chart, report: LotReport) -> dict:
    return {
        "points": len(each.y),
        "centre": each.centre,
        "short_term": each.short_term,
        "limit_sigmas": each.limit,
        "ewma_limit_sigmas": each.ewma_limit,
        "moving_range_limit": each.range_limit,
        "beyond_limit": len(each.alarms),
        "alarms": _points(each.alarms, each),
        "ewma_beyond_limit": len(each.ewma_alarms),
        "ewma_alarms": _points(each.ewma_alarms, each),
        "rules": [
            {"rule": name, "found": each.counts[name], "by_chance": each.chance[name], "broken": name in each.broken}
            for name in each.counts
        ],
    }


def _points(alarms: np.ndarray, chart: Chart) -> list[dict[str, Any]]:
    return [{"place": int(chart.place[n]), "value": float(chart.y[n]), "sigmas": float(chart.score[n])} for n in alarms[:MOST_ALARMS]]


def _gauge(each: Gauge) -> dict:
    table = None
    if each.table is not None:
        kept = zip(("part", "appraiser", "interaction", "repeat"), each.table.freedom, each.table.squares, strict=True)
        table = {
            "pooled": each.table.pooled,
            "interaction_p_value": each.table.interaction_p,
            "rows": [{"source": name, "freedom": float(f), "sum_of_squares": float(s)} for name, f, s in kept],
        }
    names = ("ev", "av", "interaction", "grr", "pv", "tv", "percent_grr", "percent_tolerance", "method", "parts", "sessions", "verdict")
    return {
        **{name: getattr(each, name) for name in names},
        "ndc": each.ndc,
        "percent_grr_interval": list(each.percent_grr_interval),
        "ndc_interval": list(each.ndc_interval),
        "anova": table,
        "why_not": each.why or None,
    }


def _capability(each: Capability) -> dict:
    table = {name: value for name, value in asdict(each).items() if not isinstance(value, dict)}
    for name in ("within", "overall", "seen"):
        table[name] = _indices(getattr(each, name))
    return table


def _indices(each: Indices) -> dict:
    return {
        "index": each.index,
        "index_interval": list(each.index_interval),
        "centred": each.centred,
        "centred_interval": list(each.centred_interval),
    }


def _outlier(each: Outlier) -> dict:
    reasons = [{"what": reason.what, "value": reason.value, "sigmas": reason.sigmas} for reason in each.reasons]
    return {
        "serial": each.serial,
        "session": each.session,
        "kind": each.kind,
        "p_value": each.p_value,
        "says": each.says,
        "reasons": reasons,
    }
