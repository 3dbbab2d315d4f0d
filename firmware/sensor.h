/* The sensor of this board: an ASM330LHH on its SPI. */
#ifndef SENSOR_H
#define SENSOR_H

#include "asm330lhh.h"
#include "asm330lhh_self_test.h"

/* Look for it. */
void sensor_start(void);

/* Whether it has ever been found since power-up.  Then no stand-in takes its place, whatever becomes of it. */
int sensor_found(void);

const struct asm330lhh *sensor_state(void);

/* True data rate, Hz. */
float sensor_rate_hz(void);

/* Stream what has come in; whether there may be more at once. */
int sensor_stream(void);

/* Start it with other settings, or the same; FAULTS where it runs. */
enum fault sensor_set(const struct asm330lhh_settings *settings);

/* Its self-test; it is started again behind it. */
void sensor_test(struct asm330lhh_tested *tested);

#endif
