/* The sketches' board: time passes by what is sent on the bus and waited for at the port, and by nothing else.  What the port sends is the
 * standard output. */
#include "board.h"

#include <cstdlib>

HardwareSerial Serial;
double now_us;

namespace {
constexpr double BITS_A_BYTE = 10;
constexpr size_t BUFFER = 64; /* bytes, as on an ATmega328P */

double baud = 9600, sent_us;

size_t print_as(const char *form, unsigned long number)
{
    char text[32];
    std::snprintf(text, sizeof text, form, number);
    return Serial.print(text);
}
}

[[noreturn]] void end()
{
    std::fflush(stdout);
    std::_Exit(0);
}

unsigned long micros() { return (uint32_t)(unsigned long long)(now_us += 4); }
unsigned long millis() { return (unsigned long)(now_us / 1000); }
void delay(unsigned long ms) { now_us += 1000.0 * (double)ms; }
void delayMicroseconds(unsigned us) { now_us += us; }

void HardwareSerial::begin(unsigned long rate) { baud = (double)rate, sent_us = now_us; }
size_t HardwareSerial::write(uint8_t byte)
{
    const double byte_us = BITS_A_BYTE * 1e6 / baud;
    if (sent_us < now_us)
        sent_us = now_us;
    sent_us += byte_us;
    if (sent_us - now_us > BUFFER * byte_us)
        now_us = sent_us - BUFFER * byte_us;
    std::putchar(byte);
    return 1;
}
size_t HardwareSerial::print(const char *text)
{
    size_t count = 0;
    for (; text[count]; count++)
        write((uint8_t)text[count]);
    return count;
}
size_t HardwareSerial::print(char letter) { return write((uint8_t)letter); }
size_t HardwareSerial::print(unsigned long number) { return print_as("%lu", number); }
size_t HardwareSerial::print(int number) { return print_as("%ld", (unsigned long)(long)number); }
size_t HardwareSerial::print(unsigned number) { return print((unsigned long)number); }
size_t HardwareSerial::print(double number, int digits)
{
    char text[64];
    std::snprintf(text, sizeof text, "%.*f", digits, number);
    return print(text);
}
size_t HardwareSerial::println(const char *text) { return print(text) + print("\r\n"); }
size_t HardwareSerial::println(int number) { return print(number) + print("\r\n"); }
size_t HardwareSerial::println() { return print("\r\n"); }
