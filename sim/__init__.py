"""The hosts: lockstep in one process, or real processes in real time."""
