"""A decoder of index files of versions 2 to 5, from docs/format.md alone: archives, heads.

Follows the sections from "Folder" on; `oracle_run` decodes the runs. Written to be checked against
the text by eye, and slow. Shares no code with ``motifold``.
"""

from __future__ import annotations

import json
import lzma
from binascii import crc_hqx
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

import zarr
from oracle_blocks import Moments, States, Viewer, joined
from oracle_model import Model, fixed_model, read_model
from oracle_nodes import Figure, Record, figure_of_markers, figure_of_skeleton
from oracle_run import Lead, Pose, RunReader, Track, usual_pose
from oracle_stream import SymbolReader

RUN = 1024


class Header(NamedTuple):
    """What stands before the streams; certificate: largest, mean, 99th percentile, centimetres.

    ``rests``: of each run, one stream, or one a body part.
    """

    rig: int
    generation: int
    frames: int
    step_code: int
    certificate: tuple[float, float, float]
    cores: list[bytes]
    rests: list[list[bytes]]
    led: bool
    mirrored: bool


@dataclass
class Head:
    """``gaps``: per marker the frames at which it is lost or found; none for skeletons.

    ``images``: of each reference, whether its image is meant.
    """

    references: list[int]
    images: list[bool]
    still: set[int] = field(default_factory=set)
    sliding: list[int] = field(default_factory=list)
    gaps: list[list[int]] = field(default_factory=list)
    fineness: list[int] = field(default_factory=list)
    leads: list[Lead] = field(default_factory=list)


class Decoded(NamedTuple):
    header: Header
    head: Head
    figure: Figure
    runs: list[States]


def read_header(data: bytes) -> Header:
    version = data[2]
    assert data[:2] == b"MF"
    assert version in (2, 3, 4, 5)
    apart = version > 2
    at = 7

    def varint() -> int:
        nonlocal at
        found = shift = 0
        while True:
            byte = data[at]
            at += 1
            found |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return found

    rig, generation, frames, step_code = (varint() for _ in range(4))
    runs = -(-frames // RUN)
    streams = varint() if apart else 1
    assert streams >= (2 if version == 3 else 1)
    core_lengths = [varint() for _ in range(max(runs, 1))]
    rest_lengths = [varint() for _ in range(runs * streams - 1)]
    largest_code = int.from_bytes(data[at : at + 2], "little")
    largest = 2.0 ** (largest_code / 1024 - 40) if largest_code else 0.0
    shares = [0.0 if code == 255 else largest * 2 ** (-code / 16) for code in data[at + 2 : at + 4]]
    at += 4
    border = at + (core_lengths[0] if apart else sum(core_lengths))
    pieces = []
    for length in core_lengths + rest_lengths:
        pieces.append(data[at : at + length])
        at += length
    if runs:
        pieces.append(data[at:])
    if apart:
        pieces[1:] = [opened(piece) for piece in pieces[1:]]
    assert crc_hqx(b"123456789", 0) == 0x31C3
    begun = version if apart else 0
    assert crc_hqx(data[7:border], begun) == int.from_bytes(data[3:5], "little")
    assert crc_hqx(data[border:], begun) == int.from_bytes(data[5:7], "little")
    certificate = (largest, shares[0], shares[1])
    cores, rest = pieces[: len(core_lengths)], pieces[len(core_lengths) :]
    rests = [rest[at : at + streams] for at in range(0, len(rest), streams)]
    fields = rig, generation, frames, step_code, certificate, cores, rests
    return Header(*fields, version == 4, version == 5)


def opened(piece: bytes) -> bytes:
    """Return a stream of versions 3 to 5 without its check byte."""
    if piece:
        assert crc_8(piece[1:]) == piece[0]
    return piece[1:]


def crc_8(data: bytes) -> int:
    """Return what is left of the bytes, as a polynomial times x^8, over x^8 + x^2 + x + 1."""
    left = int.from_bytes(data, "big") << 8
    while left >> 8:
        left ^= 0x107 << (left.bit_length() - 9)
    return left


def step_of(code: int) -> int:
    """Return the step in 2^-24 centimetres."""
    mantissa, exponent = 128 + code % 128, code // 128 - 40 + 24 - 7
    return max(mantissa << exponent if exponent >= 0 else mantissa >> -exponent, 1)


def usual_span(frame_time: float) -> int:
    rate = 1 / frame_time
    return 4 if rate < 45 else 8 if rate < 180 else 16


def read_references(reader: SymbolReader) -> list[int]:
    count = reader.number()
    assert count <= 64
    found, last = [], -1
    if count:
        for gap in reader.uniforms(1 << reader.uniform(48), count):
            last += gap + 1
            found.append(last)
    return found


def read_leads(reader: SymbolReader, references: int) -> list[Lead]:
    found: list[Lead] = []
    stop = 0
    for _ in range(reader.number()):
        reference = reader.uniform(references)
        first = stop + reader.number()
        stop = first + reader.number() + 1
        start, stride = reader.number(), reader.number() + 1
        move = []
        if reader.uniform(2):
            coded = [reader.number() for _ in range(6)]
            move = [-(each + 1) // 2 if each % 2 else each // 2 for each in coded]
        found.append(Lead(reference, first, stop, start, stride, move))
    return found


def read_head(reader: SymbolReader, rig: Record, model: Model, led: bool, mirrored: bool) -> Head:
    """Read a head up to the sizes of nodes, for which the nodes must be known."""
    named = read_references(reader)
    head = Head(named, [False] * len(named))
    if mirrored:
        head = Head([code // 2 for code in named], [code % 2 == 1 for code in named])
    if led or mirrored:
        head.leads = read_leads(reader, len(named))
        assert head.leads or mirrored
    joints = range(len(rig["names"]))
    if rig["kind"] == "skeleton":
        head.still = {j for j in joints if (j in model.still) != bool(reader.sized(8))}
        channels = rig["layout"]["channels"]
        free = [
            j
            for j in joints
            if not channels or any(name.lower().endswith("position") for name in channels[j])
        ]
        head.sliding = [j for j in free if (j in model.sliding) != bool(reader.sized(8))]
    elif reader.uniform(2):
        for _ in joints:
            turns: list[int] = []
            for _ in range(reader.number()):
                turns.append(reader.number() + (turns[-1] if turns else 0))
            head.gaps.append(turns)
    return head


def read_fineness(reader: SymbolReader, nodes: int) -> list[int]:
    found = [0] * nodes
    if reader.sized(8):
        fineness = 0
        for k in range(nodes):
            fineness += reader.sized(36)
            assert 0 <= fineness <= 24
            found[k] = fineness
    return found


class OracleArchive:
    """An archive, of which clips are asked for by number."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rigs: list[Record] = []
        self.families: dict[str, Record] = {}
        self.models: dict[tuple[str, int], Model] = {}
        self.names: list[str] = []  # of clips, by their numbers
        self.indexes: list[str] = []
        self.decoded: dict[int, Decoded] = {}
        for job in json.loads((folder / "COMMIT.json").read_text())["jobs"]:
            self.add(job["generation"])

    def add(self, generation: int) -> None:
        group: Any = zarr.open_group(self.folder / f"store.zarr/{generation:06}", mode="r")
        records = json.loads(bytes(group["records"][:]))
        self.rigs += records["rigs"]
        self.families |= {family["key"]: family for family in records["families"]}
        for key in group.get("models", ()):
            hinged = self.families[key.rpartition("-")[0]].get("hinged", ())
            data = bytes(group["models"][key][:])
            self.models[key, generation] = read_model(data, hinged)
        with lzma.open(self.folder / f"ledger/{generation:06}.json.xz") as ledger:
            clips = json.load(ledger)["clips"]
        self.names += clips["name"]
        self.indexes += clips["index"]

    def header(self, number: int) -> Header:
        name = self.indexes[number]
        return read_header((self.folder / "clips" / name[:2] / f"{name}.mfi").read_bytes())

    def family(self, rig: Record) -> Record:
        fields = {name: rig[name] for name in ("kind", "names", "parents", "parts")}
        text = json.dumps(fields, sort_keys=True, separators=(",", ":"))
        return self.families[blake2b(text.encode(), digest_size=8).hexdigest()]

    def model(self, rig: Record, generation: int) -> Model:
        span = usual_span(rig["frame_time"])
        if not generation:
            hinged = self.family(rig).get("hinged", ())
            return fixed_model(span, 2 * len(rig["names"]), hinged)
        return self.models[f"{self.family(rig)['key']}-{span}", generation]

    def clip(self, number: int) -> Decoded:
        """Decode a clip, its references first."""
        if number not in self.decoded:
            self.decoded[number] = self.decode(self.header(number))
        return self.decoded[number]

    def decode(self, header: Header) -> Decoded:
        rig = self.rigs[header.rig]
        model = self.model(rig, header.generation)
        return decode_file(header, rig, self.family(rig), model, self.clip)


def decode_file(
    header: Header, rig: Record, family: Record, model: Model, find: Callable[[int], Decoded]
) -> Decoded:
    """Decode an index file; ``find``: returns the decoded clip of a number."""
    reader = SymbolReader(header.cores[0])
    head = read_head(reader, rig, model, header.led, header.mirrored)
    if rig["kind"] == "markers":
        figure = figure_of_markers(rig, family)
    else:
        figure = figure_of_skeleton(rig, family, head.still, head.sliding)
    head.fineness = read_fineness(reader, len(figure.nodes))

    poses: list[Pose] = [usual_pose(rig, family)]
    offered: list[Moments] = []
    tracks = []
    for number, mirrored in zip(head.references, head.images, strict=True):
        reference = find(number)
        seen = reference.figure, reference.runs
        if mirrored:
            seen = image_of(reference, rig, family)
        for states in seen[1]:
            poses += reference_poses(seen[0], states)
            viewer = Viewer(seen[0], model, states)
            offered.append(viewer.moments(range(1, len(states) - model.span + 1, 2)))
        tracks.append(Track([state for states in seen[1] for state in states], seen[0].nodes))
    moments = joined(offered) if offered else None

    runs = []
    for at in range(0, header.frames, RUN):
        core = reader if at == 0 else SymbolReader(header.cores[at // RUN])
        rests = [SymbolReader(stream) for stream in header.rests[at // RUN]]
        run = RunReader(figure, model, step_of(header.step_code), head.fineness, poses)
        run.streams = streams_of(figure, rig, len(rests))
        run.follow([(lead, tracks[lead.reference]) for lead in head.leads], at)
        runs.append(run.read(core, rests, min(header.frames - at, RUN), moments))
    return Decoded(header, head, figure, runs)


def image_of(clip: Decoded, rig: Record, family: Record) -> tuple[Figure, list[States]]:
    """Return a clip in the mirror: its nodes and runs."""
    joints, mirror = len(rig["names"]), family["mirror"]
    partner = [pair[0] for pair in mirror]
    still = {partner[joint] for joint in clip.head.still}
    figure = figure_of_skeleton(rig, family, still, sorted(partner[j] for j in clip.head.sliding))
    numbers = {node.row: k for k, node in enumerate(clip.figure.nodes)}
    sources = [
        numbers[joints * node.is_place + partner[node.row % joints]] for node in figure.nodes
    ]
    for own, other in ((figure.top, clip.figure.top), (figure.path, clip.figure.path)):
        assert other == (None if own is None else sources[own])

    def shown(number: int, state: tuple[int, ...]) -> tuple[int, ...]:
        node = figure.nodes[number]
        joint = node.row % joints
        if not node.is_place:
            w, x, y, z = state
            images = (-x, w, -z, y), (w, x, -y, -z), (z, -y, -x, w), (y, z, w, x)
            return images[mirror[joint][1]]
        x, y, z, *rest = state
        if number == figure.path:
            return (-x, y, z, *rest)
        signs = (-x, -y, -z), (-x, y, z), (x, -y, z), (x, y, -z)
        return (*signs[mirror[rig["parents"][joint]][1]], *rest)

    runs: list[Any] = [
        [[shown(k, state[source]) for k, source in enumerate(sources)] for state in states]
        for states in clip.runs
    ]
    return figure, runs


def streams_of(figure: Figure, rig: Record, streams: int) -> list[int]:
    """Return the number of the stream of the rest that each node is in."""
    if streams == 1:
        return [0] * len(figure.nodes)
    assert streams == len(rig["parts"])
    part = {joint: k for k, part in enumerate(rig["parts"]) for joint in part["joints"]}
    return [part[node.row % len(rig["names"])] for node in figure.nodes]


def reference_poses(figure: Figure, states: States) -> list[Pose]:
    found = []
    for state in states[::8]:
        pose: Pose = [(0, 0, 0, 0)] * figure.rows
        for node, values in zip(figure.nodes, state, strict=True):
            pose[node.row] = values
        found.append(pose)
    return found
