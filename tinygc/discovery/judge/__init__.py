"""The best forms, refitted exactly, against the catalogue, against each other, and on what the search never saw."""
