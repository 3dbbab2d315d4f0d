/* Defaults until the host changes them: the ranges and the rate of the model that it carries, or those of the make options. */
#ifndef DEFAULTS_H
#define DEFAULTS_H

#ifdef RECORDER
#ifndef GYRO_FS_DPS
#define GYRO_FS_DPS 500
#endif
#ifndef ACCEL_FS_G
#define ACCEL_FS_G 4
#endif
#ifndef ODR_HZ
#define ODR_HZ 417
#endif
#else
#include "tinygc_model.h"
#ifndef TINYGC_ODR_HZ
#error "this model was exported without a sensor: tinygc_from_registers and the full scales are missing"
#endif
#define GYRO_FS_DPS TINYGC_GYRO_FS_DPS
#define ACCEL_FS_G TINYGC_ACCEL_FS_G
#define ODR_HZ TINYGC_ODR_HZ
#endif

#ifndef BAUD
#define BAUD 921600
#endif

/* Of the sensor's SPI: 84 MHz over 16, 32, 64, 128 or 256. */
#ifndef SPI_DIVIDER
#define SPI_DIVIDER 16
#endif

/* Of this program, as in the board frame. */
enum { FIRMWARE_MAJOR = 1, FIRMWARE_MINOR = 1, FIRMWARE_PATCH = 0 };

#endif
