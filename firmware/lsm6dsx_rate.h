/* The rate that arrives, against the one that was set: the sensor may batch at another one than its registers have. */
#ifndef LSM6DSX_RATE_H
#define LSM6DSX_RATE_H

#include <stdbool.h>
#include <stdint.h>

/* What has come since a moment. */
struct lsm6dsx_rate {
    uint32_t began_us;
    uint32_t first_ticks, last_ticks;
    uint32_t gyro, accel, stamps, samples;
    uint8_t odd_steps; /* stamps in a row that are not a period behind the one before */
    bool begun, stamped, settled;
    bool follows; /* whether the last stamp was a period behind the one before */
};

/* Words are missing: what came up to now counts no more. */
void rate_gap(struct lsm6dsx_rate *rate);

/* Take a word of the FIFO. */
void rate_take(struct lsm6dsx_rate *rate, const uint8_t *word, uint8_t odr);

/* Whether the sensor's stamps come at another step than a period, each of the last few. */
bool rate_steps_are_odd(const struct lsm6dsx_rate *rate);

/* Whether it is another rate: at once where sixteen stamps in a row of a settled sensor are odd, or where 64 slots have none; else when a second and 64
 * periods have come.  Evaluated behind a burst that emptied the FIFO.  made_us: when its last word was made, by the target's clock; settled:
 * whether samples are to be expected of all that comes from here on. */
bool rate_is_wrong(struct lsm6dsx_rate *rate, uint8_t odr, int8_t freq_fine, uint32_t made_us, bool settled);

#endif
