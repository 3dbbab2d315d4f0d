/* The board: clock, time, two serial ports.  No wait in here is without a bound. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

enum { USART1_IRQ = 37, USART2_IRQ = 38, DMA2_STREAM0_IRQ = 56 };

/* The clocks; and what the host's port can of the last of them. */
enum { CORE_HZ = 168000000, APB1_HZ = CORE_HZ / 4, APB2_HZ = CORE_HZ / 2, BAUD_LEAST = 9600, BAUD_MOST = APB2_HZ / 16 };

/* The ports, by what is at the other end. */
enum port { HOST, SENSOR, PORTS };

/* Both ports at a rate; the played sensor's at 2625000 where it is more. */
void board_start(uint32_t baud);

/* The host's port at another rate, BAUD_LEAST to BAUD_MOST, at once.  board_send_baud changes it behind what waits. */
void board_host_baud(uint32_t baud);

/* Whether DMA2 is there: emulators may lack it. */
int board_has_dma(void);

/* Since board_start; wraps after 49 days. */
uint32_t board_milliseconds(void);

/* The same clock, finer; wraps after 71 minutes.  Never goes back. */
uint32_t board_microseconds(void);

void board_wait_us(uint32_t us);

/* The next byte that has come in, or -1. */
int board_read(enum port port);

/* 1, or 0 where there is no room for all of it: then none of it is sent. */
int board_write(enum port port, const uint8_t *bytes, unsigned count);

/* Sleep until something happens, a millisecond at most. */
void board_wait(void);

void SysTick_Handler(void);
void USART1_Handler(void);
void USART2_Handler(void);

#endif
