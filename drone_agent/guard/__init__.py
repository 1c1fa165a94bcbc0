"""The guard: what stands between the ground's link and an autopilot's. Sans-IO; it knows nothing that is simulated."""
