"""Ways to damage a simulated session: ``FAMILIES`` of ``damaged_sessions.py``, and how a damaged recording becomes a session folder."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from session.base.units import DEG, MG, G
from session.log.written import toml_text
from tinygc.simulation.movement import move, table_to_body
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.sensor import registers_of
from tinygc.simulation.simulator import Simulation, simulate_session
from tinygc.simulation.write import config_of


@dataclass
class Recording:
    """A session as a family changes it.

    t_s (N,), gyro rad/s and accel m/s^2 (N, 3) as measured, temp_c (N,); turns: rows (start, stop) of each; E (3, 3), B (3,) rad/s: the
    truth.  session.toml is written from simulation; calibrated: whether it holds the accelerometer's calibration; physical: whether
    the columns are in dps and g, and not registers; comment of the log.
    """

    simulation: Simulation
    t_s: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp_c: np.ndarray
    turns: list[tuple[int, int]]
    E: np.ndarray
    B: np.ndarray
    calibrated: bool = True
    physical: bool = False
    comment: str = ""

    @property
    def since(self) -> np.ndarray:
        """(N, 1): 0 at the first row, 1 at the last."""
        return np.linspace(0, 1, len(self.t_s))[:, None]

    @property
    def turning(self) -> np.ndarray:
        """(N, 1): 1 in turns, 0 in rests."""
        inside = np.zeros((len(self.t_s), 1))
        for start, stop in self.turns:
            inside[start:stop] = 1
        return inside

    @property
    def rests(self) -> list[tuple[int, int]]:
        """Rows of each rest."""
        edges = [0, *(edge for turn in self.turns for edge in turn), len(self.t_s)]
        return list(zip(edges[::2], edges[1::2], strict=True))

    def body(self, vector_t: Sequence[float]) -> np.ndarray:
        """(N, 3): a vector fixed to the table, in the body."""
        angles = move(self.simulation.plan, self.t_s).angles
        return table_to_body(angles, np.asarray(vector_t, dtype=float))

    def mix(self, by: np.ndarray) -> None:
        """Rates times a matrix, as numbers that no register limits; the truth follows."""
        self.physical, self.gyro, self.E = True, self.gyro @ by.T, self.E @ np.linalg.inv(by)

    def drop(self, rows: np.ndarray, closed: bool = False) -> None:
        """Leave rows out; closed: the stamps of the others close the gap."""
        keep = np.delete(np.arange(len(self.t_s)), rows)
        self.t_s = self.t_s[: len(keep)] if closed else self.t_s[keep]
        self.gyro, self.accel, self.temp_c = self.gyro[keep], self.accel[keep], self.temp_c[keep]

    def options(self, **changes: object) -> None:
        """Change what session.toml says."""
        self.simulation = replace(self.simulation, options=replace(self.simulation.options, **changes))

    def pre_calibration(self, **changes: np.ndarray) -> None:
        """Change the accelerometer's calibration in session.toml."""
        self.simulation = replace(self.simulation, unit=replace(self.simulation.unit, **changes))

    def leave_uncalibrated(self) -> None:
        """Take that calibration away.  Gravity is then seen in the accelerometer's own triad: x along its x, y in its x-y plane."""
        self.calibrated = False
        self.see_gravity_from(np.eye(3))

    def see_gravity_from(self, given: np.ndarray) -> None:
        """Let the truth be that of a fit which mends a given matrix (3, 3) of the accelerometer by an upper triangular one."""
        mending = self.simulation.unit.accel_matrix @ np.linalg.inv(given)
        turn, _ = np.linalg.qr(mending)
        turn = turn * np.sign(np.diag(turn.T @ mending))
        self.E, self.B = turn.T @ self.E, turn.T @ self.B


# The families.  Each changes a recording in place.

Damage = Callable[[Recording, np.random.Generator], None]
FAMILIES: dict[str, Damage] = {"clean": lambda r, rng: None}


def family(name: str) -> Callable[[Damage], Damage]:
    """Enter a function into ``FAMILIES``."""

    def enter(function: Damage) -> Damage:
        FAMILIES[name] = function
        return function

    return enter


def draw(rng: np.random.Generator, size: float, shape: tuple[int, ...] = (3,)) -> np.ndarray:
    """Numbers of about a size, of either sign, none near zero."""
    return size * rng.uniform(0.7, 1.3, shape) * rng.choice((-1, 1), shape)


def noise_like(values: np.ndarray, row: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """White noise (N, …) with the scatter of the values in the first rest."""
    return np.std(values[row[0] : row[1]], axis=0) * rng.standard_normal(values.shape)


SWAP = np.eye(3)[[1, 0, 2]]
FAMILIES |= {
    "gyro axes swapped": lambda r, rng: r.mix(SWAP),
    "gyro axes turned round": lambda r, rng: r.mix(np.eye(3)[[1, 2, 0]]),
    "gyro axis mirrored": lambda r, rng: r.mix(np.diag([1.0, 1.0, -1.0])),
    "rates × 2": lambda r, rng: r.mix(2 * np.eye(3)),
    "rates × 1.95": lambda r, rng: r.mix(1.95 * np.eye(3)),
    "rates × 1.05": lambda r, rng: r.mix(1.05 * np.eye(3)),
    "one rate × 1.2": lambda r, rng: r.mix(np.diag([1.0, 1.2, 1.0])),
}


# Time.


@family("data rate stated wrong")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.options(odr_hz={104.0: 208.0, 208.0: 104.0}[r.simulation.options.odr_hz])


@family("counted stamps, rate off by 2 %")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.t_s, r.comment = r.t_s / (1 + draw(rng, 0.02, ())), "# stamps=counted\n"


@family("counted stamps that do not say so")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.t_s = np.arange(len(r.t_s)) / r.simulation.options.odr_hz  # of a unit whose true rate is up to some 2 % from it


@family("clock fast by 0.5 %")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.t_s = r.t_s * (1 + draw(rng, 0.005, ()))


@family("2 rows lost in each turn, stamps closed up")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.drop(np.concatenate([(start + stop) // 2 + np.arange(2) for start, stop in r.turns]), closed=True)


@family("gap of 0.3 s in four turns")
def _(r: Recording, rng: np.random.Generator) -> None:
    rows = round(0.3 * r.simulation.options.odr_hz)
    r.drop(np.concatenate([sum(r.turns[i]) // 2 + np.arange(rows) for i in (1, 5, 9, 12)]))


def jump(r: Recording, seconds: float) -> None:
    """Put the clock forward in the middle of each turn."""
    r.t_s = r.t_s + seconds * np.searchsorted([sum(turn) // 2 for turn in r.turns], np.arange(len(r.t_s)), side="right")


FAMILIES |= {
    "clock jumps 2 ms in each turn": lambda r, rng: jump(r, 2e-3),
    "clock jumps 0.25 ms in each turn": lambda r, rng: jump(r, 0.25e-3),
}


def late(values: np.ndarray, t_s: np.ndarray, delay_s: float) -> np.ndarray:
    """Readings (N, K) as they were ``delay_s`` before."""
    return np.stack([np.interp(t_s - delay_s, t_s, column) for column in values.T], axis=1)


def hear_late(r: Recording, delay_s: float) -> None:
    """Let the rates come late."""
    r.gyro = late(r.gyro, r.t_s, delay_s)


FAMILIES |= {
    "rates 2 ms late": lambda r, rng: hear_late(r, 0.002),
    "rates 20 ms late": lambda r, rng: hear_late(r, 0.02),
}


@family("one rate 5 ms late")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.gyro[:, 1:2] = late(r.gyro[:, 1:2], r.t_s, 0.005)


# The sensor.


def saturate(r: Recording, at_dps: float) -> None:
    """Bend the response softly."""
    r.gyro = at_dps * DEG * np.tanh(r.gyro / (at_dps * DEG))


def one_sided(r: Recording, half: np.ndarray) -> None:
    """Another scale factor for positive rates than for negative ones."""
    r.gyro = r.gyro * (1 + half * np.sign(r.gyro))


def in_turns(r: Recording, zero_rate: np.ndarray) -> None:
    """Another zero rate in turns than in rests."""
    r.gyro = r.gyro + zero_rate * r.turning


def dead_zone(r: Recording, width: float) -> None:
    """Rates below a width read zero, and the others so much less; only in turns, where the registers show it less."""
    zero = -np.linalg.solve(r.E, r.B)
    r.gyro = zero + np.sign(r.gyro - zero) * np.maximum(np.abs(r.gyro - zero) - width * r.turning, 0)


# The smaller ones are about what a recording of 16 turns still allows.
FAMILIES |= {
    "soft saturation at 1000 dps": lambda r, rng: saturate(r, 1000),
    "soft saturation at 3000 dps": lambda r, rng: saturate(r, 3000),
    "soft saturation at 8000 dps": lambda r, rng: saturate(r, 8000),
    "one-sided gain of 0.6 %": lambda r, rng: one_sided(r, draw(rng, 3e-3)),
    "one-sided gain of 0.02 %": lambda r, rng: one_sided(r, draw(rng, 1e-4)),
    "dead zone of 0.1 dps in turns": lambda r, rng: dead_zone(r, 0.1 * DEG),
    "dead zone of 0.01 dps in turns": lambda r, rng: dead_zone(r, 0.01 * DEG),
    "bias in turns only, 0.05 dps": lambda r, rng: in_turns(r, draw(rng, 0.05 * DEG)),
    "bias in turns only, 0.006 dps": lambda r, rng: in_turns(r, draw(rng, 0.006 * DEG)),
}


@family("rates clipped at 150 dps")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.gyro = np.clip(r.gyro, -150 * DEG, 150 * DEG)


@family("bias steps 0.1 dps in the middle")
def _(r: Recording, rng: np.random.Generator) -> None:
    change(r, draw(rng, 0.1 * DEG) * (r.since > 0.5))


@family("bias drifts 0.2 dps")
def _(r: Recording, rng: np.random.Generator) -> None:
    change(r, draw(rng, 0.2 * DEG) * r.since)


@family("bias follows 10 °C of warming")
def _(r: Recording, rng: np.random.Generator) -> None:
    warmer = 10 * -np.expm1(-3 * r.since)
    r.temp_c = r.temp_c + warmer[:, 0]
    change(r, draw(rng, 0.02 * DEG) * warmer)


def change(r: Recording, zero_rate: np.ndarray) -> None:
    """Add to the zero rate (N, 3) rad/s as measured; the truth is the mean."""
    r.gyro, r.B = r.gyro + zero_rate, r.B - r.E @ zero_rate.mean(axis=0)


@family("scale drifts 0.3 %")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.gyro = r.gyro * (1 + draw(rng, 0.003) * (r.since - 0.5))


@family("g-sensitivity 0.05 dps/g")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.gyro = r.gyro + r.accel / G @ draw(rng, 0.05 * DEG, (3, 3)).T


@family("noise × 2")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.gyro = r.gyro + np.sqrt(3) * noise_like(r.gyro, r.rests[0], rng)


# The accelerometer, which gives the references.


@family("accelerometer not calibrated")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.leave_uncalibrated()


@family("accelerometer's given scale wrong by 1 %")
def _(r: Recording, rng: np.random.Generator) -> None:
    given = r.simulation.unit.accel_matrix @ np.diag(1 + draw(rng, 0.01))
    r.see_gravity_from(given)  # the fit finds it wrong
    r.pre_calibration(accel_matrix=given)


@family("accelerometer's zero 10 mg from the given")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.pre_calibration(accel_bias=r.simulation.unit.accel_bias + draw(rng, 10 * MG))


@family("accelerometer's zero drifts 5 mg")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.accel = r.accel + draw(rng, 5 * MG) * (r.since - 0.5)


@family("accelerometer bent: 5 mg at 1 g")
def _(r: Recording, rng: np.random.Generator) -> None:
    r.accel = r.accel + draw(rng, 5 * MG) * (r.accel / G) ** 2


@family("accelerometer turns 0.1° against the gyro")
def _(r: Recording, rng: np.random.Generator) -> None:
    axis = rng.standard_normal(3)
    r.accel = r.accel + np.cross(0.1 * DEG * axis / np.linalg.norm(axis) * (r.since - 0.5), r.accel)


# The bench.


@family("knocks in the rests")
def _(r: Recording, rng: np.random.Generator) -> None:
    for start, stop in r.rests[::2]:
        at = rng.integers(start + 20, stop - 20)
        r.gyro[at : at + 3] += draw(rng, 15 * DEG, (3, 3))
        r.accel[at : at + 3] += draw(rng, 0.3 * G, (3, 3))


def tilt(r: Recording, angle: np.ndarray, axis_t: Sequence[float]) -> None:
    """Turn the whole table by small angles (N,) rad about a fixed axis, as both sensors see it."""
    axis, down = np.asarray(axis_t), np.array([0.0, 0.0, 1.0])
    force_t = np.cross(-down, axis) * -G  # what a unit angle adds to the force -g down, in the table's frame
    r.accel = r.accel + angle[:, None] * r.body(force_t)
    r.gyro = r.gyro + np.gradient(angle, r.t_s)[:, None] * r.body(axis)


@family("table creeps at 0.05 dps in rests, tilting")
def _(r: Recording, rng: np.random.Generator) -> None:
    back = np.zeros(len(r.t_s))  # each turn undoes what the rest before it crept
    for (start, stop), (_, end) in zip(r.rests, [*r.turns, (0, len(r.t_s))], strict=True):
        crept = 0.05 * DEG * (r.t_s[start:stop] - r.t_s[start])
        back[start:stop], back[stop:end] = crept, crept[-1] * (0.5 + 0.5 * np.cos(np.linspace(0, np.pi, end - stop)))
    tilt(r, back, (1.0, 0.0, 0.0))


# What a person enters.


FAMILIES |= {
    "latitude of the wrong sign": lambda r, rng: r.options(latitude_deg=-r.simulation.options.latitude_deg),
    "gravity wrong by 0.5 %": lambda r, rng: r.options(gravity_mps2=9.84),
}


# From a simulation to a recording, and from a recording to a folder.


@lru_cache(maxsize=4)
def simulated(seed: int) -> Simulation:
    """The session that the families damage: 16 turns; 104 Hz or 208 Hz."""
    return simulate_session(SimulationOptions(seed=seed, segments=16, closure_s=0.0, odr_hz=(104.0, 208.0)[seed % 2]))


def damaged(name: str, seed: int) -> Recording:
    """A family's recording."""
    simulation, rng = simulated(seed), np.random.default_rng([seed, zlib.crc32(name.encode())])
    units, log = simulation.options.register_units, simulation.log
    t_s, temp_c = log.t_us * 1e-6, units.temperature_c(log.temp)
    assert temp_c is not None  # the simulated sensor has a thermometer
    turns = [(int(start), int(stop)) for start, stop in np.searchsorted(t_s, simulation.plan.turns)]
    # A fraction of a step in place of what rounding took, or damages below a step would be rounded away.
    fraction = np.random.default_rng([seed, 1])
    gyro, accel = (
        (values + fraction.uniform(-0.5, 0.5, values.shape)) * step
        for values, step in ((log.gyro, units.gyro_rps), (log.accel, units.accel_mps2))
    )
    r = Recording(simulation, t_s, gyro, accel, temp_c, turns, simulation.unit.E, simulation.unit.B)
    FAMILIES[name](r, rng)
    return r


def write(r: Recording, folder: Path) -> None:
    """The session folder of a damaged recording."""
    options, units = r.simulation.options, r.simulation.options.register_units
    if not r.physical:
        header = "t_us,gx,gy,gz,ax,ay,az,temp"
        gyro = registers_of(r.gyro, options.gyro_fs_dps * DEG, units.gyro_rps)
        accel = registers_of(r.accel, options.accel_fs_g * G, units.accel_mps2)
        temp = np.rint(units.temperature_lsb(r.temp_c, len(r.t_s)))
        table, row = np.column_stack([np.rint(r.t_s * 1e6), gyro, accel, temp]), ",".join(["%d"] * 8)
    else:
        header, row = "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g,temp_c", "%d" + ",%.6f" * 7
        table = np.column_stack([np.rint(r.t_s * 1e6), r.gyro / DEG, r.accel / G, r.temp_c])
    rows = [row % tuple(values) for values in table.tolist()]
    (folder / "log0001.csv").write_text("\n".join([r.comment + header, *rows, ""]))
    (folder / "session.toml").write_text(toml_text(config_of(r.simulation.options, r.simulation.unit, r.calibrated)))
