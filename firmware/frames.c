#include "frames.h"

/* Four bits at a time: what each of the uppermost four leaves behind. */
static uint16_t crc16(const uint8_t *bytes, unsigned count)
{
    static const uint16_t LEFT[16] = {0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
                                      0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF};
    uint32_t crc = 0xFFFF;
    for (unsigned n = 0; n < count; n++) {
        crc = ((crc << 4) & 0xFFFFu) ^ LEFT[(crc >> 12) ^ (bytes[n] >> 4)];
        crc = ((crc << 4) & 0xFFFFu) ^ LEFT[(crc >> 12) ^ (bytes[n] & 15u)];
    }
    return (uint16_t)crc;
}

static void put(struct frame *frame, uint32_t value, unsigned count)
{
    for (unsigned n = 0; (n < count) && (frame->count < FRAME_MOST); n++, value >>= 8)
        frame->bytes[frame->count++] = (uint8_t)value;
}

void frame_begin(struct frame *frame, uint8_t type, uint16_t sequence)
{
    frame->count = 0;
    put(frame, type, 1);
    put(frame, sequence, 2);
}

void frame_u8(struct frame *frame, uint8_t value)
{
    put(frame, value, 1);
}

void frame_u16(struct frame *frame, uint16_t value)
{
    put(frame, value, 2);
}

void frame_u32(struct frame *frame, uint32_t value)
{
    put(frame, value, 4);
}

union bits {
    float f;
    uint32_t u;
};

void frame_f32(struct frame *frame, float value)
{
    const union bits bits = {.f = value};
    put(frame, bits.u, 4);
}

unsigned frame_end(struct frame *frame, uint8_t *out)
{
    put(frame, crc16(frame->bytes, frame->count), 2);
    unsigned code = 0, to = 1; /* where the length of the run at hand belongs, and where its next byte goes */
    for (unsigned n = 0; n < frame->count; n++) {
        if (frame->bytes[n] == 0) {
            out[code] = (uint8_t)(to - code);
            code = to++;
        } else {
            out[to++] = frame->bytes[n];
        }
    }
    out[code] = (uint8_t)(to - code);
    out[to++] = 0;
    return to;
}

/* In place; the decoded length, or 0.  Frames are shorter than 254 bytes, so each run but the last ends in a zero. */
static unsigned decode(uint8_t *bytes, unsigned count)
{
    unsigned from = 0, to = 0;
    while (from < count) {
        const unsigned end = from + bytes[from];
        if (end > count)
            return 0;
        while (++from < end)
            bytes[to++] = bytes[from];
        if (from < count)
            bytes[to++] = 0;
    }
    return to;
}

unsigned frame_take(struct decoder *decoder, uint8_t byte)
{
    if (byte != 0) {
        if (decoder->count < sizeof decoder->bytes)
            decoder->bytes[decoder->count] = byte;
        if (decoder->count <= sizeof decoder->bytes)
            decoder->count++;
        return 0;
    }
    const unsigned count = decoder->count;
    decoder->count = 0;
    if (count == 0 || count > sizeof decoder->bytes)
        return 0;
    const unsigned length = decode(decoder->bytes, count);
    if (length < 3 || crc16(decoder->bytes, length - 2) != get_u16(decoder->bytes + length - 2))
        return 0;
    return length - 2;
}

uint16_t get_u16(const uint8_t *from)
{
    return (uint16_t)(from[0] | ((unsigned)from[1] << 8));
}

uint32_t get_u32(const uint8_t *from)
{
    return from[0] | ((uint32_t)from[1] << 8) | ((uint32_t)from[2] << 16) | ((uint32_t)from[3] << 24);
}

float get_f32(const uint8_t *from)
{
    const union bits bits = {.u = get_u32(from)};
    return bits.f;
}

void put_u32(uint8_t *to, uint32_t value)
{
    for (int n = 0; n < 4; n++, value >>= 8)
        to[n] = (uint8_t)value;
}
