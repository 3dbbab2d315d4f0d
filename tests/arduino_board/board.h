/* What the board and the sensor at its bus share. */
#pragma once
#include "Arduino.h"

extern double now_us; /* since power-up */

/* Behind the sensor's last sample. */
[[noreturn]] void end();
