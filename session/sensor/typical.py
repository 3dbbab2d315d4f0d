"""Typical figures of the sensors that this tool knows; of any other they are given in session.toml, or measured, or not known."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Typical:
    """One-sided white noise densities, bias instability, greatest zero-rate level; source: where they are from."""

    gyro_noise_mdps_rthz: float
    gyro_bias_instability_dph: float
    accel_noise_ug_rthz: float
    zero_rate_dps: float
    source: str


#: model -> figures
TYPICAL = {
    "ASM330LHH": Typical(
        gyro_noise_mdps_rthz=5.0,
        gyro_bias_instability_dph=3.0,
        accel_noise_ug_rthz=60.0,
        zero_rate_dps=3.0,
        source="data sheet of its sibling ISM330DHCX (ST, DS13012 Rev 6); noise also as in public logs of two units",
    )
}


def typical_of(model: str) -> tuple[str, Typical] | None:
    """The known model whose name stands in ``model`` as a word, whatever its case ("ST asm330lhh, unit 2"; TR is tape and reel)."""
    for name, typical in TYPICAL.items():
        if re.search(rf"\b{name}(TR)?\b", model, re.IGNORECASE):
            return name, typical
    return None
