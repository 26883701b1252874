"""Motions of a robot programme counted by hand-written scanning: nothing of it is shared with the reader."""

from __future__ import annotations

_RAPID = {
    *("movej", "movel", "movec", "moveabsj", "moveextj", "movejdo", "moveldo", "movecdo", "movejsync", "movelsync"),
    *("movecsync", "triggj", "triggl", "triggc", "searchl", "searchc", "searchextj", "spotl", "spotj"),
    *("arcl", "arcc", "arclstart", "arclend", "arccstart", "arccend", "arcl1", "arcl2"),
    *("egmmovel", "egmmovec", "egmrunjoint", "egmrunpose"),
}
_KRL = {"ptp", "lin", "circ", "sptp", "slin", "scirc", "spl", "asyptp"}
_KRL |= {f"{word}_rel" for word in _KRL}
_UR = ("movej", "movel", "movep", "movec", "servoj", "servoc", "speedj", "speedl", "optimovej", "optimovel")


def count_motions(ending: str, text: str) -> int:
    """How many motions a text of a language has."""
    return {".ls": _fanuc, ".src": _krl, ".mod": _rapid, ".script": _ur}[ending](text)


def _fanuc(text: str) -> int:
    count, inside = 0, False
    for line in text.split("\n"):
        if line.startswith("/"):
            inside = line.startswith("/MN")
            continue
        rest = line.strip().lstrip("0123456789").strip()
        if not inside or not rest.startswith(":"):
            continue
        rest = rest[1:].strip()
        if len(rest) > 2 and rest[0] in "JLCAS" and rest[1] in " \t":
            count += rest[1:].strip().lstrip("@").startswith(("P[", "PR[", "PAL_"))
    return count


def _bare(text: str, remark: str, quotes: str) -> str:
    """The text without remarks and without what stands between quotes."""
    out, quote, skip = "", "", False
    for char in text:
        if char == "\n":
            quote, skip = "", False
        elif skip or quote:
            quote = "" if char == quote else quote
            continue
        elif char == remark:
            skip = True
            continue
        elif char in quotes:
            quote = char
            continue
        out += char
    return out


def _words(line: str) -> list[str]:
    return "".join(c.lower() if c.isalnum() or c in "_$#" else f" {c} " for c in line).split()


def _krl(text: str) -> int:
    count = 0
    for line in _bare(text, ";", '"').split("\n"):
        words = _words(line)
        if "then" in words:
            words = words[words.index("then") + 1 :] or words
        count += bool(words) and words[0] in _KRL
    return count


def _rapid(text: str) -> int:
    words = _words(_bare(text, "!", '"'))
    return sum(word in _RAPID and (k == 0 or words[k - 1] != "proc") for k, word in enumerate(words))


def _ur(text: str) -> int:
    words = _words(_bare(text, "#", '"'))
    return sum(word in _UR and words[k + 1 : k + 2] == ["("] for k, word in enumerate(words))


def without_numbers(text: str) -> str:
    """The text with a sign in the place of each number and of the blanks before it."""
    out, own = "", ""
    for k, char in enumerate(text):
        digit = char.isdigit() and char.isascii()
        if digit or (char in "+-." and k + 1 < len(text) and (text[k + 1].isdigit() or text[k + 1] == ".")):
            out, own = out.rstrip(" ") if not own else out, own + char
        elif (own and char in ".") or (own and char in "eE" and k + 1 < len(text) and text[k + 1] in "+-"):
            own += char
        else:
            out, own = out + ("#" if own else "") + char, ""
    return out + ("#" if own else "")
