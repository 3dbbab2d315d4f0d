"""The known sensors, a file for each maker.  A new one is a record, and its row of docs/sensors.md."""
