/* Which board this is. */
#ifndef IDENTITY_H
#define IDENTITY_H

#include <stdint.h>

/* The serial number: SERIAL of the build where that is not 0, else the CRC-32 of the chip's unique id.  Never 0. */
uint32_t identity_serial(void);

#endif
