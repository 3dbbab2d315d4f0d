/* What is sent to the host: a ring that DMA2 empties into USART1, so that the program does not wait for the wire. */
#ifndef BOARD_SEND_H
#define BOARD_SEND_H

#include <stdint.h>

void board_send_start(void);

/* All of it, or nothing where there is no room: a frame is never torn.  1 or 0. */
int board_send(const uint8_t *bytes, unsigned count);

/* Send on what waits.  Call it often; nothing else starts DMA again. */
void board_send_on(void);

/* Wait until all has been sent, for as long as that takes at the slowest rate at most. */
void board_send_all(void);

#endif
