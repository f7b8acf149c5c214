"""``motifold info``: what an archive, or one of its clips, holds."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import show_json, show_table
from .quantities import show_bytes, show_duration, show_length, show_ratio

if TYPE_CHECKING:
    from ..pipeline.archive import Archive
    from ..pipeline.archived_clip import ArchivedClip


def info(
    archive: Annotated[Path, typer.Argument(help="Archive folder.")],
    clip: Annotated[str | None, typer.Argument(help="A clip's name; none: the archive.")] = None,
    clips: Annotated[bool, typer.Option("--clips", help="List every clip.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Show what ARCHIVE holds, or one CLIP of it with its certificate and repairs."""
    from ..pipeline.archive import Archive

    with Archive(archive) as opened:
        if clip is not None:
            records = [clip_record(opened[name]) for name in opened.find(clip)]
            if json:
                show_json(records if len(records) > 1 else records[0])
                return
            for record in records:
                _show_clip(record)
        elif clips:
            _show_clips(opened, json)
        else:
            _show_archive(archive_record(opened), json)


def archive_record(archive: Archive) -> dict[str, Any]:
    """Return what is known of an archive, JSON-serialisable; sizes in bytes, times in seconds."""
    from ..pipeline.durable import folder_bytes
    from ..pipeline.layout import CATALOG, TRAITS, archive_bytes

    rows = [row for row, _ in archive.rows.values()]
    rigs = archive.store.rigs
    repaired = sum(bool(row.repairs) for row in rows)
    families = [
        {
            "family": key,
            "kind": family.kind,
            "parts": {
                part.name: len(patterns)
                for part, patterns in zip(family.parts, archive.store.patterns[key], strict=True)
            },
        }
        for key, family in archive.store.families.items()
    ]
    return {
        "path": str(archive.path),
        "generation": archive.commit.generation,
        "clips": len(rows),
        "frames": sum(row.frames for row in rows),
        "seconds": sum(row.frames * rigs[row.rig].frame_time for row in rows),
        "source_bytes": sum(row.source_bytes for row in rows),
        "float32_bytes": sum(4 * row.numbers for row in rows),
        "archive_bytes": archive_bytes(archive.path),
        "catalog_bytes": folder_bytes(archive.path / CATALOG),
        "traits_bytes": folder_bytes(archive.path / TRAITS),
        "rigs": len(rigs),
        "families": families,
        "repaired_clips": repaired,
        "jobs": [
            {
                "generation": job.generation,
                "clips": job.clips,
                "tolerance_cm": archive.ledgers[job.generation].settings["tolerance"],
                "failures": [
                    [failure.name, failure.reason]
                    for failure in archive.ledgers[job.generation].failures
                ],
            }
            for job in archive.commit.jobs
        ],
    }


def clip_record(clip: ArchivedClip) -> dict[str, Any]:
    """Return what is known of a clip, JSON-serialisable; lengths in centimetres."""
    rig = clip.rig
    layout = rig.layout
    return {
        "name": clip.name,
        "format": layout.format,
        "frames": clip.frames,
        "frame_time": clip.frame_time,
        "seconds": clip.seconds,
        "unit": layout.unit,
        "unit_source": layout.unit_source,
        "joints": rig.skeleton.joints,
        "parts": {part.name: [rig.skeleton.names[j] for j in part.joints] for part in rig.parts},
        "tolerance_cm": clip.tolerance,
        "certificate_cm": asdict(clip.certificate),
        "source_bytes": clip.row.source_bytes,
        "float32_bytes": 4 * clip.row.numbers,
        "index_bytes": clip.path.stat().st_size,
        "index_file": str(clip.path),
        "generation": clip.generation,
        "follows": [each._asdict() for each in clip.follows],
        "repairs": [{"place": repair.place, "what": repair.what} for repair in clip.repairs],
    }


def _show_archive(record: dict[str, Any], json: bool) -> None:
    if json:
        show_json(record)
        return
    show_table(
        [
            ["clips", f"{record['clips']:,}"],
            ["motion", show_duration(record["seconds"])],
            ["frames", f"{record['frames']:,}"],
            ["rigs", f"{record['rigs']:,}"],
            ["clips with repairs", f"{record['repaired_clips']:,}"],
            ["source files", show_bytes(record["source_bytes"])],
            ["float32 of what varies", show_bytes(record["float32_bytes"])],
            ["archive", show_bytes(record["archive_bytes"])],
            ["search catalog, beside it", show_bytes(record["catalog_bytes"])],
            ["for later jobs, beside it", show_bytes(record["traits_bytes"])],
            ["source : archive", show_ratio(record["source_bytes"], record["archive_bytes"])],
            ["float32 : archive", show_ratio(record["float32_bytes"], record["archive_bytes"])],
        ]
    )
    for family in record["families"]:
        print(f"\npatterns of {family['kind']} family {family['family']}")
        show_table([[name, f"{count:,}"] for name, count in family["parts"].items() if count])
    print("\njobs")
    rows = [["job", "clips", "tolerance", "failures"]]
    for job in record["jobs"]:
        tolerance = show_length(job["tolerance_cm"])
        failures = f"{len(job['failures']):,}"
        rows.append([str(job["generation"]), f"{job['clips']:,}", tolerance, failures])
    show_table(rows, header=True)
    for job in record["jobs"]:
        for name, reason in job["failures"]:
            print(f"failed in job {job['generation']}: {name}: {reason}")


def _show_clip(record: dict[str, Any]) -> None:
    certificate = record["certificate_cm"]
    rate = 1.0 / record["frame_time"]
    show_table(
        [
            ["clip", record["name"]],
            ["format", record["format"]],
            ["frames", f"{record['frames']:,}"],
            ["duration", f"{show_duration(record['seconds'])} at {rate:.4g} frames/s"],
            ["length unit", f"{record['unit']} ({record['unit_source']})"],
            ["joints or markers", str(record["joints"])],
            ["tolerance", show_length(record["tolerance_cm"])],
            ["certified maximum", show_length(certificate["maximum"])],
            ["certified mean", show_length(certificate["mean"])],
            ["99th percentile", show_length(certificate["percentile_99"])],
            ["source file", show_bytes(record["source_bytes"])],
            ["index file", show_bytes(record["index_bytes"])],
            ["float32 : index", show_ratio(record["float32_bytes"], record["index_bytes"])],
        ]
    )
    for name, joints in record["parts"].items():
        print(f"part {name}: {', '.join(joints)}")
    for each in record["follows"]:
        older = "an older version of " if each["replaced"] else ""
        moved = ", mirrored" * each["mirrored"] + ", moved" * each["moved"]
        print(
            f"from {each['start']:.2f} s to {each['stop']:.2f} s as {older}{each['clip']} "
            f"from {each['begun']:.2f} s on{moved}"
        )
    for repair in record["repairs"]:
        place = f" ({repair['place']})" if repair["place"] else ""
        print(f"repair: {repair['what']}{place}")


def _show_clips(archive: Archive, json: bool) -> None:
    records = [clip_record(clip) for clip in archive.values()]
    if json:
        show_json(records)
        return
    rows = [["clip", "seconds", "bytes", "float32 : index", "max error", "repairs"]]
    rows += [
        [
            record["name"],
            f"{record['seconds']:.2f}",
            str(record["index_bytes"]),
            show_ratio(record["float32_bytes"], record["index_bytes"]),
            show_length(record["certificate_cm"]["maximum"]),
            str(len(record["repairs"])),
        ]
        for record in records
    ]
    show_table(rows, header=True)
