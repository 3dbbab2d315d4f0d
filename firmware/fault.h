/* Reading what may not be there. */
#ifndef FAULT_H
#define FAULT_H

#include <stdint.h>

/* A word at an address where some emulators have nothing, and reading is a fault: then 0. */
uint32_t read_if_there(uint32_t address);

void HardFault_Handler(void);

#endif
