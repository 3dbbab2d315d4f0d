#include "stream.h"

/* A byte is ten bits on the wire; a sample is 25 bytes, and status frames take 200 a second. */
enum { SAMPLE_BITS = 250, OTHER_BITS = 2000 };

static uint16_t sequence;
static uint32_t crowded_out;
static int off;

uint16_t stream_sequence(void)
{
    return sequence;
}

void stream_switch(int on)
{
    off = !on;
}

int stream_is_on(void)
{
    return !off;
}

uint32_t stream_crowded_out(void)
{
    return crowded_out;
}

int stream_frame(enum port port, struct frame *frame)
{
    uint8_t encoded[FRAME_MOST + 2];
    return board_write(port, encoded, frame_end(frame, encoded));
}

void stream_sample(uint32_t periods, uint32_t t_us, const int16_t registers[7])
{
    struct frame frame;
    sequence = (uint16_t)(sequence + periods - 1);
    frame_begin(&frame, FRAME_SAMPLE, sequence++);
    frame_u32(&frame, t_us);
    for (int i = 0; i < 7; i++)
        frame_u16(&frame, (uint16_t)registers[i]);
    if (!off && !stream_frame(HOST, &frame))
        crowded_out++;
}

int stream_carries(float odr_hz, uint32_t baud)
{
    return odr_hz * (float)SAMPLE_BITS + (float)OTHER_BITS <= (float)baud;
}
