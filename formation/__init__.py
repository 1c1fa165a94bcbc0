"""The pure ground floor: messages, frames, the vehicle model and the control law. No I/O, no clock."""
