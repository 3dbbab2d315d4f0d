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
    "accel_noise_ug_rthz": ("accelerometer noise", "ug/√Hz"),
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
        for profile in chosen:
            console.print(_line(profile))
        console.print("(remembered figures are in brackets: nothing is held against them)")
    else:
        for line in _lines(chosen[0]):
            console.print(line)
    write_json(args.json, {"schema": "tinygc-sensors/1", "sensors": [_table(profile) for profile in chosen]})
    return 0


def _line(profile: Profile) -> str:
    noise = profile.gyro_noise_mdps_rthz
    said = "" if noise is None else f"; {_value(noise, 'mdps/√Hz')}"
    return f"{profile.name:11} {_ranges(profile.gyro)} dps; {_ranges(profile.accel)} g; {_rates(profile)}{said}"


def _lines(profile: Profile) -> list[str]:
    lines = [", ".join((profile.name, *profile.also))]
    for what, unit, full_scale, table in (("gyroscope", "mdps", "dps", profile.gyro), ("accelerometer", "mg", "g", profile.accel)):
        each = "full scale / 32768" if table is None else ", ".join(f"{lsb:.6g} at ±{fs:g} {full_scale}" for fs, lsb in table.items())
        lines.append(f"  {what}, {unit} per LSB: {each}")
    thermometer = profile.thermometer
    register = "not known" if thermometer is None else f"{thermometer.lsb_per_c:.6g} LSB per degC, 0 at {thermometer.at_zero_c:.5g} degC"
    lines.append(f"  temperature register: {register}")
    lines.append(f"  these are from: {profile.units}")
    lines.append(f"  data rates: {_rates(profile)}")
    for name, figure in profile.figures.items():
        called, unit = FIGURES[name]
        lines.append(f"  {called}: {_value(figure, unit)} ({figure.source})")
    if profile.works_c is not None:
        lines.append(f"  works from {profile.works_c[0]:g} to {profile.works_c[1]:g} degC")
    missing = [called for name, (called, _) in FIGURES.items() if profile.yardstick(name) is None]
    if missing:
        lines.append(f"  not held against anything: {'; '.join(missing)}")
    return lines


def _value(figure: Figure, unit: str) -> str:
    return f"{figure.value:g} {unit}" if figure.read else f"[{figure.value:g} {unit}]"


def _ranges(table: object) -> str:
    return "±" + ", ".join(f"{fs:g}" for fs in table) if isinstance(table, dict) else "any"


def _rates(profile: Profile) -> str:
    listed = [", ".join(f"{rate:g}" for rate in profile.odr_hz)] if profile.odr_hz else []
    listed += [f"{base_hz:g}" + (f" / 1…{most}" if most > 1 else "") for base_hz, most in profile.divided]
    return f"{', '.join(listed)} Hz" if listed else "data rates not known"


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
