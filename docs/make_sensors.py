"""The tables of docs/sensors.md, from the records that the program reads: ``python docs/make_sensors.py``."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from session.log.registers import PROFILES  # noqa: E402
from session.log.sensors import Figure, Profile  # noqa: E402

PAGE = ROOT / "docs" / "sensors.md"
BEGIN, END = "<!-- tables: docs/make_sensors.py -->", "<!-- end of tables -->"
FIGURES = ("gyro_noise_mdps_rthz", "accel_noise_ug_rthz", "gyro_bias_instability_dph", "zero_rate_dps")


def tables() -> str:
    """What stands between the two marks of the page."""
    alike: dict[str, list[str]] = {}
    for profile in PROFILES:
        alike.setdefault(_units(profile), []).extend((profile.name, *profile.also))
    units = [
        "| sensors | mdps per LSB @ ± dps | mg per LSB @ ± g | LSB per °C, °C at 0 |",
        "|---|---|---|---|",
        *(f"| {', '.join(names)} | {row} |" for row, names in alike.items()),
    ]
    figures = [
        "| sensor | data rates, Hz | gyroscope noise, mdps/√Hz | accelerometer noise, µg/√Hz | bias instability, °/h | largest bias, dps |",
        "|---|---|---|---|---|---|",
        *(_figures(profile) for profile in PROFILES),
    ]
    return "\n\n".join("\n".join(lines) for lines in (units, figures))


def _units(profile: Profile) -> str:
    each = [
        "full scale / 32768" if table is None else " ".join(f"{lsb:.5g}@{fs:g}" for fs, lsb in table.items())
        for table in (profile.gyro, profile.accel)
    ]
    register = profile.thermometer
    temperature = "not known" if register is None else f"{register.lsb_per_c:.5g}, {register.at_zero_c:.5g}"
    return f"{each[0]} | {each[1]} | {temperature}"


def _figures(profile: Profile) -> str:
    rates = [f"{rate:g}" for rate in profile.odr_hz]
    rates += [f"{base_hz:g}/1…{most}" if most > 1 else f"{base_hz:g}" for base_hz, most in profile.divided]
    figures = " | ".join(_figure(profile.figures.get(name)) for name in FIGURES)
    listed = f"`{','.join(rates)}`" if rates else "not known"
    return f"| {profile.name} | {listed} | {figures} |"


def _figure(figure: Figure | None) -> str:
    return "" if figure is None else f"{figure.value:g}" if figure.read else f"[{figure.value:g}]"


def with_tables(page: str) -> str:
    """The page with its tables as the records have them."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{tables()}\n\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
