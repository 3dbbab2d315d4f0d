#include "sensor.h"

#include "board.h"
#include "board_spi.h"
#include "defaults.h"
#include "stream.h"

enum { TRIES = 3 };

static const struct lsm6dsx_bus BUS = {board_spi_transfer, board_spi_select, board_wait_us, board_microseconds};

static struct lsm6dsx sensor;

void sensor_start(void)
{
    struct lsm6dsx_settings settings = {GYRO_FS_DPS, ACCEL_FS_G, lsm6dsx_odr((float)ODR_HZ), LPF1_OFF, 2};
    if (!lsm6dsx_possible(&settings)) /* the model is of another sensor */
        settings = (struct lsm6dsx_settings){500, 4, 6, LPF1_OFF, 2};
    board_spi_start();
    lsm6dsx_attach(&sensor, &BUS, &settings);
    for (int n = 0; n < TRIES && !sensor.found; n++)
        lsm6dsx_start(&sensor);
}

int sensor_found(void)
{
    return sensor.found;
}

const struct lsm6dsx *sensor_state(void)
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
    const unsigned count = lsm6dsx_poll(&sensor, samples);
    for (unsigned n = 0; n < count; n++) {
        stream_sample(samples[n].number - number, samples[n].t_us, samples[n].registers);
        number = samples[n].number;
    }
    more = count > 0;
    return more;
}

enum fault sensor_set(const struct lsm6dsx_settings *settings)
{
    const struct lsm6dsx_settings before = sensor.settings;
    sensor.settings = *settings;
    const enum fault fault = lsm6dsx_start(&sensor);
    if (!sensor.found)
        sensor.settings = before;
    return fault;
}

void sensor_test(struct lsm6dsx_tested *tested)
{
    lsm6dsx_self_test(&sensor, tested);
    lsm6dsx_start(&sensor);
}
