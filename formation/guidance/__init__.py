"""Where everybody is led: trajectories, shapes, transitions and the references they make."""
