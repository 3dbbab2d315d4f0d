"""Beyond the catalogue (docs/discover.md): find the equation that was left out, write it down as an effect."""
