"""A Crazyflie behind the guard: its autopilot's upper half, which speaks MAVLink, runs in the bridge."""
