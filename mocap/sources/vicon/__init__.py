"""Vicon DataStream, as Tracker, Nexus and Shogun serve it over TCP: an own client, from the published protocol."""
