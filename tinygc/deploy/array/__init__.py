"""An array's model in use: units fused, voted out and in again, on recordings of any length, live, and in C."""
