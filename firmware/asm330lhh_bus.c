/* Registers over the bus, and transfers to their end. */
#include "asm330lhh.h"
#include "asm330lhh_registers.h"

int asm330lhh_transfer(struct asm330lhh *sensor, const uint8_t *out, uint8_t *in, unsigned count)
{
    const uint32_t began = sensor->bus->time();
    int result;
    do
        result = sensor->bus->transfer(out, in, count);
    while (result == TRANSFER_BUSY && sensor->bus->time() - began < TRANSFER_MOST_US);
    sensor->failed |= result != TRANSFER_DONE;
    return result;
}

void asm330lhh_read(struct asm330lhh *sensor, uint8_t address, uint8_t *bytes, unsigned count)
{
    const uint8_t out = READ | address;
    sensor->bus->select(1);
    if (asm330lhh_transfer(sensor, &out, 0, 1) != TRANSFER_DONE || asm330lhh_transfer(sensor, 0, bytes, count) != TRANSFER_DONE)
        for (unsigned n = 0; n < count; n++)
            bytes[n] = 0;
    sensor->bus->select(0);
}

uint8_t asm330lhh_read_one(struct asm330lhh *sensor, uint8_t address)
{
    uint8_t byte;
    asm330lhh_read(sensor, address, &byte, 1);
    return byte;
}

void asm330lhh_write(struct asm330lhh *sensor, uint8_t address, uint8_t value)
{
    const uint8_t out[2] = {address, value};
    sensor->bus->select(1);
    asm330lhh_transfer(sensor, out, 0, 2);
    sensor->bus->select(0);
}
