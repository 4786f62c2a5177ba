# SPDX-License-Identifier: Apache-2.0
"""The figures that the paper prints, for objects that are not at hand. Tables II and V print none in the text."""

from __future__ import annotations

STRATEGIES = ("rrp", "grasp-line", "homography")
"""The paper's columns, in its order."""
HEADS = {"rrp": "RRP", "grasp-line": "Grasp-line", "homography": "Hom."}
"""Their heads; "Grasp-line" is printed as "Grasp-line Coord."."""
TRANSFERS = {"ours": STRATEGIES, "to the letter": tuple(f"paper-{name}" for name in STRATEGIES)}
"""What is measured in these columns, row by row."""

SIZES_COMPARE = "The printed rows are of objects that are not at hand: sizes can be compared with them, digits cannot."
"""Note to each table in which they stand."""

TABLE_I = (
    # grasp, RRP (c, r, t) of both contacts, relative (d_c, alpha_m in degrees, d_1, d_2)
    ("g1", ((0, 48, 1), (0, 95, 2)), (-0.0040, -267.57, -0.0038, 0.0039)),
    ("g2", ((0, 38, 2), (0, 181, 0)), (0.0002, -210.485, -0.0025, 0.0050)),
)
TABLE_III = (
    # original, then transferred: location (c, p) and RRP of both contacts, relative
    (((0, 587), (0, 242)), ((0, 40, 6), (0, 15, 25)), (-0.0001, -95.9817, -0.0013, 0.0007)),
    (((0, 607), (0, 243)), ((0, 40, 6), (0, 15, 25)), (-0.0001, -87.8033, -0.0012, 0.0007)),
)
TABLE_IV = (
    (((0, 152), (0, 296)), ((0, 25, 2), (0, 49, 2)), (0.0009, -89.922, -0.0041, 0.0035)),
    (((0, 172), (0, 347)), ((0, 28, 4), (0, 57, 5)), (0.0009, -89.922, -0.0041, 0.0035)),
)
TABLE_VI = (
    # original grasp, then (e_av, e_max) in 1/px for each strategy
    ("figures in Table III", ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))),
    ("figures in Table IV", ((0.0, 0.0), (0.00024, 0.00049), (0.00063, 0.00077))),
    ("figures in Table V", ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))),
)
TABLE_VII = (
    # for each original grasp R_f E (e_av), R_f E (e_max), SE (e_av), SE (e_max) in 1/px for each strategy
    ((0.00026, 0.00026, 0.0), (0.00053, 0.00053, 0.0), (0.00301, 0.00143, 0.0), (0.00322, 0.00233, 0.0)),
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.00013, 0.00036, 0.0), (0.00094, 0.00117, 0.0)),
    ((0.00104, 0.0085, 0.0), (0.00124, 0.0087, 0.0), (0.00561, 0.00499, 0.0), (0.00612, 0.00545, 0.0)),
)

OPENINGS = (*(table[0][2][3] - table[0][2][2] for table in (TABLE_III, TABLE_IV)), None)
"""1/px, openings over the area of the grasps of Tables VI and VII as far as d_2 - d_1 tells them, if the rows of Table
VII follow those of Table VI. Table V, which would tell the third, is missing."""
