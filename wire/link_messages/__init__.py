"""What crosses one drone's MAVLink link, in lab and flu axes and SI units; `wire.mavlink` is its only encoding.

Every message names the MAVLink message it stands for. Times that ride on the link are the sender's own clock.
"""
