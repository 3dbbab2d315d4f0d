"""An array's model as C99: fusion and fault detection in single precision."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from session import VERSION
from session.io.errors import FormatError
from session.io.results import json_text
from tinygc.annexes.arrays.model import ALONE, ArrayModel, load_array_model, to_table
from tinygc.annexes.arrays.voting import ASIDE, BACK, FAST, FEWEST, SLOW, SOON_STUCK, LiveArray, Tables
from tinygc.deploy import ExportError
from tinygc.deploy.embedded.source import FLAGS, commented, constant, initialiser, literal

# Template of the header file of an array's C code.

HEADER_TEXT = """\
/* {count} gyroscopes on one body as one, by TinyGC {version}.
 *
 * session  {session}
 * units    {numbers}, in this order
 * weights  {reason}
 * noise    {density} rad/s/sqrt(Hz), one-sided, while all are in
 * made for {rate_hz} samples a second
 *
 * Rate in rad/s in and out: in on each unit's own axes, as measured; out in the array's frame.  A unit that gives nothing, gives one and
 * the same reading, or differs from the others' weighted median by more than noise and their disagreement allow, is out until it agrees
 * again; a single sample that is far off is set aside.  A reading at the end of the range counts neither for nor against its unit.
 *
 * build    {flags}
 */
#ifndef TINYGC_ARRAY_H
#define TINYGC_ARRAY_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

#define TINYGC_ARRAY_ID 0x{identity:08x}u
#define TINYGC_ARRAY_UNITS {count}

/* Why a unit is out; 0: it is in. */
#define TINYGC_ARRAY_DIFFERS 1
#define TINYGC_ARRAY_DEAD 2
#define TINYGC_ARRAY_STUCK 3

typedef struct {{
    float rate[TINYGC_ARRAY_UNITS][3];     /* rad/s, as measured; NaN: no sample */
    uint8_t present[TINYGC_ARRAY_UNITS];   /* 0: this unit has no sample now */
}} tinygc_array_input;

typedef struct {{
    float rate[3];                         /* rad/s, in the array's frame */
    float variance[3];                     /* (rad/s)^2; 3e38 at the end of every unit's range */
    uint8_t valid;                         /* 0: no unit gave a sample, rate and variance are 0 */
    uint8_t at_end;                        /* 1: every unit reads its end, the rate was at least as great */
    uint8_t disagree;                      /* 1: the only two units left differ, and nobody knows which is right */
    uint8_t changed;                       /* 1: somebody's standing changed with this sample, from the next one on */
    uint8_t used[TINYGC_ARRAY_UNITS];      /* 1: in this rate */
    uint8_t why[TINYGC_ARRAY_UNITS];       /* why each unit is out */
    float score[TINYGC_ARRAY_UNITS];       /* how far each is, 1 at the bar */
}} tinygc_array_output;

typedef struct {{
    float last[TINYGC_ARRAY_UNITS][3], mean[TINYGC_ARRAY_UNITS][3];
    float allowed[TINYGC_ARRAY_UNITS], square[TINYGC_ARRAY_UNITS];
    float middle[3], step2;
    uint16_t missing[TINYGC_ARRAY_UNITS], same[TINYGC_ARRAY_UNITS], agreed[TINYGC_ARRAY_UNITS];
    uint8_t before[TINYGC_ARRAY_UNITS], why[TINYGC_ARRAY_UNITS];
    uint8_t begun, disagree;
}} tinygc_array_state;

/* All units believed, nothing seen. */
void tinygc_array_start(tinygc_array_state *state);

/* One sample of all units in, one rate out. */
void tinygc_array_step(tinygc_array_state *state, const tinygc_array_input *in, tinygc_array_output *out);
{registers_prototype}
/* 0 where all vectors agree, else the number, from 1, of the first that does not; *worst: the greatest difference, rad/s. */
int tinygc_array_self_test(float *worst);

#ifdef __cplusplus
}}
#endif
#endif
"""


# Template of the source file of an array's C code.

REGISTERS_PROTOTYPE = """
/* Registers gx gy gz of each unit as rates; all are present. */
void tinygc_array_from_registers(const int16_t registers[TINYGC_ARRAY_UNITS][3], tinygc_array_input *in);
"""

REGISTERS_TEXT = """
void tinygc_array_from_registers(const int16_t registers[TINYGC_ARRAY_UNITS][3], tinygc_array_input *in)
{
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < 3; k++)
            in->rate[i][k] = (float)registers[i][k] * PER_LSB[i];
        in->present[i] = 1;
    }
}
"""

SOURCE_TEXT = """\
/* See {header}. */
#include "{header}"

#define N TINYGC_ARRAY_UNITS
{scalars}

{tables}

static const int16_t TEST_WHY[N] = {test_why};

static float square(float x)
{{
    return x * x;
}}

/* The weighted median of values[i] with weights[i], count of them, which it sorts. */
static float median(float values[N], float weights[N], int count)
{{
    float total = 0.0f, sum = 0.0f, end = 0.0f;
    for (int i = 1; i < count; i++)
        for (int j = i; j > 0 && values[j - 1] > values[j]; j--) {{
            const float v = values[j], w = weights[j];
            values[j] = values[j - 1];
            weights[j] = weights[j - 1];
            values[j - 1] = v;
            weights[j - 1] = w;
        }}
    for (int i = 0; i < count; i++)
        total += weights[i];
    for (int i = 0; i < count; i++) {{
        const float middle = sum + 0.5f * weights[i] - 0.5f * total, begin = middle - ALONE * weights[i];
        if (begin > 0.0f && i > 0)
            return end < 0.0f ? values[i - 1] - end / (begin - end) * (values[i] - values[i - 1]) : values[i - 1];
        end = middle + ALONE * weights[i];
        sum += weights[i];
    }}
    return values[count - 1];
}}

/* inverse of m; 0 where it has none */
static int invert(float m[3][3], float inverse[3][3])
{{
    float determinant = 0.0f;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {{
            const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }}
    for (int j = 0; j < 3; j++)
        determinant += m[0][j] * inverse[j][0];
    if (!(determinant > 1e-30f))
        return 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            inverse[i][j] /= determinant;
    return 1;
}}

static void fuse(float x[N][3], tinygc_array_output *out)
{{
    float weights[3][3] = {{{{0.0f}}}}, spread[3][3] = {{{{0.0f}}}}, inverse[3][3], sum[3] = {{0.0f}};
    for (int i = 0; i < N; i++) {{
        if (!out->used[i])
            continue;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {{
                weights[r][c] += WEIGHT[i][r][c];
                spread[r][c] += SPREAD[i][r][c];
                sum[r] += WEIGHT[i][r][c] * x[i][c];
            }}
    }}
    out->valid = (uint8_t)invert(weights, inverse);
    for (int r = 0; r < 3; r++) {{
        out->rate[r] = out->variance[r] = 0.0f;
        if (!out->valid)
            continue;
        out->variance[r] = OWN[r];
        for (int c = 0; c < 3; c++) {{
            out->rate[r] += inverse[r][c] * sum[c];
            for (int k = 0; k < 3; k++)
                out->variance[r] += inverse[r][c] * spread[c][k] * inverse[r][k];
        }}
    }}
}}

void tinygc_array_start(tinygc_array_state *state)
{{
    for (int i = 0; i < N; i++) {{
        for (int k = 0; k < 3; k++)
            state->last[i][k] = state->mean[i][k] = 0.0f;
        state->allowed[i] = state->square[i] = 0.0f;
        state->missing[i] = state->same[i] = state->agreed[i] = 0;
        state->before[i] = state->why[i] = 0;
    }}
    for (int k = 0; k < 3; k++)
        state->middle[k] = 0.0f;
    state->step2 = 0.0f;
    state->begun = state->disagree = 0;
}}

static uint16_t longer(uint16_t count)
{{
    return (uint16_t)(count < 65535u ? count + 1u : count);
}}

void tinygc_array_step(tinygc_array_state *state, const tinygc_array_input *in, tinygc_array_output *out)
{{
    float x[N][3], apart[N][3], u[N], values[3][N], shares[3][N], middle[3], step2 = 0.0f, change2, allowed, size2 = 0.0f;
    uint8_t here[N], usable[N], known[N], believed[N];
    int candidates = 0, counted = 0, any = 0, there = 0, worst = -1, disagree = 0, agree = 1;

    for (int i = 0; i < N; i++) {{
        float rate[3];
        int same, end = 0;
        here[i] = in->present[i] != 0;
        for (int k = 0; k < 3; k++)
            here[i] = here[i] && in->rate[i][k] == in->rate[i][k]; /* not a number: no sample */
        for (int k = 0; k < 3; k++)
            rate[k] = here[i] ? in->rate[i][k] : 0.0f;
        same = here[i] && state->before[i];
        believed[i] = state->why[i] == 0;
        for (int k = 0; k < 3; k++) {{
            const float m = rate[k];
            same = same && m == state->last[i][k];
            end = end || m >= END_OF_RANGE[i] || m <= -END_OF_RANGE[i];
            x[i][k] = OFFSET[i][k];
            for (int c = 0; c < 3; c++)
                x[i][k] += MATRIX[i][k][c] * rate[c];
            state->last[i][k] = m;
        }}
        state->before[i] = here[i];
        state->same[i] = same && !end ? longer(state->same[i]) : 0;
        state->missing[i] = here[i] ? 0 : longer(state->missing[i]);
        usable[i] = here[i] && !end;
        if (usable[i] && believed[i]) {{
            for (int k = 0; k < 3; k++) {{
                values[k][candidates] = x[i][k];
                shares[k][candidates] = SHARE[i];
            }}
            candidates++;
        }}
    }}
    for (int k = 0; k < 3; k++) {{
        middle[k] = candidates ? median(values[k], shares[k], candidates) : state->middle[k];
        if (state->begun)
            step2 += square(middle[k] - state->middle[k]);
        size2 += square(middle[k]);
        state->middle[k] = middle[k];
    }}
    state->begun = state->begun || candidates;
    change2 = step2 > state->step2 ? step2 : state->step2;
    state->step2 = step2;
    allowed = SCALE2 * size2 + DELAY2 * change2;

    for (int i = 0; i < N; i++) {{
        known[i] = usable[i] && state->begun;
        u[i] = 0.0f;
        for (int k = 0; k < 3; k++) {{
            apart[i][k] = x[i][k] - middle[k];
            const float one = square(apart[i][k]) / (NOISE[i][k] + FIXED[i][k] + allowed);
            u[i] = one > u[i] ? one : u[i];
        }}
        counted += known[i] && believed[i];
    }}
    for (int i = 0; i < N; i++) {{
        out->used[i] = usable[i] && believed[i] && !(known[i] && u[i] > ASIDE2 && counted >= FEWEST);
        any += out->used[i];
    }}
    for (int i = 0; !any && i < N; i++)
        out->used[i] = usable[i] && believed[i];
    for (int i = 0; i < N; i++) {{
        there += here[i] && believed[i];
        any += out->used[i];
    }}
    out->at_end = !any && there;
    for (int i = 0; out->at_end && i < N; i++)
        out->used[i] = here[i] && believed[i];
    fuse(x, out);
    for (int k = 0; k < 3; k++) {{
        float most = 0.0f;
        for (int i = 0; state->disagree && i < N; i++)
            if (known[i] && believed[i] && square(apart[i][k]) > most)
                most = square(apart[i][k]);
        out->variance[k] = out->at_end ? 3e38f : out->variance[k] + most;
    }}

    out->changed = 0;
    for (int i = 0; i < N; i++) {{
        float slow = 0.0f;
        const int dead = state->missing[i] >= DEAD_AFTER, stuck = state->same[i] >= STUCK_AFTER;
        if (known[i]) {{
            const float shrink = u[i] > ASIDE2 ? ASIDE2 / u[i] : 1.0f;
            for (int k = 0; k < 3; k++)
                state->mean[i][k] += ALPHA * (apart[i][k] * shrink - state->mean[i][k]);
            state->allowed[i] += ALPHA * (allowed - state->allowed[i]);
            state->square[i] += ALPHA * ((u[i] > ASIDE2 ? ASIDE2 : u[i]) - state->square[i]);
        }}
        for (int k = 0; k < 3; k++) {{
            const float one = square(state->mean[i][k]) / (NOISE[i][k] * MEAN_SHARE + FIXED[i][k] + state->allowed[i]);
            slow = one > slow ? one : slow;
        }}
        slow /= SLOW2;
        out->score[i] = state->square[i] / FAST > slow ? state->square[i] / FAST : slow;
        if (known[i] || state->missing[i] >= DEAD_AFTER)
            state->agreed[i] = out->score[i] < BACK && !dead && !stuck && known[i] ? longer(state->agreed[i]) : 0;
        if (believed[i] && (dead || stuck)) {{
            state->why[i] = dead ? TINYGC_ARRAY_DEAD : TINYGC_ARRAY_STUCK;
            state->agreed[i] = 0;
            out->changed = 1;
        }} else if (!believed[i] && state->agreed[i] >= HOLD_FOR) {{
            state->why[i] = 0;
            state->agreed[i] = 0;
            out->changed = 1;
        }} else if (believed[i] && known[i] && out->score[i] > 1.0f) {{
            if (counted >= FEWEST && (worst < 0 || out->score[i] > out->score[worst]))
                worst = i;
        }}
        if (believed[i] && known[i] && out->score[i] > 1.0f)
            disagree = disagree || counted == FEWEST - 1;
        if (counted == FEWEST - 1 && believed[i] && !(out->score[i] < BACK))
            agree = 0;
    }}
    if (worst >= 0) {{
        state->why[worst] = state->same[worst] >= SOON_STUCK ? TINYGC_ARRAY_STUCK : TINYGC_ARRAY_DIFFERS;
        state->agreed[worst] = 0;
        out->changed = 1;
    }}
    if (state->disagree ? agree : disagree) {{
        state->disagree = !state->disagree;
        out->changed = 1;
    }}
    out->disagree = state->disagree;
    for (int i = 0; i < N; i++)
        out->why[i] = state->why[i];
}}
{registers}
int tinygc_array_self_test(float *worst)
{{
    tinygc_array_state state;
    tinygc_array_input in;
    tinygc_array_output out;
    int failed = 0;
    *worst = 0.0f;
    tinygc_array_start(&state);
    for (int n = 0; n < TEST_COUNT; n++) {{
        for (int i = 0; i < N; i++) {{
            for (int k = 0; k < 3; k++)
                in.rate[i][k] = TEST_INPUTS[n][i][k];
            in.present[i] = 1;
        }}
        tinygc_array_step(&state, &in, &out);
        for (int k = 0; k < 3; k++) {{
            const float expected = TEST_RATES[n][k];
            const float size = expected < 0.0f ? -expected : expected;
            float off = out.rate[k] - expected;
            off = off < 0.0f ? -off : off;
            if (!(off <= *worst))
                *worst = off;
            if (!(off <= {tolerance} * (1.0f + size)) && !failed)
                failed = n + 1;
        }}
    }}
    for (int i = 0; i < N; i++)
        if (out.why[i] != TEST_WHY[i] && !failed)
            failed = TEST_COUNT;
    return failed;
}}
"""


# An array's model as C99: fusion and fault detection as in ``voting.py``, sample by sample, in single precision.

HEADER, SOURCE = "tinygc_array.h", "tinygc_array.c"
#: samples of the self-test, sample at which one unit's fault begins, and its size in rad/s
TEST_COUNT, TEST_LIES_FROM, TEST_LIE = 64, 24, 2.0
#: relative tolerance of the self-test, for values plus 1 rad/s: two orders of operations in single precision differ by less
TEST_TOLERANCE = 2e-5
_SEED = 16
#: largest number of a table; the end of an unknown full scale
MOST = 1e30


def array_source(model: ArrayModel) -> dict[str, str]:
    """Return file name -> text.  Raises ExportError for numbers that exceed single precision."""
    tables, constants = Tables.of(model), c_constants(model)
    worst = max(float(np.abs(table[np.isfinite(table)]).max(initial=0.0)) for table in constants.values())
    if worst > float(np.float32(MOST)):
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
    """Return the tables in single precision, by their names in C; a unit with an unknown full scale gets ``MOST`` as its end."""
    tables = Tables.of(model)
    end = np.where(np.isfinite(tables.end), tables.end, MOST)
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
    """Return (N,) rad/s per LSB; None where a unit's registers are unknown."""
    try:
        known = [None if unit.sensor is None else unit.sensor.register_units.gyro_rps for unit in model.units]
    except FormatError:
        return None
    return None if any(value is None for value in known) else np.array(known, dtype=float)


def self_test_vectors(model: ArrayModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ``(inputs (K, N, 3), rates (K, 3) float32 rad/s, why (N,) at the end)`` of a turn in which the last unit becomes faulty."""
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


# Export of an array's model: C for a device, or its own JSON. Formats that hold the numbers of one sensor cannot hold an array.

FORMATS = ("json", "c")


def export_array(path: Path, to: str) -> dict[str, str]:
    """Return file name -> text of an array's model file.  Raises ExportError for a format that holds one sensor only."""
    model = load_array_model(path)
    if to not in FORMATS:
        raise ExportError(f"{to} holds one sensor's calibration, {path.name} is an array of {len(model)} units; json and c carry an array")
    return array_source(model) if to == "c" else {"array.json": json_text(to_table(model)) + "\n"}
