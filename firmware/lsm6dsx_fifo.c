#include "lsm6dsx_fifo.h"

/* Of TAG_SENSOR. */
enum { GYRO = 1, ACCEL = 2, TEMPERATURE = 3, STAMP = 4, CONFIGURATION = 5 };

/* What a time slot must have, by 1 << TAG_SENSOR. */
enum { WHOLE = 1 << GYRO | 1 << ACCEL | 1 << STAMP };

enum {
    QUICKEST = 10,
    TICK_Q16 = 1 << 16,
    NEAR = 256,          /* periods: a longer gap must have been one by the target's clock, too */
    CLOCKS_US = 50000,   /* that the two may differ by, */
    CLOCKS_SHARE = 16,   /* and a sixteenth */
    NOMINAL_SHIFT = 14,  /* 2^-14: 61 ppm; 40000 / 6667 is 50 ppm off six */
};

float fifo_rate_hz(uint8_t odr, int8_t freq_fine)
{
    return 6667.0f * (1.0f + 0.0015f * (float)freq_fine) / (float)(1u << (QUICKEST - odr));
}

/* 25 / (1 + 0.0015 f) = 50000 / (2000 + 3 f), in integers: no error but the last place. */
uint64_t fifo_tick_q32(int8_t freq_fine)
{
    const uint32_t divisor = (uint32_t)(2000 + 3 * freq_fine);
    return ((50000ull << 32) + divisor / 2) / divisor;
}

void fifo_gap(struct lsm6dsx_fifo *fifo)
{
    fifo->have = fifo->spoilt = fifo->open = fifo->ordered = 0;
}

void fifo_begin(struct lsm6dsx_fifo *fifo, uint8_t odr, int8_t freq_fine, uint16_t unsettled)
{
    (void)unsettled;
    fifo_gap(fifo);
    fifo->warm = fifo->anchored = fifo->bad_stamps = 0;
    fifo->tick_q32 = fifo_tick_q32(freq_fine);
    fifo->period_q16 = (uint32_t)((((uint64_t)40000 << 16) << (QUICKEST - odr)) / 6667); /* both rates hang on one oscillator */
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
        if (odd(tag) || (tag >> 3 >= GYRO && tag >> 3 <= CONFIGURATION))
            continue;
        if (found < count || n + WORDS_PER_SLOT >= count)
            return MANY_UNKNOWN;
        found = n;
    }
    return found;
}

static int16_t get_i16(const uint8_t *from)
{
    return (int16_t)(uint16_t)(from[0] | from[1] << 8);
}

/* Sample periods since the last stamp, or 0 where they are not whole.  The periods' number is known modulo 4, too, from TAG_CNT. */
static uint32_t periods_since(const struct lsm6dsx_fifo *fifo, uint32_t now_us)
{
    const uint32_t ticks = fifo->ticks - fifo->last_ticks;
    const uint64_t steps_q16 = (uint64_t)ticks << 16;
    uint32_t periods = 1;
    if (ticks == 0 || ticks >> 31)
        return 0;
    if (steps_q16 > fifo->period_q16 + fifo->period_q16 / 2)
        periods = (uint32_t)((steps_q16 + fifo->period_q16 / 2) / fifo->period_q16);
    const uint64_t whole = (uint64_t)periods * fifo->period_q16;
    const uint64_t off = steps_q16 > whole ? steps_q16 - whole : whole - steps_q16;
    if (off > TICK_Q16 + TICK_Q16 / 2 + (whole >> NOMINAL_SHIFT)) /* a tick of either end */
        return 0;
    if (periods > NEAR) {
        const uint64_t step_us = ticks * (fifo->tick_q32 >> 16) >> 16, passed_us = now_us - fifo->now_us;
        if (step_us > passed_us + passed_us / CLOCKS_SHARE + CLOCKS_US)
            return 0;
    }
    return ((periods ^ (uint32_t)(fifo->count - fifo->last_count)) & 3) == 0 ? periods : 0;
}

/* The first sample after a start: time and number go on by the target's clock, which wraps: of an absence beyond 71.6 minutes the
 * whole 71.6 are missing. */
static void anchor(struct lsm6dsx_fifo *fifo, uint32_t now_us, uint32_t faults[FAULTS])
{
    const uint64_t period_q32 = (fifo->tick_q32 >> 16) * fifo->period_q16;
    if (fifo->streamed) {
        const uint64_t gap_q32 = (uint64_t)(now_us - fifo->now_us) << 32;
        const uint32_t periods = gap_q32 > period_q32 ? (uint32_t)((gap_q32 + period_q32 / 2) / period_q32) : 1;
        fifo->time_q32 += periods * period_q32;
        fifo->number += periods;
        faults[FAULT_LOST] += periods - 1;
    } else {
        fifo->time_q32 = (uint64_t)now_us << 32;
        fifo->number = 1;
    }
    fifo->elapsed_q16 = TICK_Q16 / 2;
    fifo->anchored = fifo->streamed = 1;
}

/* Stamps are whole ticks, six to a period at the highest rate.  Time goes on by periods, and stays within the tick that the stamp names:
 * so neither the stamps' steps nor an error of the period gets into it. */
static void advance(struct lsm6dsx_fifo *fifo, uint32_t periods, uint32_t faults[FAULTS])
{
    const uint32_t ticks = fifo->ticks - fifo->last_ticks;
    const int64_t foreseen = (int64_t)fifo->elapsed_q16 + (int64_t)periods * fifo->period_q16 - ((int64_t)ticks << 16);
    const uint32_t elapsed = foreseen < 0 ? 0 : foreseen >= TICK_Q16 ? TICK_Q16 - 1u : (uint32_t)foreseen;
    fifo->time_q32 += ticks * fifo->tick_q32;
    fifo->time_q32 += (uint64_t)((int64_t)(fifo->tick_q32 >> 16) * ((int64_t)elapsed - (int64_t)fifo->elapsed_q16));
    fifo->elapsed_q16 = elapsed;
    fifo->number += periods;
    faults[FAULT_LOST] += periods - 1;
}

/* The slot in hand as a sample, if it is one; 1 or 0. */
static int finish(struct lsm6dsx_fifo *fifo, uint32_t now_us, uint32_t faults[FAULTS], struct fifo_sample *out)
{
    const int whole = fifo->open && fifo->have == WHOLE && !fifo->spoilt;
    if (fifo->open > 1 && !whole) /* the first one may have begun before we came */
        faults[FAULT_INCOMPLETE]++;
    if (!whole || !fifo->warm)
        return 0;
    if (!fifo->anchored) {
        anchor(fifo, now_us, faults);
    } else {
        const uint32_t periods = periods_since(fifo, now_us);
        if (!periods) {
            faults[FAULT_STAMP]++;
            fifo->bad_stamps++;
            return 0;
        }
        advance(fifo, periods, faults);
    }
    fifo->bad_stamps = 0;
    fifo->last_ticks = fifo->ticks;
    fifo->last_count = fifo->count;
    fifo->now_us = now_us;
    out->t_us = (uint32_t)(fifo->time_q32 >> 32);
    out->number = fifo->number;
    for (int i = 0; i < 6; i++)
        out->registers[i] = fifo->values[i];
    out->registers[6] = fifo->temperature;
    return 1;
}

int fifo_take(struct lsm6dsx_fifo *fifo, const uint8_t *word, uint32_t now_us, uint32_t faults[FAULTS], struct fifo_sample *out)
{
    const uint8_t kind = word[0] >> 3, count = word[0] >> 1 & 3;
    int complete = 0;
    if (odd(word[0])) {
        faults[FAULT_PARITY]++;
        return 0;
    }
    if (!fifo->open || count != fifo->count) {
        complete = finish(fifo, now_us, faults, out);
        if (fifo->ordered && count != fifo->next)
            faults[FAULT_ORDER]++;
        fifo->open = fifo->ordered ? 2 : 1;
        fifo->ordered = 1;
        fifo->have = fifo->spoilt = 0;
        fifo->count = count;
        fifo->next = (count + 1) & 3;
    }
    if (kind == GYRO || kind == ACCEL) {
        int16_t *to = fifo->values + (kind == GYRO ? 0 : 3);
        for (int i = 0; i < 3; i++)
            to[i] = get_i16(word + 1 + 2 * i);
    } else if (kind == STAMP) {
        fifo->ticks = word[1] | (uint32_t)word[2] << 8 | (uint32_t)word[3] << 16 | (uint32_t)word[4] << 24;
    } else {
        if (kind == TEMPERATURE)
            fifo_temperature(fifo, get_i16(word + 1));
        return complete;
    }
    if (fifo->have >> kind & 1) {
        faults[FAULT_ORDER] += !fifo->spoilt;
        fifo->spoilt = 1;
    }
    fifo->have |= (uint8_t)(1 << kind);
    return complete;
}
