"""Links and buses: Zenoh, UDP, serial, memory."""
