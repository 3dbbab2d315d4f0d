/* A sensor's registers in, the project's frames out.
 *
 * The host's port carries samples, and once a second the status of the board: a tinygc-frame/1 stream, ready to be recorded.  The
 * samples are those of the sensor.  Without one a stand-in streams at the model's data rate, and the board frame states it: there is
 * something to try the host with.  Whoever sends a sample frame, on either port, gets the calibrated rate back on that port, so that it can
 * pace itself by the answers; without a sensor the stand-in then falls silent, and what was sent is streamed. */
#include "answers.h"
#include "board.h"
#include "board_watchdog.h"
#include "commands.h"
#include "defaults.h"
#include "frames.h"
#include "sensor.h"
#include "standin.h"
#include "status.h"
#include "stream.h"

_Static_assert((double)ODR_HZ * 250 + 2000 <= BAUD, "BAUD does not carry this data rate: make BAUD=2000000");

enum { BURST = 8 };

/* The stand-in's samples that are due by now; behind by more than a burst, it leaves some out, as a sensor would. */
static void play_standin(void)
{
    static uint32_t played;
    const uint32_t odr_mhz = (uint32_t)((float)ODR_HZ * 1000.0f);
    const uint32_t due = (uint32_t)((uint64_t)board_milliseconds() * odr_mhz / 1000000u);
    int16_t registers[7];
    if (due - played > BURST)
        played = due - BURST;
    for (; played != due; played++) {
        const uint32_t t_us = (uint32_t)((uint64_t)played * 1000000000u / odr_mhz);
        standin_read(played, registers);
        status_pace(t_us);
        stream_sample(1, t_us, registers);
    }
}

/* Whether a byte has come in; fed: the model has received input. */
static int hear(enum port port, int *fed)
{
    static struct decoder decoders[PORTS];
    const int byte = board_read(port);
    if (byte < 0)
        return 0;
    const unsigned count = frame_take(&decoders[port], (uint8_t)byte);
    const uint8_t *bytes = decoders[port].bytes;
    if (count == 0)
        return 1;
    if (port == HOST)
        commands_heard();
    if (!commands_take(port, bytes, count))
        *fed |= answers_take(port, bytes, count);
    return 1;
}

int main(void)
{
    int fed = 0;
    bool looked = false;
    answers_start();
    board_start(BAUD);
    status_start(BAUD);
    sensor_start();
    for (;;) {
        int busy = 0;
        for (int port = 0; port < PORTS; port++) {
            if (!sensor_busy()) /* what comes meanwhile waits its turn */
                busy |= hear((enum port)port, &fed);
        }
        busy |= sensor_stream() ? 1 : 0;
        if (!looked && !sensor_busy()) {
            status_send(); /* whose samples follow, before the first of them */
            looked = true;
        }
        status_service();
        commands_service();
        if (looked && !fed && !sensor_found())
            play_standin();
        board_alive();
        if (!busy)
            board_wait();
    }
}
