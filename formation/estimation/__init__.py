"""What is known of every vehicle: position, velocity, heading, disturbance (FTESO, Eqs. 3-4)."""
