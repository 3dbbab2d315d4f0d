"""Configurations as hypothesis makes them: everything that docs/formats.md lets a session.toml say."""

from dataclasses import fields, replace

import numpy as np
from hypothesis import strategies as st

from session.base.records import record_of
from session.base.results import Flag, Number
from session.log.config import REFERENCES, Accelerometer, BoardGiven, Config, LeftOut, Protocol, Sensor, Site, StillByHand
from session.log.registers import DEFAULT
from session.log.requirements import GUARDED, QUANTITIES, SIZES, Requirements, Rule

#: ordinary ones, those of a shell, of TOML and of a terminal, and any other
TEXTS = st.one_of(
    st.sampled_from(["", "42", "ASM330LHH", "gyro №7 🛰", "it's", 'say "no"', "\\", "a\nb = 1", "]]\n[site]"]),
    st.sampled_from(["\x1b[2J", "\x00\x7f\x85\u2028"]),
    st.text(max_size=30),
)


def numbers(low, high, **more):
    return st.floats(low, high, allow_subnormal=False, **more)


def maybe(strategy):
    return st.none() | strategy


def of_shape(shape):
    """Values that a key of this shape may have."""
    if isinstance(shape, Number):
        assert not shape.whole
        return numbers(shape.low, shape.high, exclude_min=shape.above)
    return st.booleans() if isinstance(shape, Flag) else st.sampled_from(shape.one_of) if getattr(shape, "one_of", ()) else TEXTS


def drawn(kind, **own):
    """Records of a kind, each key as it is declared; own: strategies of some."""
    entries = [each for each in record_of(kind, null=False).entries if each.attribute not in own]
    strategies = {each.attribute: maybe(of_shape(each.shape)) if each.absent is None else of_shape(each.shape) for each in entries}
    return st.builds(kind, **own, **strategies)


SENSORS = drawn(
    Sensor,
    model=st.sampled_from([DEFAULT, "MPU-9250", "unknown"]) | TEXTS,
    gyro_fs_dps=st.sampled_from([125.0, 250.0, 500.0, 2000.0]) | numbers(1, 1e5),
    accel_fs_g=st.sampled_from([2.0, 4.0, 16.0]) | numbers(0.1, 1000),
)


def _accelerometer(cells, bias, sigma_mg, own_stills):
    return Accelerometer(np.eye(3) + np.reshape(cells, (3, 3)), np.array(bias), "given", sigma_mg, own_stills)


GIVEN = st.builds(
    _accelerometer,
    st.lists(numbers(-0.1, 0.1), min_size=9, max_size=9),
    st.lists(numbers(-5, 5), min_size=3, max_size=3),
    maybe(numbers(1e-3, 1000)),
    maybe(st.booleans()),
)
ACCELEROMETERS = st.builds(lambda: Accelerometer(source="none")) | GIVEN
SITES, PROTOCOLS, BOARDS = drawn(Site), drawn(Protocol, reference=st.sampled_from(REFERENCES)), drawn(BoardGiven)
BOUNDS = st.tuples(maybe(numbers(-1e6, 0, exclude_max=True)), maybe(numbers(0, 1e6, exclude_min=True))).filter(any)
LIMITS = st.dictionaries(
    st.sampled_from([each for each in QUANTITIES if each not in SIZES]),
    BOUNDS.map(lambda both: tuple(end if value is None else value for value, end in zip(both, (-np.inf, np.inf), strict=True))),
    min_size=1,
    max_size=3,
)
REQUIREMENTS = st.builds(Requirements, LIMITS, st.just(Rule()) | st.builds(Rule, st.just(GUARDED), numbers(0, 100)), TEXTS)
NOTE = TEXTS | st.booleans() | st.integers(-(2**53), 2**53) | numbers(-1e9, 1e9) | st.datetimes() | st.dates()
NOTES = st.dictionaries(TEXTS, NOTE, max_size=4)
EXCLUDED = st.lists(st.builds(LeftOut, TEXTS, numbers(-1e9, 1e9)), max_size=3).map(tuple)
STILLS = st.lists(drawn(StillByHand, log=TEXTS), max_size=3).map(tuple)
CONFIGS = st.builds(
    Config,
    sensor=SENSORS,
    accelerometer=ACCELEROMETERS,
    site=SITES,
    protocol=PROTOCOLS,
    notes=NOTES,
    exclude=EXCLUDED,
    still=STILLS,
    board=BOARDS,
    requirements=maybe(REQUIREMENTS),
)


def difference(one, other):
    """Names of what differs, but for what no session.toml says."""
    found = [
        name for name in ("sensor", "site", "protocol", "exclude", "still", "board", "notes") if getattr(one, name) != getattr(other, name)
    ]
    limits = [None if each.requirements is None else replace(each.requirements, source="") for each in (one, other)]
    found += ["requirements"] * (limits[0] != limits[1]) + ["unknown"] * bool(other.unknown)
    for name in ("accelerometer",):
        mine, theirs = getattr(one, name), getattr(other, name)
        for field in fields(mine):
            values = getattr(mine, field.name), getattr(theirs, field.name)
            if not (values[0] is values[1] or np.array_equal(*values)):
                found.append(f"{name}.{field.name}: {values[0]} became {values[1]}")
    return found
