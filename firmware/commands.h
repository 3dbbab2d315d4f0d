/* Commands of the host to the board. */
#ifndef COMMANDS_H
#define COMMANDS_H

#include <stdint.h>

#include "board.h"

/* Obey a frame that came in on a port, and answer it there; 0 where it is no command.  While the sensor is busy with one
 * (sensor_busy), no frame may be given. */
int commands_take(enum port port, const uint8_t *bytes, unsigned count);

/* A frame with a good check has come in on the host's port: its new rate, if it has one, is understood. */
void commands_heard(void);

/* Answer what the sensor has done by now.  Go back to the port's rate of before, if nothing was received at the new one. */
void commands_service(void);

#endif
