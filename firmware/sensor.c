#include "sensor.h"

#include "board.h"
#include "board_spi.h"
#include "defaults.h"
#include "stream.h"

enum { TRIES = 3 };

static const struct asm330lhh_bus BUS = {board_spi_transfer, board_spi_select, board_wait_us, board_microseconds};

static struct asm330lhh sensor;

void sensor_start(void)
{
    struct asm330lhh_settings settings = {GYRO_FS_DPS, ACCEL_FS_G, asm330lhh_odr((float)ODR_HZ), LPF1_OFF, 2};
    if (!asm330lhh_possible(&settings)) /* the model is of another sensor */
        settings = (struct asm330lhh_settings){500, 4, 6, LPF1_OFF, 2};
    board_spi_start();
    asm330lhh_attach(&sensor, &BUS, &settings);
    for (int n = 0; n < TRIES && !sensor.found; n++)
        asm330lhh_start(&sensor);
}

int sensor_found(void)
{
    return sensor.found;
}

const struct asm330lhh *sensor_state(void)
{
    return &sensor;
}

float sensor_rate_hz(void)
{
    return fifo_rate_hz(sensor.settings.odr, sensor.freq_fine);
}

int sensor_stream(void)
{
    static struct fifo_sample samples[FIFO_SAMPLES];
    static uint32_t polled_ms, number;
    static int more;
    const uint32_t now_ms = board_milliseconds();
    if (!sensor.found || (!more && !sensor.burst && now_ms == polled_ms))
        return 0;
    polled_ms = now_ms;
    const unsigned count = asm330lhh_poll(&sensor, samples);
    for (unsigned n = 0; n < count; n++) {
        stream_sample(samples[n].number - number, samples[n].t_us, samples[n].registers);
        number = samples[n].number;
    }
    more = count > 0;
    return more;
}

enum fault sensor_set(const struct asm330lhh_settings *settings)
{
    const struct asm330lhh_settings before = sensor.settings;
    sensor.settings = *settings;
    const enum fault fault = asm330lhh_start(&sensor);
    if (!sensor.found)
        sensor.settings = before;
    return fault;
}

void sensor_test(struct asm330lhh_tested *tested)
{
    asm330lhh_self_test(&sensor, tested);
    asm330lhh_start(&sensor);
}
