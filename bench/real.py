"""`python -m bench.real FOLDER`: how far the simulator is right about flights that others flew.

FOLDER: `datasets/dataset` of https://github.com/syediu/nanobench-iros2026 (BSD-3-Clause; arXiv 2603.09908): a Crazyflie
2.1 in Vicon under its own PID and Mellinger controllers, three speeds, several repetitions. Fetch it yourself.

What is fitted and what is foretold was written down before the first flight was foretold, and never mixes. A file that
is another's copy under a new number is named once.
"""

FITTED = {"B2_circle_fast": (2,), "B3_figure8_medium": (2,), "B8_star_fast": (1,), "B10_lissajous_fast": (1,)}
"""Under PID, by figure and repetition: of these the vehicle is identified."""
FORETOLD_PID = {
    "B2_circle_slow": (1, 2, 3), "B2_circle_medium": (1, 2), "B2_circle_fast": (1, 3),
    "B3_figure8_slow": (1, 2, 3), "B3_figure8_medium": (1,), "B3_figure8_fast": (1, 2),
    "B5_helix": (1,), "B5_helix_slow": (1, 2), "B5_helix_medium": (1, 2, 3), "B5_helix_fast": (1, 2, 3),
    "B6_linear_ramp": (3, 4), "B7_oval_slow": (2, 3), "B7_oval_medium": (1, 2, 3), "B7_oval_fast": (1, 2, 3),
    "B8_star_slow": (1,), "B8_star_medium": (1,), "B9_trefoil_slow": (1, 13, 14, 15, 16, 17, 18),
    "B9_trefoil_medium": (12, 13, 14, 15), "B9_trefoil_fast": (1, 14), "B10_lissajous_slow": (1,),
}  # fmt: skip
FORETOLD_MELLINGER = {
    "B5_helix_fast_mell": (1,), "B8_star_slow": (2, 3), "B8_star_medium": (2, 3), "B8_star_fast": (2, 3),
    "B9_trefoil_slow": (2, 6, 10, 11, 12), "B9_trefoil_medium": (1, 2, 10, 11), "B9_trefoil_fast": (4, 11, 12, 13),
}  # fmt: skip
LEFT_OUT = {
    "A1b_multisine_sysid, B11_random_waypoints, B12_staircase_climb, C4_battery_drain": "not in the copy at hand",
    "B2_circle_medium 3": "falls away at the end, 5.8 m from its reference",
    "B3_figure8_medium 3": "Mellinger; looked at while the identification was written",
    "B6_linear_ramp 1, B7_oval_slow 1": "do not fly",
    "B6_linear_ramp 2": "1.1 m from a reference that hardly moves",
    "B9_trefoil_fast 2": "the cameras' track is lost: 24 m",
    "B9_trefoil_fast 10, 15": "fly away halfway, 8.9 and 2.3 m",
}
"""Seen in the recordings, before any was foretold."""
