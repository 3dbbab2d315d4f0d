#include "answers.h"

#include "frames.h"
#include "sensor.h"
#include "status.h"
#include "stream.h"
#include "tinygc_model.h"

enum { SAMPLE_BYTES = 21, HELLO_BYTES = 3 };

static tinygc_state state;

void answers_start(void)
{
    tinygc_start(&state);
}

/* It is streamed as well, as if the board's sensor had given it, unless there is one. */
static void answer_sample(enum port port, const uint8_t *bytes)
{
    const uint32_t t_us = get_u32(bytes + 3);
    struct frame frame;
    tinygc_input in;
    int16_t registers[7];
    float omega[3];
    for (int i = 0; i < 7; i++)
        registers[i] = (int16_t)get_u16(bytes + 7 + 2 * i);
    if (!sensor_found()) {
        status_pace(t_us);
        stream_sample(1, t_us, registers);
    }
    tinygc_from_registers(registers, &in);
    tinygc_step(&state, &in, omega);
    frame_begin(&frame, FRAME_CALIBRATED, get_u16(bytes + 1));
    frame_u32(&frame, t_us);
    for (int i = 0; i < 3; i++)
        frame_f32(&frame, omega[i]);
    stream_frame(port, &frame);
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
    stream_frame(port, &frame);
}

int answers_take(enum port port, const uint8_t *bytes, unsigned count)
{
    if (bytes[0] == FRAME_SAMPLE && count == SAMPLE_BYTES)
        answer_sample(port, bytes);
    else if (bytes[0] == FRAME_HELLO && count == HELLO_BYTES)
        answer_hello(port, bytes);
    else
        return 0;
    return 1;
}
