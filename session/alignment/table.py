"""How a truth file was read, as the results' JSON has it (docs/formats.md)."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from session.log.truth_reading import TruthAlignment


def alignment_table(alignment: TruthAlignment) -> dict:
    """JSON-ready; null for what the recording does not show."""
    reading = alignment.reading
    return {
        "offset_s": _number(alignment.offset_s),
        "offset_std_s": _number(alignment.offset_sigma_s),
        "offset_used_s": reading.offset_s,
        "gyro_to_truth_deg": [_number(value) for value in alignment.turned / DEG],
        "gyro_to_truth_std_deg": [_number(value) for value in alignment.turned_sigma / DEG],
        "mounting": reading.mounting.tolist(),
        "frame": reading.frame,
        "sense": reading.sense,
        "order": reading.order,
        "up": None if alignment.up is None else alignment.up.tolist(),
        "source": {name.removesuffix("_s"): source for name, source in alignment.source.items()},
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
