/* The sensor of this board: an ASM330LHH on its SPI. */
#ifndef SENSOR_H
#define SENSOR_H

#include "lsm6dsx.h"
#include "lsm6dsx_self_test.h"

/* Look for it. */
void sensor_start(void);

/* Whether it has ever been found since power-up.  Then no stand-in takes its place, whatever becomes of it. */
int sensor_found(void);

const struct lsm6dsx *sensor_state(void);

/* True data rate, Hz. */
float sensor_rate_hz(void);

/* Stream what has come in; whether there may be more at once. */
int sensor_stream(void);

/* Start it with other settings, or the same; FAULTS where it runs. */
enum fault sensor_set(const struct lsm6dsx_settings *settings);

/* Its self-test; it is started again behind it. */
void sensor_test(struct lsm6dsx_tested *tested);

#endif
