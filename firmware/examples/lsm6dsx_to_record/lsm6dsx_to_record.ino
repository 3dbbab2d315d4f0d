// An IMU of ST's family (ASM330LHH, LSM6DSO) on SPI for `calibrate.py record --baud 115200`: the driver of firmware/, its samples as text.
// docs/boards.md explains wiring, rates and memory.
#include <SPI.h>
extern "C" {
#include "lsm6dsx.h"
}
const unsigned long BAUD = 115200;
const unsigned long ODR_HZ = 104; // 12 (which is 12.5), 26, 52, 104, 208, 417, 833
const uint16_t GYRO_FS_DPS = 500, ACCEL_FS_G = 4;
const char SERIAL_NUMBER[] = "bench-1"; // another one for each sensor
const uint8_t CS = SS;                  // the sensor's chip select
const unsigned long SPI_HZ = 4000000;   // 10 MHz at most; mode 3

static_assert(ODR_HZ == 12 || ODR_HZ == 26 || ODR_HZ == 52 || ODR_HZ == 104 || ODR_HZ == 208 || ODR_HZ == 417 || ODR_HZ == 833 ||
              ODR_HZ == 1667 || ODR_HZ == 3333 || ODR_HZ == 6667, "the sensor has no such data rate; 12 is 12.5");
static_assert(GYRO_FS_DPS == 125 || GYRO_FS_DPS == 250 || GYRO_FS_DPS == 500 || GYRO_FS_DPS == 1000 || GYRO_FS_DPS == 2000 ||
              GYRO_FS_DPS == 4000, "the gyroscope has no such range");
static_assert(ACCEL_FS_G == 2 || ACCEL_FS_G == 4 || ACCEL_FS_G == 8 || ACCEL_FS_G == 16, "the accelerometer has no such range");
const unsigned long LINE_BYTES = 61; // at most, ten bits each, with 15 % to spare
static_assert(LINE_BYTES * 10 * ODR_HZ / 100 * 115 <= BAUD, "BAUD does not carry the lines of this data rate: docs/boards.md, Baud rates");
#ifdef __AVR__
static_assert(ODR_HZ <= 417, "eight bits at 16 MHz do not write the lines of this data rate in time");
#endif

int transfer(const uint8_t *out, uint8_t *in, unsigned count) {
  for (unsigned n = 0; n < count; n++) {
    const uint8_t byte = SPI.transfer(out ? out[n] : 0xFF);
    if (in) in[n] = byte;
  }
  return TRANSFER_DONE;
}

void select_sensor(int selected) {
  if (selected) SPI.beginTransaction(SPISettings(SPI_HZ, MSBFIRST, SPI_MODE3));
  digitalWrite(CS, selected ? LOW : HIGH);
  if (!selected) SPI.endTransaction();
}

void wait_us(uint32_t us) { // delayMicroseconds alone ends at 16383
  delay(us / 1000);
  delayMicroseconds(us % 1000);
}

uint32_t time_us() { return micros(); }

const char NAMES[] PROGMEM = // of enum fault, in its order
  " overrun order parity tag hang zeros ones reset changed identity silent stamp incomplete starts lost rate ";
const unsigned long HEADER_MS = 4000; // from one to the next: record waits 10 s for it
const lsm6dsx_bus BUS = {transfer, select_sensor, wait_us, time_us};
lsm6dsx sensor;
fifo_sample samples[FIFO_SAMPLES];

void setup() {
  lsm6dsx_settings settings = {GYRO_FS_DPS, ACCEL_FS_G, 0, LPF1_OFF, 2};
  settings.odr = lsm6dsx_odr(ODR_HZ == 12 ? 12.5f : ODR_HZ);
  Serial.begin(BAUD);
  pinMode(CS, OUTPUT);
  digitalWrite(CS, HIGH);
  SPI.begin();
  lsm6dsx_attach(&sensor, &BUS, &settings); // the first polls look for the sensor and start it
}

void print_header() {
  Serial.print("# gyro_fs_dps=");
  Serial.print(sensor.settings.gyro_fs_dps);
  Serial.print(" accel_fs_g=");
  Serial.print(sensor.settings.accel_fs_g);
  Serial.print(" odr_hz=");
  Serial.print(fifo_rate_hz(sensor.settings.odr, sensor.freq_fine), 3);
  Serial.print(" serial=");
  Serial.print(SERIAL_NUMBER);
  Serial.print(" sensor=");
  Serial.println(sensor.chip->name);
  const char *name = NAMES, *before = "# faults";
  for (uint32_t count : sensor.faults) { // those above 0
    if (count) Serial.print(before), before = "";
    do if (count) Serial.print((char)pgm_read_byte(name));
    while (pgm_read_byte(++name) != ' ');
    if (count) Serial.print('='), Serial.print(count);
  }
  if (!*before) Serial.println();
  Serial.println("t_us,gx,gy,gz,ax,ay,az,temp");
}

void loop() {
  static unsigned long sent_ms = millis(), header_ms = sent_ms - HEADER_MS;
  const unsigned count = lsm6dsx_poll(&sensor, samples);
  if (!sensor.running && millis() - sent_ms >= 1000) {
    sent_ms = millis();
    Serial.print("# no sensor runs: look at CS, SCK, SDI, SDO, 3.3 V, GND, and its ranges; WHO_AM_I reads ");
    Serial.println(sensor.who);
  }
  for (unsigned n = 0; n < count; n++) {
    const int16_t *r = samples[n].registers;
    char line[LINE_BYTES + 1];
    if (millis() - header_ms >= HEADER_MS) header_ms = millis(), print_header();
    snprintf(line, sizeof line, "%lu,%d,%d,%d,%d,%d,%d,%d", (unsigned long)samples[n].t_us, r[0], r[1], r[2], r[3], r[4], r[5], r[6]);
    Serial.println(line);
  }
}
