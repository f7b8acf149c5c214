"""The first stage of a job: look at every file once, and give each clip a rig and a family."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ..codec.figure.bodyparts import BodyPart, PartsFile
from ..codec.figure.rig import Rig, found_family
from .discover import Source
from .executors import Executor, map_batches
from .ledger import Failure
from .plan import Plan
from .store import Store
from .tasks import FamilySketch, Prepared, Survey, Surveyed, lost_failures, survey_batch


@dataclass
class SurveyedLibrary:
    """What a library holds that the archive does not: clips by name, their rigs and families."""

    clips: dict[str, Survey] = field(default_factory=dict)
    rigs: dict[str, Rig] = field(default_factory=dict)
    families: dict[str, FamilySketch] = field(default_factory=dict)
    unchanged: int = 0
    failures: list[Failure] = field(default_factory=list)


def survey_clips(
    engine: Executor,
    plan: Plan,
    overrides: PartsFile | None,
    known: Mapping[str, str],
    progress: Callable[[int, int], None],
) -> SurveyedLibrary:
    """Look at every file of a plan; those whose digest is ``known`` under their name are skipped.

    ``progress`` gets clips done and clips in all.
    """
    found = SurveyedLibrary()
    done = 0
    for batch, result in map_batches(
        engine, survey_batch, plan.batches, plan.settings.units, overrides, known, lost=_lost
    ):
        found.failures += result.failures
        found.unchanged += result.unchanged
        found.clips.update((clip.name, clip) for clip in result.clips)
        found.rigs.update(result.rigs)
        for key, sketch in result.families.items():
            if key in found.families:
                found.families[key].usual = found.families[key].usual + sketch.usual
                found.families[key].bends = found.families[key].bends + sketch.bends
            else:
                found.families[key] = sketch
        done += len(batch)
        progress(done, plan.clips)
    return found


def settle(found: SurveyedLibrary, plan: Plan, store: Store) -> list[tuple[Prepared, ...]]:
    """Give every new clip a rig and a family in the store; return the clips in batches.

    Clips of the same markers share the hierarchy of the first one, because the automatic one
    depends on what moves in a clip.
    """
    markers = {rig.skeleton.names: rig.parts for rig in store.rigs if rig.kind == "markers"}
    numbers: dict[str, int] = {}
    batches = []
    for batch in plan.batches:
        items = []
        for source in batch:
            clip = found.clips.get(source.name)
            if clip is None:
                continue
            if clip.rig_key not in numbers:
                local = "world" in plan.settings.without
                numbers[clip.rig_key] = _settled(found, clip.rig_key, markers, store, local)
            number = numbers[clip.rig_key]
            items.append(Prepared(source, number, store.rigs[number], clip.source))
        if items:
            batches.append(tuple(items))
    return batches


def _settled(
    found: SurveyedLibrary,
    key: str,
    markers: dict[tuple[str, ...], tuple[BodyPart, ...]],
    store: Store,
    local: bool,
) -> int:
    rig = found.rigs[key]
    sketch = found.families[rig.family_key]
    if rig.kind == "markers":
        rig = replace(rig, parts=markers.setdefault(rig.skeleton.names, rig.parts))
    if rig.family_key not in store.families:
        founded = found_family(
            rig, sketch.usual, sketch.bones, sketch.bends, sketch.head_diagonal, local
        )
        store.add_family(founded)
    number = store.rig_number(rig)
    return store.add_rig(rig) if number is None else number


def _lost(batch: Sequence[Source]) -> Surveyed:
    return Surveyed(failures=lost_failures(source.name for source in batch))
