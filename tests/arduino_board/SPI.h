#pragma once
#include "Arduino.h"

enum { MSBFIRST = 1, SPI_MODE3 = 0x0C };

struct SPISettings {
    SPISettings(uint32_t clock_hz, uint8_t order, uint8_t mode);
    uint32_t hz;
};

/* The bus, with the sensor at its other end. */
struct SPIClass {
    void begin();
    void beginTransaction(SPISettings settings);
    void endTransaction();
    uint8_t transfer(uint8_t byte);
};

extern SPIClass SPI;
