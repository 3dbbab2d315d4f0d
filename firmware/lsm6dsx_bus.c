/* Registers over the bus, and transfers to their end. */
#include "lsm6dsx.h"
#include "lsm6dsx_registers.h"

int lsm6dsx_transfer(struct lsm6dsx *sensor, const uint8_t *out, uint8_t *in, unsigned count)
{
    const uint32_t began = sensor->bus->time();
    int result;
    do
        result = sensor->bus->transfer(out, in, count);
    while (result == TRANSFER_BUSY && sensor->bus->time() - began < TRANSFER_MOST_US);
    sensor->failed |= result != TRANSFER_DONE;
    return result;
}

void lsm6dsx_read(struct lsm6dsx *sensor, uint8_t address, uint8_t *bytes, unsigned count)
{
    const uint8_t out = READ | address;
    sensor->bus->select(1);
    if (lsm6dsx_transfer(sensor, &out, 0, 1) != TRANSFER_DONE || lsm6dsx_transfer(sensor, 0, bytes, count) != TRANSFER_DONE)
        for (unsigned n = 0; n < count; n++)
            bytes[n] = 0;
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
    lsm6dsx_transfer(sensor, out, 0, 2);
    sensor->bus->select(0);
}
