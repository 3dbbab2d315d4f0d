/* A sensor's registers in, the project's frames out: each sample as it came, and calibrated by the exported model.
 *
 * Samples come as frames, from the sensor's port or from the host's.  Until a host or sensor has spoken, a stand-in is streamed at the
 * sensor's data rate, so that there is something to record. */
#include "board.h"
#include "frames.h"
#include "standin.h"
#include "tinygc_model.h"

#ifndef TINYGC_ODR_HZ
#error "this model was exported without a sensor: tinygc_from_registers and the full scales are missing"
#endif
#ifndef SERIAL
#define SERIAL 0
#endif

enum { BAUD = 921600, SAMPLE_BYTES = 21, HELLO_BYTES = 3, BURST = 8 };

static tinygc_state state;
static uint16_t sequence; /* of samples */
static uint32_t until_info;

static void send(struct frame *frame)
{
    uint8_t encoded[FRAME_MOST + 2];
    const unsigned count = frame_end(frame, encoded);
    board_write(HOST, encoded, count);
}

static void send_info(void)
{
    struct frame frame;
    frame_begin(&frame, FRAME_INFO, sequence);
    frame_u16(&frame, TINYGC_GYRO_FS_DPS);
    frame_u16(&frame, TINYGC_ACCEL_FS_G);
    frame_f32(&frame, TINYGC_ODR_HZ);
    frame_u32(&frame, SERIAL);
    send(&frame);
    until_info = (uint32_t)TINYGC_ODR_HZ;
}

static void send_self_test(void)
{
    struct frame frame;
    float worst;
    const int failed = tinygc_self_test(&worst);
    frame_begin(&frame, FRAME_SELF_TEST, sequence);
    frame_u16(&frame, (uint16_t)failed);
    frame_f32(&frame, worst);
    frame_u32(&frame, TINYGC_MODEL_ID);
    send(&frame);
}

static void on_sample(uint32_t t_us, const int16_t registers[7])
{
    struct frame frame;
    tinygc_input in;
    float omega[3];
    if (until_info == 0)
        send_info();
    until_info--;
    tinygc_from_registers(registers, &in);
    tinygc_step(&state, &in, omega);
    frame_begin(&frame, FRAME_SAMPLE, sequence);
    frame_u32(&frame, t_us);
    for (int i = 0; i < 7; i++)
        frame_u16(&frame, (uint16_t)registers[i]);
    send(&frame);
    frame_begin(&frame, FRAME_CALIBRATED, sequence);
    frame_u32(&frame, t_us);
    for (int i = 0; i < 3; i++)
        frame_f32(&frame, omega[i]);
    send(&frame);
    sequence++;
}

/* Whether the frame was one that we know. */
static int on_frame(const uint8_t *bytes, unsigned count)
{
    if (bytes[0] == FRAME_SAMPLE && count == SAMPLE_BYTES) {
        int16_t registers[7];
        for (int i = 0; i < 7; i++)
            registers[i] = (int16_t)get_u16(bytes + 7 + 2 * i);
        on_sample(get_u32(bytes + 3), registers);
        return 1;
    }
    if (bytes[0] == FRAME_HELLO && count == HELLO_BYTES) {
        tinygc_start(&state);
        sequence = 0;
        send_info();
        send_self_test();
        return 1;
    }
    return 0;
}

/* The stand-in's samples that are due by now; behind by more than a burst, it leaves some out, as a sensor would. */
static void play_standin(void)
{
    static uint32_t played;
    const uint32_t due = (uint32_t)((float)board_milliseconds() * (TINYGC_ODR_HZ / 1000.0f));
    int16_t registers[7];
    if (due - played > BURST)
        played = due - BURST;
    for (; played != due; played++) {
        standin_read(played, registers);
        on_sample((uint32_t)((uint64_t)played * 1000000u / (uint32_t)TINYGC_ODR_HZ), registers);
    }
}

int main(void)
{
    static struct decoder decoders[PORTS];
    int fed = 0;
    tinygc_start(&state);
    board_start(BAUD);
    for (;;) {
        int idle = 1;
        for (int port = 0; port < PORTS; port++) {
            const int byte = board_read((enum port)port);
            if (byte < 0)
                continue;
            idle = 0;
            const unsigned count = frame_take(&decoders[port], (uint8_t)byte);
            if (count > 0)
                fed |= on_frame(decoders[port].bytes, count);
        }
        if (!fed)
            play_standin();
        if (idle)
            board_wait();
    }
}
