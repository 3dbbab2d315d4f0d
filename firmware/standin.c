/* Level, still for 416 samples, then turning about one axis for 624, each axis in turn, either way; noise of some LSB.  Gravity does not
 * turn with it: it shows that the stream flows, and calibrates nothing. */
#include "standin.h"

enum { STILL = 416, TURN = 624, PEAK = 12000, ONE_G = 8197 };

static int noise(uint32_t *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (int)(*seed >> 28) - 8;
}

void standin_read(uint32_t n, int16_t registers[7])
{
    uint32_t seed = n;
    const uint32_t turn = n / (STILL + TURN), at = n % (STILL + TURN);
    for (int i = 0; i < 7; i++)
        registers[i] = (int16_t)noise(&seed);
    registers[5] = (int16_t)(registers[5] - ONE_G);
    if (at >= STILL) {
        /* A parabola, zero at both ends. */
        const int32_t done = (int32_t)(at - STILL);
        const int32_t rate = 4 * PEAK * (done * (TURN - done) / TURN) / TURN;
        registers[turn % 3] = (int16_t)(registers[turn % 3] + (turn & 1 ? -rate : rate));
    }
}
