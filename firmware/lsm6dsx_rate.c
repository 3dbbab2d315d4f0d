#include "lsm6dsx_rate.h"

#include "lsm6dsx.h"

enum {
    PERIODS_LEAST = 64,
    ODD_STEPS = 4,     /* in a row, */
    ODD_STEPS_MOST = 16, /* and so many are enough by themselves */
    TICKS = 6,         /* of the stamps in a period at the highest rate, by name */
    STEP_SHARE = 8,    /* a step is odd that is off by STAMPS_STRAY ticks and an eighth of a period */
    LOSS_SHARE = 8,    /* an eighth of the words or samples may be missing, or too many, for another reason */
};

static const float WINDOW_US = 1e6f;

void rate_gap(struct lsm6dsx_rate *rate)
{
    *rate = (struct lsm6dsx_rate){0};
}

void rate_take(struct lsm6dsx_rate *rate, const uint8_t *word, uint8_t odr)
{
    const uint8_t kind = (uint8_t)(word[0] >> 3);
    rate->gyro += (kind == TAG_GYRO) ? 1u : 0u;
    rate->accel += (kind == TAG_ACCEL) ? 1u : 0u;
    if (kind != TAG_STAMP)
        return;
    const uint32_t ticks = fifo_stamp(word);
    const uint32_t step = ticks - rate->last_ticks, period = (uint32_t)TICKS << (LSM6DSX_QUICKEST - odr);
    const uint32_t off = (step > period) ? (step - period) : (period - step);
    rate->follows = rate->stamped && (off <= STAMPS_STRAY + (period / STEP_SHARE));
    if (!rate->stamped || rate->follows)
        rate->odd_steps = 0;
    else if (rate->odd_steps < ODD_STEPS_MOST)
        rate->odd_steps++;
    rate->last_ticks = ticks;
    rate->stamped = true;
    rate->stamps++;
}

bool rate_steps_are_odd(const struct lsm6dsx_rate *rate)
{
    return rate->odd_steps >= ODD_STEPS;
}

static bool differs(float value, float expected, float share)
{
    const float off = (value > expected) ? (value - expected) : (expected - value);
    return off > (2.0f + (expected / share));
}

bool rate_is_wrong(struct lsm6dsx_rate *rate, uint8_t odr, int8_t freq_fine, uint32_t made_us, bool settled)
{
    const float passed_us = rate->begun ? (float)(int32_t)(made_us - rate->began_us) : 0.0f;
    const float periods = passed_us * 1e-6f * fifo_rate_hz(odr, freq_fine);
    const float period_ticks = (float)((uint32_t)TICKS << (LSM6DSX_QUICKEST - odr));
    bool wrong = false;
    if (settled && (rate->odd_steps >= ODD_STEPS_MOST))
        return true;
    if (!rate->begun && (rate->stamps == 0u) && ((rate->gyro + rate->accel) > (2u * (uint32_t)PERIODS_LEAST)))
        return true;
    if ((!rate->follows && !rate_steps_are_odd(rate)) || (passed_us < 0.0f)) /* a stamp that was spoilt on its way is no end of a window */
        return false;
    if (rate->begun && (rate->settled == settled)) {
        if ((passed_us < WINDOW_US) || (periods < (float)PERIODS_LEAST))
            return false;
        wrong = differs((float)(rate->last_ticks - rate->first_ticks) / period_ticks, periods, (float)CLOCKS_SHARE) ||
                differs((float)rate->gyro, periods, (float)LOSS_SHARE) || differs((float)rate->accel, periods, (float)LOSS_SHARE) ||
                differs((float)rate->stamps, periods, (float)LOSS_SHARE) ||
                (rate->settled && differs((float)rate->samples, periods, (float)LOSS_SHARE));
    }
    *rate = (struct lsm6dsx_rate){.began_us = made_us, .first_ticks = rate->last_ticks, .last_ticks = rate->last_ticks, .begun = true,
                                  .odd_steps = rate->odd_steps, .stamped = rate->stamped, .follows = rate->follows, .settled = settled};
    return wrong;
}
