"""Configurations as hypothesis makes them: everything that docs/formats.md lets a session.toml say."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from hypothesis import strategies as st

from session.log.config import REFERENCES, Accelerometer, Config, LeftOut, Protocol, Sensor, Site
from session.log.registers import DEFAULT

#: ordinary ones, those of a shell, of TOML and of a terminal, and any other
TEXTS = st.one_of(
    st.sampled_from(["", "42", "ASM330LHH", "gyro №7 🛰", "it's", 'say "no"', "\\", "a\nb = 1", "]]\n[site]"]),
    st.sampled_from(["\x1b[2J", "\x00\x7f\x85\u2028"]),
    st.text(max_size=30),
)


def numbers(low: float, high: float, **more):
    return st.floats(low, high, allow_subnormal=False, **more)


def maybe(strategy):
    return st.none() | strategy


SENSORS = st.builds(
    Sensor,
    model=st.sampled_from([DEFAULT, "MPU-9250", "unknown"]) | TEXTS,
    serial=TEXTS,
    odr_hz=numbers(0.1, 50000),
    gyro_fs_dps=st.sampled_from([125.0, 250.0, 500.0, 2000.0]) | numbers(1, 1e5),
    accel_fs_g=st.sampled_from([2.0, 4.0, 16.0]) | numbers(0.1, 1000),
    gyro_bias_instability_dph=maybe(numbers(0, 1000)),
    gyro_noise_mdps_rthz=maybe(numbers(1e-3, 1000)),
    gyro_mdps_per_lsb=maybe(numbers(1e-6, 1e5)),
    accel_mg_per_lsb=maybe(numbers(1e-6, 1e5)),
    temp_lsb_per_c=maybe(numbers(1e-3, 1e5)),
    temp_at_zero_c=maybe(numbers(-300, 300)),
)


def _accelerometer(cells, bias, sigma_mg, own_stills) -> Accelerometer:
    return Accelerometer(np.eye(3) + np.reshape(cells, (3, 3)), np.array(bias), "given", sigma_mg, own_stills)


GIVEN = st.builds(
    _accelerometer,
    st.lists(numbers(-0.1, 0.1), min_size=9, max_size=9),
    st.lists(numbers(-5, 5), min_size=3, max_size=3),
    maybe(numbers(1e-3, 1000)),
    maybe(st.booleans()),
)
ACCELEROMETERS = st.builds(lambda: Accelerometer(source="none")) | GIVEN
SITES = st.builds(Site, maybe(numbers(-90, 90)), maybe(numbers(9.7, 9.9)), maybe(numbers(-360, 360)))
PROTOCOLS = st.builds(Protocol, numbers(0.1, 600), numbers(0.5, 3600), st.sampled_from(REFERENCES), numbers(1e-4, 10))
NOTE = TEXTS | st.booleans() | st.integers(-(2**53), 2**53) | numbers(-1e9, 1e9) | st.datetimes() | st.dates()
NOTES = st.dictionaries(TEXTS, NOTE, max_size=4)
EXCLUDED = st.lists(st.builds(LeftOut, TEXTS, numbers(-1e9, 1e9)), max_size=3).map(tuple)
CONFIGS = st.builds(Config, SENSORS, ACCELEROMETERS, SITES, PROTOCOLS, st.just(()), st.just(True), NOTES, EXCLUDED)


def difference(one: Config, other: Config) -> list[str]:
    """Names of what differs, but for what no session.toml says."""
    found = [name for name in ("sensor", "site", "protocol", "exclude") if getattr(one, name) != getattr(other, name)]
    found += ["notes"] * (dict(one.notes) != dict(other.notes)) + ["unknown"] * bool(other.unknown)
    for name in ("accelerometer",):
        mine, theirs = getattr(one, name), getattr(other, name)
        for field in fields(mine):
            values = getattr(mine, field.name), getattr(theirs, field.name)
            if not (values[0] is values[1] or np.array_equal(*values)):
                found.append(f"{name}.{field.name}: {values[0]} became {values[1]}")
    return found
