"""OptiTrack's Motive over NatNet 3.0 to 4.2, multicast or unicast; rigid bodies only.

Layouts as NaturalPoint's direct-depacketization samples read them; packets that Motive sent in 3.0 are in the tests.
"""
