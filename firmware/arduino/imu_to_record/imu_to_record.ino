// Any IMU on I2C for `calibrate.py record --baud 115200`: registers as text, stamped when they are new.  docs/boards.md explains it.
// What follows is an MPU-6050 (GY-521) at 100 Hz, 500 dps, 4 g.  Another sensor is another block of these lines.
#include <Wire.h>
const char INFO[] = "# gyro_fs_dps=500 accel_fs_g=4 odr_hz=100 serial=bench-1 sensor=MPU-6050"; // another serial for each sensor
const uint8_t CHIP = 0x68, WHO = 0x75, NAME = 0x68;    // address on the bus; the register that says its name, and what it says
const uint8_t SETUP[][2] = {{0x6B, 1}, {0x1A, 3}, {0x19, 9}, {0x1B, 8}, {0x1C, 8}, {0x38, 1}}; // awake, 44 Hz, 100 Hz, ranges, "new"
const uint8_t STATUS = 0x3A, NEW = 0x01;               // the register and the bits that say that a sample is new
const uint8_t FIRST = 0x3B, ACCEL = 0, TEMP = 3, GYRO = 4; // seven numbers from this register on: which of them are what
const bool HIGH_FIRST = true;                          // of a number's two bytes

uint8_t bytes[14];

bool fetch(uint8_t address, uint8_t count) {
  Wire.beginTransmission(CHIP);
  Wire.write(address);
  if (Wire.endTransmission(false) != 0 || Wire.requestFrom(CHIP, count) != count) return false;
  for (uint8_t n = 0; n < count; n++) bytes[n] = Wire.read();
  return true;
}
int number(uint8_t n) { return (int16_t)(bytes[2 * n + !HIGH_FIRST] << 8 | bytes[2 * n + HIGH_FIRST]); }

void setup() {
  Serial.begin(115200);
  Wire.begin();
  Wire.setClock(400000);
  for (; !fetch(WHO, 1) || bytes[0] != NAME; delay(1000)) Serial.println("# no such sensor: look at SDA, SCL, 3.3 V, GND, CHIP, NAME");
  for (auto &pair : SETUP) Wire.beginTransmission(CHIP), Wire.write(pair[0]), Wire.write(pair[1]), Wire.endTransmission();
}

void loop() {
  static unsigned long said_us = micros() - 4000000; // record waits ten seconds for INFO: it comes each four
  if (!fetch(STATUS, 1) || (bytes[0] & NEW) != NEW) return;
  const unsigned long t_us = micros();                 // now, and not once it has been printed
  if (!fetch(FIRST, 14)) return;                       // a gap in the stamps, which record counts
  if (t_us - said_us >= 4000000) said_us = t_us, Serial.println(INFO), Serial.println("t_us,gx,gy,gz,ax,ay,az,temp");
  char line[64];
  snprintf(line, sizeof line, "%lu,%d,%d,%d,%d,%d,%d,%d", t_us, number(GYRO), number(GYRO + 1), number(GYRO + 2),
           number(ACCEL), number(ACCEL + 1), number(ACCEL + 2), number(TEMP));
  Serial.println(line);
}
