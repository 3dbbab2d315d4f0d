"""The tables of the paper that TinyGC-Net comes from, a module each, on its public data and on our own."""
