"""The HIERARCHY part of a BVH file: reading it, and building one for a skeleton."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass, field

import numpy as np

from ..clip import Skeleton
from ..errors import FormatError, InputError, UnsupportedError
from .channels import POSITIONS, ROTATIONS, Channels, rotation_order
from .numerals import usable_number

MAX_JOINTS = 10_000
LINE_END = re.compile(r"\r\n|\r|\n")
_BYTE_ORDER_MARK = "\xef\xbb\xbf"
_TOKEN = re.compile(r"[{}]|[^\s{}]+", re.ASCII)
_REST_OF_LINE = re.compile(r"[^{}\r\n]*")
_CHANNELS = {name.upper(): name for name in POSITIONS + ROTATIONS}


@dataclass
class Hierarchy:
    """A header's joints in file order and units; ``stop`` is the end of the word MOTION."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[tuple[str, ...]] = field(default_factory=list)
    end_parents: list[int] = field(default_factory=list)
    end_offsets: list[list[float]] = field(default_factory=list)
    stop: int = 0

    def skeleton(self) -> Skeleton:
        """Return the joints as a `Skeleton`, in file units."""
        return Skeleton(
            tuple(self.names),
            np.array(self.parents, np.int64),
            np.array(self.offsets, np.float64).reshape(-1, 3),
            np.array(self.end_parents, np.int64),
            np.array(self.end_offsets, np.float64).reshape(-1, 3),
        )


def parse_hierarchy(text: str) -> Hierarchy:
    """Read a BVH header; ``text`` is the file, one character per byte (Latin-1).

    Raises FormatError and UnsupportedError with the line.
    """
    return _Reader(text).read()


class _Reader:
    """Walks the header's words with a stack of its own, so that deep nesting costs nothing."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.position = len(_BYTE_ORDER_MARK) if text.startswith(_BYTE_ORDER_MARK) else 0
        self.rig = Hierarchy()
        self.open: list[int] = []  # joints whose braces are open; -1 for an end site

    def read(self) -> Hierarchy:
        if self.word("HIERARCHY").upper() != "HIERARCHY":
            raise self.error("HIERARCHY is not the first word: this is no BVH file")
        while True:
            word = self.word("a joint, a closing brace or MOTION")
            key = word.upper()
            if not self.open:
                if key == "ROOT":
                    self.joint(-1)
                elif key == "MOTION" and self.rig.names:
                    self.rig.stop = self.position
                    return self.rig
                else:
                    raise self.error(f"{word[:40]!r} where ROOT or MOTION should be")
            elif key == "}":
                self.close()
            elif key == "OFFSET":
                self.offset()
            elif self.open[-1] >= 0 and key == "CHANNELS":
                self.channels(self.open[-1])
            elif self.open[-1] >= 0 and key == "JOINT":
                self.joint(self.open[-1])
            elif self.open[-1] >= 0 and key == "END":
                self.end_site(self.open[-1])
            else:
                raise self.error(f"{word[:40]!r} does not belong inside a joint")

    def error(self, problem: str, kind: type[InputError] = FormatError) -> InputError:
        line = 1 + len(LINE_END.findall(self.text, 0, self.position))
        return kind(problem, place=f"line {line}")

    def word(self, wanted: str) -> str:
        found = _TOKEN.search(self.text, self.position)
        self.position = found.end() if found else len(self.text)
        if found is None:
            raise self.error(f"the file ends where {wanted} should be")
        return found[0]

    def open_block(self) -> str:
        """Return what stands before the opening brace: a name, which may hold blanks."""
        found = _REST_OF_LINE.match(self.text, self.position)
        assert found is not None  # the pattern matches nothing, too
        self.position = found.end()
        if self.word("an opening brace") != "{":
            raise self.error("an opening brace is missing")
        return found[0].strip(" \t\f\v")

    def joint(self, parent: int) -> None:
        rig = self.rig
        if parent < 0 and rig.names:
            raise self.error("there are several roots, motifold reads one", UnsupportedError)
        if len(rig.names) == MAX_JOINTS:
            raise self.error(f"there are more than {MAX_JOINTS} joints", UnsupportedError)
        self.open.append(len(rig.names))
        rig.names.append(_decoded(self.open_block()))
        rig.parents.append(parent)
        rig.offsets.append([])
        rig.channels.append(())

    def end_site(self, parent: int) -> None:
        if len(self.rig.end_parents) == MAX_JOINTS:
            raise self.error(f"there are more than {MAX_JOINTS} end sites", UnsupportedError)
        self.open_block()
        self.open.append(-1)
        self.rig.end_parents.append(parent)
        self.rig.end_offsets.append([])

    def innermost_offset(self) -> list[float]:
        joint = self.open[-1]
        return self.rig.offsets[joint] if joint >= 0 else self.rig.end_offsets[-1]

    def offset(self) -> None:
        numbers = self.innermost_offset()
        if numbers:
            raise self.error("a second OFFSET for the same joint")
        numbers += [usable_number(self.word("a number")) for _ in range(3)]
        if any(math.isnan(number) for number in numbers):
            raise self.error("OFFSET is not followed by three usable numbers")

    def channels(self, joint: int) -> None:
        count = usable_number(self.word("the number of channels"))
        if count not in range(7):
            raise self.error("CHANNELS is not followed by a number from 0 to 6")
        words = [self.word("a channel's name") for _ in range(int(count))]
        for word in words:
            if word.upper() not in _CHANNELS:
                raise self.error(f"{word[:40]!r} where a channel's name should be")
        if self.rig.channels[joint]:
            raise self.error("a second CHANNELS for the same joint")
        names = tuple(_CHANNELS[word.upper()] for word in words)
        order = rotation_order(names)
        if any(names.count(name) > 1 for name in POSITIONS):
            raise self.error("the same position channel twice")
        if len(order) > 3 or any(a == b for a, b in itertools.pairwise(order)):
            raise self.error(f"rotation channels {order} are not Euler angles", UnsupportedError)
        self.rig.channels[joint] = names

    def close(self) -> None:
        if not self.innermost_offset():
            raise self.error("a joint or end site without OFFSET")
        self.open.pop()


def _decoded(name: str) -> str:
    try:
        return name.encode("latin-1").decode("utf-8")
    except UnicodeDecodeError:
        return name  # an older encoding: one character per byte loses nothing


def depth_first(skeleton: Skeleton) -> list[int]:
    """Return the joints in the order in which a BVH header lists them."""
    children = skeleton.children()
    order, waiting = [], [0]
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += reversed(children[joint])
    return order


def build_hierarchy(skeleton: Skeleton, channels: Channels, centimetres: float) -> str:
    """Return a header, one character per byte, in units of ``centimetres``, MOTION included."""
    ends: dict[int, list[int]] = {}
    for end, carrier in enumerate(skeleton.end_parents):
        ends.setdefault(int(carrier), []).append(end)
    lines = ["HIERARCHY"]
    depth = 0
    depths: dict[int, int] = {-1: -1}
    for joint in depth_first(skeleton):
        parent = int(skeleton.parents[joint])
        depths[joint] = depths[parent] + 1
        lines += ["\t" * level + "}" for level in range(depth - 1, depths[joint] - 1, -1)]
        depth = depths[joint] + 1
        kind = "ROOT" if parent < 0 else "JOINT"
        name = re.sub(r"[{}\x00-\x1f]+", "_", skeleton.names[joint])
        names = channels[joint]
        lines += _block(f"{kind} {name}", depth - 1, skeleton.offsets[joint] / centimetres)
        lines.append("\t" * depth + " ".join(["CHANNELS", str(len(names)), *names]))
        for end in ends.get(joint, []):
            lines += _block("End Site", depth, skeleton.end_offsets[end] / centimetres)
            lines.append("\t" * depth + "}")
    lines += ["\t" * level + "}" for level in range(depth - 1, -1, -1)]
    return "\n".join([*lines, "MOTION"]).encode("utf-8", "surrogateescape").decode("latin-1")


def _block(title: str, depth: int, offset: object) -> list[str]:
    indent = "\t" * depth
    rounded = np.round(np.asarray(offset), 9) + 0.0  # no "-0"
    numbers = " ".join(f"{number:.9f}".rstrip("0").rstrip(".") for number in rounded)
    return [indent + title, indent + "{", indent + "\tOFFSET " + numbers]
