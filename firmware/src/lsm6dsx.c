/* For the Arduino IDE, which compiles what lies in this folder: the driver itself is one floor up. */
#include "../lsm6dsx.c"
#include "../lsm6dsx_bus.c"
#include "../lsm6dsx_chips.c"
#include "../lsm6dsx_fifo.c"
#include "../lsm6dsx_rate.c"
#include "../lsm6dsx_settings.c"
#include "../lsm6dsx_start.c"
