#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SPI_OP_MODE_MASTER 0u
#define SPI_MODE_CPOL (1u << 1)
#define SPI_MODE_CPHA (1u << 2)
#define SPI_TRANSFER_MSB 0u
#define SPI_WORD_SET(bits) ((bits) << 5)
#define SPI_HOLD_ON_CS (1u << 12)
#define SPI_LOCK_ON (1u << 13)

struct spi_config {
    uint32_t frequency;
    uint16_t operation;
};

struct spi_dt_spec {
    const void *bus;
    struct spi_config config;
};

#define SPI_DT_SPEC_GET(node, flags, delay) {.config = {5000000, (flags)}}

struct spi_buf {
    void *buf; /* or null: zeros are sent, or what comes is dropped */
    size_t len;
};

struct spi_buf_set {
    const struct spi_buf *buffers;
    size_t count;
};

bool spi_is_ready_dt(const struct spi_dt_spec *spec);
int spi_transceive_dt(const struct spi_dt_spec *spec, const struct spi_buf_set *tx_bufs, const struct spi_buf_set *rx_bufs);
int spi_release_dt(const struct spi_dt_spec *spec);
