"""The learned codec's part of an archive job: references, models, and encoding level by level."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from secrets import token_hex
from time import monotonic

from ..codec.blocks.motionmodel import MotionModel, fixed_model, model_key, usual_span
from ..codec.blocks.startpose import usual_pose
from ..codec.figure.rig import Family
from ..codec.geometry.limits import Bounds
from ..codec.learned.economy import Candidate, candidate, cheapest, coarsened
from ..codec.learned.learning import learn
from ..codec.learned.modelfile import can_store, write_model
from ..codec.learned.predictorfit import products_of
from ..codec.learned.rehearsal import Rehearsal
from ..codec.learned.samples import Manner
from ..codec.learned.sketch import Sketch
from ..codec.version2.motionencode import LARGEST_STEP, MEAN_STEP, THRIFT, MotionEncoder
from ..codec.version2.motionhead import Named
from .archive import Archive
from .assigning import Wish, assigned
from .earlier import EarlierClips
from .executors import Executor, map_batches, one_thread
from .ledger import Failure
from .motion_tasks import (
    Assignment,
    encode_assigned,
    lost_sketches,
    sample_of,
    sketch_batch,
)
from .plan import BATCH_CLIPS, Settings
from .references import ReferenceFinder
from .relay import Relay
from .tasks import EncodedBatch, EncodedClip, Prepared, lost_failures
from .traits import Trait, Traits, write_traits

SAMPLE_CLIPS = 240  # that a model is learned from at the most
LEAST_FRAMES = 400  # fewer are not worth learning from
SMALL_MODEL = 0.03  # of the archive
SCRATCH = ".scratch"


def likely_step(bounds: Bounds) -> float:
    """Return about the step, centimetres, that clips will be coded at."""
    step = LARGEST_STEP * bounds.tolerance
    return step if bounds.mean is None else min(step, MEAN_STEP * bounds.mean)


@dataclass
class MotionJob:
    """What is known while the clips of a job are encoded.

    ``models``: by key, (generation, model), those of earlier jobs and this one's; ``first``:
    number of the job's first clip; ``frames``: of every clip by name.
    """

    engine: Executor
    settings: Settings
    families: Mapping[str, Family]
    models: dict[str, tuple[int, MotionModel]]
    generation: int
    first: int
    folder: Path
    frames: Mapping[str, int]
    failures: list[Failure] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    numbered: int = 0

    def run(
        self, batches: Sequence[tuple[Prepared, ...]], tell: Callable[[str, int, int], None]
    ) -> Iterator[tuple[Prepared, EncodedClip]]:
        """Yield every clip encoded, in the order of their numbers."""
        shutil.rmtree(self.folder / SCRATCH, ignore_errors=True)
        # a name that no job had before: workers keep what they read from it, by its path
        scratch = self.folder / SCRATCH / token_hex(8)
        try:
            began = monotonic()
            own, images = self._sketched(batches, tell)
            self.seconds["sketch"] = monotonic() - began
            items = {item.source.name: item for batch in batches for item in batch}
            groups: dict[str, list[str]] = {}
            twins: dict[str, list[str]] = {}
            firsts: dict[tuple[str, int], str] = {}
            for name in sorted(own.sketches):
                item = items[name]
                first = firsts.setdefault((item.digest, item.rig_number), name)
                if first != name:  # the same file once more: it shares the index file
                    twins.setdefault(first, []).append(name)
                    continue
                groups.setdefault(model_key(items[name].rig), []).append(name)
            self._learn(groups, items, own.sketches)
            self.seconds["learn"] = monotonic() - began - self.seconds["sketch"]
            began = monotonic()
            models = {key: model for key, (_, model) in self.models.items()}
            archive = Archive(self.folder) if self.first and groups else None
            earlier = EarlierClips(self.engine, archive, models, scratch)
            levels = self._planned(groups, earlier, own, images)
            rows: list[str] = []
            for item, encoded in self._encoded(levels, items, earlier, scratch, tell):
                yield item, encoded
                rows.append(encoded.name)
                depth = earlier.depths[self.first + self.numbered - 1]
                for twin in twins.get(encoded.name, ()):
                    earlier.depths[self.first + self.numbered] = depth
                    self.numbered += 1
                    yield items[twin], replace(encoded, name=twin)
                    rows.append(twin)
            if rows:
                traits = self._traits(rows, own, earlier)
                write_traits(self.folder, self.generation, rows, traits)
            failed = {failure.name: failure.reason for failure in self.failures}
            for name, others in twins.items():
                if name in failed:
                    self.failures += [Failure(twin, failed[name]) for twin in others]
            self.seconds["encode"] = monotonic() - began
        finally:
            shutil.rmtree(self.folder / SCRATCH, ignore_errors=True)

    def _traits(self, rows: Sequence[str], own: Traits[str], earlier: EarlierClips) -> list[Trait]:
        """Return what is to be kept of the job's clips, in the order of their rows."""
        return [
            Trait(own.sketches[name], own.landmarks[name], earlier.depths.get(number, 0))
            for number, name in enumerate(rows, self.first)
        ]

    def _sketched(
        self, batches: Sequence[tuple[Prepared, ...]], tell: Callable[[str, int, int], None]
    ) -> tuple[Traits[str], Traits[str]]:
        """Return what is known of clips, and of their mirror images as far as they have one."""
        found, images = Traits[str]({}, {}), Traits[str]({}, {})
        done, clips = 0, sum(map(len, batches))
        for batch, result in map_batches(
            self.engine, sketch_batch, batches, self.families, self.settings, lost=lost_sketches
        ):
            for known, more in ((found, result.clips), (images, result.images)):
                known.sketches.update(more.sketches)
                known.landmarks.update(more.landmarks)
            self.failures += result.failures
            done += len(batch)
            tell("sketch", done, clips)
        return found, images

    def _learn(
        self,
        groups: Mapping[str, list[str]],
        items: Mapping[str, Prepared],
        sketches: Mapping[str, Sketch],
    ) -> None:
        """Give every key a model: a known one, one learned now, or the fixed one."""
        step = likely_step(self.settings.bounds)
        for key, names in sorted(groups.items()):
            if key in self.models:
                continue
            rig = items[names[0]].rig
            span = usual_span(rig.frame_time)
            rows = 2 * rig.skeleton.joints
            plain = fixed_model(rows, span, hinged=self.families[rig.family_key].hinged)
            self.models[key] = 0, plain
            frames = sum(self.frames[name] for name in names)
            if frames < LEAST_FRAMES or not can_store(rows, span):
                continue
            if self.settings.model == "fixed":
                continue
            moving = [name for name in names if self.frames[name]]
            chosen = moving[:: -(-len(moving) // SAMPLE_CLIPS)]
            family = self.families[rig.family_key]
            samples = [sample_of(items[name], family, self.settings) for name in chosen]
            manner = Manner(int(step * (1 << 24)), THRIFT)
            finder = ReferenceFinder(self.settings.references + 1)
            finder.add([sketches[name] for name in chosen])
            neighbours = [
                [other.number for other in finder.find(sketches[name]) if other.number != at][
                    : self.settings.references
                ]
                for at, name in enumerate(chosen)
            ]
            share = frames / sum(len(sample.goal) for sample in samples)
            usual = usual_pose(rig, family)
            without = self.settings.without
            # the fixed model has parents and contexts; its basis is what is left of one
            plain_serves = "parents" not in without and "contexts" not in without
            start = Rehearsal(samples, neighbours)
            first = one_thread(products_of, start, plain, manner)
            found: list[Candidate] = []
            for keep_weights in (False, True):
                if not keep_weights and self.settings.model == "basis":
                    continue
                if keep_weights and "parents" in without:
                    continue
                model, rehearsal = one_thread(
                    learn, first, plain, manner, usual, keep_weights, without
                )
                tried = [coarsened(model), model]
                if not found and plain_serves:
                    tried.insert(0, plain)
                found += [one_thread(candidate, each, rehearsal, manner, share) for each in tried]
                best = cheapest(found)
                if len(write_model(best.model)) < SMALL_MODEL * best.costs.sum():
                    break  # a cheaper model has nothing to save
            if not plain_serves or best.costs.sum() < found[0].costs.sum():
                self.models[key] = self.generation, best.model

    def _planned(
        self,
        groups: Mapping[str, list[str]],
        earlier: EarlierClips,
        own: Traits[str],
        images: Traits[str],
    ) -> list[list[Wish]]:
        """Return, per level, clips with those that they refer to; earlier ones are decoded."""
        levels: list[list[Wish]] = []
        for key, names in groups.items():
            members = Traits(
                {name: own.sketches[name] for name in names},
                {name: own.landmarks[name] for name in names},
            )
            most, seed = self.settings.references, self.settings.seed
            before = earlier.traits(key) if most else Traits[int]({}, {})
            wishes = assigned(members, images, before, most, seed)
            levels += [[] for _ in range(len(wishes) - len(levels))]
            for level, more in zip(levels, wishes, strict=False):
                level += more
            wanted = {each for level in wishes for wish in level for each in wish.references}
            archived = [Named(clip, flip) for clip, flip in wanted if isinstance(clip, int)]
            earlier.recall(key, archived)
        return levels

    def _encoded(
        self,
        levels: list[list[Wish]],
        items: Mapping[str, Prepared],
        earlier: EarlierClips,
        scratch: Path,
        tell: Callable[[str, int, int], None],
    ) -> Iterator[tuple[Prepared, EncodedClip]]:
        by_part = self.settings.streams == "parts"
        encoders = {
            key: MotionEncoder(self.families[key.rsplit("-", 1)[0]], model, generation, by_part)
            for key, (generation, model) in self.models.items()
        }
        relay = Relay(scratch, levels, earlier.ready)
        below: dict[str, int] = {}
        done, clips = 0, sum(map(len, levels))
        for level in levels:
            assignments = [relay.assignment(wish, items[wish.name]) for wish in level]
            for work in assignments:
                depths = [earlier.depths[named.number] for named, _ in work.references]
                below[work.item.source.name] = max(depths, default=-1)
            batches = [
                tuple(assignments[at : at + BATCH_CLIPS])
                for at in range(0, len(assignments), BATCH_CLIPS)
            ]
            for batch, result in map_batches(
                self.engine,
                encode_assigned,
                batches,
                encoders,
                self.settings,
                str(scratch),
                lost=_lost,
            ):
                self.failures += result.failures
                for encoded in result.clips:
                    item = items[encoded.name]
                    number = self.first + self.numbered
                    self.numbered += 1
                    earlier.depths[number] = 1 + below[encoded.name]
                    relay.number(item, number)
                    yield item, encoded
                done += len(batch)
                tell("encode", done, clips)


def _lost(batch: Sequence[Assignment]) -> EncodedBatch:
    return EncodedBatch(failures=lost_failures(work.item.source.name for work in batch))
