#include "lsm6dsx_fifo.h"

/* What a time slot must have, and what it may have, by 1 << TAG_SENSOR. */
enum { WHOLE = 1u << TAG_GYRO | 1u << TAG_ACCEL | 1u << TAG_STAMP, WARM = 1u << TAG_TEMPERATURE };

enum {
    QUICKEST = 10,
    NEAR = 256,          /* periods: a longer gap must have been one by the target's clock, too */
    CLOCKS_PERIODS = 64, /* the two may differ by CLOCKS_SHARE, by what is not known of the age of a full FIFO's words, */
    GAIN_MOST = 12,
    STEADY = 16,         /* slots behind a start must follow by a period each, before one is a sample */
};
static const uint32_t CLOCKS_US = 50000; /* and by this */
static const uint32_t BACK_US = 4000000; /* that age is 3 s too high at most, at the lowest rate: so much later words may seem older */

/* Ticks of a period at the highest rate.  It is not published: 40000 / 6667 = 5.9997, or six, as both rates hang on one
 * oscillator.  It is taken for six to 417 ppm. */
static const uint64_t SHORTEST_Q32 = (59975ULL << 32) / 10000, LONGEST_Q32 = (60025ULL << 32) / 10000;

/* Of a stamp, in ticks.  It names a whole tick, and may be two late or early: how soon after its sample it is taken is not known.  So it
 * is off the middle of its tick by 2.5, two are apart as their slots are to JITTERS, and the place that is held is off by as much, and by
 * the lag of set_period.  A stamp that deviates from the place by more than STRAY is none.  CLIP is what moves the place at most, by half:
 * a spoilt stamp moves it by three quarters of a tick.  From one that deviates by more than LEARN nothing is learned: it may be spoilt. */
static const uint64_t TICK = 1ULL << 32, JITTERS = (uint64_t)STAMPS_STRAY << 32, STRAY = 23ULL << 30;
static const int64_t CLIP = (int64_t)3 << 31, LEARN = (int64_t)3 << 32;

float fifo_rate_hz(uint8_t odr, int8_t freq_fine)
{
    return 6667.0f * (1.0f + 0.0015f * (float)freq_fine) / (float)(1u << (QUICKEST - odr));
}

/* 25 / (1 + 0.0015 f) = 50000 / (2000 + 3 f), in integers: no error but the last place. */
uint64_t fifo_tick_q32(int8_t freq_fine)
{
    const uint32_t divisor = (uint32_t)(2000 + 3 * freq_fine);
    return ((50000ULL << 32) + divisor / 2) / divisor;
}

void fifo_gap(struct lsm6dsx_fifo *fifo)
{
    fifo->have = fifo->spoilt = fifo->open = fifo->ordered = fifo->whole_before = fifo->counted = fifo->unsure = 0;
}

/* The place follows the stamps as slowly as the period's doubt allows: its lag is doubt / gain, half a tick. */
static void set_period(struct lsm6dsx_fifo *fifo, uint64_t shortest_q32, uint64_t longest_q32)
{
    fifo->shortest_q32 = shortest_q32;
    fifo->longest_q32 = longest_q32;
    fifo->doubt_q32 = (longest_q32 - shortest_q32) / 2;
    fifo->period_q32 = shortest_q32 + fifo->doubt_q32;
    fifo->gain = 1;
    while (fifo->gain < GAIN_MOST && fifo->doubt_q32 << (fifo->gain + 1) <= TICK / 2)
        fifo->gain++;
}

static void forget_period(struct lsm6dsx_fifo *fifo)
{
    set_period(fifo, SHORTEST_Q32 << (QUICKEST - fifo->odr), LONGEST_Q32 << (QUICKEST - fifo->odr));
}

/* From the middle of the last stamp's tick to the time of its slot, in 2^-32 us. */
static uint64_t place_us_q32(const struct lsm6dsx_fifo *fifo)
{
    return (uint64_t)((int64_t)(fifo->tick_q32 >> 16) * (fifo->place_q32 / 65536));
}

void fifo_begin(struct lsm6dsx_fifo *fifo, uint8_t odr, int8_t freq_fine, uint16_t unsettled)
{
    fifo_gap(fifo);
    if (fifo->joined)
        fifo->time_q32 += place_us_q32(fifo);
    fifo->warm = fifo->anchored = fifo->bad_stamps = fifo->settled = fifo->joined = 0;
    fifo->unsettled = unsettled;
    fifo->masked = (uint16_t)(MASKED_LEAST + (MASKED_MOST - MASKED_LEAST) / (1u << (QUICKEST - odr)));
    fifo->odr = odr;
    fifo->tick_q32 = fifo_tick_q32(freq_fine);
    forget_period(fifo);
}

void fifo_temperature(struct lsm6dsx_fifo *fifo, int16_t value)
{
    fifo->temperature = value;
    fifo->warm = 1;
}

static int odd(uint8_t tag)
{
    tag = (uint8_t)(tag ^ tag >> 4);
    tag = (uint8_t)(tag ^ tag >> 2);
    return (tag ^ tag >> 1) & 1;
}

unsigned fifo_unknown_tag(const uint8_t *words, unsigned count)
{
    unsigned found = count;
    for (unsigned n = 0; n < count; n++) {
        const uint8_t tag = words[FIFO_WORD_BYTES * n];
        if (odd(tag) || (tag >> 3 >= TAG_GYRO && tag >> 3 <= TAG_CONFIGURATION))
            continue;
        if (found < count || n + WORDS_PER_SLOT >= count)
            return MANY_UNKNOWN;
        found = n;
    }
    return found;
}

static int16_t get_i16(const uint8_t *from)
{
    return (int16_t)(uint16_t)(from[0] | (uint16_t)from[1] << 8);
}

uint32_t fifo_stamp(const uint8_t *word)
{
    return word[1] | ((uint32_t)word[2] << 8) | ((uint32_t)word[3] << 16) | ((uint32_t)word[4] << 24);
}

static int64_t within(int64_t value, int64_t most)
{
    return value > most ? most : value < -most ? -most : value;
}

/* A value times 2^-shift.  No division, which is dear. */
static int64_t part(int64_t value, uint8_t shift)
{
    return value < 0 ? -(int64_t)((uint64_t)-value >> shift) : (int64_t)((uint64_t)value >> shift);
}

/* Since then, by the target's clock. */
static uint32_t passed_since(const struct lsm6dsx_fifo *fifo, uint32_t from_us)
{
    const uint32_t passed_us = fifo->made_us - from_us;
    return (passed_us > (UINT32_MAX - BACK_US)) ? 0u : passed_us;
}

/* Whether the target's clock has seen as much time pass. */
static int clocks_agree(const struct lsm6dsx_fifo *fifo, uint32_t ticks)
{
    const uint64_t step_us = ticks * (fifo->tick_q32 >> 16) >> 16, passed_us = passed_since(fifo, fifo->stamped_us);
    const uint64_t periods_us = CLOCKS_PERIODS * ((fifo->period_q32 >> 16) * (fifo->tick_q32 >> 16) >> 32);
    const uint64_t apart_us = step_us > passed_us ? step_us - passed_us : passed_us - step_us;
    return apart_us <= passed_us / CLOCKS_SHARE + periods_us + CLOCKS_US;
}

/* Whether the stamp in hand goes on by a period from the last one that the target's clock contradicted: then the clock has stood still,
 * as where a core is held with its interrupts off. */
static int confirms(const struct lsm6dsx_fifo *fifo)
{
    const int64_t step_q32 = (int64_t)((uint64_t)(fifo->ticks - fifo->contradicted) << 32);
    const int64_t off_q32 = step_q32 - (int64_t)fifo->period_q32;
    return within(off_q32, (int64_t)JITTERS) == off_q32;
}

static void learn_from_here(struct lsm6dsx_fifo *fifo)
{
    fifo->learned_from = fifo->ticks;
    fifo->learned = 0;
    fifo->learned_again = 1;
}

/* The period from a stamp some time ago and the one in hand: the longer ago, the better.  Not each time, as a division is dear. */
static void learn(struct lsm6dsx_fifo *fifo)
{
    const uint32_t ticks = fifo->ticks - fifo->learned_from;
    const uint64_t ticks_q32 = (uint64_t)ticks << 32;
    uint64_t shortest_q32 = fifo->shortest_q32, longest_q32 = fifo->longest_q32;
    if (fifo->learned < fifo->learned_again)
        return;
    if ((ticks >> 31) != 0u) { /* the 32 bits soon wrap: what was learned in 15 hours is good enough */
        learn_from_here(fifo);
        return;
    }
    fifo->learned_again = fifo->learned + fifo->learned / 8 + 1;
    if (ticks_q32 > JITTERS && (ticks_q32 - JITTERS) / fifo->learned > shortest_q32)
        shortest_q32 = (ticks_q32 - JITTERS) / fifo->learned;
    if ((ticks_q32 + JITTERS) / fifo->learned < longest_q32)
        longest_q32 = (ticks_q32 + JITTERS) / fifo->learned;
    if (shortest_q32 < longest_q32) {
        set_period(fifo, shortest_q32, longest_q32);
    } else { /* the stamps stray by more than was thought, or the period is none that can be */
        forget_period(fifo);
        learn_from_here(fifo);
    }
}

/* Sample periods since the last stamp, or 0 where the one in hand does not follow.  Where no slot can have been missed, they are as many
 * as began since.  Else TAG_CNT gives their number modulo 4: of what is left, the nearest.  That is certain as long as the period's doubt
 * does not add up to two periods.  Where it does, the number is the most probable one, a fault is counted, and the time goes on by the
 * sensor's ticks all the same. */
static uint32_t periods_since(struct lsm6dsx_fifo *fifo, uint32_t faults[FAULTS])
{
    const uint32_t ticks = fifo->ticks - fifo->last_ticks;
    const int64_t period_q32 = (int64_t)fifo->period_q32;
    uint32_t periods = (fifo->counted != 0u) ? fifo->slots : ((((uint32_t)fifo->count - fifo->last_count - 1u) & 3u) + 1u);
    if (ticks == 0 || ticks >> 30)
        return 0;
    int64_t off_q32 = (int64_t)((uint64_t)ticks << 32) - fifo->place_q32 - periods * period_q32;
    if ((fifo->counted == 0u) && (off_q32 >= 2 * period_q32)) {
        const int64_t fours = (off_q32 + 2 * period_q32) / (4 * period_q32);
        periods += 4 * (uint32_t)fours;
        off_q32 -= 4 * fours * period_q32;
    }
    const uint64_t doubt_q32 = periods * fifo->doubt_q32, stray_q32 = STRAY + doubt_q32;
    const int certain = (fifo->counted != 0u) || (stray_q32 < (2u * fifo->period_q32));
    if (certain && (off_q32 > (int64_t)stray_q32 || off_q32 < -(int64_t)stray_q32))
        return 0;
    if (periods > NEAR && !clocks_agree(fifo, ticks)) {
        const int confirmed = certain && confirms(fifo);
        fifo->contradicted = fifo->ticks;
        if (!confirmed)
            return 0;
    }
    if (!certain) {
        faults[FAULT_STAMP]++;
        fifo->place_q32 = 0;
        learn_from_here(fifo);
        return periods;
    }
    if (doubt_q32 > TICK / 4) /* it may have strayed by as much meanwhile: that much goes back into the tick that the stamp names */
        fifo->place_q32 = within(off_q32 - within(off_q32, (int64_t)(TICK / 2)), (int64_t)doubt_q32) - off_q32;
    else
        fifo->place_q32 = part(within(off_q32, CLIP), fifo->gain) - off_q32;
    fifo->learned += periods;
    if (within(off_q32, LEARN) == off_q32)
        learn(fifo);
    return periods;
}

/* Whether a whole slot goes on from the stamp before; the periods in between, if there is one.  While the filters settle, slots may come
 * as they like, of a sensor that is late: the first sample waits until they follow. */
static int goes_on(struct lsm6dsx_fifo *fifo, uint32_t faults[FAULTS], uint32_t *periods)
{
    *periods = (fifo->anchored != 0u) ? periods_since(fifo, faults) : 0u;
    if (*periods == 0u) {
        if ((fifo->anchored != 0u) && (fifo->settled != 0u)) {
            faults[FAULT_STAMP]++;
            fifo->bad_stamps++;
            return 0;
        }
        if ((fifo->anchored != 0u) && (fifo->unsettled < STEADY))
            fifo->unsettled = STEADY;
        fifo->place_q32 = 0;
        fifo->anchored = 1;
        forget_period(fifo);
        learn_from_here(fifo);
    }
    fifo->bad_stamps = 0;
    return 1;
}

/* The first sample after a start: time and number go on by the target's clock, which wraps: of an absence beyond 71.6 minutes the
 * whole 71.6 are missing. */
static void join(struct lsm6dsx_fifo *fifo, uint32_t faults[FAULTS])
{
    const uint64_t period_q32 = (fifo->tick_q32 >> 16) * (fifo->period_q32 >> 16);
    if (fifo->streamed) {
        const uint64_t gap_q32 = (uint64_t)passed_since(fifo, fifo->now_us) << 32;
        const uint32_t periods = gap_q32 > period_q32 ? (uint32_t)((gap_q32 + period_q32 / 2) / period_q32) : 1;
        fifo->time_q32 += periods * period_q32;
        fifo->number += periods;
        faults[FAULT_LOST] += periods - 1;
    } else {
        fifo->time_q32 = (uint64_t)fifo->made_us << 32;
        fifo->number = 1;
    }
    fifo->time_q32 -= place_us_q32(fifo);
    fifo->joined = fifo->streamed = 1;
}

/* Whether the slot in hand may be a sample: the filters have settled, as far as can be seen.  As ST's own driver counts, a masked slot is
 * not one of those that are unsettled. */
static int is_settled(struct lsm6dsx_fifo *fifo, int whole)
{
    if (fifo->settled)
        return 1;
    for (int i = 0; i < 6; i++) {
        if (fifo->values[i] >= MASKED && fifo->masked > 0) {
            fifo->masked--;
            return 0;
        }
    }
    if (fifo->unsettled > 0) {
        fifo->unsettled--;
        return 0;
    }
    if (!whole)
        return 0;
    fifo->settled = 1;
    return 1;
}

/* A temperature counts when the slots before and behind its own are whole as well: a false tag may make one of any word, and have it
 * seem to belong to a neighbour, but then that word is missing in one of the three. */
static void take_warmth(struct lsm6dsx_fifo *fifo, int whole)
{
    if (whole && fifo->whole_before && fifo->waiting)
        fifo_temperature(fifo, fifo->waiting_warmth);
    fifo->waiting = (fifo->whole_before && ((fifo->have & WARM) != 0u)) ? 1u : 0u;
    fifo->waiting_warmth = fifo->warmth;
    fifo->whole_before = (uint8_t)whole;
}

/* The slot in hand as a sample, if it is one; 1 or 0. */
static int finish(struct lsm6dsx_fifo *fifo, int whole, uint32_t faults[FAULTS], struct fifo_sample *out)
{
    uint32_t periods = 0;
    const int follows = whole && goes_on(fifo, faults, &periods);
    const int settled = is_settled(fifo, whole);
    take_warmth(fifo, whole);
    if (!follows)
        return 0;
    if (fifo->joined) {
        fifo->time_q32 += (fifo->ticks - fifo->last_ticks) * fifo->tick_q32;
        fifo->number += periods;
        faults[FAULT_LOST] += periods - 1;
    }
    fifo->last_ticks = fifo->ticks;
    fifo->last_count = fifo->count;
    fifo->counted = 1;
    fifo->slots = 0;
    fifo->stamped_us = fifo->made_us;
    if (!settled)
        return 0;
    if (!fifo->warm) {
        faults[FAULT_LOST] += fifo->joined;
        return 0;
    }
    if (!fifo->joined)
        join(fifo, faults);
    fifo->now_us = fifo->made_us;
    out->t_us = (uint32_t)((fifo->time_q32 + place_us_q32(fifo)) >> 32);
    out->number = fifo->number;
    for (int i = 0; i < 6; i++)
        out->registers[i] = fifo->values[i];
    out->registers[6] = fifo->temperature;
    return 1;
}

/* The slot in hand is over, and the next one, of this TAG_CNT, begins; 1 where a sample is complete. */
static int turn_slot(struct lsm6dsx_fifo *fifo, uint8_t count, uint32_t now_us, uint32_t faults[FAULTS], struct fifo_sample *out)
{
    const int whole = fifo->open && (fifo->have & WHOLE) == WHOLE && !fifo->spoilt;
    const int complete = fifo->open && finish(fifo, whole, faults, out);
    if (fifo->open > 1 && !whole) /* the first one may have begun before we came */
        faults[FAULT_INCOMPLETE]++;
    const int in_order = !fifo->ordered || count == fifo->next;
    if (!in_order)
        faults[FAULT_ORDER]++;
    if (!in_order || (fifo->unsure != 0u))
        fifo->counted = 0;
    fifo->unsure = 0;
    fifo->slots++;
    fifo->open = fifo->ordered ? 2 : 1;
    fifo->ordered = 1;
    fifo->have = fifo->spoilt = 0;
    fifo->count = count;
    fifo->made_us = now_us;
    fifo->next = (count + 1) & 3;
    return complete;
}

int fifo_take(struct lsm6dsx_fifo *fifo, const uint8_t *word, uint32_t now_us, uint32_t faults[FAULTS], struct fifo_sample *out)
{
    const uint8_t kind = word[0] >> 3, count = word[0] >> 1 & 3;
    int complete = 0;
    if (odd(word[0])) {
        faults[FAULT_PARITY]++;
        fifo->unsure = 1; /* it may have been of a slot that no other word shows */
        return 0;
    }
    if (!fifo->open || count != fifo->count)
        complete = turn_slot(fifo, count, now_us, faults, out);
    if (kind == TAG_GYRO || kind == TAG_ACCEL) {
        int16_t *to = fifo->values + (kind == TAG_GYRO ? 0 : 3);
        for (int i = 0; i < 3; i++)
            to[i] = get_i16(word + 1 + 2 * i);
    } else if (kind == TAG_STAMP) {
        fifo->ticks = fifo_stamp(word);
    } else if (kind == TAG_TEMPERATURE) {
        fifo->warmth = get_i16(word + 1);
    } else {
        return complete;
    }
    if (fifo->have >> kind & 1) {
        if (!fifo->spoilt)
            faults[FAULT_ORDER]++;
        fifo->spoilt = 1;
        fifo->unsure = 1; /* they may be of two slots, four apart */
    }
    fifo->have = (uint8_t)(fifo->have | 1u << kind);
    return complete;
}
