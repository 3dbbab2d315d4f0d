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
FIGURES = ("gyro_noise_mdps_rthz", "accel_noise_ug_rthz", "gyro_bias_instability_dph", "zero_rate_dps", "accel_zero_mg")


def tables() -> str:
    """What stands between the two marks of the page."""
    units = [
        "| sensor | mdps per LSB at ± dps | mg per LSB at ± g | temperature | from |",
        "| --- | --- | --- | --- | --- |",
        *(_units(profile) for profile in PROFILES),
    ]
    figures = [
        "| sensor | data rates, Hz | gyroscope noise, mdps/√Hz | accelerometer noise, µg/√Hz | bias instability, °/h "
        "| zero rate, at most, dps | accelerometer's zero, at most, mg | works, °C |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *(_figures(profile) for profile in PROFILES),
    ]
    sources = ["| sensor | figure | source |", "| --- | --- | --- |", *(row for profile in PROFILES for row in _sources(profile))]
    return "\n\n".join("\n".join(lines) for lines in (units, figures, sources))


def _units(profile: Profile) -> str:
    each = [
        "full scale / 32768" if table is None else ", ".join(f"{lsb:.6g} at {fs:g}" for fs, lsb in table.items())
        for table in (profile.gyro, profile.accel)
    ]
    register = profile.thermometer
    temperature = "not known" if register is None else f"{register.lsb_per_c:.5g} LSB per °C, 0 at {register.at_zero_c:.5g} °C"
    names = ", ".join((profile.name, *profile.also))
    return f"| {names} | {each[0]} | {each[1]} | {temperature} | {profile.units} |"


def _figures(profile: Profile) -> str:
    rates = [f"{rate:g}" for rate in profile.odr_hz]
    rates += [f"{base_hz:g} / 1…{most}" if most > 1 else f"{base_hz:g}" for base_hz, most in profile.divided]
    works = "" if profile.works_c is None else f"{profile.works_c[0]:g} to {profile.works_c[1]:g}".replace("-", "−")
    figures = " | ".join(_figure(profile.figures.get(name)) for name in FIGURES)
    return f"| {profile.name} | {', '.join(rates) or 'not known'} | {figures} | {works} |"


def _figure(figure: Figure | None) -> str:
    return "" if figure is None else f"{figure.value:g}" if figure.read else f"[{figure.value:g}]"


def _sources(profile: Profile) -> list[str]:
    """Figures of one source in one row; what is remembered says so in the table before."""
    named = {"gyro_noise_mdps_rthz": "gyroscope noise", "accel_noise_ug_rthz": "accelerometer noise"}
    named |= {"gyro_bias_instability_dph": "bias instability", "zero_rate_dps": "zero rate", "accel_zero_mg": "accelerometer's zero"}
    by_source: dict[str, list[str]] = {}
    for name, figure in profile.figures.items():
        if figure.read:
            by_source.setdefault(figure.source, []).append(named[name])
    return [f"| {profile.name} | {', '.join(names)} | {source} |" for source, names in by_source.items()]


def with_tables(page: str) -> str:
    """The page with its tables made anew."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{tables()}\n\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
