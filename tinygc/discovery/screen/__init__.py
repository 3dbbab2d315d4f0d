"""All forms by their linear columns, and what chance makes of so many."""
