/* tinygc-frame/1: COBS-encoded, delimited by 0x00, little-endian, CRC-16/CCITT-FALSE over everything before it. */
#ifndef FRAMES_H
#define FRAMES_H

#include <stdint.h>

enum {
    FRAME_SAMPLE = 0x01,     /* u16 sequence, u32 t_us, i16 gx gy gz ax ay az temp */
    FRAME_INFO = 0x02,       /* u16 sequence, u16 gyro_fs_dps, u16 accel_fs_g, f32 odr_hz, u32 serial */
    FRAME_CALIBRATED = 0x03, /* u16 sequence, u32 t_us, f32 wx wy wz in rad/s: the answer to a sample, with its sequence and t_us */
    FRAME_SELF_TEST = 0x04,  /* u16 sequence, u16 failed (0: passed), f32 worst in rad/s, u32 model id: the answer to a hello */
    FRAME_BOARD = 0x05,      /* status of the board and its sensor (status.c) */
    FRAME_FAULTS = 0x06,     /* u16 sequence, u32 counts */
    FRAME_DONE = 0x07,       /* u16 sequence, u8 command, u8 result: the answer to a command, with its sequence */
    FRAME_TESTED = 0x08,     /* u16 sequence, u16 failed, f32 gyroscope x y z in dps, accelerometer x y z in mg: of a sensor's self-test */
    FRAME_HELLO = 0x10,      /* u16 sequence: run the model's self-test, forget the samples so far */
    FRAME_SET_RATE = 0x11,   /* u16 sequence, f32 Hz */
    FRAME_SET_RANGES = 0x12, /* u16 sequence, u16 dps, u16 g */
    FRAME_SET_FILTERS = 0x13, /* u16 sequence, u8 gyroscope's LPF1 (0xFF: off), u16 divisor of the accelerometer's bandwidth */
    FRAME_START = 0x14,      /* u16 sequence: stream samples, as the board does by itself */
    FRAME_STOP = 0x15,       /* u16 sequence: stream none */
    FRAME_TEST = 0x16,       /* u16 sequence: the sensor's self-test */
    FRAME_IDENTIFY = 0x17,   /* u16 sequence: info, board and faults at once */
    FRAME_SET_BAUD = 0x18,   /* u16 sequence, u32 baud of the host's port */
    FRAME_MOST = 80,         /* bytes of the longest frame, before encoding */
};

/* A frame being written, without its CRC. */
struct frame {
    uint8_t bytes[FRAME_MOST];
    unsigned count;
};

void frame_begin(struct frame *frame, uint8_t type, uint16_t sequence);
void frame_u8(struct frame *frame, uint8_t value);
void frame_u16(struct frame *frame, uint16_t value);
void frame_u32(struct frame *frame, uint32_t value);
void frame_f32(struct frame *frame, float value);

/* Append the CRC, encode, append the delimiter; the number of bytes in out, which holds FRAME_MOST + 2. */
unsigned frame_end(struct frame *frame, uint8_t *out);

/* Bytes of a stream between two delimiters. */
struct decoder {
    uint8_t bytes[FRAME_MOST + 1];
    unsigned count; /* FRAME_MOST + 2 once too many have come */
};

/* Take a byte; the length, without CRC, of the frame that it completes, decoded to decoder->bytes, or 0. */
unsigned frame_take(struct decoder *decoder, uint8_t byte);

uint16_t get_u16(const uint8_t *from);
uint32_t get_u32(const uint8_t *from);
float get_f32(const uint8_t *from);
void put_u32(uint8_t *to, uint32_t value);

#endif
