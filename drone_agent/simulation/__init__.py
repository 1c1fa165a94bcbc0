"""The true vehicle: airframe, motors, battery, the air around it."""
