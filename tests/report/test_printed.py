"""A report whose name ends in .pdf is printed by a Chromium, or says what is missing."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import pytest
from headless import browser
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.report import printed

POSE = ["stiffness", "fanuc_m900ib", "--pose=0,20,-10,0,40,0", "--load=0,0,-4000"]


@browser
def test_a_report_is_printed_with_its_view_in_3d(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, [*POSE, "--report", str(tmp_path / "s.pdf")])
    assert done.exit_code == 0, done.output
    content = (tmp_path / "s.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    pictures = [int(w) * int(h) for w, h in re.findall(rb"/Width (\d+)\s*/Height (\d+)", content)]
    assert max(pictures, default=0) > 200_000, "the scene is on paper"
    assert [p.name for p in tmp_path.iterdir()] == ["s.pdf"]


@browser
def test_words_and_nothing_from_elsewhere(tmp_path: Path) -> None:
    page = '<!DOCTYPE html><title>t</title><p>stiff</p><img src="https://example.com/a.png">'
    out = printed.printed(page, tmp_path / "x.pdf")
    assert out.count(b"/Type /Page\n") + out.count(b"/Type /Page ") + out.count(b"/Type /Page/") >= 1
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", out, re.S)
    assert streams
    assert any(b"BT" in _plain(s) for s in streams), "text is text"


def _plain(stream: bytes) -> bytes:
    try:
        return zlib.decompress(stream)
    except zlib.error:
        return b""


def test_without_a_browser_it_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(printed, "BROWSERS", ("no-such-browser",))
    with pytest.raises(InputError, match=r"s\.pdf: a PDF is printed by Chromium, and none is installed\. Write \.html"):
        printed.write_page(tmp_path / "s.pdf", "<p>x</p>")
    assert not list(tmp_path.iterdir())
    assert printed.write_page(tmp_path / "s.HTML", "<p>x</p>").read_text() == "<p>x</p>"


def test_a_browser_that_prints_nothing_is_no_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "bin" / "browser"
    fake.parent.mkdir()
    fake.write_text("#!/bin/sh\necho 'cannot open display' >&2\n")
    fake.chmod(0o755)
    monkeypatch.setattr(printed, "BROWSERS", (str(fake),))
    with pytest.raises(InputError, match="printed nothing: cannot open display"):
        printed.write_page(tmp_path / "s.pdf", "<p>x</p>")
    assert not (tmp_path / "s.pdf").exists()
