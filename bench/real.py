"""`python -m bench.real FOLDER`: how far the simulator is right about flights that others flew.

FOLDER: `datasets/dataset` of https://github.com/syediu/nanobench-iros2026 (BSD-3-Clause; arXiv 2603.09908): a Crazyflie 2.1
in Vicon under its own PID and Mellinger controllers, three speeds, several repetitions. Fetch it yourself.

What is fitted and what is foretold was written down before the first flight was foretold, and never mixes. A file that is
another's copy under a new number is named once.
"""

FITTED = ("B2_circle_fast_rep2", "B3_figure8_medium_rep2", "B8_star_fast_rep1", "B10_lissajous_fast_rep1")
"""Under PID: of these the vehicle is identified."""
FORETOLD_PID = (
    "B2_circle_slow_rep1", "B2_circle_slow_rep2", "B2_circle_slow_rep3", "B2_circle_medium_rep1", "B2_circle_medium_rep2",
    "B2_circle_fast_rep1", "B2_circle_fast_rep3", "B3_figure8_slow_rep1", "B3_figure8_slow_rep2", "B3_figure8_slow_rep3",
    "B3_figure8_medium_rep1", "B3_figure8_fast_rep1", "B3_figure8_fast_rep2", "B5_helix_rep1", "B5_helix_slow_rep1",
    "B5_helix_slow_rep2", "B5_helix_medium_rep1", "B5_helix_medium_rep2", "B5_helix_medium_rep3", "B5_helix_fast_rep1",
    "B5_helix_fast_rep2", "B5_helix_fast_rep3", "B6_linear_ramp_rep3", "B6_linear_ramp_rep4", "B7_oval_slow_rep2",
    "B7_oval_slow_rep3", "B7_oval_medium_rep1", "B7_oval_medium_rep2", "B7_oval_medium_rep3", "B7_oval_fast_rep1",
    "B7_oval_fast_rep2", "B7_oval_fast_rep3", "B8_star_slow_rep1", "B8_star_medium_rep1", "B9_trefoil_slow_rep1",
    "B9_trefoil_slow_rep13", "B9_trefoil_slow_rep14", "B9_trefoil_slow_rep15", "B9_trefoil_slow_rep16",
    "B9_trefoil_slow_rep17", "B9_trefoil_slow_rep18", "B9_trefoil_medium_rep12", "B9_trefoil_medium_rep13",
    "B9_trefoil_medium_rep14", "B9_trefoil_medium_rep15", "B9_trefoil_fast_rep1", "B9_trefoil_fast_rep14",
    "B10_lissajous_slow_rep1",
)  # fmt: skip
FORETOLD_MELLINGER = (
    "B5_helix_fast_mell_rep1", "B8_star_slow_rep2", "B8_star_slow_rep3", "B8_star_medium_rep2", "B8_star_medium_rep3",
    "B8_star_fast_rep2", "B8_star_fast_rep3", "B9_trefoil_slow_rep2", "B9_trefoil_slow_rep6", "B9_trefoil_slow_rep10",
    "B9_trefoil_slow_rep11", "B9_trefoil_slow_rep12", "B9_trefoil_medium_rep1", "B9_trefoil_medium_rep2",
    "B9_trefoil_medium_rep10", "B9_trefoil_medium_rep11", "B9_trefoil_fast_rep4", "B9_trefoil_fast_rep11",
    "B9_trefoil_fast_rep12", "B9_trefoil_fast_rep13",
)  # fmt: skip
LEFT_OUT = {
    "A1b_multisine_sysid_rep*, B11_random_waypoints_rep*, B12_staircase_climb_rep1, C4_battery_drain_rep*": "not in the copy at hand",
    "B2_circle_medium_rep3": "falls away at the end, 5.8 m from its reference",
    "B3_figure8_medium_rep3": "Mellinger; looked at while the identification was written",
    "B6_linear_ramp_rep1, B7_oval_slow_rep1": "do not fly",
    "B6_linear_ramp_rep2": "1.1 m from a reference that hardly moves",
    "B9_trefoil_fast_rep2": "the cameras' track is lost: 24 m",
    "B9_trefoil_fast_rep10, B9_trefoil_fast_rep15": "fly away halfway, 8.9 and 2.3 m",
}
"""Seen in the recordings, before any was foretold."""
