"""Know the vehicle: what the controller must assume of it, estimated from one recorded flight."""
