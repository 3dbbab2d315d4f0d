"""A model over temperature, of rest logs and of sessions at several temperatures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import Feature
from session.base.options import Record, option
from session.base.texts import command_line

# Options of a model over temperature, and of a simulated rest log.

HIGHEST_ORDER = 20  #: above it powers of a temperature are indistinguishable in float64


@dataclass(frozen=True)
class ThermalOptions(Record):
    """Options of ``temperature``."""

    most_order: int = option(5, "highest power of the temperature that is tried", least=0, most=HIGHEST_ORDER, flags=("--order",))


GROUP = "a rest log, with --rest-cycles"


@dataclass(frozen=True)
class RestOptions(Record):
    """Options of one simulated rest log; temperature effects have the same size on every axis, with the signs +, −, + for x, y, z."""

    PREFIX = "rest-"

    cycles: float = option(0.0, "of the temperature in the rest log; 0: a session with turns is simulated", least=0, most=1000, group=GROUP)
    cycle_s: float = option(3600.0, "length of a cycle", unit="s", least=10, most=1e7, group=GROUP, rare=True)
    cold_c: float = option(-10.0, "coldest, where it begins", unit="degC", least=-40, most=105, group=GROUP, cli=False)
    warm_c: float = option(70.0, "warmest", unit="degC", least=-40, most=105, group=GROUP, rare=True)
    zero_dps: tuple[float, float, float] = option(
        (0.5, -0.3, 0.6), "the zero in the middle of the range", unit="dps", least=-1e4, most=1e4, group=GROUP, cli=False
    )
    slope_dps_per_c: float = option(
        0.03, "how the zero follows the element's temperature", unit="dps/degC", least=-100, most=100, group=GROUP, cli=False
    )
    bend_dps_per_c2: float = option(2e-4, "its curvature", unit="dps/degC^2", least=-10, most=10, group=GROUP, cli=False)
    lag_s: float = option(
        0.0,
        "by which the element is behind the temperature reading; negative: ahead of it",
        unit="s",
        least=-1e5,
        most=1e5,
        group=GROUP,
        rare=True,
    )
    hysteresis_dps: float = option(0.0, "between the way up and the way down", unit="dps", least=-1e4, most=1e4, group=GROUP, cli=False)
    random_walk_dps_rts: float = option(0.0, "how the zero wanders as well", unit="dps/sqrt(s)", least=0, most=100, group=GROUP, cli=False)
    noise_per_c: float = option(0.0, "how the white noise grows with temperature", unit="1/degC", group=GROUP, cli=False)
    knocks: int = option(0, "blows of a tenth of a second", least=0, most=100000, group=GROUP, cli=False)

    def __post_init__(self) -> None:
        """Check each field, and that the noise stays above zero."""
        super().__post_init__()
        self.expect(self.cold_c <= self.warm_c, "cold_c", "at most warm_c")
        self.expect(abs(self.noise_per_c) * (self.warm_c - self.cold_c) < 2, "noise_per_c", "less: the noise would be negative")


# What the core asks.


def fit(args: Any) -> None:
    """Refuse a folder of rest logs alone, in which nothing turns."""
    folder: Path = args.folder
    if folder.is_dir() and any(folder.glob("rest*.csv*")) and not any(folder.glob("log*.csv*")):
        command = command_line("noise", folder)
        raise CalibrationError(f"{folder}: rest logs alone, in which nothing is turned; `{command}` or temperature reads them")


FEATURE = Feature(
    commands={
        "temperature": ("command", "one calibration over temperature from several sessions", "lab"),
    },
    public={"fit_temperature": "library", "ThermalFit": "sessions_fit"},
    kinds={"thermal": "model"},
    exports={"thermal": "deploy"},
    serves={
        "zero over temperature": "rest_fit",
        "fit of a folder": "feature:fit",
        "options of simulate": "feature:RestOptions",
        "simulation": "command:simulate",
    },
)
