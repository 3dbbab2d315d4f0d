/* The SPI bus of the sketch's board, with the sensor of small_imu.c: board WHO FREQ_FINE TICKS ANSWERS_S SPOILT START_US < rows. */
#include <cstdlib>

#include "SPI.h"
#include "board.h"
#include "small_imu.h"

void setup();
void loop();

SPIClass SPI;

namespace {
constexpr double LOOP_US = 5; /* that a loop takes which asks for no time */

double began_us, bus_hz; /* when the sensor was switched on; 0 outside a transaction */

void demand(bool met)
{
    if (!met)
        std::abort(); /* the sketch uses its bus as no board allows */
}
}

SPISettings::SPISettings(uint32_t clock_hz, uint8_t order, uint8_t mode) : hz(clock_hz) { demand(order == MSBFIRST && mode == SPI_MODE3); }

void pinMode(uint8_t pin, uint8_t mode) { demand(pin == SS && mode == OUTPUT); }
void digitalWrite(uint8_t pin, uint8_t level)
{
    demand(pin == SS);
    imu_select(level == LOW);
}

void SPIClass::begin() {}
void SPIClass::beginTransaction(SPISettings settings)
{
    demand(bus_hz == 0);
    bus_hz = settings.hz;
}
void SPIClass::endTransaction()
{
    demand(bus_hz > 0);
    bus_hz = 0;
}
uint8_t SPIClass::transfer(uint8_t byte)
{
    demand(bus_hz > 0);
    now_us += 8e6 / bus_hz;
    if (!imu_goes_on(now_us - began_us))
        end();
    return imu_exchange(byte, now_us - began_us);
}

int main(int, char **words)
{
    imu_begin(words + 1);
    now_us = began_us = std::atof(words[6]);
    setup();
    for (; imu_goes_on(now_us - began_us); now_us += LOOP_US)
        loop();
    end();
}
