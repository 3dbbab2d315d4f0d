/* What one chip of the family has and another has not: a table for each.  The rest of the driver holds for all of them. */
#ifndef LSM6DSX_CHIPS_H
#define LSM6DSX_CHIPS_H

#include <stdint.h>

/* FIFO_CTRL1 to CTRL10_C: what makes up a sample.  They are written, kept as they were read back, and proved behind each burst. */
enum { LSM6DSX_KEPT = 19, LSM6DSX_KEPT_WHO = 8 }; /* the place of WHO_AM_I; behind it come CTRL1_XL to CTRL10_C */

/* A value and the code that a register has for it. */
struct lsm6dsx_code {
    uint16_t value; /* 0 behind the last */
    uint8_t code;
};

/* Of the self-test: how far the output must move, and what one LSB is. */
struct lsm6dsx_force {
    float least_lsb, most_lsb, unit;
};

struct lsm6dsx_chip {
    const char *name;
    uint8_t who;
    const struct lsm6dsx_code *gyro_fs_dps, *accel_fs_g; /* fs_g with fs_125 and fs_4000, fs_xl */
    uint8_t set[LSM6DSX_KEPT];                           /* bits that are set whatever the settings */
    uint8_t known[LSM6DSX_KEPT];                         /* bits that have a meaning; the others may read as they like */
    struct lsm6dsx_force gyro_force, accel_force;        /* at 2000 dps, unit dps; at 4 g, unit mg */
};

/* The chip of a WHO_AM_I, or null. */
const struct lsm6dsx_chip *lsm6dsx_chip_of(uint8_t who);

#endif
