"""What the name of a point says: pose, marker, state, load, repeat and cycle."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from qsframework.applications.importers.campaign import Campaign
from qsframework.applications.importers.vocabulary import LOADED, UNLOADED, WITH, WITHOUT, words_of

_TOKEN = re.compile(r"[^\W\d_]+\d*|\d+")
_COUNT = re.compile(r"(r|rep|repeat|c|cycle)0*([1-9]\d{0,4})")
HALF = "half"
"""What says in a name that half of the load hung."""


@dataclass(frozen=True, kw_only=True)
class Said:
    """What a name says; None or "" where it says nothing of it. several: what it says twice, such as two poses.

    unknown: words that say nothing
    """

    pose: str | None = None
    marker: str | None = None
    loaded: bool | None = None
    load: str = ""
    repeat: int | None = None
    cycle: int | None = None
    several: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True)
class Vocabulary:
    """Everything that a word of a name may mean, by the word made plain: its kind and its value."""

    meanings: Mapping[str, tuple[tuple[str, str], ...]]
    longest: int

    def meant(self, word: str, kind: str) -> list[str]:
        """What a whole word may mean of one kind."""
        return [value for own, value in self.meanings.get(plain(word), ()) if own == kind]


def plain(text: str) -> str:
    """Letters and digits alone, small, without zeros in front of a number: P-07 and p7 are one."""
    return re.sub(r"(?<!\d)0+(?=\d)", "", "".join(words_of(text.lower())))


def vocabulary(campaign: Campaign, markers: Sequence[str], words: Mapping[str, str]) -> Vocabulary:
    """The words of a campaign, and those that the user states: found=meant."""
    found: dict[str, list[tuple[str, str]]] = {}

    def add(kind: str, names: Iterable[str]) -> None:
        for name in names:
            own = found.setdefault(plain(name), [])
            if (kind, name) not in own:
                own.append((kind, name))

    add("pose", campaign.poses)
    add("marker", markers)
    loads = {(i, name) for own in campaign.names.values() for i, name in own.items() if name}
    for load, name in sorted(loads):
        found.setdefault(plain(name), []).append(("load", load or name))
    for state, spelled in (("loaded", LOADED), ("unloaded", UNLOADED)):
        for word in spelled:
            if word not in found:
                found[word] = [("state", state)]
    for word in (HALF, "halfload"):
        found.setdefault(word, [("half", HALF)])
    for word, meant in words.items():
        target = found.get(plain(meant))
        if target is not None:
            found[plain(word)] = list(target)
    longest = max((len(_TOKEN.findall(t)) for t in (*campaign.poses, *markers, *words)), default=1)
    loads_long = max((len(_TOKEN.findall(name)) for _, name in loads), default=1)
    return Vocabulary({k: tuple(v) for k, v in found.items() if k}, max(longest, loads_long, 2))


def state_word(name: str, unknown: Sequence[str]) -> str:
    """FOUND=STATE by the words of a name that speak of a load, such as `ohne Last=unloaded`; "" where none does."""
    spoken = [word for word in unknown if word.lower() in (*WITH, *WITHOUT)]
    if not spoken:
        return ""
    words = " ".join(spoken) if plain("".join(spoken)) in plain(name) else spoken[0]
    return f"{words}={'unloaded' if any(word.lower() in WITHOUT for word in spoken) else 'loaded'}"


def decode(text: str, known: Vocabulary) -> Said:
    """What a name says, by the longest runs of its words that mean something."""
    tokens = _TOKEN.findall(text)
    told: dict[str, list[str]] = {}
    unknown: list[str] = []
    i = 0
    while i < len(tokens):
        for size in range(min(known.longest, len(tokens) - i), 0, -1):
            meanings = known.meanings.get(plain("".join(tokens[i : i + size])))
            if meanings:
                for kind, value in meanings:
                    told.setdefault(kind, []).append(value)
                i += size
                break
        else:
            two = "".join(tokens[i : i + 2]).lower()  # repeat 2, as the day's sheet writes it
            counts = [found for text in (tokens[i].lower(), two) if (found := _COUNT.fullmatch(text)) is not None]
            if counts:
                told.setdefault("repeat" if counts[0][1][0] == "r" else "cycle", []).append(counts[0][2])
                i += len(counts[0][0]) > len(tokens[i])
            else:
                unknown.append(tokens[i])
            i += 1
    return _said(told, unknown)


def _said(told: Mapping[str, Sequence[str]], unknown: Sequence[str]) -> Said:
    one = {kind: list(dict.fromkeys(values)) for kind, values in told.items()}
    several = [f"{kind} {' or '.join(v)}" for kind, v in one.items() if len(v) > 1 and kind != "load"]
    shared = set(one.get("pose", ())) & set(one.get("marker", ()))
    several += [f"pose or marker {name}" for name in sorted(shared)]
    first = {kind: values[0] for kind, values in one.items()}
    load = HALF if "half" in one else first.get("load", "")
    state = first.get("state")
    loaded = None if state is None else state == "loaded"
    if loaded is None and load:
        loaded = True
    return Said(
        pose=first.get("pose"),
        marker=first.get("marker"),
        loaded=loaded,
        load=load,
        repeat=int(first["repeat"]) if "repeat" in first else None,
        cycle=int(first["cycle"]) if "cycle" in first else None,
        several=tuple(several),
        unknown=tuple(unknown),
    )
