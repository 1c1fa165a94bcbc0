"""Everything that bounds a command, in the order in which it acts.

1. `barriers`: separation filter, speed limit and keep-out, on the demanded accelerations of all bodies.
2. `attitude`: the fence, on each vehicle's demanded acceleration; lift, tilt, thrust and turn, on the specific force;
   then the attitude, body rates and thrust that realise it.
3. `target`: level flight, then no setpoint, for a drone whose pose is rejected; the attitude in the autopilot's own
   idea of level.
"""

MONITORS = SEPARATION_FILTER, SPEED_LIMIT, KEEP_OUT = ("separation-filter", "speed-limit", "keep-out")
"""What alters demands, by the names under which a campaign switches it off."""
