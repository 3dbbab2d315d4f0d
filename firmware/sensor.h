/* The sensor of this board, on its SPI. */
#ifndef SENSOR_H
#define SENSOR_H

#include "lsm6dsx.h"
#include "lsm6dsx_self_test.h"

/* Begin to look for it. */
void sensor_start(void);

/* Whether it has ever been found since power-up.  Then no stand-in takes its place, whatever becomes of it. */
bool sensor_found(void);

/* Whether it is looked for after power-up, 2 s at most, or whether the last request goes on. */
bool sensor_busy(void);

const struct lsm6dsx *sensor_state(void);

/* True data rate, Hz. */
float sensor_rate_hz(void);

/* Do what is due, and stream what has come in; whether there may be more at once. */
bool sensor_stream(void);

/* Start it with other settings, or the same; outcome, once it is no longer busy: FAULTS where it runs, LSM6DSX_IMPOSSIBLE where it has
 * no such settings and keeps those of before (at power-up's fallback where it has not those either), or the fault. */
void sensor_set(const struct lsm6dsx_settings *settings);
enum fault sensor_outcome(void);

/* Its self-test; it is started again behind it. */
void sensor_test(void);
const struct lsm6dsx_tested *sensor_tested(void);

#endif
