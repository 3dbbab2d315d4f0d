/* The self-test of the sensor's two moving parts: a known force is switched on and off, and the output must follow.  It must
 * lie still. */
#ifndef LSM6DSX_SELF_TEST_H
#define LSM6DSX_SELF_TEST_H

#include "lsm6dsx.h"

struct lsm6dsx_tested {
    uint16_t failed;      /* bit 0 to 2: gyroscope x y z, 3 to 5: accelerometer; 0x8000: nothing was measured.  0: passed */
    float gyro_dps[3];    /* change of the output */
    float accel_mg[3];
};

/* A self-test under way. */
struct lsm6dsx_self_test {
    struct lsm6dsx_tested tested;
    uint8_t phase, taken;     /* of six: gyroscope without the force, with it, without it; accelerometer; outputs taken */
    bool done;
    int32_t sum[3][3];        /* without the force, with it, without it */
    int16_t least[3], most[3];
    uint32_t since_us;        /* when the phase began, or the last output came */
};

/* Begin one.  Poll it each millisecond instead of the sensor; it waits as little as that. */
void lsm6dsx_self_test_begin(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test);

/* Whether it goes on; it takes 1.3 s.  Behind it the sensor stands still, all its settings gone, until lsm6dsx_poll starts it again. */
bool lsm6dsx_self_test_poll(struct lsm6dsx *sensor, struct lsm6dsx_self_test *test);

/* For small targets: the whole of it at once. */
void lsm6dsx_self_test(struct lsm6dsx *sensor, struct lsm6dsx_tested *tested);

#endif
