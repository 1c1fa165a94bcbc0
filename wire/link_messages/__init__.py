"""What crosses one drone's MAVLink link, in lab and flu axes and SI units; `wire.mavlink.codec` is its only encoding.

Every message names the MAVLink message it stands for. Times that ride on the link are the sender's own clock.
What streams is a named tuple, which costs a third of a frozen dataclass to make; the rare dialogues (commands,
parameters, storage) are dataclasses.
"""
