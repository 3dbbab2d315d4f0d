/* The calibrated rate, for whoever sends a sample. */
#ifndef ANSWERS_H
#define ANSWERS_H

#include <stdint.h>

#include "board.h"

void answers_start(void);

/* Answer a sample or a hello on its port; 0 where the frame is neither. */
int answers_take(enum port port, const uint8_t *bytes, unsigned count);

#endif
