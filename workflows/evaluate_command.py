"""``motifold evaluate``: how well search finds what labels call the same."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import ProgressLine, show_json, show_table
from .quantities import parse_seconds

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ..pipeline.archive import Archive


def evaluate(
    archive: Annotated[Path, typer.Argument(help="Archive folder.")],
    labels: Annotated[
        str, typer.Option(help="Pattern with named groups, which reads labels from clip names.")
    ],
    relevant: Annotated[
        list[str] | None, typer.Option(help="Label that must agree; may be repeated.")
    ] = None,
    exclude_same: Annotated[
        list[str] | None, typer.Option(help="Clips with the query's own one do not compete.")
    ] = None,
    within: Annotated[
        list[str] | None, typer.Option(help="Only clips with the query's own one compete.")
    ] = None,
    windows: Annotated[
        str | None, typer.Option(help="Find spans this long in other takes instead, such as 1.5s.")
    ] = None,
    queries: Annotated[
        int, typer.Option(min=1, help="Random queries for the slow yardstick.")
    ] = 200,
    seed: Annotated[int, typer.Option(help="Seed of the random queries.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Measure search in ARCHIVE against labels, leave-one-out, beside what it should beat.

    Without --relevant: all labels one by one, each also with every other label's own excluded,
    and within every other.
    """
    import numpy as np

    from ..catalog.catalogfolder import Catalog
    from ..catalog.evaluate import (
        baseline_ranks,
        compare,
        frame_ranks,
        index_ranks,
        label_task,
        read_labels,
        remember,
    )
    from ..catalog.windoweval import compare_windows, groups_of, random_pieces
    from ..pipeline.archive import Archive
    from ..pipeline.executors import one_thread

    line = ProgressLine()
    catalog = Catalog(archive, many=True)
    found = read_labels(list(catalog.numbers), labels)
    with Archive(archive) as opened:
        motions, times, described = _motions(opened, list(found), line)
    numbers = np.array([catalog.numbers[name] for name in found], np.int64)
    marks = list(found.values())
    if windows is not None:
        lengths = [len(motion) * time for motion, time in zip(motions, times, strict=True)]
        pieces = random_pieces(lengths, parse_seconds(windows), queries, seed)
        results = [
            one_thread(
                compare_windows,
                catalog,
                numbers,
                motions,
                times,
                groups_of(marks),
                pieces,
                lambda done, total: line.update("methods", done, total),
                seed,
            )
        ]
    else:
        tasks = (
            [label_task(marks, relevant, exclude_same or (), within or ())]
            if relevant
            else [label_task(marks, *each) for each in _all_tasks(list(marks[0]))]
        )
        rng = np.random.default_rng(seed)
        some = np.sort(rng.choice(len(numbers), min(queries, len(numbers)), replace=False))
        everything = list(range(len(numbers)))
        methods = {
            method: one_thread(remember, rank, chosen, partial(line.update, method))
            for method, rank, chosen in (
                ("index only", index_ranks(catalog, numbers, rerank=False), everything),
                ("index, re-ranked", index_ranks(catalog, numbers, rerank=True), everything),
                ("mean and deviation", baseline_ranks(described), everything),
                ("time warping over joints", frame_ranks(motions), some.tolist()),
            )
        }
        results = [compare(methods, task, len(numbers), seed) for task in tasks]
    line.clear()
    if json:
        show_json(results)
        return
    for result in results:
        _show_result(result)


def _all_tasks(labels: list[str]) -> list[tuple[list[str], list[str], list[str]]]:
    tasks: list[tuple[list[str], list[str], list[str]]] = []
    for label in labels:
        tasks.append(([label], [], []))
        for other in labels:
            if other != label:
                tasks += [([label], [other], []), ([label], [], [other])]
    return tasks


def _motions(
    archive: Archive, names: list[str], line: ProgressLine
) -> tuple[list[npt.NDArray[np.float32]], list[float], list[npt.NDArray[np.float64]]]:
    """Return joint positions of clips, which must have equally many, frame times and moments."""
    from ..catalog.bodysignals import faced
    from ..catalog.evaluate import moments
    from ..codec.errors import UsageError

    motions, times, described = [], [], []
    for number, name in enumerate(names):
        clip = archive[name]
        decoded = clip.decode()
        motions.append(faced(decoded, clip.rig.parts).astype("float32"))
        described.append(moments(faced(decoded, clip.rig.parts, steady=True).astype("float32")))
        times.append(clip.frame_time)
        if motions[-1].shape[1] != motions[0].shape[1] or not len(motions[-1]):
            raise UsageError(f"{name} has other joints than {names[0]}", advice="Narrow --labels")
        line.update("decode", number + 1, len(names))
    return motions, times, described


def _show_result(result: dict[str, Any]) -> None:
    for key, title in (
        ("all_queries", f"{result['task']}: {result['clips']:,} clips, every one a query"),
        ("same_random_queries", f"{result['task']}: the same random queries for every method"),
    ):
        if key not in result:
            continue
        print(f"\n{title}")
        rows = [["", "queries", "at 1", "at 10", "mAP", "nDCG", "ms a query", "median"]]
        for each in result[key]:
            shares = ("precision_1", "precision_10", "mean_average_precision", "ndcg")
            rows.append(
                [
                    each["method"],
                    f"{each['queries']:,}",
                    *(f"{100 * each[share]:.1f} %" for share in shares),
                    f"{1000 * each['seconds']:.3g}",
                    f"{1000 * each['median_seconds']:.3g}",
                ]
            )
        show_table(rows, header=True)
