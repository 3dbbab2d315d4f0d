/* Registers of the STM32F405 that more than one file needs; RM0090. */
#ifndef BOARD_REGISTERS_H
#define BOARD_REGISTERS_H

#include <stdint.h>

#define REG(address) (*(volatile uint32_t *)(address))

#define RCC 0x40023800u
#define RCC_AHB1ENR REG(RCC + 0x30u)
#define RCC_APB1ENR REG(RCC + 0x40u)
#define RCC_APB2ENR REG(RCC + 0x44u)
#define RCC_APB2RSTR REG(RCC + 0x24u)

#define NVIC_ISER1 REG(0xE000E104u)

#define GPIOA_MODER REG(0x40020000u)
#define GPIOA_OSPEEDR REG(0x40020008u)
#define GPIOA_PUPDR REG(0x4002000Cu)
#define GPIOA_BSRR REG(0x40020018u)
#define GPIOA_AFRL REG(0x40020020u)
#define GPIOA_AFRH REG(0x40020024u)

/* DMA2: flags of streams 0 to 3 and 4 to 7, and the registers of a stream. */
#define DMA2 0x40026400u
#define DMA2_LISR REG(DMA2 + 0x00u)
#define DMA2_HISR REG(DMA2 + 0x04u)
#define DMA2_LIFCR REG(DMA2 + 0x08u)
#define DMA2_HIFCR REG(DMA2 + 0x0Cu)
#define DMA2_CR(stream) REG(DMA2 + 0x10u + 0x18u * (uint32_t)(stream))
#define DMA2_NDTR(stream) REG(DMA2 + 0x14u + 0x18u * (uint32_t)(stream))
#define DMA2_PAR(stream) REG(DMA2 + 0x18u + 0x18u * (uint32_t)(stream))
#define DMA2_M0AR(stream) REG(DMA2 + 0x1Cu + 0x18u * (uint32_t)(stream))

enum {
    DMA_ENABLE = 1u << 0,
    DMA_INTERRUPTS = 1u << 4, /* interrupt at its end */
    DMA_FROM_MEMORY = 1u << 6,
    DMA_MEMORY_STEPS = 1u << 10,
    DMA_URGENT = 3u << 16,
    DMA_SPINS = 1000, /* until a stream that is switched off has stopped */
};

#define DMA_CHANNEL(channel) ((uint32_t)(channel) << 25)

#endif
