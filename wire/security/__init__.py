"""Who a process is on the lab's links: its keys in files, its identity on the bus, the signing of its MAVLink."""
