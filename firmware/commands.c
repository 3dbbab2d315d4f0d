#include "commands.h"

#include "board.h"
#include "board_send.h"
#include "board_spi.h"
#include "frames.h"
#include "sensor.h"
#include "status.h"
#include "stream.h"

/* The second byte of an answer; LATER is none: it comes when the sensor has done it. */
enum result { DONE, UNKNOWN, IMPOSSIBLE, NO_SENSOR, TOO_QUICK, NOT_TAKEN, TEST_FAILED, LATER };

enum { TRIAL_MS = 5000, HEAD = 3 };

static struct {
    uint32_t before, began_ms; /* the port's rate of before, or 0 */
} trial;

/* The command that is being obeyed: no other one is taken meanwhile. */
static struct {
    enum port port;
    uint8_t bytes[HEAD];
    bool waits;
} pending;

static enum result set(const struct lsm6dsx_settings *settings)
{
    if (!lsm6dsx_possible(settings, sensor_state()->chip))
        return IMPOSSIBLE;
    const float hz = fifo_rate_hz(settings->odr, sensor_state()->freq_fine);
    if (!stream_carries(hz, status_rate_of_port()) || !board_spi_carries(hz))
        return TOO_QUICK;
    sensor_set(settings);
    return LATER;
}

static enum result was_set(void)
{
    const enum fault fault = sensor_outcome();
    if (fault == FAULTS)
        return DONE;
    if (fault == LSM6DSX_IMPOSSIBLE)
        return IMPOSSIBLE;
    return sensor_found() ? NOT_TAKEN : NO_SENSOR;
}

static enum result test(void)
{
    if (!sensor_found())
        return NO_SENSOR;
    sensor_test();
    return LATER;
}

static enum result was_tested(uint16_t sequence, enum port port)
{
    const struct lsm6dsx_tested *tested = sensor_tested();
    struct frame frame;
    frame_begin(&frame, FRAME_TESTED, sequence);
    frame_u16(&frame, tested->failed);
    for (int i = 0; i < 3; i++)
        frame_f32(&frame, tested->gyro_dps[i]);
    for (int i = 0; i < 3; i++)
        frame_f32(&frame, tested->accel_mg[i]);
    (void)stream_frame(port, &frame);
    return (tested->failed != 0u) ? TEST_FAILED : DONE;
}

static enum result possible_baud(uint32_t baud)
{
    if (baud < BAUD_LEAST || baud > BAUD_MOST)
        return IMPOSSIBLE;
    return sensor_found() && !stream_carries(sensor_rate_hz(), baud) ? TOO_QUICK : DONE;
}

static void change_baud(uint32_t baud)
{
    board_send_baud(baud);
    status_baud(baud);
}

static void answer(enum port port, const uint8_t *bytes, enum result result)
{
    struct frame frame;
    frame_begin(&frame, FRAME_DONE, get_u16(bytes + 1));
    frame_u8(&frame, bytes[0]);
    frame_u8(&frame, (uint8_t)result);
    (void)stream_frame(port, &frame);
}

/* Bytes of a command, or 0 where there is none of that type. */
static unsigned length_of(uint8_t type)
{
    switch (type) {
    case FRAME_SET_RATE:
    case FRAME_SET_RANGES:
    case FRAME_SET_BAUD:
        return HEAD + 4;
    case FRAME_SET_FILTERS:
        return HEAD + 3;
    case FRAME_START:
    case FRAME_STOP:
    case FRAME_TEST:
    case FRAME_IDENTIFY:
        return HEAD;
    default:
        return 0;
    }
}

static enum result obey(const uint8_t *bytes)
{
    struct lsm6dsx_settings settings = sensor_state()->settings;
    const uint8_t *body = bytes + HEAD;
    switch (bytes[0]) {
    case FRAME_SET_RATE:
        settings.odr = lsm6dsx_odr(get_f32(body));
        return set(&settings);
    case FRAME_SET_RANGES:
        settings.gyro_fs_dps = get_u16(body);
        settings.accel_fs_g = get_u16(body + 2);
        return set(&settings);
    case FRAME_SET_FILTERS:
        settings.gyro_lpf1 = body[0];
        settings.accel_lpf2_divisor = get_u16(body + 1);
        return set(&settings);
    case FRAME_START:
    case FRAME_STOP:
        stream_switch(bytes[0] == FRAME_START);
        return DONE;
    case FRAME_TEST:
        return test();
    case FRAME_SET_BAUD:
        return possible_baud(get_u32(body));
    default:
        return DONE;
    }
}

int commands_take(enum port port, const uint8_t *bytes, unsigned count)
{
    const unsigned length = length_of(bytes[0]);
    if (bytes[0] <= FRAME_HELLO || bytes[0] >= 0x20) /* not a command at all */
        return 0;
    const enum result result = !length ? UNKNOWN : length != count ? IMPOSSIBLE : obey(bytes);
    if (result == LATER) {
        pending.port = port;
        pending.waits = true;
        for (unsigned n = 0; n < HEAD; n++)
            pending.bytes[n] = bytes[n];
        return 1;
    }
    answer(port, bytes, result);
    if ((result == DONE) && (bytes[0] == FRAME_SET_BAUD)) {
        trial.before = trial.before ? trial.before : status_rate_of_port();
        trial.began_ms = board_milliseconds();
        change_baud(get_u32(bytes + HEAD));
    } else if (result == DONE) {
        status_send();
    }
    return 1;
}

void commands_heard(void)
{
    trial.before = 0;
}

void commands_service(void)
{
    if (pending.waits && !sensor_busy()) {
        const enum result result = (pending.bytes[0] == FRAME_TEST) ? was_tested(get_u16(&pending.bytes[1]), pending.port) : was_set();
        pending.waits = false;
        answer(pending.port, pending.bytes, result);
        if ((result == DONE) || (result == TEST_FAILED))
            status_send();
    }
    if (trial.before && board_milliseconds() - trial.began_ms >= TRIAL_MS) {
        change_baud(trial.before);
        trial.before = 0;
    }
}
