"""The least scenario: a leader and a follower in formation for 0.3 s."""

SHORT = """
name = "short"
formation_s = 0.3
[lab.leader]
body = "leader"
sysid = 1
[[lab.followers]]
body = "left"
sysid = 2
offset_m = [-0.5, 0.0, 0.0]
"""
