"""``sensors``: list the known sensors and their data."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from session.base.options import argument
from tinygc.cli.options import Command
from tinygc.cli.results import output, write_json

if TYPE_CHECKING:
    from session.log.sensors import Figure, Profile

#: figure -> its name for the user, and its unit
FIGURES = {
    "gyro_noise_mdps_rthz": ("gyroscope noise", "mdps/√Hz"),
    "accel_noise_ug_rthz": ("accelerometer noise", "µg/√Hz"),
    "gyro_bias_instability_dph": ("bias instability", "deg/h"),
    "zero_rate_dps": ("zero-rate level, at most", "dps"),
    "accel_zero_mg": ("accelerometer's zero, at most", "mg"),
}


@dataclass(frozen=True)
class Options(Command):
    """Options of ``sensors``."""

    name: str | None = argument("as in session.toml or --sensor, such as mpu9250 (all)", None, metavar="NAME")


def run(args: Options) -> int:
    """Print one line for each sensor, or several for one."""
    from tinygc.library.known import sensors

    console, chosen = output(args), sensors(args.name)
    if args.name is None:
        from session.base.texts import command_line
        from tinygc.reporting.facts import Table

        console.print(f"{len(chosen)} sensors; {command_line('sensors', 'NAME')} shows all about one")
        header = ("", "± dps", "± g", "data rates, Hz", "noise, mdps/√Hz")
        console.print(Table("", header, list(map(_row, chosen)), "In brackets: a figure from memory, not used.", left=(0, 1, 2, 3)))
    else:
        for line in _lines(chosen[0]):
            console.print(line)
    write_json(args.json, {"schema": "tinygc-sensors/1", "sensors": [_table(profile) for profile in chosen]})
    return 0


def _row(profile: Profile) -> list[str]:
    noise = profile.gyro_noise_mdps_rthz
    rates = [*profile.odr_hz, *(rate for base_hz, most in profile.divided for rate in (base_hz, base_hz / most))]
    cells = (_span(list(values or ())) for values in (profile.gyro, profile.accel, rates))
    return [profile.name, *cells, "" if noise is None else _value(noise, "")]


def _span(values: list[float]) -> str:
    ends = [f"{value:.5g}" for value in sorted({min(values), max(values)})] if values else ["any"]
    return " to ".join(ends)


def _lines(profile: Profile) -> list[str]:
    lines = [", ".join((profile.name, *profile.also))]
    for what, unit, full_scale, table in (("gyroscope", "mdps", "dps", profile.gyro), ("accelerometer", "mg", "g", profile.accel)):
        if table is None:
            lines.append(f"  {what}: full scale / 32768")
        else:
            lines.append(f"  {what}, ± {full_scale}: {', '.join(f'{fs:g}' for fs in table)}")
            lines.append(f"  {unit} per LSB: {', '.join(f'{lsb:.5g}' for lsb in table.values())}")
    thermometer = profile.thermometer
    register = "not known" if thermometer is None else f"{thermometer.lsb_per_c:.5g} LSB per degC, 0 at {thermometer.at_zero_c:.5g} degC"
    lines.append(f"  temperature register: {register}")
    sources = "; ".join([profile.units, *(figure.source.partition("; ")[0] for figure in profile.figures.values())])
    first, *others = dict.fromkeys(sources.split("; "))
    lines += [f"  source: {first}", *(f"    {text}" for text in others)]
    lines.append(f"  rates: {_rates(profile)}")
    lines += [f"  {called}: {_value(profile.figures[name], unit)}" for name, (called, unit) in FIGURES.items() if name in profile.figures]
    if profile.works_c is not None:
        lines.append(f"  works from {profile.works_c[0]:g} to {profile.works_c[1]:g} degC")
    return lines


def _value(figure: Figure, unit: str) -> str:
    text = f"{figure.value:g} {unit}".strip()
    return text if figure.read else f"[{text}]"


def _rates(profile: Profile) -> str:
    listed = [", ".join(f"{rate:g}" for rate in profile.odr_hz)] if profile.odr_hz else []
    listed += [f"{base_hz:g}" + (f" / 1 to {most}" if most > 1 else "") for base_hz, most in profile.divided]
    return f"{', '.join(listed)} Hz" if listed else "not known"


def _table(profile: Profile) -> dict:
    thermometer = profile.thermometer
    return {
        "name": profile.name,
        "also": list(profile.also),
        "gyro_mdps_per_lsb": None if profile.gyro is None else {f"{fs:g}": lsb for fs, lsb in profile.gyro.items()},
        "accel_mg_per_lsb": None if profile.accel is None else {f"{fs:g}": lsb for fs, lsb in profile.accel.items()},
        "units_source": profile.units,
        "temp_lsb_per_c": None if thermometer is None else thermometer.lsb_per_c,
        "temp_at_zero_c": None if thermometer is None else thermometer.at_zero_c,
        "odr_hz": list(profile.odr_hz),
        "divided": [{"base_hz": base_hz, "most": most} for base_hz, most in profile.divided],
        "clock_within": None if profile.clock_within is None else asdict(profile.clock_within),
        "works_c": None if profile.works_c is None else list(profile.works_c),
        "figures": {name: asdict(figure) for name, figure in profile.figures.items()},
    }
