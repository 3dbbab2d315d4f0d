/* The I2C bus of the sketch's board, with its sensor.
 *
 * board FAMILY PERIOD_US START_US FAIL_EACH WHO < rows: a sensor of the family (mpu: 0x68, numbers high byte first, accelerometer, temperature,
 * gyroscope from 0x3B on, "new" goes when it is read; st: 0x6A, low byte first, temperature, gyroscope, accelerometer from 0x20 on, "new"
 * goes when the numbers are read) makes the rows gx gy gz ax ay az temp one after the other, one each period.  Each FAIL_EACH-th time its
 * numbers are not answered.  WHO: what it says that it is, 0: the usual.  Behind the last row the program ends. */
#include <cstdlib>
#include <cstring>

#include "Wire.h"
#include "board.h"

void setup();
void loop();

TwoWire Wire;

namespace {
double start_us, period_us, bus_hz = 100000;
bool is_st;
long fail_each, asked, seen = -1; /* the last row that was "new" */
uint8_t registers[256], address, pointer, to_write;
int rows[1 << 16][7];
long row_count;
uint8_t answer[256];
size_t answered, place;

bool on_the_bus(uint8_t chip) { return chip == (is_st ? 0x6A : 0x68); }

long present() { return (long)((now_us - start_us) / period_us) - 1; }

void pass_bytes(size_t count) { now_us += 9e6 * (double)count / bus_hz; }

/* Registers as they are when they are asked for. */
void refresh()
{
    const long row = present();
    if (row >= row_count)
        end();
    const bool fresh = row > seen && row >= 0;
    registers[is_st ? 0x1E : 0x3A] = fresh ? (is_st ? 0x07 : 0x01) : 0;
    if (row < 0)
        return;
    static const int MPU[] = {3, 4, 5, 6, 0, 1, 2}, ST[] = {6, 0, 1, 2, 3, 4, 5};
    for (int n = 0; n < 7; n++) {
        const uint16_t value = (uint16_t)rows[row][is_st ? ST[n] : MPU[n]];
        const int first = (is_st ? 0x20 : 0x3B) + 2 * n;
        registers[first + (is_st ? 1 : 0)] = (uint8_t)(value >> 8);
        registers[first + (is_st ? 0 : 1)] = (uint8_t)value;
    }
}
}

void TwoWire::begin() {}
void TwoWire::setClock(uint32_t hz) { bus_hz = hz; }
void TwoWire::beginTransmission(uint8_t chip) { address = chip, to_write = 0; }
size_t TwoWire::write(uint8_t byte)
{
    if (to_write++ == 0)
        pointer = byte;
    else if (on_the_bus(address))
        registers[pointer++] = byte;
    return 1;
}
uint8_t TwoWire::endTransmission(bool)
{
    pass_bytes(1u + to_write);
    return on_the_bus(address) ? 0 : 2;
}
uint8_t TwoWire::requestFrom(uint8_t chip, uint8_t count)
{
    answered = place = 0;
    if (!on_the_bus(chip))
        return 0;
    refresh();
    const bool numbers = count == 14;
    if (numbers && fail_each && ++asked % fail_each == 0)
        return 0;
    if (numbers == is_st && (numbers || pointer == 0x3A))
        seen = present();
    for (int n = 0; n < count; n++)
        answer[answered++] = registers[(uint8_t)(pointer + n)];
    pass_bytes(1u + count);
    return count;
}
int TwoWire::read() { return place < answered ? answer[place++] : -1; }

int main(int, char **words)
{
    is_st = !std::strcmp(words[1], "st");
    period_us = std::atof(words[2]);
    now_us = start_us = std::atof(words[3]);
    fail_each = std::atol(words[4]);
    for (int count = 0; std::scanf("%d", &rows[count / 7][count % 7]) == 1; row_count = ++count / 7)
        ;
    const int who = std::atoi(words[5]);
    registers[is_st ? 0x0F : 0x75] = (uint8_t)(who ? who : is_st ? 0x6B : 0x68);
    setup();
    std::fputs("set", stderr); /* what was written: the test looks at it */
    for (int n = 0; n < 128; n++)
        std::fprintf(stderr, " %d", registers[n]);
    for (;;)
        loop();
}
