"""Make the README's picture: the report of a design in headless Chromium. Run: python docs/make_pictures.py"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--virtual-time-budget=15000", "--hide-scrollbars", "--window-size=1060,1500",
)  # fmt: skip


def screenshot(page: Path, picture: Path) -> None:
    """Save what Chromium shows of a page."""
    picture.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run(
            ["chromium", *FLAGS, f"--user-data-dir={profile}", f"--screenshot={picture}", page.as_uri()],
            check=True,
            capture_output=True,
        )


def main() -> None:
    """Design twelve poses for the M-900iB and picture the report."""
    experiment = HERE.parent / "examples" / "m900ib" / "experiment.yaml"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options = ["--output", str(folder / "plan.csv"), "--report", str(folder / "plan.html")]
        subprocess.run(["qsf", "design", str(experiment), *options], check=True, capture_output=True)
        screenshot(folder / "plan.html", HERE / "images" / "report.png")


if __name__ == "__main__":
    main()
