from __future__ import annotations

import numpy as np
import pytest
from joint_trees import t_pose

from motifold.codec.clip import Skeleton
from motifold.codec.figure.bodysize import head_diagonal, marker_head_diagonal


def test_the_head_diagonal_follows_the_standing_height() -> None:
    rig = t_pose()
    once = head_diagonal(rig)
    ankle_to_root, root_to_head = 2.1 + 8.1 + 40.1 + 40.1, 6 * 12
    assert once == pytest.approx(0.12 * (ankle_to_root + root_to_head) / 0.96)
    twice = head_diagonal(Skeleton(rig.names, rig.parents, 2 * rig.offsets))
    assert twice == pytest.approx(2 * once)
    turned = Skeleton(rig.names, rig.parents, rig.offsets[:, [2, 0, 1]])
    assert head_diagonal(turned) == pytest.approx(once)


def test_the_marker_head_diagonal() -> None:
    names = ("kim:LFHD", "kim:RFHD", "kim:LBHD", "kim:RBHD", "kim:LTOE")
    square = np.array([[8, 10, 160], [-8, 10, 160], [8, -10, 160], [-8, -10, 160], [0, 0, 0.0]])
    positions = np.repeat(square[None], 300, axis=0)
    positions[10:20, 3] = np.nan
    positions[200:] *= 7  # later than the first 200 frames
    assert marker_head_diagonal(names, positions) == pytest.approx(np.hypot(16, 20))
    others = tuple(name.replace("HD", "XX") for name in names)
    assert marker_head_diagonal(others, positions) == pytest.approx(0.12 * 160)
    for nothing in (np.full((5, 5, 3), np.nan), np.zeros((0, 5, 3)), np.zeros((9, 5, 3))):
        assert marker_head_diagonal(names, nothing) == 1.0


def test_without_a_head_or_feet_the_longest_way_counts() -> None:
    offsets = np.array([[0, 0, 0], [30, 0, 0], [0, 40, 0], [0, -20, 0], [0, -5, 0]], float)
    ends = np.array([3]), np.array([[0.0, 0.0, 10.0]])
    rig = Skeleton(tuple("abcde"), np.array([-1, 0, 1, 0, 3]), offsets, *ends)
    assert head_diagonal(rig) == pytest.approx(0.12 * (30 + 40 + 20 + 10))
