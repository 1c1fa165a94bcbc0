"""The formation control law, stage by stage."""
