"""The detector as C99 for a controller: ``calibration_watch.h`` and ``.c``, beside what ``export --to c`` writes.

The operations and their order are those of ``detector``: single precision, products and sums not contracted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from session import VERSION
from session.io.texts import significant
from session.io.units import DEG
from tinygc.annexes.watch.detector import (
    ATTITUDE,
    COEFFICIENT,
    G_ROW,
    GRAVITY_ATTITUDE,
    GRAVITY_COEFFICIENT,
    GRAVITY_STATES,
    PROCESSES,
    ROW,
    STATES,
)
from tinygc.annexes.watch.expectation import MOST_TEMPERATURE_C, ModelInUse, expect
from tinygc.annexes.watch.settings import (
    BLOCKS,
    CLIP,
    MOST_FORCE_MPS2,
    MOST_GAP,
    MOST_RATE_RPS,
    MOST_SCATTER,
    NOISE_WINDOWS,
    ROOT_STEPS,
    SHIFTS,
    TEMPERATURE_BITS,
    Settings,
    settings,
)
from tinygc.deploy.embedded.source import FLAGS, commented, constant, literal
from tinygc.deploy.exports._context import Context
from tinygc.models.model import Model

HEADER, SOURCE = "calibration_watch.h", "calibration_watch.c"
#: bytes of ``tinygc_watch`` where an int64_t is aligned to 8
STATE_BYTES = 496

_HEADER = """\
/* {title}
 *
{facts}
 *
 * Whether the calibration still holds: at each rest the zero of the calibrated rate and the length of gravity are held against what the
 * calibration, a switch-on and the sensor's wander allow.  A false alarm comes once in {every} of rest, on average; two windows of
 * {window} s are the least that an alarm takes.
 *
 * units    rate in rad/s, calibrated; specific force in m/s^2, calibrated; temperature in degC, any number beyond 200 where none is known
 * rate     {rate} samples a second: samples may not be left out without tinygc_watch_gap
 * memory   {state} bytes of state, no heap; no library but the compiler's own (memset, int64_t to float)
 * order    float32, sums from the first to the last; tinygc.annexes.watch.detector has the same bits
 * build    {flags}
 */
#ifndef CALIBRATION_WATCH_H
#define CALIBRATION_WATCH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

/* What tinygc_watch_step returns: 0, or a window was judged, and perhaps an alarm: of zero x, y, z and of gravity, which rose or fell. */
#define TINYGC_WATCH_JUDGED 1u
#define TINYGC_WATCH_ROSE(channel) (2u << (channel))
#define TINYGC_WATCH_FELL(channel) (32u << (channel))
#define TINYGC_WATCH_ALARM 0x1feu

typedef struct {{
    int64_t squares[2], window_squares[2];
    int32_t sums[7], window_sums[7];
    float P[{states}], x[{n}][3], gravity_P[{gravity_states}], gravity_x[{m}];
    float own, noise[2], cusum[4][2][{tests}];
    uint16_t samples, ticks;
    uint8_t spoilt, blocks, state, waiting;
}} tinygc_watch;

/* The sensor was switched on. */
void tinygc_watch_start(tinygc_watch *watch);

/* One sample in; what is to be known of it out. */
uint32_t tinygc_watch_step(tinygc_watch *watch, const float rate[3], const float force[3], float temp_c);

/* So many samples were lost. */
void tinygc_watch_gap(tinygc_watch *watch, uint32_t samples);

/* Zero of the present rest, rad/s, for a person to read. */
void tinygc_watch_zero(const tinygc_watch *watch, float zero[3]);

#ifdef __cplusplus
}}
#endif
#endif
"""

_SOURCE = """\
/* {title}  See {header}. */
#include "{header}"

#if defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#endif

typedef char tinygc_watch_is_small[sizeof(tinygc_watch) <= 512 ? 1 : -1];

{constants}

enum {{ MOVING, SETTLING, RESTING }};

static int at(int i, int j)
{{
    return i < j ? j * (j + 1) / 2 + i : i * (i + 1) / 2 + j;
}}

static float root(float value)
{{
    float found = 0.5f * (1.0f + value);
    for (int k = 0; k < {root_steps}; k++)
        found = 0.5f * (found + value / found);
    return found;
}}

/* P h, and h P h + noise. */
static float project(const float *P, const float *h, int n, float noise, float *Ph)
{{
    float S = 0.0f;
    for (int i = 0; i < n; i++) {{
        float sum = P[at(i, 0)] * h[0];
        for (int j = 1; j < n; j++)
            sum = sum + P[at(i, j)] * h[j];
        Ph[i] = sum;
        S = i ? S + h[i] * sum : h[i] * sum;
    }}
    return S + noise;
}}

/* Joseph's form: M = P - K (P h)', P = M - (M h) K' + noise K K'. */
static void update(float *P, const float *h, int n, float noise, const float *Ph, const float *K)
{{
    float Mh[{m}];
    for (int i = 0; i < n; i++) {{
        float sum = (P[at(i, 0)] - K[i] * Ph[0]) * h[0];
        for (int j = 1; j < n; j++)
            sum = sum + (P[at(i, j)] - K[i] * Ph[j]) * h[j];
        Mh[i] = sum;
    }}
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            P[at(i, j)] = ((P[at(i, j)] - K[i] * Ph[j]) - Mh[i] * K[j]) + (noise * K[i]) * K[j];
}}

static uint32_t test(tinygc_watch *w, int channel, float z)
{{
    uint32_t found = 0;
    for (int side = 1; side >= 0; side--)
        for (int k = 0; k < {tests}; k++) {{
            float *sum = &w->cusum[channel][side][k];
            const float step = SHIFT[k] * z;
            *sum = (side ? *sum - step : *sum + step) - HALF[k];
            if (!(*sum > 0.0f))
                *sum = 0.0f;
            if (*sum >= BAR[k])
                found = side ? TINYGC_WATCH_FELL(channel) : TINYGC_WATCH_ROSE(channel);
        }}
    return found;
}}

static void decay(float *P, int n, const float *share)
{{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            P[at(i, j)] = (P[at(i, j)] * share[i]) * share[j];
}}

static void predict(tinygc_watch *w)
{{
    for (int i = 0; i < {n}; i++)
        for (int a = 0; a < 3; a++)
            w->x[i][a] = w->x[i][a] * DECAY[2 + i];
    for (int i = 0; i < {m}; i++)
        w->gravity_x[i] = w->gravity_x[i] * DECAY[i];
    decay(w->P, {n}, DECAY + 2);
    decay(w->gravity_P, {m}, DECAY);
    w->P[0] = w->P[0] + WALK[0];
    for (int i = 0; i < 3; i++)
        w->gravity_P[at(i, i)] = w->gravity_P[at(i, i)] + WALK[1];
    for (int k = 0; k < {processes}; k++) {{
        w->P[at(1 + k, 1 + k)] = w->P[at(1 + k, 1 + k)] + DRIVE[k];
        w->gravity_P[at(3 + k, 3 + k)] = w->gravity_P[at(3 + k, 3 + k)] + GRAVITY_DRIVE[k];
    }}
}}

static void new_rest(tinygc_watch *w)
{{
    for (int a = 0; a < 3; a++)
        w->x[{attitude}][a] = 0.0f;
    for (int j = 0; j < {n}; j++)
        w->P[at({attitude}, j)] = 0.0f;
    w->P[at({attitude}, {attitude})] = PRIOR[1];
    for (int i = {gravity_attitude}; i < {m}; i++) {{
        w->gravity_x[i] = 0.0f;
        for (int j = 0; j < {m}; j++)
            w->gravity_P[at(i, j)] = 0.0f;
    }}
    w->gravity_P[at({gravity_attitude}, {gravity_attitude})] = w->own;
    w->gravity_P[at({gravity_coefficient}, {gravity_coefficient})] = GRAVITY_PRIOR[2];
}}

static float clipped(float z)
{{
    return z > {clip} ? {clip} : z < -{clip} ? -{clip} : z;
}}

/* One window: test it, then let the filters follow it. */
static uint32_t judge(tinygc_watch *w)
{{
    float wide[2], h[{n}], hg[{m}], Ph[{n}], Phg[{m}], K[{n}], Kg[{m}], innovation[3], direction[3];
    float S, Sg, sigma, innovation_g, length, warmer, z;
    uint32_t found = 0, found_g;
    int far = 0;
    for (int k = 0; k < 2; k++) {{
        int64_t own = 0;
        for (int i = 3 * k; i < 3 * k + 3; i++)
            own += (int64_t)w->window_sums[i] * w->window_sums[i];
        wide[k] = (float)({blocks} * w->window_squares[k] - own) * SCATTER[k];
    }}
    if (wide[0] > {most_scatter} || wide[1] > {most_scatter})
        return 0;
    if (w->waiting) {{
        w->waiting = 0;
        new_rest(w);
    }}
    for (int k = 0; k < 2; k++) {{
        const float ratio = wide[k];
        w->noise[k] = w->noise[k] + (ratio - w->noise[k]) * {noise_share};
        wide[k] = w->noise[k] > 1.0f ? w->noise[k] : 1.0f;
        if (ratio > wide[k] + wide[k])
            wide[k] = ratio;
    }}
    for (int i = 0; i < 3; i++)
        direction[i] = (float)w->window_sums[3 + i] * FORCE_UNIT[0];
    length = (direction[0] * direction[0] + direction[1] * direction[1]) + direction[2] * direction[2];
    warmer = (float)w->window_sums[6] * TEMPERATURE_UNIT[0] - REFERENCE[0];
    for (int i = 0; i < {coefficient}; i++)
        h[i] = 1.0f;
    h[{coefficient}] = warmer;
    for (int i = 0; i < {gravity_coefficient}; i++)
        hg[i] = i < 3 ? direction[i] : 1.0f;
    hg[{gravity_coefficient}] = warmer;
    S = project(w->P, h, {n}, wide[0], Ph);
    Sg = project(w->gravity_P, hg, {m}, wide[1], Phg);
    for (int i = 0; i < {n}; i++)
        K[i] = Ph[i] / S;
    for (int i = 0; i < {m}; i++)
        Kg[i] = Phg[i] / Sg;
    sigma = root(S);
    for (int a = 0; a < 3; a++) {{
        float sum = h[0] * w->x[0][a];
        for (int i = 1; i < {n}; i++)
            sum = sum + h[i] * w->x[i][a];
        innovation[a] = ((float)w->window_sums[a] * RATE_UNIT[a] - direction[a] * EARTH[a]) - sum;
        z = clipped(innovation[a] / sigma);
        far |= z >= {clip} || z <= -{clip};
        found |= test(w, a, z);
    }}
    {{
        float sum = hg[0] * w->gravity_x[0];
        for (int i = 1; i < {m}; i++)
            sum = sum + hg[i] * w->gravity_x[i];
        innovation_g = (length - 1.0f) * GRAVITY_UNIT[0] - sum;
        z = clipped(innovation_g / root(Sg));
        found_g = test(w, 3, z);
    }}
    if (found) {{ /* the present reading is the new state */
        for (int a = 0; a < 3; a++) {{
            w->x[0][a] = w->x[0][a] + innovation[a];
            for (int k = 0; k < {pairs}; k++)
                w->cusum[a][k / {tests}][k % {tests}] = 0.0f;
        }}
        w->P[0] = w->P[0] + S;
    }} else if (!far) {{
        update(w->P, h, {n}, wide[0], Ph, K);
        for (int i = 0; i < {n}; i++)
            for (int a = 0; a < 3; a++)
                w->x[i][a] = w->x[i][a] + K[i] * innovation[a];
    }}
    if (found_g) {{
        const float change = innovation_g * innovation_g;
        w->gravity_P[at({gravity_attitude}, {gravity_attitude})] = w->gravity_P[at({gravity_attitude}, {gravity_attitude})] + Sg;
        w->gravity_x[{gravity_attitude}] = w->gravity_x[{gravity_attitude}] + innovation_g;
        if (change > w->own)
            w->own = change; /* in other attitudes it may differ by as much */
        for (int k = 0; k < {pairs}; k++)
            w->cusum[3][k / {tests}][k % {tests}] = 0.0f;
    }} else if (!(z >= {clip} || z <= -{clip})) {{
        update(w->gravity_P, hg, {m}, wide[1], Phg, Kg);
        for (int i = 0; i < {m}; i++)
            w->gravity_x[i] = w->gravity_x[i] + Kg[i] * innovation_g;
    }}
    return found | found_g | TINYGC_WATCH_JUDGED;
}}

static void forget_window(tinygc_watch *w)
{{
    w->blocks = 0;
    w->window_squares[0] = w->window_squares[1] = 0;
    for (int i = 0; i < 7; i++)
        w->window_sums[i] = 0;
}}

static void forget_block(tinygc_watch *w)
{{
    w->samples = 0;
    w->spoilt = 0;
    w->squares[0] = w->squares[1] = 0;
    for (int i = 0; i < 7; i++)
        w->sums[i] = 0;
}}

static uint32_t block(tinygc_watch *w)
{{
    int64_t own[2] = {{0, 0}};
    uint32_t found = 0;
    int quiet = !w->spoilt;
    for (int i = 0; i < 6; i++)
        own[i / 3] += (int64_t)w->sums[i] * w->sums[i];
    for (int i = 0; i < 3; i++)
        quiet = quiet && w->sums[i] < RATE_LIMIT && w->sums[i] > -RATE_LIMIT;
    quiet = quiet && SAMPLES * w->squares[0] - own[0] < GYRO_LIMIT && SAMPLES * w->squares[1] - own[1] < ACCEL_LIMIT;
    quiet = quiet && own[1] > GRAVITY_LOW && own[1] < GRAVITY_HIGH;
    w->ticks++;
    if (w->ticks == {blocks}) {{
        w->ticks = 0;
        predict(w);
    }}
    if (!quiet || w->state == MOVING) {{
        w->state = quiet ? SETTLING : MOVING;
        w->waiting = quiet ? 1 : w->waiting;
        forget_window(w);
    }} else {{
        if (w->blocks == {blocks}) {{ /* this block shows that the last of them was not the end of the rest */
            found = judge(w);
            forget_window(w);
        }}
        w->state = RESTING;
        for (int i = 0; i < 7; i++)
            w->window_sums[i] += w->sums[i];
        w->window_squares[0] += own[0];
        w->window_squares[1] += own[1];
        w->blocks++;
    }}
    forget_block(w);
    return found;
}}

/* value * scale as the nearest integer: 1.5 * 2^23 leaves no place for fractions. */
static int32_t whole(float value, float scale)
{{
    return (int32_t)(value * scale + 12582912.0f) - 12582912;
}}

void tinygc_watch_start(tinygc_watch *w)
{{
    forget_block(w);
    forget_window(w);
    w->state = MOVING;
    w->waiting = 0;
    w->ticks = 0;
    for (int i = 0; i < {states}; i++)
        w->P[i] = 0.0f;
    for (int i = 0; i < {n}; i++)
        for (int a = 0; a < 3; a++)
            w->x[i][a] = 0.0f;
    for (int i = 0; i < {gravity_states}; i++)
        w->gravity_P[i] = 0.0f;
    for (int i = 0; i < {m}; i++)
        w->gravity_x[i] = 0.0f;
    w->P[0] = PRIOR[0];
    w->P[at({attitude}, {attitude})] = PRIOR[1];
    w->P[at({coefficient}, {coefficient})] = PRIOR[2];
    for (int i = 0; i < 3; i++)
        w->gravity_P[at(i, i)] = GRAVITY_PRIOR[0];
    w->gravity_P[at({gravity_attitude}, {gravity_attitude})] = GRAVITY_PRIOR[1];
    w->gravity_P[at({gravity_coefficient}, {gravity_coefficient})] = GRAVITY_PRIOR[2];
    w->own = GRAVITY_PRIOR[1];
    w->noise[0] = w->noise[1] = 1.0f;
    for (int c = 0; c < 4; c++)
        for (int k = 0; k < {pairs}; k++)
            w->cusum[c][k / {tests}][k % {tests}] = 0.0f;
}}

uint32_t tinygc_watch_step(tinygc_watch *w, const float rate[3], const float force[3], float temp_c)
{{
    int32_t q[6];
    for (int i = 0; i < 3; i++) {{
        if (!(rate[i] < {most_rate} && rate[i] > -{most_rate} && force[i] < {most_force} && force[i] > -{most_force}))
            w->spoilt = 1; /* also what is not a number */
        else {{
            q[i] = whole(rate[i], {rate_scale});
            q[3 + i] = whole(force[i], {force_scale});
            w->sums[i] += q[i];
            w->sums[3 + i] += q[3 + i];
            w->squares[0] += (int64_t)q[i] * q[i];
            w->squares[1] += (int64_t)q[3 + i] * q[3 + i];
        }}
    }}
    if (!(temp_c < {most_temperature} && temp_c > -{most_temperature}))
        temp_c = REFERENCE[0];
    w->sums[6] += whole(temp_c, {temperature_scale});
    w->samples++;
    return w->samples == SAMPLES ? block(w) : 0;
}}

void tinygc_watch_gap(tinygc_watch *w, uint32_t samples)
{{
    uint32_t blocks = samples / SAMPLES;
    forget_block(w);
    forget_window(w);
    w->state = MOVING;
    blocks = blocks < {most_gap}u ? blocks : {most_gap}u;
    for (blocks += w->ticks; blocks >= {blocks}; blocks -= {blocks})
        predict(w);
    w->ticks = (uint16_t)blocks;
}}

void tinygc_watch_zero(const tinygc_watch *w, float zero[3])
{{
    for (int a = 0; a < 3; a++) {{
        float sum = w->x[0][a];
        for (int i = 1; i < {coefficient}; i++)
            sum = sum + w->x[i][a];
        zero[a] = sum * ZERO_UNIT[a];
    }}
}}
"""


def watch_files(chosen: Settings, title: str, facts: dict[str, str], every: str, rate_hz: float) -> dict[str, str]:
    """Return file name -> text; title and facts go into comments; every: the mean time of rest to a false alarm, in words."""
    one = np.ones(1, np.float32)
    decay = np.r_[one, one, one, chosen.decay, one, one]  # of gravity's states; from the third on, of an axis'
    tables = {
        "SHIFT": chosen.shift,
        "HALF": chosen.half,
        "BAR": chosen.bar,
        "DECAY": decay,
        "DRIVE": chosen.drive,
        "GRAVITY_DRIVE": chosen.accel_drive,
        "WALK": _row(chosen.walk, chosen.accel_walk),
        "PRIOR": _row(chosen.offset, chosen.attitude, chosen.per_k),
        "GRAVITY_PRIOR": _row(chosen.accel_offset, chosen.accel_attitude, chosen.accel_per_k),
        "SCATTER": _row(chosen.gyro_scatter, chosen.accel_scatter),
        "RATE_UNIT": chosen.rate_unit,
        "EARTH": chosen.earth,
        "ZERO_UNIT": chosen.rate_sigma_rps.astype(np.float32),
        "FORCE_UNIT": _row(chosen.force_unit),
        "GRAVITY_UNIT": _row(chosen.gravity_unit),
        "TEMPERATURE_UNIT": _row(chosen.temperature_unit),
        "REFERENCE": _row(chosen.reference),
    }
    integers = [f"#define SAMPLES {chosen.samples}", f"#define RATE_LIMIT {chosen.rate_limit}"]
    integers += [
        f"#define {name.upper()} INT64_C({getattr(chosen, name)})" for name in ("gyro_limit", "accel_limit", "gravity_low", "gravity_high")
    ]
    numbers: dict[str, Any] = {
        "clip": CLIP,
        "most_scatter": MOST_SCATTER,
        "noise_share": 1 / NOISE_WINDOWS,
        "most_rate": MOST_RATE_RPS,
        "most_force": MOST_FORCE_MPS2,
        "most_temperature": MOST_TEMPERATURE_C,
        "temperature_scale": 2.0**TEMPERATURE_BITS,
        "rate_scale": chosen.rate_scale,
        "force_scale": chosen.force_scale,
    }
    fill = {name: literal(np.float32(value)) for name, value in numbers.items()} | {
        "title": commented(title),
        "header": HEADER,
        "facts": "\n".join(f" * {commented(name):8} {commented(value)}" for name, value in facts.items()),
        "every": commented(every),
        "window": f"{chosen.window_samples / rate_hz:.3g}",
        "rate": f"{rate_hz:.5g}",
        "state": STATE_BYTES,
        "flags": FLAGS,
        "n": STATES,
        "m": GRAVITY_STATES,
        "states": len(ROW),
        "gravity_states": len(G_ROW),
        "processes": PROCESSES,
        "attitude": ATTITUDE,
        "coefficient": COEFFICIENT,
        "gravity_attitude": GRAVITY_ATTITUDE,
        "gravity_coefficient": GRAVITY_COEFFICIENT,
        "tests": len(SHIFTS),
        "pairs": 2 * len(SHIFTS),
        "blocks": BLOCKS,
        "root_steps": ROOT_STEPS,
        "most_gap": MOST_GAP,
        "constants": "\n".join([*integers, "", *(constant(name, array) for name, array in tables.items())]),
    }
    return {HEADER: _HEADER.format(**fill), SOURCE: _SOURCE.format(**fill)}


def _row(*values: np.float32) -> np.ndarray:
    return np.array(values, np.float32)


def export_watch(model: Model, context: Context, false_alarm_every_s: float) -> dict[str, str]:
    """The files for an exported model: of the fit's own figures, at its data rate.

    Raises CalibrationError for a data rate or a time that the detector cannot have.
    """
    known = ModelInUse.of_export(model, context)
    rate_hz = context.config.sensor.odr_hz
    expected = expect(known, rate_hz)
    chosen = settings(expected, false_alarm_every_s)
    if expected.assumed:
        context.say(f"watch: assumed as usual, not this unit's own: {', '.join(expected.assumed)}")
    facts = {
        "session": context.session,
        "zero": f"one sigma of a switch-on {', '.join(significant(each / DEG, 2) for each in expected.offset)} dps",
        "noise": f"one window {', '.join(significant(each / DEG, 2) for each in chosen.rate_sigma_rps)} dps",
    }
    every = f"{false_alarm_every_s / 86400:.3g} days"
    return watch_files(chosen, f"A gyroscope's calibration under watch, by TinyGC {VERSION}.", facts, every, rate_hz)
