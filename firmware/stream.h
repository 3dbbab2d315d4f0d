/* The samples on the host's port. */
#ifndef STREAM_H
#define STREAM_H

#include <stdint.h>

#include "board.h"
#include "frames.h"

/* Number of the next sample.  Other frames bear it too, and take none of their own. */
uint16_t stream_sequence(void);

/* A sample, so many sample periods behind the one before. */
void stream_sample(uint32_t periods, uint32_t t_us, const int16_t registers[7]);

/* Whether samples are sent; they are numbered all the same. */
void stream_switch(int on);
int stream_is_on(void);

/* Samples that the port had no room for. */
uint32_t stream_crowded_out(void);

/* End a frame and send it; 0 where there is no room. */
int stream_frame(enum port port, struct frame *frame);

/* Whether samples at this rate, and the status frames, fit the port. */
int stream_carries(float odr_hz, uint32_t baud);

#endif
