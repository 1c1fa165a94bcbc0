"""The mocap process: one file a source, each making RawFrame; one alignment into LabFrame; one door onto the bus.

source -> RawFrame -> check, alignment (MocapCore) -> LabFrame -> bus -> ground, agents, bridges, tools
"""
