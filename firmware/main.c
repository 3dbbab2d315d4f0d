/* A sensor's registers in, the project's frames out.
 *
 * The host's port carries samples and, once a second, the info frame: a plain tinygc-frame/1 stream, ready to be recorded.  Whoever sends
 * a sample frame, on either port, gets the calibrated rate back on that port, so that it can pace itself by the answers.  Until somebody
 * has spoken a stand-in is streamed at the sensor's data rate: there is something to record at once. */
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

/* The data rate as the stamps show it: a real sensor would say it in INTERNAL_FREQ_FINE.  Counted from the first sample, and from each that
 * does not follow the one before. */
static struct {
    uint32_t first_us, last_us, samples;
    float odr_hz;
} pace;

static void send(enum port port, struct frame *frame)
{
    uint8_t encoded[FRAME_MOST + 2];
    board_write(port, encoded, frame_end(frame, encoded));
}

static void send_info(void)
{
    struct frame frame;
    frame_begin(&frame, FRAME_INFO, sequence);
    frame_u16(&frame, TINYGC_GYRO_FS_DPS);
    frame_u16(&frame, TINYGC_ACCEL_FS_G);
    frame_f32(&frame, pace.odr_hz);
    frame_u32(&frame, SERIAL);
    send(HOST, &frame);
}

/* Once a second the info frame; for the first time when a second of samples has shown their rate. */
static void keep_pace(uint32_t t_us)
{
    const uint32_t second = (uint32_t)TINYGC_ODR_HZ, step_us = t_us - pace.last_us;
    pace.last_us = t_us;
    if (pace.samples == 0 || step_us == 0 || step_us > 1500000u / second) {
        pace.first_us = t_us;
        pace.samples = 1;
        return;
    }
    if (pace.samples == second)
        pace.odr_hz = (float)second * 1e6f / (float)(t_us - pace.first_us);
    if (pace.samples % second == 0)
        send_info();
    pace.samples++;
}

static void send_sample(uint32_t t_us, const int16_t registers[7])
{
    struct frame frame;
    keep_pace(t_us);
    frame_begin(&frame, FRAME_SAMPLE, sequence++);
    frame_u32(&frame, t_us);
    for (int i = 0; i < 7; i++)
        frame_u16(&frame, (uint16_t)registers[i]);
    send(HOST, &frame);
}

static void answer_sample(enum port port, const uint8_t *bytes)
{
    struct frame frame;
    tinygc_input in;
    int16_t registers[7];
    float omega[3];
    for (int i = 0; i < 7; i++)
        registers[i] = (int16_t)get_u16(bytes + 7 + 2 * i);
    send_sample(get_u32(bytes + 3), registers);
    tinygc_from_registers(registers, &in);
    tinygc_step(&state, &in, omega);
    frame_begin(&frame, FRAME_CALIBRATED, get_u16(bytes + 1));
    frame_u32(&frame, get_u32(bytes + 3));
    for (int i = 0; i < 3; i++)
        frame_f32(&frame, omega[i]);
    send(port, &frame);
}

static void answer_hello(enum port port, const uint8_t *bytes)
{
    struct frame frame;
    float worst;
    const int failed = tinygc_self_test(&worst);
    tinygc_start(&state);
    frame_begin(&frame, FRAME_SELF_TEST, get_u16(bytes + 1));
    frame_u16(&frame, (uint16_t)failed);
    frame_f32(&frame, worst);
    frame_u32(&frame, TINYGC_MODEL_ID);
    send(port, &frame);
}

/* Whether the frame was one that we know. */
static int on_frame(enum port port, const uint8_t *bytes, unsigned count)
{
    if (bytes[0] == FRAME_SAMPLE && count == SAMPLE_BYTES)
        answer_sample(port, bytes);
    else if (bytes[0] == FRAME_HELLO && count == HELLO_BYTES)
        answer_hello(port, bytes);
    else
        return 0;
    return 1;
}

/* The stand-in's samples that are due by now; behind by more than a burst, it leaves some out, as a sensor would. */
static void play_standin(void)
{
    static uint32_t played;
    const uint32_t odr_mhz = (uint32_t)(TINYGC_ODR_HZ * 1000.0f);
    const uint32_t due = (uint32_t)((uint64_t)board_milliseconds() * odr_mhz / 1000000u);
    int16_t registers[7];
    if (due - played > BURST)
        played = due - BURST;
    for (; played != due; played++) {
        standin_read(played, registers);
        send_sample((uint32_t)((uint64_t)played * 1000000000u / odr_mhz), registers);
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
                fed |= on_frame((enum port)port, decoders[port].bytes, count);
        }
        if (!fed)
            play_standin();
        if (idle)
            board_wait();
    }
}
