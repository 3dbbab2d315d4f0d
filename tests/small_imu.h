/* A small IMU of ST's family on SPI, in the time of whoever asks: as much of it as the driver of firmware/ uses, written from the facts
 * of its registers and not from the driver.  The time slots of its FIFO hold the rows of the standard input, one after the other. */
#ifndef SMALL_IMU_H
#define SMALL_IMU_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Words of the command line: WHO_AM_I, INTERNAL_FREQ_FINE, ticks of a period at the highest rate, seconds after which it first answers,
 * the row whose accelerometer word has a false parity (-1: none's).  Reads the rows gx gy gz ax ay az. */
void imu_begin(char **words);

/* Whether rows are left, and are made: for four seconds nobody need have asked. */
int imu_goes_on(double now_us);

/* Chip select; low where selected. */
void imu_select(int selected);

/* A byte each way, at the time in microseconds since power-up.  Aborts where anything but ones is sent in a read: a sensor that has
 * missed the address would take it for a write. */
uint8_t imu_exchange(uint8_t sent, double now_us);

#ifdef __cplusplus
}
#endif
#endif
