/* The sensor's SPI: SPI1 on PA5 to PA7 with the chip select on PA4, 5.25 MHz, mode 3; long transfers by DMA2.
 * make SPI_DIVIDER= slows it. */
#ifndef BOARD_SPI_H
#define BOARD_SPI_H

#include <stdint.h>

void board_spi_start(void);

void board_spi_select(int selected);

/* As struct lsm6dsx_bus wants it: -1, 0, or 1 while DMA goes on by itself. */
int board_spi_transfer(const uint8_t *out, uint8_t *in, unsigned count);

/* Whether it carries the sensor's words at a true data rate; docs/boards.md has the table. */
int board_spi_carries(float odr_hz);

void DMA2_Stream0_Handler(void);

#endif
