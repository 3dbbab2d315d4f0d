/* The board: clock, a millisecond counter, two serial ports.  No wait in here is without a bound. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

enum { USART1_IRQ = 37, USART2_IRQ = 38 };

/* The ports, by what is at the other end. */
enum port { HOST, SENSOR, PORTS };

void board_start(uint32_t baud);

/* Since board_start; wraps after 49 days. */
uint32_t board_milliseconds(void);

/* The next byte that has come in, or -1. */
int board_read(enum port port);

void board_write(enum port port, const uint8_t *bytes, unsigned count);

/* Sleep until something happens. */
void board_wait(void);

void SysTick_Handler(void);
void USART1_Handler(void);
void USART2_Handler(void);

#endif
