/* Stands in for a sensor that is not there. */
#ifndef STANDIN_H
#define STANDIN_H

#include <stdint.h>

/* Registers gx gy gz ax ay az temp of the n-th sample. */
void standin_read(uint32_t n, int16_t registers[7]);

#endif
