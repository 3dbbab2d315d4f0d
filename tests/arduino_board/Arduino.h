/* As much of an Arduino as the sketches of firmware/examples need, on this machine and in simulated time (board.cpp). */
#pragma once
#include <cstddef>
#include <cstdint>
#include <cstdio>

unsigned long micros();
unsigned long millis();
void delay(unsigned long ms);
void delayMicroseconds(unsigned us);

#define PROGMEM
inline uint8_t pgm_read_byte(const void *address) { return *(const uint8_t *)address; }

enum { LOW, HIGH, OUTPUT = 1, SS = 10 };
void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t level);

/* A port whose bytes leave at its baud rate; whoever writes into a full buffer waits. */
struct HardwareSerial {
    void begin(unsigned long baud);
    size_t write(uint8_t byte);
    size_t print(const char *text);
    size_t print(char letter);
    size_t print(int number);
    size_t print(unsigned number);
    size_t print(unsigned long number);
    size_t print(double number, int digits = 2);
    size_t println(const char *text);
    size_t println(int number);
    size_t println();
};

extern HardwareSerial Serial;
