"""An array's model as C99: fusion and vote of ``one_vote.py``, sample by sample, in single precision."""

from __future__ import annotations

import zlib

import numpy as np

from session.common.errors import FormatError
from session.common.version import VERSION
from tinygc.array.fused.medians import ALONE
from tinygc.array.fused.model import ArrayModel
from tinygc.deploy.array.c_header import HEADER_TEXT
from tinygc.deploy.array.c_text import REGISTERS_PROTOTYPE, REGISTERS_TEXT, SOURCE_TEXT
from tinygc.deploy.array.live import LiveArray
from tinygc.deploy.array.voting import ASIDE, BACK, FAST, FEWEST, SLOW, SOON_STUCK, Tables
from tinygc.deploy.embedded.source import FLAGS, commented, constant, initialiser, literal
from tinygc.deploy.errors import ExportError

HEADER, SOURCE = "tinygc_array.h", "tinygc_array.c"
#: samples of the self-test, from which on one unit lies, and by how much, rad/s
TEST_COUNT, TEST_LIES_FROM, TEST_LIE = 64, 24, 2.0
#: of the answer, plus 1 rad/s: two orders of operations in single precision differ by less
TEST_TOLERANCE = 2e-5
_SEED = 16


def array_source(model: ArrayModel) -> dict[str, str]:
    """File name -> text.  ExportError for numbers that single precision does not hold."""
    tables, constants = Tables.of(model), c_constants(model)
    worst = max(float(np.abs(table[np.isfinite(table)]).max(initial=0.0)) for table in constants.values())
    if worst > 1e30:
        raise ExportError(f"the model has a number of {worst:.3g}, which single precision cannot reckon with; json carries it")
    registers = _per_lsb(model)
    if registers is not None:
        constants["PER_LSB"] = registers.astype(np.float32)
    inputs, rates, why = self_test_vectors(model)
    constants |= {"TEST_INPUTS": inputs, "TEST_RATES": rates}
    scalars = {
        "SCALE2": tables.scale2,
        "DELAY2": tables.delay2,
        "ALPHA": tables.alpha,
        "MEAN_SHARE": tables.share_of_noise,
        "ASIDE2": ASIDE**2,
        "SLOW2": SLOW**2,
        "FAST": FAST,
        "BACK": BACK,
        "ALONE": ALONE,
    }
    whole = {
        "DEAD_AFTER": tables.dead,
        "STUCK_AFTER": tables.stuck,
        "HOLD_FOR": tables.hold,
        "FEWEST": FEWEST,
        "SOON_STUCK": SOON_STUCK,
        "TEST_COUNT": TEST_COUNT,
    }
    fill = {
        "count": len(model),
        "header": HEADER,
        "flags": FLAGS,
        "version": VERSION,
        "session": commented(model.session) or "-",
        "reason": commented(model.reason) or model.best_for,
        "numbers": ", ".join(map(str, model.numbers)),
        "rate_hz": f"{model.rate_hz:g}",
        "density": ", ".join(f"{value:.3g}" for value in model.noise_density),
        "identity": zlib.crc32(b"".join(table.tobytes() for table in constants.values())),
        "tables": "\n\n".join(constant(name, table) for name, table in constants.items()),
        "scalars": "\n".join(f"#define {name} {literal(np.float32(value))}" for name, value in scalars.items())
        + "\n"
        + "\n".join(f"#define {name} {value}" for name, value in whole.items()),
        "test_why": initialiser(why.astype(np.int16)),
        "tolerance": literal(np.float32(TEST_TOLERANCE)),
        "registers_prototype": "" if registers is None else REGISTERS_PROTOTYPE,
        "registers": "" if registers is None else REGISTERS_TEXT,
    }
    return {HEADER: HEADER_TEXT.format(**fill), SOURCE: SOURCE_TEXT.format(**fill)}


def c_constants(model: ArrayModel) -> dict[str, np.ndarray]:
    """Tables in single precision, by their names in C; a unit without a known end has the greatest number as its end."""
    tables = Tables.of(model)
    end = np.where(np.isfinite(tables.end), tables.end, 1e30)
    return {
        name: np.asarray(table, dtype=np.float32)
        for name, table in {
            "MATRIX": tables.matrix,
            "OFFSET": tables.offset,
            "WEIGHT": tables.weights,
            "SHARE": tables.share,
            "NOISE": tables.noise,
            "FIXED": tables.fixed,
            "SPREAD": tables.spread,
            "OWN": tables.own,
            "END_OF_RANGE": end,
        }.items()
    }


def _per_lsb(model: ArrayModel) -> np.ndarray | None:
    """(N,) rad/s of one LSB; None where a unit's registers are not known."""
    try:
        known = [None if unit.sensor is None else unit.sensor.register_units.gyro_rps for unit in model.units]
    except FormatError:
        return None
    return None if any(value is None for value in known) else np.array(known, dtype=float)


def self_test_vectors(model: ArrayModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``(inputs (K, N, 3), rates (K, 3) float32 rad/s, why (N,) at the end)``: a turn in which the last unit begins to lie."""
    rng = np.random.default_rng(_SEED)
    at = np.arange(TEST_COUNT) / TEST_COUNT
    omega = np.sin(2 * np.pi * np.outer(at, [1.0, 2.0, 0.5])) * [0.3, 0.2, 0.4]
    clean = np.einsum("nij,tnj->tni", np.linalg.inv(model.matrices), omega[:, None] - model.offsets)
    sigma = np.stack([unit.noise_density for unit in model.units]) * np.sqrt(model.rate_hz / 2)
    inputs = clean + sigma * rng.normal(size=clean.shape)
    inputs[TEST_LIES_FROM:, -1] += TEST_LIE
    single = inputs.astype(np.float32)
    live = LiveArray(model)
    rates = live(single.astype(float)).rate.astype(np.float32)
    why = np.array([live.standing[number] for number in model.numbers], dtype=int)
    return single, rates, why
