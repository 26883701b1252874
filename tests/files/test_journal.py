"""A journal: what was acknowledged is there, whatever ended the process or spoilt the file."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from qsframework.errors import InputError
from qsframework.files.journal import Journal

HEADER = {"format": "day 1", "plan": "a1b2"}
RECORDS = [{"event": "read", "visit": k, "xyz": [0.1 * k, -0.0, 1e-300], "said": "à\n\u2028"} for k in range(6)]


def filled(path: Path) -> bytes:
    """A journal with all records, and what the file holds."""
    with Journal(path, HEADER) as journal:
        for record in RECORDS[len(journal.records) :]:
            journal.append(record)
        assert journal.records == RECORDS
    return path.read_bytes()


def line(text: str) -> bytes:
    """A line whose checksum is right."""
    return b"%08x %s\n" % (zlib.crc32(text.encode()), text.encode())


def test_records_come_back_as_they_were(tmp_path: Path) -> None:
    content = filled(tmp_path / "j")
    assert content.count(b"\n") == 1 + len(RECORDS)
    with Journal(tmp_path / "j", dict(reversed(HEADER.items()))) as journal:
        assert journal.records == RECORDS
        assert not journal.spoilt
    assert (tmp_path / "j").read_bytes() == content, "looking changes nothing"


def test_one_cut_anywhere_keeps_what_is_whole(tmp_path: Path) -> None:
    """A kill in the middle of a line, the header's too."""
    content, path = filled(tmp_path / "whole"), tmp_path / "cut"
    ends = [k + 1 for k, byte in enumerate(content) if byte == ord("\n")]
    for size in sorted({0, *range(1, len(content), 17), *(end + by for end in ends for by in (-1, 0, 1))}):
        path.write_bytes(content[:size])
        with Journal(path, HEADER) as journal:
            whole = content[: size + 1].count(b"\n")  # a record that lacks its end of line alone is whole
            assert journal.records == RECORDS[: max(whole - 1, 0)]
            assert not journal.spoilt
        assert content.startswith(path.read_bytes())
        assert filled(path) == content


KILLED = """
import os, signal, sys
from qsframework.files import journal
class Half:
    def __init__(self, stream): self.stream = stream
    def __getattr__(self, name): return getattr(self.stream, name)
    def write(self, line):
        self.stream.write(line[: len(line) // 2])
        os.kill(os.getpid(), signal.SIGKILL)
with journal.Journal(sys.argv[1], {"format": "day 1", "plan": "a1b2"}) as open_journal:
    open_journal.append({"number": 1})
    open_journal._stream = Half(open_journal._stream)
    open_journal.append({"number": 2})
"""


def test_a_process_killed_while_it_writes(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "j")])
    assert done.returncode < 0
    assert not (tmp_path / "j").read_bytes().endswith(b"\n")
    with Journal(tmp_path / "j", HEADER) as journal:
        assert journal.records == [{"number": 1}]
        journal.append({"number": 3})
    with Journal(tmp_path / "j", HEADER) as journal:
        assert journal.records == [{"number": 1}, {"number": 3}]
        assert not journal.spoilt


def test_spoilt_lines_are_listed_and_all_others_kept(tmp_path: Path) -> None:
    path = tmp_path / "j"
    filled(path)
    lines = path.read_bytes().splitlines(keepends=True)
    lines[2] = lines[2].replace(b"visit", b"visjt")
    lines[4] = b"\xff\xfe\n"
    lines[5] = b"\n"
    path.write_bytes(b"".join(lines))
    with Journal(path, HEADER) as journal:
        assert journal.spoilt == [3, 5, 6]
        assert journal.records == [RECORDS[k] for k in (0, 2, 5)]
        journal.append({"more": True})
    assert path.read_bytes().startswith(b"".join(lines)), "they stay in the file"


def test_one_byte_spoils_one_record_at_most(tmp_path: Path) -> None:
    """An end of line, the header's and the last one too: what stands on both sides is whole."""
    content, path = filled(tmp_path / "whole"), tmp_path / "j"
    ends = [k for k, byte in enumerate(content) if byte == ord("\n")]
    for place in range(len(content)):
        path.write_bytes(content[:place] + b"\xff" + content[place + 1 :])
        with Journal(path, HEADER) as journal:
            left = [r for r in RECORDS if r in journal.records]
            assert journal.records == left
            hit = sum(end < place for end in ends) - 1
            assert left == [r for k, r in enumerate(RECORDS) if k != hit or place in ends]
        with Journal(path, HEADER) as journal:
            assert journal.records == left


def test_a_journal_that_an_editor_saved(tmp_path: Path) -> None:
    content, path = filled(tmp_path / "whole"), tmp_path / "j"
    for text in (content.replace(b"\n", b"\r\n"), content[content.index(b"\n") + 1 :], content.rstrip()):
        path.write_bytes(text)
        with Journal(path, HEADER) as journal:
            assert journal.records == RECORDS
            assert not journal.spoilt


@pytest.mark.parametrize("text", ["[1]", "null", "{", "[" * 100_000, '{"a": 1} {"b": 2}', "gASVIQAAAAAAAACMBXBvc2l4"])
def test_a_sealed_line_that_is_no_record_is_spoilt(tmp_path: Path, text: str) -> None:
    path = tmp_path / "j"
    with Journal(path, HEADER):
        pass
    head = path.read_bytes()
    path.write_bytes(head + line(text) + line('{"a": 1}'))
    with Journal(path, HEADER) as journal:
        assert journal.spoilt == [2]
        assert journal.records == [{"a": 1}]


def test_two_writers(tmp_path: Path) -> None:
    with Journal(tmp_path / "j", HEADER) as journal:
        with pytest.raises(InputError, match=r"j: another process is writing this file\. Wait"):
            Journal(tmp_path / "j", HEADER)
        journal.append(RECORDS[0])
    with Journal(tmp_path / "j", HEADER) as journal:
        assert journal.records == RECORDS[:1]


def test_the_lock_goes_with_the_process(tmp_path: Path) -> None:
    hold = "import sys, time; from qsframework.files.journal import Journal\n"
    hold += "j = Journal(sys.argv[1], {'format': 'day 1', 'plan': 'a1b2'}); print('here', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", hold, str(tmp_path / "j")], stdout=-1, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "here\n"
        with pytest.raises(InputError, match="another process"):
            Journal(tmp_path / "j", HEADER)
        other.kill()
    with Journal(tmp_path / "j", HEADER) as journal:
        assert journal.records == []


@pytest.mark.parametrize("other", [{"format": "day 2", "plan": "a1b2"}, {"format": "day 1"}, {}])
def test_another_header_is_refused(tmp_path: Path, other: dict[str, str]) -> None:
    content = filled(tmp_path / "j")
    with pytest.raises(InputError, match=r"journal of format day 1, plan a1b2, not of .*Give another file") as caught:
        Journal(tmp_path / "j", other)
    assert caught.value.problems[0].file == str(tmp_path / "j")
    assert (tmp_path / "j").read_bytes() == content
    assert filled(tmp_path / "j") == content, "and it is not locked any more"


@pytest.mark.parametrize("text", ["my notes", "my notes\n", "\n", json.dumps(HEADER) + "\n", "00000000 {}\n"])
def test_a_file_that_is_no_journal_stays(tmp_path: Path, text: str) -> None:
    (tmp_path / "notes.txt").write_text(text)
    with pytest.raises(InputError, match="no journal of qsframework"):
        Journal(tmp_path / "notes.txt", HEADER)
    assert (tmp_path / "notes.txt").read_text() == text


def test_what_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name in ("folder", "pipe"):
        with pytest.raises(InputError, match="no ordinary file"):
            Journal(tmp_path / name, HEADER)
    with pytest.raises(InputError, match="cannot be written: No such file"):
        Journal(tmp_path / "nowhere" / "j", HEADER)
    with Journal(tmp_path / "j", HEADER) as journal:
        with pytest.raises(TypeError):
            journal.append({"what": object()})
        assert journal.records == []
        journal.append({"a": 1})
    with Journal(tmp_path / "j", HEADER) as journal:
        assert journal.records == [{"a": 1}]


LIMITED = """
import resource, signal, sys
from qsframework.errors import InputError
from qsframework.files.journal import Journal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300))
with Journal(sys.argv[1], {"format": "day 1", "plan": "a1b2"}) as journal:
    journal.append({"text": "x" * 150})
    for size in (150, 20):
        try:
            journal.append({"text": "y" * size})
            print("stored")
        except InputError as error:
            print(error)
"""


def test_a_full_disk(tmp_path: Path) -> None:
    """Nothing is left of the record that found no room, and a shorter one still finds it."""
    done = subprocess.run([sys.executable, "-c", LIMITED, str(tmp_path / "j")], capture_output=True, text=True)
    first, second = done.stdout.splitlines()
    assert first == (
        f"{tmp_path / 'j'}: cannot be written: File too large. All earlier records are kept: make room and try again."
    )
    assert second == "stored"
    with Journal(tmp_path / "j", HEADER) as journal:
        assert [r["text"] for r in journal.records] == ["x" * 150, "y" * 20]
        assert not journal.spoilt


def test_a_record_is_on_the_disk_when_it_is_acknowledged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Journal(tmp_path / "j", HEADER) as journal:
        synced: list[bytes] = []
        monkeypatch.setattr(os, "fsync", lambda handle: synced.append((tmp_path / "j").read_bytes()))
        journal.append({"a": 1})
    assert synced == [(tmp_path / "j").read_bytes()]


def test_the_lock_is_that_of_the_system(tmp_path: Path) -> None:
    """Another program can see it, too."""
    with Journal(tmp_path / "j", HEADER), (tmp_path / "j").open() as stream, pytest.raises(BlockingIOError):
        fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
