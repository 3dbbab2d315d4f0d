/* The self-test of the sensor's two moving parts: a known force is switched on, and the output must follow.  It must lie still. */
#ifndef LSM6DSX_SELF_TEST_H
#define LSM6DSX_SELF_TEST_H

#include "lsm6dsx.h"

struct lsm6dsx_tested {
    uint16_t failed;      /* bit 0 to 2: gyroscope x y z, 3 to 5: accelerometer; 0x8000: nothing was measured.  0: passed */
    float gyro_dps[3];    /* change of the output */
    float accel_mg[3];
};

/* Takes 0.8 s.  The sensor stands still behind it, all its settings gone: start it again. */
void lsm6dsx_self_test(struct lsm6dsx *sensor, struct lsm6dsx_tested *tested);

#endif
