"""What a joint's name says: the side of the body, and the role of the joint there.

The tables cover the naming of the usual sources: CMU (ASF and BVH conversions), Bandai-Namco,
MotionBuilder and Mixamo, 3ds Max Biped, Poser and Daz, Unreal, Vicon and OpenSim bones, SMPL,
Xsens and Rokoko, VRM.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Literal, TypeAlias

Side: TypeAlias = Literal["left", "right", ""]

# A named role; "" where the name says nothing. The roles that end in "?" depend on what hangs
# below: "shoulder?" is a clavicle or an upper arm, "hip?" a hip joint or a thigh.
Role: TypeAlias = Literal[
    "root",
    "spine",
    "head",
    "face",
    "shoulder",
    "shoulder?",
    "upper_arm",
    "forearm",
    "hand",
    "fingers",
    "hip?",
    "thigh",
    "shin",
    "foot",
    "other",
    "",
]

_SPINE = re.compile(
    r"spine|chest|thora|torso|\b(lower|upper|mid)?back\b|abdom|waist|trunk|lumbar|sternum|belly"
)
_PATTERNS: tuple[tuple[Role, str], ...] = (
    # things that carry a body part's word without being one come first
    ("other", r"\bik\b|\bpole\b|target|weapon|\bprop|handle|attach|socket|tail\b|\bwing|hair"),
    ("other", r"footsteps|backpack|necklace|necktie|headset|headgear|\bvb\b"),
    ("face", r"\beye|jaw|brow|\blips?\b|tongue|cheek|\bnose|nostril|mouth|\blid|eyelid|teeth"),
    ("face", r"\bears?\b|\bchin\b|\bface|facial"),
    ("foot", r"toe|foot|feet|ankle|\bball\b|heel|talus|calcn|tarsal|\bmtp\b"),
    ("fingers", r"thumb|index|middle|\bmid\b|\bring\b|pink(y|ie)|little|finger|metacarp|phalan"),
    ("hand", r"hand|wrist|palm|carpal|carpus"),
    ("shoulder", r"clavic|collar|scapula"),
    ("forearm", r"fore(arm|twist)|low(er)?arm|radius|ulna\b|elbow"),
    ("upper_arm", r"up(per)?arm|humerus|arms?\b|arm(roll|twist|bend|nub|end)"),
    ("shoulder?", r"shoulder|shldr"),
    ("thigh", r"thigh|up(per)?leg|femur"),
    (
        "shin",
        r"low(er)?leg|shin|calf|tibia|fibula|knee|patella|shank|legs?\b|leg(roll|twist|bend|nub|end)",
    ),
    ("hip?", r"hip(joint|s)?\b|buttock|pelvis"),
    ("head", r"head|neck|skull|crani"),
    ("spine", _SPINE.pattern),
)
_RULES: tuple[tuple[Role, re.Pattern[str]], ...] = tuple(
    (role, re.compile(pattern)) for role, pattern in _PATTERNS
)
_ROOT = re.compile(r"root|\bhips?\b|pelvis")
_VERTEBRA = re.compile(r"[TL]\d{1,2}")  # Xsens: L5, L3, T12, T8
_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
_SIDES: dict[str, Side] = {"left": "left", "l": "left", "right": "right", "r": "right"}
_NOISE = frozenset(("armature", "bip", "bone", "character", "jnt", "joint", "mixamorig", "subject"))


@lru_cache(maxsize=4096)
def read_name(name: str) -> tuple[Side, Role]:
    """Return the side and the role that a joint's name states, either "" where it is silent.

    Namespaces (all up to the last ``:`` or ``|``), digits, case and separators do not count;
    a side is a word of its own (``Hand_L``, ``L Hand``, ``LHand``, ``LeftHand``) or a prefix
    (``lhand``, ``lefthand``).
    """
    bare = re.split(r"[:|]", name)[-1].strip()
    if _VERTEBRA.fullmatch(bare):
        return "", "spine"
    side: Side = ""
    words: list[str] = []
    for word in (found.lower() for found in _WORD.findall(bare)):
        if word in _SIDES:
            side = side or _SIDES[word]
            continue
        prefix = _side_prefix(word)
        if prefix:
            side = side or _SIDES[prefix]
        if word not in _NOISE:
            words.append(word[len(prefix) :])
    # both forms, so that "fore arm" and "forearm" match alike and \b finds whole words
    text = f"{' '.join(words)} {''.join(words)}"
    role: Role = next((role for role, rule in _RULES if rule.search(text)), "")
    if not side and role != "other":  # "Spine_Mid" is no middle finger, "Hips" no hip joint
        if _SPINE.search(text):
            return "", "spine"
        if role in ("", "hip?") and _ROOT.search(text):
            return "", "root"
    return side, role


def _side_prefix(word: str) -> str:
    """Return the side that an unseparated word starts with, if the rest of it is a role."""
    for prefix in ("left", "right", "l", "r"):
        rest = word.removeprefix(prefix)
        if rest != word and len(rest) > 2 and any(rule.match(rest) for _, rule in _RULES):
            return prefix
    return ""


def other_side(name: str) -> str:
    """Return a joint's name with left for right and right for left, in small letters.

    A name without a side stays, in small letters, too.
    """
    side = read_name(name)[0]
    if not side:
        return name.lower()
    start = max(name.rfind(":"), name.rfind("|")) + 1
    for found in _WORD.finditer(name, start):
        word = found.group().lower()
        said = word if word in _SIDES else _side_prefix(word)
        if said:
            other = {"left": "right", "right": "left", "l": "r", "r": "l"}[said]
            return (name[: found.start()] + other + name[found.start() + len(said) :]).lower()
    return name.lower()
