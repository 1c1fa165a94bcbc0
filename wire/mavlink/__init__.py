"""MAVLink in bytes; the only place that knows north, east, down."""
