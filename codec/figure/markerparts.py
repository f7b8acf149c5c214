"""The body parts of a marker set: by known names, otherwise by what moves together.

Gu et al. 2009 (Section 3.1, Figure 4) group the markers by hand. Here the names of the Plug-in
Gait set give that hierarchy. Other sets are clustered by how constant the distances between
their markers are, and the clusters joined by a minimum spanning tree, after Kirk, O'Brien and
Forsyth 2005 ("Skeletal Parameter Estimation from Optical Motion Capture Data").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..clip import FloatArray, IntArray
from .bodyparts import BodyPart

LOOSE = 0.03
"""Markers are of one part up to this mean looseness, times the median distance of markers."""
DISTANCE_WEIGHT = 0.02
"""What a centimetre of distance counts for, beside one of variation of the distance."""
SAMPLED_FRAMES = 200
WELL_SEEN = 0.25
"""Markers seen in fewer frames than this, times the best seen one's, do not form parts."""
MOST_MARKERS = 1000
"""Sets of more markers stay in one part: time and memory grow with the square of the number."""
KNOWN_SHARE = 0.75
"""The share of Plug-in Gait's markers that must be there for its hierarchy to be used."""

# Name, parent and markers of each part (Vicon's Plug-in Gait marker set); the first marker that
# is well seen is the reference: the one nearest to the joints with the children.
_PLUG_IN_GAIT = (
    ("root", "", "LPSI RPSI LASI RASI SACR"),
    ("torso", "root", "C7 CLAV T10 STRN RBAK"),
    ("head", "torso", "LBHD RBHD LFHD RFHD"),
    *(
        part
        for side, s in (("left", "L"), ("right", "R"))
        for part in (
            (f"{side}_shoulder", "torso", f"{s}SHO"),
            (f"{side}_arm", f"{side}_shoulder", f"{s}ELB {s}FRM {s}UPA"),
            (f"{side}_hand", f"{side}_arm", f"{s}WRA {s}WRB {s}FIN"),
            (f"{side}_leg", "root", f"{s}KNE {s}TIB {s}THI"),
            (f"{side}_foot", f"{side}_leg", f"{s}ANK {s}HEE {s}TOE"),
        )
    ),
)
_OPTIONAL = {"SACR"}  # stands for LPSI and RPSI in some set-ups


@dataclass(frozen=True, eq=False)
class _Pairs:
    """What the sampled frames tell about each pair of markers.

    ``seen``: (markers,) frames in which each was seen; ``together``: (markers, markers) frames
    in which both were; ``distance``: mean distance over those, cm; ``looseness``: the standard
    deviation of the distance plus `DISTANCE_WEIGHT` of its mean, cm, infinite for markers that
    were never seen together.
    """

    seen: IntArray
    together: IntArray
    distance: FloatArray
    looseness: FloatArray


def marker_parts(names: tuple[str, ...], positions: FloatArray) -> tuple[BodyPart, ...]:
    """Return the hierarchy of parts of a marker set; every marker is in exactly one part.

    ``positions``: (frames, markers, 3) centimetres, NaN in gaps. The names of the markers
    decide where `KNOWN_SHARE` of Plug-in Gait's are there (with or without a subject's name and
    a colon before them); other markers then join the part that they move most rigidly with.
    Markers that were never seen with another one form the part ``unseen`` under the root. More
    than `MOST_MARKERS` markers form a single part.
    Deterministic; the order of the markers does not matter where their names differ.
    """
    if not names:
        return ()
    if len(names) > MOST_MARKERS:
        return (BodyPart("root", tuple(range(len(names))), -1, 0),)
    pairs = _pairs(positions)
    known = _known_groups(names)
    if known:
        labels = np.full(len(names), -1)
        for label, (_, _, members) in enumerate(known):
            labels[members] = label
        titles = [title for title, _, _ in known]
        parents = [titles.index(parent) if parent else -1 for _, parent, _ in known]
        references = [_first_well_seen(members, pairs) for _, _, members in known]
        labels = _attach(labels, pairs)
    else:
        labels = _attach(_cluster(pairs), pairs)
        if labels.max() < 0:  # nothing was seen: there is nothing to tell the markers apart by
            labels = np.zeros_like(labels)
        labels = _by_name(labels, names)
        order, parents = _tree(labels, pairs)
        labels = np.where(labels < 0, -1, np.argsort(order)[labels])
        titles = ["root", *(f"part_{number}" for number in range(1, len(order)))]
        references = [
            _reference(label, labels, parents, names, pairs) for label in range(len(order))
        ]
    unseen = np.flatnonzero(labels < 0)
    if len(unseen):
        labels[unseen] = len(titles)
        titles.append("unseen")
        parents.append(0)
        references.append(min(unseen.tolist(), key=lambda marker: names[marker]))
    return tuple(
        BodyPart(title, tuple(np.flatnonzero(labels == label).tolist()), parent, reference)
        for label, (title, parent, reference) in enumerate(
            zip(titles, parents, references, strict=True)
        )
    )


def cluster_markers(positions: FloatArray) -> IntArray:
    """Return a cluster number, from 0, per marker: what moves as one rigid body has one number.

    ``positions``: (frames, markers, 3) centimetres, NaN in gaps. Average-linkage clustering of
    the standard deviation of the distance between two markers, over up to `SAMPLED_FRAMES`
    frames, plus `DISTANCE_WEIGHT` of its mean, up to `LOOSE` times the median distance. Markers
    that were seen seldom join the cluster they are most rigid with; -1 for markers that were
    never seen with another one.
    """
    pairs = _pairs(positions)
    return _attach(_cluster(pairs), pairs)


def _pairs(positions: FloatArray) -> _Pairs:
    visible = np.asarray(~np.isnan(positions).any(axis=2))
    frames, markers = visible.shape
    first_seen = visible.argmax(axis=0) if frames else np.zeros(0, np.int64)
    spread = np.linspace(0, frames - 1, min(frames, SAMPLED_FRAMES)).astype(np.int64)
    total, square, together = np.zeros((3, markers, markers))
    for frame in np.union1d(spread, first_seen):
        points = np.where(visible[frame, :, None], positions[frame], 0.0)
        both = visible[frame, :, None] & visible[frame]
        apart = np.zeros((markers, markers))
        for axis in range(3):
            apart += (points[:, None, axis] - points[None, :, axis]) ** 2
        square += apart * both
        total += np.sqrt(apart) * both
        together += both
    times = np.maximum(together, 1.0)
    distance = total / times
    deviation = np.sqrt(np.maximum(square / times - distance**2, 0.0))
    looseness = np.where(together > 0, deviation + DISTANCE_WEIGHT * distance, np.inf)
    np.fill_diagonal(looseness, 0.0)
    return _Pairs(visible.sum(axis=0), together.astype(np.int64), distance, looseness)


def _known_groups(names: tuple[str, ...]) -> list[tuple[str, str, list[int]]]:
    """Return (name, parent's name, markers) of Plug-in Gait's parts, or nothing."""
    found: dict[str, list[int]] = {}
    for marker, name in enumerate(names):
        found.setdefault(name.rpartition(":")[2].strip().upper(), []).append(marker)
    core = {name for *_, members in _PLUG_IN_GAIT for name in members.split()} - _OPTIONAL
    if len(core & found.keys()) < KNOWN_SHARE * len(core):
        return []
    groups: list[tuple[str, str, list[int]]] = []
    stand_in: dict[str, str] = {"": ""}  # a part without markers hands its children to its parent
    for title, parent, members in _PLUG_IN_GAIT:
        markers = [marker for name in members.split() for marker in found.get(name, [])]
        stand_in[title] = title if markers else stand_in[parent]
        if markers:
            groups.append((title, stand_in[parent], markers))
    return groups if groups[0][0] == "root" else []


def _first_well_seen(markers: list[int], pairs: _Pairs) -> int:
    seen = pairs.seen[markers]
    return markers[int(np.argmax(seen >= 0.5 * seen.max()))]


def _cluster(pairs: _Pairs) -> IntArray:
    """Return cluster numbers of the markers that are well seen, -1 for the others."""
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    labels = np.full(len(pairs.seen), -1)
    # A marker that no other was ever seen with has no distances to be judged by.
    alone = (pairs.together - np.diag(np.diag(pairs.together))).sum(axis=0) == 0
    alone &= len(labels) > 1
    good = np.flatnonzero((pairs.seen >= WELL_SEEN * pairs.seen.max()) & (pairs.seen > 0) & ~alone)
    if len(good) < 2:
        labels[good] = 0
        return labels
    loose = squareform(pairs.looseness[np.ix_(good, good)], checks=False)
    distance = squareform(pairs.distance[np.ix_(good, good)], checks=False)
    known = np.isfinite(loose)
    limit = LOOSE * float(np.median(distance[known])) if known.any() else 0.0
    loose[~known] = 2.0 * max(limit, float(loose[known].max(initial=0.0)))
    labels[good] = fcluster(linkage(loose, "average"), limit, "distance") - 1
    return labels


def _attach(labels: IntArray, pairs: _Pairs) -> IntArray:
    """Give each marker without a label that of the labelled marker it is most rigid with."""
    labels = labels.copy()
    owners = np.flatnonzero(labels >= 0)
    for marker in np.flatnonzero(labels < 0):
        loose = pairs.looseness[marker, owners]
        if np.isfinite(loose).any():
            labels[marker] = labels[owners[int(np.argmin(loose))]]
    return labels


def _by_name(labels: IntArray, names: tuple[str, ...]) -> IntArray:
    """Renumber the clusters in the order of their first names, so that ties go by name."""
    clusters = range(int(labels.max()) + 1)
    firsts = [min(names[marker] for marker in np.flatnonzero(labels == each)) for each in clusters]
    return np.where(labels < 0, -1, np.argsort(np.argsort(firsts, kind="stable"))[labels])


def _tree(labels: IntArray, pairs: _Pairs) -> tuple[IntArray, list[int]]:
    """Return the clusters in order, parents first, and the place of each one's parent.

    The links are those of the minimum spanning tree (Prim) of the looseness of the tightest
    pair of markers of two clusters: markers near a joint hold together best across it. The root
    is the middle of the tree: the cluster with the fewest steps to all markers.
    """
    order = np.argsort(labels, kind="stable")[np.count_nonzero(labels < 0) :]
    sizes = np.bincount(labels[order])
    starts = np.cumsum(sizes) - sizes
    links = np.minimum.reduceat(pairs.looseness[np.ix_(order, order)], starts, axis=0)
    links = np.minimum.reduceat(links, starts, axis=1)

    clusters = len(sizes)
    steps = np.zeros((clusters, clusters), np.int64)
    nearest, cost = np.zeros(clusters, np.int64), links[0].copy()
    inside = np.arange(clusters) == 0
    neighbours: list[list[int]] = [[] for _ in range(clusters)]
    for _ in range(clusters - 1):
        outside = np.flatnonzero(~inside)
        new = int(outside[np.argmin(cost[outside])])
        old = int(nearest[new])
        neighbours[old].append(new)
        neighbours[new].append(old)
        steps[new, inside] = steps[inside, new] = steps[old, inside] + 1
        inside[new] = True
        nearer = links[new] < cost
        nearest[nearer], cost[nearer] = new, links[new, nearer]

    queue = [int(np.lexsort((np.arange(clusters), -sizes, steps @ sizes))[0])]
    parents = [-1]
    for place, cluster in enumerate(queue):  # grows while it is walked: breadth first
        children = sorted(set(neighbours[cluster]) - set(queue))
        queue += children
        parents += [place] * len(children)
    return np.array(queue), parents


def _reference(
    part: int, labels: IntArray, parents: list[int], names: tuple[str, ...], pairs: _Pairs
) -> int:
    """Return the well-seen marker of a part that is nearest to the children, else best seen."""
    members = np.flatnonzero(labels == part)
    seen = pairs.seen[members]
    members = members[seen >= 0.9 * seen.max()]
    children = [child for child, parent in enumerate(parents) if parent == part]
    near = np.zeros(len(members))
    for child in children:
        near += pairs.looseness[np.ix_(members, np.flatnonzero(labels == child))].min(axis=1)
    ranks = [
        (near[place], -int(pairs.seen[marker]), names[marker], int(marker))
        for place, marker in enumerate(members)
    ]
    return min(ranks)[3]
