/* The self-test of the sensor's two moving parts: a known force is switched on, and the output must follow.  It must lie still. */
#ifndef ASM330LHH_SELF_TEST_H
#define ASM330LHH_SELF_TEST_H

#include "asm330lhh.h"

struct asm330lhh_tested {
    uint16_t failed;      /* bit 0 to 2: gyroscope x y z, 3 to 5: accelerometer; 0x8000: nothing was measured.  0: passed */
    float gyro_dps[3];    /* change of the output */
    float accel_mg[3];
};

/* Takes 0.8 s.  The sensor stands still behind it, all its settings gone: start it again. */
void asm330lhh_self_test(struct asm330lhh *sensor, struct asm330lhh_tested *tested);

#endif
