"""Running an archive job: survey, segment, cluster, encode, verify, publish.

Everything that decides the archive's bytes happens in this process, in the plan's order;
workers only compute. What they return is consumed in order (see `executors`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from ..codec.anyfile import check_whole
from ..codec.errors import DamagedError, UsageError
from ..codec.figure.bodyparts import PartsFile
from ..codec.version1.encode import Encoder
from .clustering import Representatives, grow
from .commit import Commit, Job, publish, read_or_start
from .discover import discover
from .durable import NAME_DIGITS, digest, name_of, sync, write_whole
from .executors import Executor, executor, map_batches, one_thread
from .layout import archive_bytes, current_rows, index_path, read_ledgers
from .ledger import Ledger, Row, ledger_path, write_ledger
from .leftovers import remove_leftovers
from .lock import writer_lock
from .motion_job import MotionJob
from .plan import Plan, Settings, make_plan
from .report import Progress, Report
from .searchers import Searchers
from .store import Store, read_store, write_generation
from .survey import settle, survey_clips
from .tasks import (
    EncodedBatch,
    EncodedClip,
    Prepared,
    Segmented,
    Survey,
    encode_batch,
    lost_failures,
    segment_batch,
)

ROUND_CLIPS = 1024  # clips whose segments are clustered at a time: bounds the memory


def archive_library(
    library: str | Path,
    archive: str | Path,
    settings: Settings | None = None,
    *,
    include: Sequence[str] = (),
    parts: PartsFile | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Report:
    """Archive the clips of a library folder that are new or changed; return what was done.

    ``workers``: local processes, None for one per core, 0 for none; ``scheduler``: address of
    a Dask scheduler to use instead; neither changes a byte of the archive. ``parts``: body-part
    overrides. ``progress`` is called now and then. Files that cannot be used are in the
    report's ``failures`` and do not stop the job; an interrupted job leaves the archive as it
    was. Raises `MotifoldError` subclasses.
    """
    sources = discover(Path(library), include)
    plan = make_plan(sources, settings or Settings())
    folder = Path(archive)
    with writer_lock(folder), executor(workers, scheduler) as engine:
        return _Job(folder, plan, parts, engine, progress or (lambda _: None)).run()


class _Job:
    def __init__(
        self,
        folder: Path,
        plan: Plan,
        overrides: PartsFile | None,
        engine: Executor,
        progress: Callable[[Progress], None],
    ) -> None:
        self.folder = folder
        self.plan = plan
        self.settings = plan.settings
        self.overrides = overrides
        self.engine = engine
        self.progress = progress
        self.report = Report()
        self.rows: list[Row] = []

    def run(self) -> Report:
        before = read_or_start(self.folder)
        generation = before.generation + 1
        ledgers = read_ledgers(self.folder, before)
        remove_leftovers(self.folder, ledgers, generation)
        store = read_store(self.folder, before, ledgers)
        known = {
            name: row.source
            for name, (row, made) in current_rows(ledgers).items()
            if self.settings.covers(ledgers[made].settings)
        }

        with self.report.timed("survey"):
            surveyed = survey_clips(
                self.engine, self.plan, self.overrides, known, self._tell("survey")
            )
            prepared = settle(surveyed, self.plan, store)
        self.report.unchanged = surveyed.unchanged
        self.report.failures += surveyed.failures
        if self.settings.codec == "learned":
            self._encode_learned(prepared, surveyed.clips, store, ledgers, generation)
        else:
            with self.report.timed("cluster"):
                self._cluster(prepared, store)
            with self.report.timed("encode"):
                self._encode(prepared, surveyed.clips, store, generation)
        with self.report.timed("publish"):
            if self.rows or self._new_failures(ledgers):
                self._publish(before, generation, store)
        self.report.patterns = sum(sum(counts) for counts in store.counts().values())
        self.report.archive_bytes = archive_bytes(self.folder)
        return self.report

    def _new_failures(self, ledgers: dict[int, Ledger]) -> bool:
        """Return whether a file failed that the last job does not tell of."""
        told = ledgers[max(ledgers)].failures if ledgers else ()
        return not set(self.report.failures) <= set(told)

    def _tell(self, stage: str) -> Callable[[int, int], None]:
        return lambda done, clips: self.progress(Progress(stage, done, clips))

    def _cluster(self, batches: list[tuple[Prepared, ...]], store: Store) -> None:
        """Segment in parallel, then let each family's patterns grow, a round at a time."""
        radii = {
            key: self.settings.clusters.radius(family.head_diagonal, self.settings.tolerance)
            for key, family in store.families.items()
        }
        searchers = Searchers(store)
        clips = sum(len(batch) for batch in batches)
        gathered: dict[tuple[str, int], list[Representatives]] = {}
        waiting = done = 0
        for batch, result in map_batches(
            self.engine,
            segment_batch,
            batches,
            store.families,
            radii,
            self.settings.segments,
            self.settings.units,
            lost=_lost_segments,
        ):
            self.report.failures += result.failures
            for item in batch:
                made = result.clips.get(item.source.name, [])
                for part, group in enumerate(made):
                    if group is not None and len(group.points):
                        gathered.setdefault((item.rig.family_key, part), []).append(group)
            waiting += len(batch)
            done += len(batch)
            if waiting >= ROUND_CLIPS or done == clips:
                self._grow(store, searchers, gathered, radii)
                gathered, waiting = {}, 0
            self.progress(Progress("cluster", done, clips))

    def _grow(
        self,
        store: Store,
        searchers: Searchers,
        gathered: dict[tuple[str, int], list[Representatives]],
        radii: dict[str, float],
    ) -> None:
        for (key, part), groups in sorted(gathered.items(), key=lambda entry: entry[0]):
            searcher, settings = searchers.of(key, part), self.settings
            new = one_thread(grow, searcher, groups, radii[key], settings.clusters, settings.seed)
            store.add_patterns(key, part, new)

    def _encode(
        self,
        batches: list[tuple[Prepared, ...]],
        surveys: dict[str, Survey],
        store: Store,
        generation: int,
    ) -> None:
        report, settings = self.report, self.settings
        slack = 1.0 if settings.clusters.bound == "max" else 3.0
        encoders = {
            key: Encoder(
                store.codebook(key),
                generation,
                settings.tolerance,
                slack * settings.clusters.radius(family.head_diagonal, settings.tolerance),
                settings.segments,
            )
            for key, family in store.families.items()
        }
        failed = {failure.name for failure in report.failures}
        batches = [
            kept
            for batch in batches
            if (kept := tuple(item for item in batch if item.source.name not in failed))
        ]
        clips, done, error_sum = sum(map(len, batches)), 0, 0.0
        for batch, result in map_batches(
            self.engine, encode_batch, batches, encoders, settings.units, lost=_lost_encoded
        ):
            report.failures += result.failures
            numbers = {item.source.name: item.rig_number for item in batch}
            for encoded in result.clips:
                survey = surveys[encoded.name]
                self._keep(encoded, survey, numbers[encoded.name])
                error_sum += encoded.certificate.mean * survey.frames
            done += len(batch)
            self.progress(Progress("encode", done, clips, report.source_bytes, report.index_bytes))
        report.mean_error = error_sum / max(report.frames, 1)
        self.rows.sort(key=lambda row: row.name)

    def _encode_learned(
        self,
        batches: list[tuple[Prepared, ...]],
        surveys: dict[str, Survey],
        store: Store,
        ledgers: dict[int, Ledger],
        generation: int,
    ) -> None:
        """Encode with index files of version 2; see `motion_job`."""
        for pattern, _ in self.settings.joint_tolerances:
            names = [name for rig in store.rigs for name in rig.skeleton.names]
            if not any(fnmatchcase(name, pattern) for name in names):
                raise UsageError(f"no joint or marker {pattern}", advice="See: motifold info")
        job = MotionJob(
            self.engine,
            self.settings,
            store.families,
            store.newest_models(),
            generation,
            sum(len(ledger.rows) for ledger in ledgers.values()),
            self.folder,
            {name: survey.frames for name, survey in surveys.items()},
        )
        error_sum = 0.0
        stages = self.report.seconds
        for item, encoded in job.run(batches, self._staged):
            survey = surveys[encoded.name]
            self._keep(encoded, survey, item.rig_number)
            error_sum += encoded.certificate.mean * survey.frames
        stages.update(job.seconds)
        self.report.failures += job.failures
        self.report.mean_error = error_sum / max(self.report.frames, 1)
        store.models.update(
            ((key, made), model) for key, (made, model) in job.models.items() if made
        )

    def _staged(self, stage: str, done: int, clips: int) -> None:
        report = self.report
        self.progress(Progress(stage, done, clips, report.source_bytes, report.index_bytes))

    def _keep(self, encoded: EncodedClip, survey: Survey, rig: int) -> None:
        """Write one clip's index file, read it back, and note its row."""
        name = name_of(encoded.data)
        path = index_path(self.folder, name)
        if path.exists() and path.read_bytes() != encoded.data:  # another file's name begins alike
            name = digest(encoded.data)
            path = index_path(self.folder, name)
        if not path.exists():
            write_whole(path, encoded.data)
        if (written := path.read_bytes()) != encoded.data:
            raise DamagedError("was not written as it should", file=path, advice="Check the disk")
        check_whole(written)
        self.rows.append(
            Row(
                survey.name,
                name,
                survey.source[:NAME_DIGITS],
                survey.source_bytes,
                survey.frames,
                rig,
                survey.numbers,
                survey.repairs,
            )
        )
        report = self.report
        report.clips += 1
        report.frames += survey.frames
        report.source_bytes += survey.source_bytes
        report.float32_bytes += 4 * survey.numbers
        report.index_bytes += len(encoded.data)
        report.segments += encoded.segments
        report.matched += encoded.matched
        report.max_error = max(report.max_error, encoded.certificate.maximum)

    def _publish(self, before: Commit, generation: int, store: Store) -> None:
        digests = write_generation(self.folder, generation, before, store)
        ledger = Ledger(
            self.settings.to_record(),
            tuple(self.rows),
            tuple(sorted(self.report.failures, key=lambda failure: failure.name)),
            digests,
        )
        path = ledger_path(self.folder, generation)
        job = Job(
            generation, write_ledger(path, ledger), len(self.rows), len(store.rigs), store.counts()
        )
        for folder in (self.folder / "ledger", self.folder / "clips", *self.folder.glob("clips/*")):
            if folder.is_dir():
                sync(folder)
        publish(self.folder, Commit((*before.jobs, job)))


def _lost_segments(batch: Sequence[Prepared]) -> Segmented:
    return Segmented(failures=lost_failures(item.source.name for item in batch))


def _lost_encoded(batch: Sequence[Prepared]) -> EncodedBatch:
    return EncodedBatch(failures=lost_failures(item.source.name for item in batch))
