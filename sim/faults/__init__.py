"""Faults as data, and what each does to frames, datagrams, cores, vehicles and the operator of a lockstep flight."""
