/* What is sent to the host: a ring that DMA2 empties into USART1, so that the program does not wait for the wire. */
#ifndef BOARD_SEND_H
#define BOARD_SEND_H

#include <stdint.h>

void board_send_start(void);

/* All of it, or nothing where there is no room: a frame is never torn.  1 or 0. */
int board_send(const uint8_t *bytes, unsigned count);

/* Send on what waits.  Call it often; nothing else starts DMA again. */
void board_send_on(void);

/* The port at another rate behind what waits now; nothing waits for that. */
void board_send_baud(uint32_t baud);

#endif
