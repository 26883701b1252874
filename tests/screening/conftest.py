from pathlib import Path

import pytest
from clean_tables import write_clean
from independent import Setting
from independent_arm import ARMS


@pytest.fixture(scope="package")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 poses of the heavy arm by the second generator, displacements and positions."""
    root = tmp_path_factory.mktemp("heavy")
    for kind in ("displacements", "positions"):
        write_clean(Setting(ARMS["heavy"], 24, 3, kind, fit="springs", loads="many"), root / kind)
    return root
