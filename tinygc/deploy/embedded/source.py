"""A program as two C files: ``tinygc_model.h`` and ``tinygc_model.c``."""

from __future__ import annotations

from textwrap import indent

import numpy as np

from session.base.texts import comment
from session.log.config import Accelerometer
from tinygc.deploy.embedded.program import FORCE_FUNCTION, TOLERANCE, Program, Registers, force_map, single, vectors
from tinygc.deploy.embedded.program import FUNCTION as REGISTERS_FUNCTION
from tinygc.effects.device import Stage

#: characters in a line of comment
LONGEST = 120
HEADER, SOURCE = "tinygc_model.h", "tinygc_model.c"
FLAGS = "-std=c11 -ffp-contract=off -Wall -Wextra -Wdouble-promotion -Werror"

_HEADER = """\
/* {title}
 *
{facts}
 *
 * From what the sensor reads to what it feels: m is the measured rate, r begins as m,
{formula}
 * and is the answer.  No sample is looked at twice, and none ahead.{averaged}
 *
 * units    rate in rad/s in and out; specific force in m/s^2, calibrated (level and still, z down: 0, 0, -g); temperature in degC
 * axes     the sensor's own
 * memory   {weights} bytes of weights, {state} of state; the self-test adds {tested}: leave it out on small chips
 * cost     single precision; code size and instructions on a Cortex-M4F: python benchmarks/firmware.py
 * build    {flags}
 *          (any C99 compiler will do; what keeps each bit is that products and sums are not contracted)
 */
#ifndef TINYGC_MODEL_H
#define TINYGC_MODEL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

/* CRC-32 of the weights: which model this is. */
#define TINYGC_MODEL_ID 0x{identity:08x}u
{defines}
typedef struct {{
    float rate[3];  /* rad/s, as measured: registers times sensitivity */
    float force[3]; /* m/s^2, specific force{force} */
    float temp_c;   /* degC{temp} */
}} tinygc_input;

typedef struct {{
{members}}} tinygc_state;

/* Forget all samples. */
void tinygc_start(tinygc_state *state);

/* One sample in, the calibrated rate omega in rad/s out. */
void tinygc_step(tinygc_state *state, const tinygc_input *in, float omega[3]);
{prototype}
/* Run the vectors: 0 where all agree, else the number, from 1, of the first that does not.  *worst becomes the greatest difference, in
 * rad/s: exactly 0 where the arithmetic is IEEE 754 single precision, uncontracted. */
int tinygc_self_test(float *worst);

#ifdef __cplusplus
}}
#endif
#endif
"""

_SOURCE = """\
/* {title}  See {header}. */
#include "{header}"

typedef char tinygc_state_is_{state}_bytes[sizeof(tinygc_state) == {state} ? 1 : -1];

{constants}

{functions}
{from_registers}
void tinygc_start(tinygc_state *state)
{{
{start}
}}

void tinygc_step(tinygc_state *state, const tinygc_input *in, float omega[3])
{{
    float r[3] = {{in->rate[0], in->rate[1], in->rate[2]}};
{body}
    for (int i = 0; i < 3; i++)
        omega[i] = r[i];
}}

{self_test}"""

_AVERAGED = """  The calibration took the temperature's
 * mean over a second; here it is taken as it comes."""

_DEFINES = """\
#define TINYGC_GYRO_FS_DPS {sensor.gyro_fs_dps:g}
#define TINYGC_ACCEL_FS_G {sensor.accel_fs_g:g}
#define TINYGC_ODR_HZ {odr} /* nominal */
"""

_FROM_REGISTERS = """
/* Registers gx gy gz ax ay az temp of the {model} at {sensor.gyro_fs_dps:g} dps and {sensor.accel_fs_g:g} g, in physical units; the
 * accelerometer's calibration is in it. */
void tinygc_from_registers(const int16_t registers[7], tinygc_input *in);
"""

_FORCE = """
/* Specific force as the accelerometer measures it, m/s^2, calibrated: for whoever fills tinygc_input without registers.  The two
 * arrays are not one. */
void tinygc_force(const float measured[3], float force[3]);
"""

_SELF_TEST = """\
static const int16_t TEST_REGISTERS[{count}][7] = {registers};

static const float TEST_RATES[{count}][3] = {rates};

int tinygc_self_test(float *worst)
{{
    tinygc_state state;
    tinygc_input in;
    float omega[3];
    int failed = 0;
    *worst = 0.0f;
    tinygc_start(&state);
    for (int n = 0; n < {count}; n++) {{
        tinygc_from_registers(TEST_REGISTERS[n], &in);
        tinygc_step(&state, &in, omega);
        for (int i = 0; i < 3; i++) {{
            const float expected = TEST_RATES[n][i];
            const float size = expected < 0.0f ? -expected : expected;
            float off = omega[i] - expected;
            off = off < 0.0f ? -off : off;
            if (!(off <= *worst)) /* also where it is not a number */
                *worst = off;
            if (!(off <= {tolerance} * (1.0f + size)) && !failed)
                failed = n + 1;
        }}
    }}
    return failed;
}}
"""


_AFFINE = """\
/* y = W x + b; b is the last column of w. */
static void affine(const float w[3][4], const float x[3], float y[3])
{
    for (int i = 0; i < 3; i++) {
        float s = w[i][3];
        s += w[i][0] * x[0];
        s += w[i][1] * x[1];
        s += w[i][2] * x[2];
        y[i] = s;
    }
}
"""


def source_files(
    program: Program, registers: Registers | None, title: str, facts: dict[str, str], accelerometer: Accelerometer | None = None
) -> dict[str, str]:
    """Return file name -> text.  registers: None where those of the sensor are unknown; title and facts go into comments;
    accelerometer: the calibration that ``tinygc_force`` applies, the registers' by default.

    Without registers ``tinygc_from_registers`` is private to the self-test.
    """
    known = registers or Registers()
    sensor = known.sensor
    constants, stages = program.constants, program.stages
    accelerometer = accelerometer or known.accelerometer
    members, start = ("".join(getattr(stage, name) for stage in stages) for name in ("state", "start"))
    code = "\n".join(stage.body for stage in stages)
    calibration = single({"ACCELEROMETER": force_map(accelerometer)}, "the accelerometer's calibration")
    tables = constants | known.constants | calibration
    inputs, rates = vectors(program, known)
    unread = "; this model does not read it"
    fill = {
        "title": commented(title),
        "header": HEADER,
        "flags": FLAGS,
        "facts": "\n".join(f" * {commented(name):8} {commented(value)}" for name, value in facts.items()),
        "formula": "\n".join(f" *     {commented(stage.formula)}" for stage in stages),
        "identity": program.identity,
        "weights": 4 * sum(array.size for array in constants.values()),
        "tested": inputs.nbytes + rates.nbytes,
        "state": sum(stage.state_bytes for stage in stages) or 1,
        "members": members or "    unsigned char unused;\n",
        "averaged": _AVERAGED if "in->temp_c" in code else "",
        "force": "" if "in->force" in code else unread,
        "temp": "" if "in->temp_c" in code else unread,
        "defines": "" if registers is None else _DEFINES.format(sensor=sensor, odr=literal(np.float32(sensor.nominal_hz))),
        "prototype": _FORCE + ("" if registers is None else _FROM_REGISTERS.format(sensor=sensor, model=commented(sensor.model))),
        "constants": "\n\n".join(constant(name, array) for name, array in tables.items()),
        "functions": "\n".join([_AFFINE, *(stage.functions for stage in stages if stage.functions)]),
        "from_registers": FORCE_FUNCTION + "\n" + ("static " if registers is None else "") + REGISTERS_FUNCTION,
        "start": indent(start or "state->unused = 0;", "    "),
        "body": indent("\n".join(["(void)state;"] * (not members) + [_block(stage) for stage in stages]), "    "),
        "self_test": _SELF_TEST.format(
            count=len(inputs), registers=initialiser(inputs), rates=initialiser(rates), tolerance=literal(np.float32(TOLERANCE))
        ),
    }
    return {HEADER: _HEADER.format(**fill), SOURCE: _SOURCE.format(**fill)}


def _block(stage: Stage) -> str:
    return f"{{ /* {commented(stage.formula)} */\n{indent(stage.body, '    ')}\n}}"


def constant(name: str, array: np.ndarray) -> str:
    """Return a table in C syntax."""
    sizes = "".join(f"[{size}]" for size in array.shape)
    return f"static const float {name}{sizes} = {initialiser(array)};"


def initialiser(array: np.ndarray) -> str:
    """Return a C initialiser with one row per line; long rows are broken."""
    if array.ndim == 1:
        words = [literal(value) for value in array]
        lines = [", ".join(words[at : at + 7]) for at in range(0, len(words), 7)]
        return "{" + ",\n     ".join(lines) + "}"
    return "{\n" + ",\n".join(indent(initialiser(row), "    ") for row in array) + "}"


def literal(value: np.generic) -> str:
    """Return a literal that reads back as the same number: the shortest decimals of a float32, or an integer."""
    if isinstance(value, np.integer):
        return str(value)
    text = repr(float(str(value)))
    return f"{text}f"


def commented(text: str) -> str:
    """Make text safe for a C comment."""
    return comment(text, ascii_only=True)[:LONGEST]
