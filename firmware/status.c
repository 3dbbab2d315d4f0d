#include "status.h"

#include "board.h"
#include "board_watchdog.h"
#include "defaults.h"
#include "identity.h"
#include "sensor.h"
#include "stream.h"

enum { EACH_MS = 1000, FAULTS_AGAIN_MS = 100 };

/* Who gives the samples. */
enum { FROM_STANDIN = 0, FROM_SENSOR = 1 };

static uint32_t serial, rate_of_port, sent_ms, faults_ms, faults_sent;

/* The data rate of samples that others give, as the stamps show it.  Counted from the first sample, and from each that does not follow the
 * one before. */
static struct {
    uint32_t first_us, last_us, samples;
    float odr_hz;
} pace;

void status_start(uint32_t baud)
{
    serial = identity_serial();
    rate_of_port = baud;
}

void status_baud(uint32_t baud)
{
    rate_of_port = baud;
}

uint32_t status_rate_of_port(void)
{
    return rate_of_port;
}

static void send_info(void)
{
    const struct lsm6dsx_settings *settings = &sensor_state()->settings;
    const bool sensor = sensor_found();
    const float paced_hz = pace.odr_hz > 0.0f ? pace.odr_hz : (float)ODR_HZ;
    struct frame frame;
    frame_begin(&frame, FRAME_INFO, stream_sequence());
    frame_u16(&frame, sensor ? settings->gyro_fs_dps : (uint16_t)GYRO_FS_DPS);
    frame_u16(&frame, sensor ? settings->accel_fs_g : (uint16_t)ACCEL_FS_G);
    frame_f32(&frame, sensor ? sensor_rate_hz() : paced_hz);
    frame_u32(&frame, serial);
    (void)stream_frame(HOST, &frame);
}

static void send_board(void)
{
    const struct lsm6dsx *sensor = sensor_state();
    struct frame frame;
    frame_begin(&frame, FRAME_BOARD, stream_sequence());
    frame_u8(&frame, sensor_found() ? FROM_SENSOR : FROM_STANDIN);
    const uint8_t runs = sensor->running ? 2u : 0u;
    const uint8_t settles = (sensor->running && (sensor->fifo.settled == 0u)) ? 4u : 0u;
    frame_u8(&frame, (uint8_t)((unsigned)stream_is_on() | (unsigned)runs | (unsigned)settles | ((unsigned)board_cause() << 3)));
    frame_u8(&frame, FIRMWARE_MAJOR);
    frame_u8(&frame, FIRMWARE_MINOR);
    frame_u8(&frame, FIRMWARE_PATCH);
    frame_u8(&frame, sensor->who);
    frame_u8(&frame, (uint8_t)sensor->freq_fine);
    for (int n = LSM6DSX_KEPT_WHO + 1; n < LSM6DSX_KEPT; n++)
        frame_u8(&frame, sensor->kept[n]);
    frame_u32(&frame, rate_of_port);
    frame_f32(&frame, sensor_found() ? lsm6dsx_nominal_hz(sensor->settings.odr) : (float)ODR_HZ);
    (void)stream_frame(HOST, &frame);
}

static uint32_t all_faults(void)
{
    uint32_t sum = stream_crowded_out();
    for (int fault = 0; fault < FAULTS; fault++)
        sum += sensor_state()->faults[fault];
    return sum;
}

static void send_faults(void)
{
    struct frame frame;
    frame_begin(&frame, FRAME_FAULTS, stream_sequence());
    for (int fault = 0; fault < FAULT_RATE; fault++)
        frame_u32(&frame, sensor_state()->faults[fault]);
    frame_u32(&frame, stream_crowded_out()); /* firmware 1.0 ended here */
    frame_u32(&frame, sensor_state()->faults[FAULT_RATE]);
    if (stream_frame(HOST, &frame))
        faults_sent = all_faults();
    faults_ms = board_milliseconds();
}

void status_send(void)
{
    sent_ms = board_milliseconds();
    send_info();
    send_board();
    send_faults();
}

void status_service(void)
{
    const uint32_t now_ms = board_milliseconds();
    if (!sensor_found())
        return;
    if (now_ms - sent_ms >= EACH_MS)
        status_send();
    else if (now_ms - faults_ms >= FAULTS_AGAIN_MS && all_faults() != faults_sent)
        send_faults();
}

void status_pace(uint32_t t_us)
{
    const uint32_t second = (uint32_t)ODR_HZ, step_us = t_us - pace.last_us;
    pace.last_us = t_us;
    if (pace.samples == 0 || step_us == 0 || step_us > 1500000u / second) {
        pace.first_us = t_us;
        pace.samples = 1;
        return;
    }
    if (pace.samples == second)
        pace.odr_hz = (float)second * 1e6f / (float)(t_us - pace.first_us);
    if (pace.samples % second == 0)
        status_send();
    pace.samples++;
}
