"""The header of an array's C, facts left open."""

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
