/* Registers over the bus, and transfers to their end. */
#include "lsm6dsx.h"
#include "lsm6dsx_registers.h"

enum { REGISTERS_MOST_US = 1000 }; /* 31 bytes take 0.2 ms at 1.6 MHz */

bool lsm6dsx_transfer(struct lsm6dsx *sensor, const uint8_t *out, uint8_t *in, unsigned count)
{
    const uint32_t began_us = sensor->bus->time();
    int result = TRANSFER_FAILED;
    if (!sensor->failed) {
        do
            result = sensor->bus->transfer(out, in, count);
        while ((result == TRANSFER_BUSY) && (sensor->bus->time() - began_us < REGISTERS_MOST_US));
    }
    if (result != TRANSFER_DONE)
        sensor->failed = true;
    return result == TRANSFER_DONE;
}

void lsm6dsx_read(struct lsm6dsx *sensor, uint8_t address, uint8_t *bytes, unsigned count)
{
    const uint8_t out = (uint8_t)(READ | address);
    sensor->bus->select(1);
    if (!lsm6dsx_transfer(sensor, &out, 0, 1) || !lsm6dsx_transfer(sensor, 0, bytes, count)) {
        for (unsigned n = 0; n < count; n++)
            bytes[n] = 0;
    }
    sensor->bus->select(0);
}

uint8_t lsm6dsx_read_one(struct lsm6dsx *sensor, uint8_t address)
{
    uint8_t byte;
    lsm6dsx_read(sensor, address, &byte, 1);
    return byte;
}

void lsm6dsx_write(struct lsm6dsx *sensor, uint8_t address, uint8_t value)
{
    const uint8_t out[2] = {address, value};
    sensor->bus->select(1);
    (void)lsm6dsx_transfer(sensor, out, 0, 2); /* failed holds the result */
    sensor->bus->select(0);
}
